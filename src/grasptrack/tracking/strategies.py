# SPDX-License-Identifier: Apache-2.0
"""Carriers of a grasp from image to image; those that answer with one of the paper's transfers (Section IV)."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from grasptrack import kernels
from grasptrack.errors import ConditioningError, ObservationError, TransferError
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.images import Grey
from grasptrack.segmentation.outline_detector import MAX_TRIED, OutlineDetector
from grasptrack.snake.active_contour import Snake
from grasptrack.tracking.camera import Beforehand
from grasptrack.tracking.follower import AUTO, Follower, Moved, Registration, StrategyProposal
from grasptrack.tracking.messages import StatusReason
from grasptrack.tracking.numbers import NUMBERS, Numbers
from grasptrack.tracking.pose import Hypothesis
from grasptrack.tracking.redetection import wide_prior
from grasptrack.transfer import rrp, strategy_named
from grasptrack.transfer.alignment import as_similarity, find_alignments
from grasptrack.typing import Floats

UNLIKE = 0.25
"""Outlines that a similarity brings no nearer than this fraction of sqrt(area), rms, are not the same, however they tilt."""
OUTLINE = 64
"""Points of the outer contour that say where to look for it."""


class Carrier(Protocol):
    """Carries one grasp to image after image.

    Attributes:
        name: of the strategy, as results tell it.
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
        strategy: "auto" or the name of one of the paper's.
        grasp, view: contacts and outline of the object.
        grey, time: (H, W) the image and when it was taken, s.
        observer: of the object.
        numbers: the core's, with the risk and the tolerance that are asked for.
        before: what is known of camera and tilt beforehand, as for `Plane`.

    Raises:
        TransferError: the strategy cannot describe the grasp on this outline.
    """
    extractor = None if strategy == AUTO else make_extractor(strategy, grasp, view, grey)
    follower = Follower(grey, view, grasp.contacts, time, observer, numbers, before)
    if extractor is None:
        return Registration(follower)
    return Alone(strategy, follower, extractor, observer)


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

    Raises:
        TransferError: the outline lies on no edge of the image.
    """

    segments = False

    def __init__(self, grasp: Grasp, reference: View, grey: Grey) -> None:
        try:
            self._snake = Snake(reference, grey, contacts=grasp.contacts)
        except ObservationError as error:
            raise TransferError(str(error)) from None
        self._description = rrp.describe(grasp, self._snake.template)

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
        return Carried(rrp.apply(self._description, followed).grasp.contacts, fit.homography, followed)


def make_extractor(strategy: str, grasp: Grasp, view: View, grey: Grey) -> Extractor:
    """What carries a grasp by one of the paper's strategies from the outline in an image to others."""
    return Snakes(grasp, view, grey) if strategy == "rrp" else Silhouettes(strategy, grasp, view)


class Alone:
    """One of the paper's strategies by itself: its contacts are the answer, and the core decides whether they are right.

    Args:
        name: of the strategy.
        follower: of the object.
        extractor: the strategy.
        observer: finds contours; it has been told which object is meant.
    """

    def __init__(self, name: str, follower: Follower, extractor: Extractor, observer: OutlineDetector) -> None:
        self.name, self.follower = name, follower
        self._extractor, self._observer = extractor, observer
        view = follower.target.view
        self._reference = view
        self._missed = 0
        self._outline = np.ascontiguousarray(view.outer.points[:: max(1, len(view.outer) // OUTLINE)])
        self._holes = np.array([c.points.mean(axis=0) for c in view.contours[1:]]).reshape(-1, 2)

    def move(self, grey: Grey, time: float | None) -> Moved:
        """See Carrier."""
        tried: list[StrategyProposal] = []
        refused: list[str] = []
        decision, chosen = self.follower.judge(grey, time, lambda G: self._propose_transfers(grey, G, tried, refused))
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
        covariance = self.follower.pose_covariance(answer.estimate)
        return Moved(answer, chosen.contacts, chosen.homography, chosen.view, covariance)

    def _propose_transfers(
        self, grey: Grey, G: Floats, tried: list[StrategyProposal], refused: list[str]
    ) -> Iterator[list[StrategyProposal]]:
        """Transfers to contours near an expected pose first, then to any that are alike; notes them, and why there is none."""
        target, missed = self.follower.target, self._missed
        expected, P = target.homography(G), wide_prior(target)

        def transfer_proposals(view: View | None, *priors: Floats | None) -> list[StrategyProposal]:
            found = []
            for prior in priors:
                try:
                    carried = self._extractor.carry(grey, view, prior)
                except TransferError as error:
                    refused.append(str(error))
                    continue
                found.append(StrategyProposal(Hypothesis(self.name, target.pose(carried.homography), P), *carried))
            tried.extend(found)
            return found

        if not self._extractor.segments:
            yield transfer_proposals(None, expected if missed else None)
        known: View | None = None
        try:
            outline, holes = apply_homography(expected, self._outline), apply_homography(expected, self._holes)
        except ConditioningError:
            return
        for view in self._observer.views_near(grey, outline, holes):
            known = view
            if self._extractor.segments:
                yield transfer_proposals(view, self._correct_homography(expected, outline, view))
            yield transfer_proposals(view, *self._align_reference(view))
        area = abs(kernels.polygon_moments(outline, np.array([0, len(outline)], dtype=np.int64))[0])
        for views in self._observer.views_anywhere(grey, area, missed, known):
            alike = sorted((self._shape_difference(view), i) for i, view in enumerate(views))
            for unlike, i in alike[:MAX_TRIED]:
                if unlike <= UNLIKE:
                    yield transfer_proposals(views[i], *self._align_reference(views[i]))

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
