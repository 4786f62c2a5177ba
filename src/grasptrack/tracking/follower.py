# SPDX-License-Identifier: Apache-2.0
"""Follows one target through images: hypotheses, estimates, decision, and what is learned from them (Fig. 3)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.kernels import seen_area
from grasptrack.segmentation.outline_detector import OutlineDetector
from grasptrack.tracking.camera import Beforehand
from grasptrack.tracking.decision import (
    LONG,
    SAME_PLACE,
    SUDDEN,
    TURNED,
    Decision,
    Expected,
    ExpectedSize,
    any_of,
    check_strategy_contacts,
    contact_tolerance,
    decide_pose,
    departure_probability,
    max_contact_distance,
    mean_point,
    outline_surprisal,
    pose_evidence,
    texture_evidence,
    wrong_object_probability,
)
from grasptrack.tracking.estimator import (
    Hypothesis,
    PoseEstimate,
    Solutions,
    distinct_hypotheses,
    estimate_pose,
    lead_alike,
    with_origin,
)
from grasptrack.tracking.hypotheses import Predictions, predict_hypotheses
from grasptrack.tracking.mending import Mended, Mender
from grasptrack.tracking.messages import Reason
from grasptrack.tracking.numbers import DEFAULT_RISK, NUMBERS, Numbers
from grasptrack.tracking.redetection import Redetection, best_sighted_pose, place_is_empty
from grasptrack.tracking.selection import make_target
from grasptrack.tracking.state import Look, TrackState, first_state
from grasptrack.tracking.target import Grey, build_pyramid
from grasptrack.typing import Floats

OUTLINE = 60
"""Points of an outline at which it is compared with another."""
ALIKE = 0.5
"""Share of the evidence for the object that something has to show to be just like it."""
AUTO = "auto"
"""Name of the strategy that registers all that is seen."""
REGISTRATION = "registration"
"""Name of what it answers with."""


class Proposal(NamedTuple):
    """What a strategy by itself makes of an image.

    Attributes:
        hypothesis: the pose that it suggests.
        contacts: (k, 2) px where it puts them.
        homography: (3, 3) H_current_reference by which it carried them.
        view: the outline that this was made on.
    """

    hypothesis: Hypothesis
    contacts: Floats
    homography: Floats
    view: View


Proposals = Iterable[Sequence[Proposal]]
"""In the order in which they are to be tried, those that are rivals together."""


class _Expectation(NamedTuple):
    """Of an image that is not looked at yet.

    Attributes:
        levels: its pyramid.
        predictions: hypotheses of continuity.
        expected: where the object should lie.
        presence: prior probability that it is there.
    """

    levels: list[Grey]
    predictions: Predictions
    expected: Expected
    presence: float


class Follower:
    """One target, from its first image on.

    Args:
        grey: (H, W) the first image.
        view: the object's outline in it.
        contacts: (k, 2) px in it.
        time: s, or None.
        hidden: (H, W) nonzero where no image shows anything of the scene.
        numbers: the core's.
        observer: finds outlines of the object, see `Redetection`.
        before: what is known of camera and tilt beforehand, as for `Plane`.

    Attributes:
        target, state: of the object.
        plane: its own, as of the state.
        mended: the share of the first outline that was none, once that was found out; else 0.
    """

    def __init__(
        self,
        grey: Grey,
        view: View,
        contacts: Floats,
        time: float | None = None,
        hidden: Grey | None = None,
        numbers: Numbers = NUMBERS,
        observer: OutlineDetector | None = None,
        before: Beforehand | None = None,
    ) -> None:
        levels = build_pyramid(grey)
        self.numbers = numbers
        self.target = make_target(levels, view, contacts, numbers, hidden)
        self.state: TrackState = first_state(self.target, levels, numbers, before, time)
        self.plane = self.state.plane
        self.redetection = Redetection(self.target, levels, observer, hidden)
        self.mended = 0.0
        self._mended: Mended | None = None
        self._observer, self._hidden, self._mender = observer, hidden, Mender(self.target, levels, hidden)
        if self._has_lookalike(self.state.last):
            self.state.note_lookalike(anywhere=True)

    def update(self, grey: Grey, time: float | None = None) -> Decision:
        """The best pose in the next image (H, W), taken at a time in s, and whether it is believed."""
        levels, predictions, expected, presence = self._predict(grey, time)
        state, target, numbers = self.state, self.target, self.numbers
        first = self.redetection.continued(levels, predictions.first) if state.lost else predictions.first
        solutions = Solutions(target, state, levels, numbers, first)
        decision = decide_pose(state, solutions.found, expected, presence, numbers)
        if decision.accepted and decision.estimate is not None and self._is_sudden(decision.estimate):
            # texture may have slid along itself
            before = decision.estimate
            solutions.add(distinct_hypotheses(target, predictions.second))
            decision = decide_pose(state, solutions.found, expected, presence, numbers)
            if decision.estimate is not None and lead_alike(target, decision.estimate, before):
                state.confirm(decision.estimate, numbers)
        # what this image alone shows to be there is not looked for elsewhere
        e, told = decision.estimate, decision.evidence > -math.log(numbers.risk)
        shown = decision.code == "uncertain" and told and not state.lost and e is not None and not self._is_sudden(e)
        if not decision.accepted and not shown:
            expected = self._if_gone(levels, predictions, expected)
            second = self.redetection.promising(levels, predictions.second)
            solutions.add(second + self.redetection.search(state, levels))
            decision = decide_pose(state, solutions.found, expected, presence, numbers)
        elif decision.accepted and state.lost and departure_probability(expected.steps, numbers) > numbers.risk:
            # what lies at its place may be another one while it lies elsewhere
            solutions.add(self.redetection.search(state, levels))
            decision = decide_pose(state, solutions.found, expected, presence, numbers)
        decision = self._against_slides(decision, solutions, expected, presence)
        decision = self._against_turns(decision, solutions, expected, presence)
        self._learn_from_image(levels, decision, predictions)
        if state.lost:
            state.sight(best_sighted_pose(state, solutions.found, expected.steps, numbers))
        return decision

    def judge(
        self, grey: Grey, time: float | None, propose: Callable[[Floats], Proposals]
    ) -> tuple[Decision, Proposal | None]:
        """As `update`, of what a strategy proposes, against continuity: what is decided of a proposal, and of which.

        Args:
            grey, time: as for `update`.
            propose: the proposals, given the pose (3, 3) that is expected; they are asked for until one is accepted.
        """
        levels, predictions, expected, presence = self._predict(grey, time)
        state, numbers = self.state, self.numbers
        solutions = Solutions(self.target, state, levels, numbers, predictions.first)
        found = answer = decide_pose(state, solutions.found, expected, presence, numbers)
        if not found.accepted:
            expected = self._if_gone(levels, predictions, expected)
        proposed, nearest = list[Proposal](), None
        for batch in propose(state.expected if state.lost else predictions.first[0].G):
            proposed += batch
            solutions.add([proposal.hypothesis for proposal in batch])
            found = answer = decide_pose(state, solutions.found, expected, presence, numbers)
            if found.estimate is None or not proposed:
                continue
            contacts = found.estimate.contacts
            nearest = min(proposed, key=lambda proposal: max_contact_distance(proposal.contacts, contacts))
            found = self._against_turns(found, solutions, expected, presence)
            answer = check_strategy_contacts(found, nearest.contacts)
            if answer.accepted:
                break
        self._learn_from_image(levels, found, predictions)  # whatever the strategy makes of it
        return answer, nearest

    def pose_covariance(self, estimate: PoseEstimate) -> Floats:
        """(8, 8) of the error of a pose in the last image, with what the model does not know."""
        exposed = np.zeros(8)
        exposed[:2] = self.numbers.exposed * min(self.state.moved)
        return np.asarray(estimate.P * self.numbers.inflate**2 + np.diag(exposed**2), dtype=np.float64)

    def _predict(self, grey: Grey, time: float | None) -> _Expectation:
        """What continuity says of the next image, before it is looked at."""
        self._apply_mended_outline()
        state, numbers = self.state, self.numbers
        levels, steps = build_pyramid(grey), state.advance(time)
        predictions = predict_hypotheses(self.target, state, levels, steps, numbers)
        presence = min(max(state.presence * (1.0 - numbers.hazard), numbers.redetected), 1.0 - numbers.hazard)
        return _Expectation(levels, predictions, self._expected_location(predictions), presence)

    def _is_sudden(self, estimate: PoseEstimate) -> bool:
        """Whether the outline lies elsewhere all at once, or much of it is covered, by what may have carried texture along."""
        numbers, usual = self.numbers, max(self.state.strange, self.state.confirmed)
        cover = -numbers.cover_power * math.log1p(-min(estimate.hidden, 0.999))
        noticed = -numbers.cover_power * math.log1p(-numbers.elsewhere)
        return outline_surprisal(estimate, numbers) - usual > SUDDEN or cover - usual > noticed

    def _against_slides(
        self, decision: Decision, solutions: Solutions, expected: Expected, presence: float
    ) -> Decision:
        """A decision against the shifts under which the surface looks like itself.

        They are tried where it may have moved by half of one, or where so much of the surface is missing that it may be seen
        elsewhere.
        """
        state, slides, missing = self.state, self.target.slides, -math.log(self.numbers.risk) / self.numbers.temper
        for _ in slides:  # from one to the next, as far as it slid
            e = decision.estimate
            if e is None:
                break
            moved = self.target.handle.difference(state.last.G, e.G)
            near = float(np.hypot(*moved[:2])) < 0.5 * float(np.hypot(*slides[0]))
            if near and not state.lost and solutions.surface_missing(e) < missing:
                break
            G = [e.G @ np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]]) for x, y in slides]
            P = e.P + self.numbers.predicted**2 * self.target.noise_of_motion
            solutions.add([Hypothesis(e.origin, each, P) for each in G])
            decision = decide_pose(state, solutions.found, expected, presence, self.numbers)
            if (
                decision.estimate is None
                or max_contact_distance(decision.estimate.contacts, e.contacts) < decision.tolerance
            ):
                break
        return decision

    def _against_turns(self, decision: Decision, solutions: Solutions, expected: Expected, presence: float) -> Decision:
        """A decision after a loss against the turns under which the outline fits itself; their estimates are added."""
        state, target, estimates = self.state, self.target, solutions.found

        def decided() -> Decision:
            own = decision.estimate
            for k, e in enumerate(estimates):
                if own is not None and e is not own and self._is_turned(own, e):
                    estimates[k] = with_origin(e, TURNED)
            return decide_pose(state, estimates, expected, presence, self.numbers)

        if target.turns and (state.lost or state.gone or not state.accepted):
            if decision.rival is not None and not decision.accepted:
                decision = decided()
            if decision.estimate is not None and decision.accepted:
                turned = [Hypothesis(TURNED, decision.estimate.G @ T, decision.estimate.P) for T in target.turns]
                solutions.add(turned)
                decision = decided()
        own, rival = decision.estimate, decision.rival
        unknown = target.is_round and not state.accepted
        if unknown and own is not None:  # does its surface tell of another turn?
            against = texture_evidence(own, state.usual, self.numbers) < 0.0
            if against or (solutions.falls_short(own) and own.covered > self.numbers.elsewhere):
                return self._any_turn(decision, own)
        only_turned = own is not None and rival is not None and self._is_turned(own, rival)
        return replace(decision, doubt="ambiguous") if decision.doubt == "other-place" and only_turned else decision

    def _any_turn(self, decision: Decision, own: PoseEstimate) -> Decision:
        """A decision of what is round and may have turned by any angle, few of which leave the contacts there."""
        center = np.array(own.middle)
        radius = float(np.hypot(*(own.contacts - center).T).max())
        share = 2.0 / math.pi * math.asin(min(1.0, 0.5 * decision.tolerance / max(radius, 1e-9)))
        return decision.among(share)

    def _is_turned(self, one: PoseEstimate, other: PoseEstimate) -> bool:
        """Whether two estimates put the contacts at different places, but the outline at the same."""
        allowed = contact_tolerance(one.area, self.numbers)
        if max_contact_distance(one.contacts, other.contacts) <= allowed:
            return False
        a, b = (apply_homography(e.G, self.target.outline) for e in (one, other))
        away = np.hypot(*(a[:: max(1, len(a) // OUTLINE), None] - b[None]).transpose(2, 0, 1)).min(axis=1)
        return bool(away.max() < allowed)

    def _expected_location(self, predictions: Predictions) -> Expected:
        """Where it is expected, how long it may have moved freely, and how large it would be."""
        state, target, numbers = self.state, self.target, self.numbers
        passed = max(1.0, state.steps)
        if not state.lost:
            G, unseen, adrift = predictions.first[0].G, passed, 0.0 if predictions.ground is not None else passed
        elif predictions.ground is not None and state.anchored:
            G, unseen, adrift = predictions.ground, state.unseen + state.wander, 0.0
        else:
            G, unseen, adrift = state.expected, state.unseen + passed, state.adrift + passed
        spread = math.hypot(numbers.stretch_rate, numbers.stretch_rate * unseen, numbers.swell * adrift)
        area = abs(seen_area(G, target.outline))
        size = None
        if area > 0.0:
            (a, b, _), (c, d, _), (e, f, _) = G.tolist()
            size = ExpectedSize(area, (c * f - d * e, b * e - a * f, a * d - b * c), state.slope, spread)
        return Expected(
            target.carried(G), LONG if state.gone else unseen, size, state.lost + passed if state.lost else 0.0
        )

    def _if_gone(self, levels: list[Grey], predictions: Predictions, expected: Expected) -> Expected:
        """What is expected, given whether its place is seen without it."""
        state = self.state
        if not state.gone:
            G = predictions.first[0].G if not state.lost else state.expected
            if state.lost and predictions.ground is not None and state.anchored:
                G = predictions.ground
            state.note_gone(gone=place_is_empty(self.target, state.located, levels, G))
        return expected._replace(steps=LONG) if state.gone else expected

    def _has_lookalike(self, look: Look) -> bool:
        """Whether a look at the object shows something just like it elsewhere."""
        state, numbers = self.state, self.numbers
        own = estimate_pose(self.target, state, look.levels, Hypothesis("at rest", look.G, state.P))
        if own is None:
            return False
        size = math.sqrt(own.area)
        # later on, what covers the object may have an outline like it
        for hypothesis in self.redetection.rivals(look, thorough=not state.accepted):
            other = estimate_pose(self.target, state, look.levels, hypothesis, still=True)
            if other is None or math.dist(other.middle, own.middle) < SAME_PLACE * size:
                continue
            if pose_evidence(other, state.usual, numbers) > ALIKE * pose_evidence(own, state.usual, numbers) > 0.0:
                return True
        return False

    def _shows_both(self, decision: Decision) -> bool:
        """Whether one image shows the object where it was, and something that looks just like it elsewhere."""
        state, one, other = self.state, decision.estimate, decision.rival
        if one is None or other is None or math.dist(one.middle, other.middle) < SAME_PLACE * math.sqrt(one.area):
            return False
        less, more = sorted(pose_evidence(e, state.usual, self.numbers) for e in (one, other))
        if not less > ALIKE * more > 0.0:
            return False
        place = mean_point(self.target.carried(state.expected))
        away = max(one, other, key=lambda e: math.dist(e.middle, place))
        return wrong_object_probability(state, away, 1.0, self.numbers) < 0.5

    def _learn_from_image(self, levels: list[Grey], decision: Decision, predictions: Predictions) -> None:
        state, e = self.state, decision.estimate
        if self._shows_both(decision):
            state.note_lookalike()
        roughly = decision.code == "uncertain" and decision.evidence > 0.0
        if state.lost:  # what is found anew must be the object, wherever its contacts are
            roughly = roughly and any_of(1.0 - decision.presence, decision.exchanged) < self.numbers.risk
        if e is not None and (decision.accepted or roughly):
            state.learn(self.target, levels, decision, e, predictions)
        else:
            alike = not state.lost and (state.lookalike or self._has_lookalike(state.located))
            state.lose(self.target, levels, decision, predictions, lookalike=alike)
        if not self._mender.is_over:
            self._mended = self._mender.look(state, levels, decision)

    def _apply_mended_outline(self) -> None:
        """Once the last image has told that the outline is another."""
        if self._mended is not None:
            self.target, self.mended = self._mended.target, self._mended.share
            self.redetection = Redetection(self.target, self._mended.levels, self._observer, self._hidden)
            self.state.forget_outline(self._mended.usual)
            self.state.plane.mend(self.target)
            self._mended = None


class Moved(NamedTuple):
    """The grasp in an image.

    Attributes:
        decision: whether it is believed, how surely, and by what estimate.
        contacts: (k, 2) px; None where there are none.
        homography: (3, 3) H_current_reference by which they were carried: the strategy's own.
        view: the outline that was laid on the image, or found in it.
        covariance: (8, 8) of the pose's error, with what the model does not know.
        reason: why it is not believed.
    """

    decision: Decision
    contacts: Floats | None = None
    homography: Floats | None = None
    view: View | None = None
    covariance: Floats | None = None
    reason: Reason = Reason()


class Registration:
    """The first view laid on the image: the estimate's own contacts.

    Args:
        follower: of the object.
        risk: probability below which an answer may be wrong.
    """

    name = REGISTRATION

    def __init__(self, follower: Follower, risk: float = DEFAULT_RISK) -> None:
        self.follower, self._risk = follower, risk

    def move(self, grey: Grey, time: float | None) -> Moved:
        """The grasp in the next image (H, W), taken at a time in s."""
        decision, target = self.follower.update(grey, time).at(self._risk), self.follower.target
        estimate = decision.estimate
        if estimate is None or not decision.accepted:
            return Moved(decision, reason=Reason(decision.code, decision.figures))
        H = target.homography(estimate.G)
        view, covariance = target.view.transformed(H), self.follower.pose_covariance(estimate)
        return Moved(decision, estimate.contacts, H, view, covariance)
