# SPDX-License-Identifier: Apache-2.0
"""Carriers of a grasp from image to image; those that answer with one of the paper's transfers (Section IV)."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from grasptrack import kernels
from grasptrack.errors import ConditioningError, GraspTrackError, ObservationError, StrategyError, TransferError
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.images import Grey
from grasptrack.segmentation.outline_detector import MAX_TRIED, OutlineDetector
from grasptrack.snake.active_contour import Snake
from grasptrack.tracking.camera import Beforehand
from grasptrack.tracking.decision import Decision
from grasptrack.tracking.follower import AUTO, Follower, StrategyProposal
from grasptrack.tracking.messages import StatusReason
from grasptrack.tracking.numbers import NUMBERS, Numbers
from grasptrack.tracking.pose import Hypothesis, PoseEstimate, contact_tolerance, share_in_view, similarity_is_enough
from grasptrack.tracking.redetection import wide_prior
from grasptrack.transfer import STRATEGIES, rrp, strategy_named
from grasptrack.transfer.alignment import as_similarity, find_alignments
from grasptrack.transfer.choice import StrategyChoice, TransferContext, choose_strategy
from grasptrack.typing import Floats

PAPER = "paper"
"""Name of the strategy that chooses one of the paper's for each image."""
UNLIKE = 0.25
"""Outlines that a similarity brings no nearer than this fraction of sqrt(area), rms, are not the same, however they tilt."""
OUTLINE = 64
"""Points of the outer contour that say where to look for it."""
REGISTRATION = "registration"
"""Name of what `auto` answers with."""


class Moved(NamedTuple):
    """The grasp in an image.

    Attributes:
        decision: whether it is believed, how surely, and by what estimate.
        contacts: (k, 2) px; None where there are none.
        homography: (3, 3) H_current_reference by which they were carried: the strategy's own.
        view: the outline that was laid on the image, or found in it.
        covariance: (8, 8) of the pose's error, with what the model does not know.
        reason: why it is not believed.
        switch: why another strategy carried them than the last answer's; empty where none did.
    """

    decision: Decision
    contacts: Floats | None = None
    homography: Floats | None = None
    view: View | None = None
    covariance: Floats | None = None
    reason: StatusReason = StatusReason()
    switch: str = ""


class Registration:
    """The first view laid on the image: the estimate's own contacts."""

    name = REGISTRATION

    def __init__(self, follower: Follower) -> None:
        self.follower = follower

    def move(self, grey: Grey, time: float | None) -> Moved:
        """The grasp in the next image (H, W), taken at a time in s."""
        return self.carry_by(self.follower.update(grey, time))

    def carry_by(self, decided: Decision) -> Moved:
        """The grasp by what was decided of an image."""
        decision, target = decided.with_risk(self.follower.risk), self.follower.target
        estimate = decision.estimate
        if estimate is None or not decision.is_accepted:
            return Moved(decision, reason=StatusReason(decision.code, decision.figures))
        H = target.homography(estimate.G)
        view, covariance = target.view.transformed(H), self.follower.pose_covariance(estimate)
        return Moved(decision, estimate.contacts, H, view, covariance)


class Carrier(Protocol):
    """Carries one grasp to image after image.

    Attributes:
        name: of the strategy that gave the last answer, as results tell it.
        follower: knows where the object is.
    """

    name: str
    follower: Follower

    def move(self, grey: Grey, time: float | None) -> Moved:
        """The grasp in the next image (H, W), taken at a time in s."""
        ...


def carrier_for(
    strategy: str,
    grasp: Grasp,
    view: View,
    grey: Grey,
    time: float | None,
    observer: OutlineDetector,
    numbers: Numbers = NUMBERS,
    before: Beforehand | None = None,
) -> Carrier:
    """What carries a grasp from the view in which it was chosen.

    Args:
        strategy: "auto", "paper", or the name of one of the paper's.
        grasp, view: contacts and outline of the object.
        grey, time: (H, W) the image and when it was taken, s.
        observer: of the object.
        numbers: the core's, with the risk and the tolerance that are asked for.
        before: what is known of camera and tilt beforehand, as for `Plane`.

    Raises:
        TransferError: the strategy cannot describe the grasp on this outline.
    """
    if strategy == PAPER:
        extractors, refused = describe_by_all(grasp, view, grey)
        if not extractors:
            raise TransferError("; ".join(refused))
        follower = Follower(grey, view, grasp.contacts, time, observer, numbers, before)
        follower.follow_beside([])
        return Switching(follower, extractors, observer, TransferContext.of(grasp, view, predicted=True))
    extractor = None if strategy == AUTO else make_extractor(strategy, grasp, view, grey)
    follower = Follower(grey, view, grasp.contacts, time, observer, numbers, before)
    follower.follow_beside([])
    if extractor is None:
        return Registration(follower)
    return Alone(strategy, follower, {strategy: extractor}, observer)


# --- the paper's strategies ----------------------------------------------------------------------


class Carried(NamedTuple):
    """A transfer in an image: (k, 2) px contacts, H_current_reference (3, 3), and the outline that it was made on."""

    contacts: Floats
    homography: Floats
    view: View


class Extractor(Protocol):
    """One strategy: how it gets its contour, and what it remembers of the reference.

    Attributes:
        segments: it is given contours; else it follows one.
    """

    segments: bool

    def carry(self, grey: Grey, view: View | None, prior: Floats | None) -> Carried:
        """Transfer the grasp.

        Args:
            grey: (H, W).
            view: a contour in it, for those who take one.
            prior: (3, 3) H_current_reference as expected; None for what has an expectation of its own.

        Raises:
            TransferError: with the reason.
        """
        ...


class Silhouettes:
    """Grasp line and homography: the contour is segmented anew in every image.

    Raises:
        TransferError: the reference cannot be described this way.
    """

    segments = True

    def __init__(self, name: str, grasp: Grasp, reference: View) -> None:
        self._name = name
        self._strategy = strategy_named(name)
        self._description: Any = self._strategy.describe(grasp, reference)

    def __getstate__(self) -> dict[str, Any]:
        """The strategy may be a module, which has no copy."""
        return {"_name": self._name, "_description": self._description}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Find the strategy again by its name."""
        self.__dict__.update(state, _strategy=strategy_named(state["_name"]))

    def carry(self, grey: Grey, view: View | None, prior: Floats | None) -> Carried:
        """See Extractor."""
        if view is None:
            raise TransferError("the object was not found in this image")
        found = self._strategy.apply(self._description, view, prior)
        if found.homography is None:
            raise TransferError("the strategy does not tell how the object moved")
        return Carried(found.grasp.contacts, found.homography, view)


class Snakes:
    """RRP: a snake follows the outline as a whole, and the contacts are places on it (Section IV-A).

    Args:
        grasp, reference, grey: contacts, outline and image (H, W) of the first view.
        exact: contacts keep their distance from the snake's outline there, which a spline rounds: other strategies carry the
            very same points.

    Raises:
        TransferError: the outline lies on no edge of the image.
    """

    segments = False

    def __init__(self, grasp: Grasp, reference: View, grey: Grey, *, exact: bool = False) -> None:
        try:
            self._snake = Snake(reference, grey, contacts=grasp.contacts)
        except ObservationError as error:
            raise TransferError(str(error)) from None
        self._description = rrp.describe(grasp, self._snake.template)
        placed = rrp.apply(self._description, self._snake.template).grasp.contacts
        self._beside = grasp.contacts - placed if exact else np.zeros_like(placed)

    def carry(self, grey: Grey, view: View | None, prior: Floats | None) -> Carried:
        """See Extractor; the view is not looked at. Without a prior the snake's own filter predicts."""
        if prior is None:
            self._snake.predict()
        else:
            self._snake.reseed(prior)
        fit = self._snake.update(grey)
        if not fit.ok:
            raise TransferError(fit.reason)
        followed = self._snake.view(fit)
        contacts = rrp.apply(self._description, followed).grasp.contacts + self._beside @ fit.homography[:2, :2].T
        return Carried(contacts, fit.homography, followed)


def make_extractor(strategy: str, grasp: Grasp, view: View, grey: Grey, *, exact: bool = False) -> Extractor:
    """What carries a grasp by one of the paper's strategies from the outline in an image to others; `exact` as of `Snakes`."""
    return Snakes(grasp, view, grey, exact=exact) if strategy == "rrp" else Silhouettes(strategy, grasp, view)


def describe_by_all(grasp: Grasp, view: View, grey: Grey) -> tuple[dict[str, Extractor], list[str]]:
    """What carries a grasp from an image (H, W), by the name of each of the paper's strategies, and why the others do not."""
    found, refused = dict[str, Extractor](), list[str]()
    for name in STRATEGIES:
        try:
            found[name] = make_extractor(name, grasp, view, grey, exact=True)
        except GraspTrackError as error:  # as `TransferContext.of` has it
            refused.append(f"{name}: {error}")
    return found, refused


class Alone:
    """One of the paper's strategies by itself: its contacts are the answer, and the core decides whether they are right.

    Args:
        name: of the strategy.
        follower: of the object.
        extractors: it by its name, described from the first view.
        observer: finds contours; it has been told which object is meant.
    """

    def __init__(
        self, name: str, follower: Follower, extractors: dict[str, Extractor], observer: OutlineDetector
    ) -> None:
        self.name, self.follower = name, follower
        self._observer, self._missed = observer, 0
        self._reasons: dict[str, str] = {}  # why each strategy was asked of the last image
        self._describe(extractors, follower.target.view, None)

    def _describe(self, extractors: dict[str, Extractor], view: View, H: Floats | None) -> None:
        """Carry on from the image in which this is the outline: H (3, 3) leads there from the first one, None is none."""
        self._extractors, self._reference, self._base = extractors, view, H
        self._outline = np.ascontiguousarray(view.outer.points[:: max(1, len(view.outer) // OUTLINE)])
        self._holes = np.array([c.points.mean(axis=0) for c in view.contours[1:]]).reshape(-1, 2)

    def move(self, grey: Grey, time: float | None) -> Moved:
        """See Carrier."""
        tried: list[StrategyProposal] = []
        refused: list[str] = []
        decision, chosen = self.follower.judge(
            grey, time, lambda G, found: self._propose_transfers(grey, G, self._order(grey, G, found), tried, refused)
        )
        if chosen is None:  # of its contacts nothing can be said
            self._missed += 1
            decision = replace(decision, probability_off=1.0, doubt=decision.code or "no-transfer")
            why = StatusReason(decision.doubt, decision.figures)
            return Moved(
                decision, reason=why if tried or not refused else StatusReason("no-transfer", detail=refused[0])
            )
        if decision.is_accepted:
            self._missed = 0
            self._observer.learn_levels(chosen.view)
        else:
            self._missed += 1
        answer = decision.with_risk(self.follower.risk)
        if answer.estimate is None or not answer.is_accepted:
            return Moved(answer, reason=StatusReason(answer.code, answer.figures))
        covariance, before = self.follower.pose_covariance(answer.estimate), self.name
        self.name = chosen.hypothesis.origin
        switch = "" if self.name == before else f"{before} to {self.name}: {self._reasons[self.name]}"
        return Moved(answer, chosen.contacts, chosen.homography, chosen.view, covariance, switch=switch)

    def _expected(self, G: Floats) -> Floats:
        """(3, 3) from the image in which the strategies describe the grasp to one that shows the object through G (3, 3)."""
        H = self.follower.target.homography(G)
        return H if self._base is None else H @ np.linalg.inv(self._base)

    def _order(self, grey: Grey, G: Floats, found: Decision) -> Iterator[str]:
        """Strategies to try in an image (H, W), given the pose (3, 3) that is expected and what was found without them."""
        yield from self._extractors

    def _propose_transfers(
        self, grey: Grey, G: Floats, order: Iterator[str], tried: list[StrategyProposal], refused: list[str]
    ) -> Iterator[list[StrategyProposal]]:
        """Transfers to contours near an expected pose first, then to any that are alike; notes them, and why there is none."""
        target, missed = self.follower.target, self._missed
        expected, P = self._expected(G), wide_prior(target)

        def transfer_proposals(name: str, view: View | None, *priors: Floats | None) -> list[StrategyProposal]:
            found = []
            for prior in priors:
                try:
                    carried = self._extractors[name].carry(grey, view, prior)
                except TransferError as error:
                    refused.append(str(error))
                    continue
                if self._base is not None:
                    carried = carried._replace(homography=carried.homography @ self._base)
                found.append(StrategyProposal(Hypothesis(name, target.pose(carried.homography), P), *carried))
            tried.extend(found)
            return found

        seen: list[View] = []
        near: Iterator[View] = iter(())
        try:
            outline, holes = apply_homography(expected, self._outline), apply_homography(expected, self._holes)
            near = self._observer.views_near(grey, outline, holes)
        except ConditioningError:
            outline = np.empty((0, 2))

        def near_views() -> Iterator[View]:
            yield from tuple(seen)
            for view in near:
                seen.append(view)
                yield view

        asked, following = list[str](), list[str]()
        for name in order:
            asked.append(name)
            if not self._extractors[name].segments:
                following.append(name)
                yield transfer_proposals(name, None, expected if missed or name != self.name else None)
                continue
            for view in near_views():
                yield transfer_proposals(name, view, self._correct_homography(expected, outline, view))
                yield transfer_proposals(name, view, *self._align_reference(view))
        if not len(outline):
            return
        for view in near_views() if following else ():
            for name in following:
                yield transfer_proposals(name, view, *self._align_reference(view))
        area = abs(kernels.polygon_moments(outline, np.array([0, len(outline)], dtype=np.int64))[0])
        for views in self._observer.views_anywhere(grey, area, missed, seen[-1] if seen else None):
            alike = sorted((self._shape_difference(view), i) for i, view in enumerate(views))
            for unlike, i in alike[:MAX_TRIED]:
                for name in asked if unlike <= UNLIKE else ():
                    yield transfer_proposals(name, views[i], *self._align_reference(views[i]))

    def _correct_homography(self, H: Floats, outline: Floats, view: View) -> Floats:
        """A predicted homography moved and scaled so that the outline's centroid and area are those observed."""
        if view.is_clipped or self._reference.is_clipped:
            return H
        area, x, y, *_ = kernels.polygon_moments(view.outer.points, view.outer.offsets)
        wanted, u, v, *_ = kernels.polygon_moments(outline, np.array([0, len(outline)], dtype=np.int64))
        s = math.sqrt(area / abs(wanted))
        return np.array([[s, 0.0, x - s * u], [0.0, s, y - s * v], [0.0, 0.0, 1.0]]) @ H

    def _align_reference(self, view: View) -> list[Floats]:
        """(3, 3) each, the similarities that lay the reference on a contour; several where it is symmetric."""
        first, second = self._reference.outer, view.outer
        if self._reference.is_clipped or view.is_clipped:
            return []
        return [as_similarity(alignment, first, second) for alignment in find_alignments(first, second)]

    def _shape_difference(self, view: View) -> float:
        """How far a contour is from the reference's under the best similarity, rms in sqrt(area)."""
        if view.is_clipped or self._reference.is_clipped:
            return math.inf
        found = find_alignments(self._reference.outer, view.outer)
        return found[0].residual / math.sqrt(view.outer.area) if found else 0.0


def choices_in_turn(context: TransferContext) -> Iterator[StrategyChoice]:
    """What `choose_strategy` takes, then what it takes where that fails: its outline is not tracked, or the motion another.

    Each strategy comes once, with the reason why it is its turn. The last ones may not suffice: whether an answer is right is
    not decided here.
    """
    untracked, another = {"tracked": False}, {"dof": 4 if context.dof > 4 else 6}
    before: list[str] = []
    for change in ({}, untracked, another, another | untracked):
        try:
            name, reason = choose_strategy(replace(context, **change))
        except StrategyError:
            continue
        if name not in before:
            failed = f"no answer of {' or '.join(before)} is believed"
            yield StrategyChoice(name, failed if before else reason or "it suffices, and costs least")
            before.append(name)


class Switching(Alone):
    """The paper's strategies in turn: in each image the one that `choose_strategy` takes (Sections III and V).

    All of them describe the grasp from one view, so that a switch carries no error of the images between: whichever strategy
    answers, it is the physical grasp of that view. It is the first one. Where the border cuts the object there, it is the first
    later one that shows it whole and in which the grasp was believed; the contacts are then where the follower has them, which
    lays the first view on every image and knows no chain either.

    What the choice hangs on is seen anew in each image: the outline is whole where it is expected within the image, tracked
    where there is a snake, and the motion is of 4 DoF while `similarity_is_enough`. The follower predicts every image. Time
    decides by the order of the costs. A strategy that refuses an image, or whose answer is not believed there, gives way to the
    next of `choices_in_turn`.

    Args:
        follower, extractors, observer: as of `Alone`.
        context: of the grasp in the first view.
    """

    def __init__(
        self,
        follower: Follower,
        extractors: dict[str, Extractor],
        observer: OutlineDetector,
        context: TransferContext,
    ) -> None:
        self._context = replace(context, tracked="rrp" in extractors)
        super().__init__(choose_strategy(self._context).strategy, follower, extractors, observer)

    def move(self, grey: Grey, time: float | None) -> Moved:
        """See Carrier."""
        moved = super().move(grey, time)
        if moved.contacts is not None and moved.decision.estimate is not None and self._reference.is_clipped:
            self._describe_whole(grey, moved.decision.estimate)
        return moved

    def _describe_whole(self, grey: Grey, estimate: PoseEstimate) -> None:
        """Describe the grasp anew where an outline in an image (H, W) is whole and holds what the first view shows of it."""
        H = self.follower.target.homography(estimate.G)
        if share_in_view(H, self._outline, grey) < 1.0:
            return
        allowed, outer = contact_tolerance(estimate.area, self.follower.state.numbers), self._reference.outer
        cut = np.zeros(len(outer), np.bool_) if outer.clipped is None else outer.clipped
        shown = apply_homography(H, outer.points[~cut])
        for view in (v for views in self._observer.views_anywhere(grey, estimate.area, 0) for v in views):
            off = kernels.project_to_contour(view.outer.points, view.outer.offsets, shown)[:, 2]
            grasp = Grasp(estimate.contacts)
            if view.is_clipped or not off.max() < allowed:
                continue
            extractors, _ = describe_by_all(grasp, view, grey)
            if extractors:
                self._describe(extractors, view, H)
                self._context = TransferContext.of(grasp, view, tracked="rrp" in extractors, predicted=True)
                return

    def _order(self, grey: Grey, G: Floats, found: Decision) -> Iterator[str]:
        """See Alone."""
        target, e, context = self.follower.target, found.estimate, self._context
        if e is not None and found.is_accepted:
            start = target.A if self._base is None else target.pose(self._base)
            enough = similarity_is_enough(target, start, e.G, self.follower.pose_covariance(e))
            context = self._context = replace(context, dof=4 if enough else 6)
        if share_in_view(self._expected(G), self._outline, grey) < 1.0:
            context = replace(context, whole=False)
        self._reasons = {}
        for name, reason in choices_in_turn(context):
            self._reasons[name] = reason
            yield name
