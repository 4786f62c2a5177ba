# SPDX-License-Identifier: Apache-2.0
"""Follows one target through images: hypotheses, estimates, decision, and what is learned from them (Fig. 3)."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.segmentation.outline_detector import OutlineDetector
from grasptrack.segmentation.work import WorkBudget
from grasptrack.tracking.bodies import ContactBodies
from grasptrack.tracking.camera import Beforehand
from grasptrack.tracking.decision import (
    ANYWHERE_STEPS,
    Decision,
    Expected,
    ExpectedSize,
    any_of,
    check_strategy_contacts,
    place_prior,
)
from grasptrack.tracking.emptiness import against_bare_contacts, has_gone_from
from grasptrack.tracking.equals import NOTICED, Way, log_density
from grasptrack.tracking.estimator import first_state
from grasptrack.tracking.evidence import (
    SUDDEN,
    departure_probability,
    outline_surprisal,
    pose_evidence,
    power_surprisal,
    texture_evidence,
)
from grasptrack.tracking.fixed_patches import forget_fixed_patches
from grasptrack.tracking.hypotheses import Predictions, predict_hypotheses, surface_goes_on
from grasptrack.tracking.learning import learn, lose
from grasptrack.tracking.numbers import DEFAULT_RISK, NUMBERS, Numbers
from grasptrack.tracking.patches import self_similar_shifts
from grasptrack.tracking.pose import (
    CONTINUOUS,
    TRIED,
    TURNED,
    Hypothesis,
    PoseEstimate,
    changed_estimate,
    contact_tolerance,
    distinct_hypotheses,
    is_at,
    lead_alike,
    max_contact_distance,
    mean_point,
)
from grasptrack.tracking.redetection import Redetection, best_sighted_pose
from grasptrack.tracking.rivals import Rivals
from grasptrack.tracking.selection import make_target
from grasptrack.tracking.solutions import Solutions
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.surroundings import Surroundings
from grasptrack.tracking.target import Grey, Target, build_pyramid
from grasptrack.typing import Floats

OUTLINE_POINTS = 60
"""Points of an outline at which it is compared with another."""
AUTO = "auto"
"""Name of the strategy that registers all that is seen."""


class StrategyProposal(NamedTuple):
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


Proposals = Iterable[Sequence[StrategyProposal]]
"""In the order in which they are to be tried, those that are rivals together."""


class Sight(NamedTuple):
    """What an image shows of a target, before anything is learned from it.

    Attributes:
        levels: the image's pyramid.
        predictions: where continuity has the object.
        solutions: all that was tried.
        decision: the best of it.
    """

    levels: list[Grey]
    predictions: Predictions
    solutions: Solutions
    decision: Decision


class Follower:
    """One target, from its first image on.

    Args:
        grey: (H, W) the first image.
        view: the object's outline in it.
        contacts: (k, 2) px in it.
        time: s, or None.
        observer: finds outlines of the object, and knows where no image shows anything of the scene; see `Redetection`.
        numbers: the core's, with the risk and the tolerance that are asked for.
        before: what is known of camera and tilt beforehand, as for `Plane`.

    Attributes:
        state: of the object.
        redetection: finds it after a loss.
        risk: that is asked for; images teach only what is sure at the default risk too.
        search_ms: work that the search for it may do in an image, as `WorkBudget` counts it; None is no bound. What speaks
            against an answer is looked for without one.
        slides: (n, 2) work px, shifts under which the surface looks like itself, the nearest first.
    """

    def __init__(
        self,
        grey: Grey,
        view: View,
        contacts: Floats,
        time: float | None = None,
        observer: OutlineDetector | None = None,
        numbers: Numbers = NUMBERS,
        before: Beforehand | None = None,
    ) -> None:
        levels = build_pyramid(grey)
        self.risk, hidden = numbers.risk, None if observer is None else observer.hidden
        target = make_target(levels, view, contacts, numbers.for_learning(DEFAULT_RISK), hidden)
        if before is not None and before.any_turn:
            target = replace(target, turns=(), any_turn=True)
        self.slides = self_similar_shifts(*target.surface, target.noise, target.size, target.numbers)
        self.state = first_state(target, levels, before, time)
        self.redetection = Redetection(target, levels, observer, hidden)
        self.rivals = Rivals(self.state, self.redetection)
        self._surroundings = Surroundings(self.state)
        self._bodies = ContactBodies(self.state)
        self.search_ms: float | None = None
        self._alone = True

    def follow_beside(self, others: list[TrackState], *, alone: bool = True) -> None:
        """Look for equals of it in its first image, before the next one.

        What of them is followed too is no danger to it by itself: what all of them did is decided together. Where it is not
        alone parts come and go, and one that is lost may not be the one that is found.
        """
        self.rivals.followed, self._alone = others, alone
        if not self.state.accepted and not self.state.lost:
            # only now it is known which of its first image are followed
            self.rivals.forget_equals()
            self.state.lookalike = self.rivals.shows_equals(self.state.located) and not others

    @property
    def target(self) -> Target:
        """What is followed."""
        return self.state.target

    def update(self, grey: Grey, time: float | None = None) -> Decision:
        """The best pose in the next image (H, W), taken at a time in s, and whether it is believed."""
        return self.conclude(self.look_at(build_pyramid(grey), time))

    def look_at(
        self, levels: list[Grey], time: float | None = None, is_taken: Callable[[PoseEstimate], bool] | None = None
    ) -> Sight:
        """What the next image shows; `conclude` has to follow.

        Args:
            levels: the image's pyramid.
            time: s, at which it was taken.
            is_taken: whether another object surely lies where an estimate has this one.
        """
        predictions, expected = self._predict_next(levels, time)
        state, target, risk = self.state, self.target, self.state.numbers.risk
        first = self.redetection.worth_solving(levels, predictions.first) if state.lost else predictions.first
        solutions = Solutions(state, levels, expected, first, predictions.ground, is_taken)
        decision = solutions.decide_among()
        if decision.is_accepted and decision.estimate is not None and self._is_sudden(decision.estimate):
            # texture may have slid along itself
            before = decision.estimate
            solutions.add(distinct_hypotheses(target, predictions.second))
            decision = solutions.decide_among()
            if decision.estimate is not None and lead_alike(target, decision.estimate, before):
                state.confirmed = outline_surprisal(decision.estimate, target.numbers)
        # what this image alone shows to be there is not looked for elsewhere
        e, told = decision.estimate, decision.evidence > -math.log(risk)
        shown = decision.code == "uncertain" and told and not state.lost and e is not None and not self._is_sudden(e)
        if not decision.is_accepted and not shown:
            self._look_if_gone(levels, predictions, solutions)
            second = self.redetection.samples.promising(levels[0], predictions.second)
            solutions.add(second + self.redetection.search_image(state, levels, WorkBudget(self.search_ms)))
            decision = solutions.decide_among()
        elif decision.is_accepted and state.lost and departure_probability(expected.steps, target.numbers) > risk:
            # what lies at its place may be another one while it lies elsewhere
            solutions.add(self.redetection.search_image(state, levels, WorkBudget()))
            decision = solutions.decide_among()
        elif decision.is_accepted and e is not None and not state.lost and solutions.may_have_slid(e):
            decision = self._against_sliding(decision, e, levels, solutions)
        decision, predictions = self._among_surroundings(decision, levels, predictions, solutions)
        decision = self._against_slides(decision, solutions)
        decision = self._against_turns(decision, solutions, predictions)
        return Sight(
            levels, predictions, solutions, self._against_rivals(decision, levels, predictions, solutions.expected)
        )

    def reconsider(self, sight: Sight, is_taken: Callable[[PoseEstimate], bool], way: Floats | None) -> Sight:
        """The same of what lies where no other object is found, and goes with what went a way (2,) px, if any did.

        `is_taken` is as of `look_at`.
        """
        levels, predictions, solutions, _ = sight
        solutions.found = [e for e in solutions.found if not is_taken(e)]
        if way is not None:
            contacts = self.target.carried_contacts(self.state.last.G) + way
            solutions.expected = solutions.expected._replace(contacts=contacts)
        decision = self._against_turns(solutions.decide_among(), solutions, predictions)
        return sight._replace(decision=self._against_rivals(decision, levels, predictions, solutions.expected))

    def conclude(self, sight: Sight, alias: float = 0.0) -> Decision:
        """What is decided of an image in the end, and learned from it; `alias` as of `Decision`, by what else is followed."""
        state, solutions = self.state, sight.solutions
        decision = sight.decision.with_alias(alias) if alias else sight.decision
        self._learn_from_image(sight.levels, decision, sight.predictions)
        state.learn_shutter(solutions.sharp_gain)
        if state.lost:
            state.sighted = best_sighted_pose(state, solutions.found, solutions.expected.steps)
        return decision

    def judge(
        self, grey: Grey, time: float | None, propose: Callable[[Floats, Decision], Proposals]
    ) -> tuple[Decision, StrategyProposal | None]:
        """As `update`, of what a strategy proposes, against continuity: what is decided of a proposal, and of which.

        Args:
            grey, time: as for `update`.
            propose: the proposals, given the pose (3, 3) that is expected, and what is decided without them; they are asked for
                until one is accepted.
        """
        levels = build_pyramid(grey)
        predictions, expected = self._predict_next(levels, time)
        state = self.state
        solutions = Solutions(state, levels, expected, predictions.first, predictions.ground)
        found = answer = solutions.decide_among()
        if not found.is_accepted:
            self._look_if_gone(levels, predictions, solutions)
        proposed, nearest = list[StrategyProposal](), None
        for batch in propose(state.expected if state.lost else predictions.first[0].G, found):
            proposed += batch
            solutions.add([proposal.hypothesis for proposal in batch])
            found = answer = solutions.decide_among()
            if found.estimate is None or not proposed:
                continue
            contacts = found.estimate.contacts
            nearest = min(proposed, key=lambda proposal: max_contact_distance(proposal.contacts, contacts))
            found = self._against_turns(found, solutions, predictions)
            found = self._against_rivals(found, levels, predictions, solutions.expected)
            answer = check_strategy_contacts(found, nearest.contacts)
            if answer.is_accepted:
                break
        self._learn_from_image(levels, found, predictions)  # whatever the strategy makes of it
        return answer, nearest

    def pose_covariance(self, estimate: PoseEstimate) -> Floats:
        """(8, 8) of the error of a pose in the last image, with what the model does not know."""
        exposed, numbers = np.zeros(8), self.state.numbers
        exposed[:2] = numbers.exposed * min(self.state.moved)
        return np.asarray(estimate.P * numbers.inflate**2 + np.diag(exposed**2), dtype=np.float64)

    def _predict_next(self, levels: list[Grey], time: float | None) -> tuple[Predictions, Expected]:
        """What continuity says of the next image, of which this is the pyramid, before it is looked at."""
        forget_fixed_patches(self.state)
        self.state.advance(time)
        predictions = predict_hypotheses(self.state, levels)
        goes_on = None if self.state.lost else partial(surface_goes_on, self.state, levels)
        return predictions, self._expected_location(predictions)._replace(goes_on=goes_on)

    def _among_surroundings(
        self, decision: Decision, levels: list[Grey], predictions: Predictions, solutions: Solutions
    ) -> tuple[Decision, Predictions]:
        """A decision by what surrounded the object where ground and object were lost together, and what is predicted then."""
        state = self.state
        e = decision.estimate
        jumped = bool(state.lost) or (e is not None and e.origin not in (*CONTINUOUS, TURNED, TRIED))
        followed = predictions.background if state.anchored else None
        told = -math.log(state.numbers.risk)
        contradicted = not decision.is_accepted and any(pose_evidence(state, each) > told for each in solutions.found)
        # what left its place may lie anywhere
        if not jumped or (followed is not None and (state.gone or not (state.lost and contradicted))):
            return decision, predictions
        # of ground that is followed from image to image errors add up, and it may be lost for what looks like it
        guess = self.redetection.find_ground(state, levels) if followed is None else followed
        ground = self._surroundings.find_ground(levels, solutions.found, guess)
        if ground is None:
            return decision, predictions
        predictions = predictions._replace(background=ground, anew=True)
        known = decision.is_accepted and e is not None and is_at(e, mean_point(self.target.carried_contacts(ground)))
        if not known:  # what surrounds it need not lie in its plane
            state.gone = has_gone_from(state, ground, levels, predictions.even)  # where that was, was not known
            solutions.expected = self._expected_location(predictions)
        before = len(solutions.found)
        solutions.add([Hypothesis("background", ground, state.P + self.target.noise_of_motion)])
        if known and e is not None:  # what shows the same is no second answer
            new, limit = solutions.found[before:], decision.tolerance
            solutions.found[before:] = [o for o in new if max_contact_distance(o.contacts, e.contacts) > limit]
        return solutions.decide_among(), predictions

    def expected_way(self, sight: Sight) -> Way:
        """Where it would be in an image, had it moved as is expected."""
        pose = self._expected_pose(sight.predictions)
        return self.rivals.expected_way(sight.predictions, pose, sight.solutions.expected.steps)

    def _is_sudden(self, estimate: PoseEstimate) -> bool:
        """Whether the outline lies elsewhere all at once, or much of it is hidden, by what may have carried texture along; or
        the second image of all contradicts the surface of the first one, so that it turned along its outline or is another."""
        if not self.state.accepted and texture_evidence(self.state, estimate) < 0.0:
            return True
        numbers, usual = self.state.numbers, max(self.state.strange, self.state.confirmed)
        cover = power_surprisal(estimate.hidden, numbers.cover_power)
        noticed = power_surprisal(numbers.elsewhere, numbers.cover_power)
        return outline_surprisal(estimate, numbers) - usual > SUDDEN or cover - usual > noticed

    def _against_sliding(
        self, decision: Decision, e: PoseEstimate, levels: list[Grey], solutions: Solutions
    ) -> Decision:
        """A decision, or what a search about the place shows instead, if the surface falls short or its motion failed.

        Of answers so near that both may be right noise alone makes the one that was searched for look better.
        """
        before = len(solutions.found)
        solutions.add_around(self.redetection.search_image(self.state, levels, WorkBudget()))
        searched = solutions.decide_among()
        other = searched.estimate
        if other is None or max_contact_distance(other.contacts, e.contacts) > decision.tolerance:
            return searched
        gain = pose_evidence(self.state, other) - pose_evidence(self.state, e)
        if solutions.falls_short(e) or gain > -math.log(self.state.numbers.witness_fails):
            return searched
        del solutions.found[before:]
        return decision

    def _against_slides(self, decision: Decision, solutions: Solutions) -> Decision:
        """A decision against the shifts under which the surface looks like itself.

        They are tried where it may have moved by half of one, or where so much of the surface is missing that it may be seen
        elsewhere.
        """
        state, target, numbers = self.state, self.target, self.state.numbers
        missing = -math.log(numbers.risk) / numbers.temper
        for _ in self.slides:  # from one to the next, as far as it slid
            e = decision.estimate
            if e is None:
                break
            moved = target.pose_difference(state.last.G, e.G)
            near = float(np.hypot(*moved[:2])) < 0.5 * float(np.hypot(*self.slides[0]))
            if near and not state.lost and solutions.missing_texture(e) < missing:
                break
            G = [e.G @ np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]]) for x, y in self.slides]
            P = e.P + numbers.predicted**2 * target.noise_of_motion
            solutions.add([Hypothesis(e.origin, each, P) for each in G])
            decision = solutions.decide_among()
            own = decision.estimate
            if own is None or max_contact_distance(own.contacts, e.contacts) < decision.tolerance:
                break
        return decision

    def _against_turns(self, decision: Decision, solutions: Solutions, predictions: Predictions) -> Decision:
        """A decision against the turns under which the outline fits itself; their estimates are added.

        They are tried after a loss, and where its motion, or what is missing of its surface, makes one of them possible.
        """
        state, target, numbers, estimates = self.state, self.target, self.state.numbers, solutions.found

        def decide_turned() -> Decision:
            own = decision.estimate
            for k, e in enumerate(estimates):
                if own is not None and e is not own and self._is_turned(own, e):
                    estimates[k] = changed_estimate(e, origin=TURNED)
            return solutions.decide_among()

        own = decision.estimate
        asked = bool(state.lost or state.gone or (target.is_round and not state.accepted))
        if target.turns and not asked and not target.is_round and decision.is_accepted and own is not None:
            density = partial(log_density, state, even=predictions.even, background=predictions.background)
            prior = place_prior(own, solutions.expected, numbers) - density(own.G, own)
            turned = max(density(own.G @ T, own) for T in target.turns) - density(own.G, own)
            most = numbers.temper * max(0.0, solutions.missing_texture(own))  # that its surface can say for a turn
            if asked := turned + most > math.log(NOTICED * numbers.risk / len(target.turns)):
                solutions.expected = solutions.expected._replace(turned=lambda e: prior + density(e.G, e))
        if target.turns and asked:
            if decision.rival is not None and not decision.is_accepted:
                decision = decide_turned()
            if decision.estimate is not None and decision.is_accepted:
                solutions.add([Hypothesis(TRIED, decision.estimate.G @ T, decision.estimate.P) for T in target.turns])
                decision = decide_turned()
        own, rival = decision.estimate, decision.rival
        if target.is_round and not state.accepted and own is not None:  # does its surface tell of another turn?
            against = texture_evidence(state, own) < 0.0
            if against or (solutions.falls_short(own) and own.covered > numbers.elsewhere):
                return self._any_turn(decision, own)
        only_turned = own is not None and rival is not None and self._is_turned(own, rival)
        return replace(decision, doubt="ambiguous") if decision.doubt == "other-place" and only_turned else decision

    def _against_rivals(
        self, decision: Decision, levels: list[Grey], predictions: Predictions, expected: Expected
    ) -> Decision:
        """A decision against all that may be taken for the object."""
        decision = self._bodies.against_moved_contacts(against_bare_contacts(decision, self.state, levels), levels)
        decision = self.rivals.against_other_sizes(decision, levels)
        decision = self.rivals.against_other_looks(decision, levels, predictions)
        return self.rivals.against_equals(
            decision, levels, predictions, self._expected_pose(predictions), expected.steps
        )

    def _any_turn(self, decision: Decision, own: PoseEstimate) -> Decision:
        """A decision of what is round and may have turned by any angle, few of which leave the contacts there."""
        center = np.array(own.middle)
        radius = float(np.hypot(*(own.contacts - center).T).max())
        share = 2.0 / math.pi * math.asin(min(1.0, 0.5 * decision.tolerance / max(radius, 1e-9)))
        return decision.among_several(share)

    def _is_turned(self, one: PoseEstimate, other: PoseEstimate) -> bool:
        """Whether two estimates put the contacts at different places, but outline and holes at the same."""
        allowed = contact_tolerance(one.area, self.state.numbers)
        if max_contact_distance(one.contacts, other.contacts) <= allowed:
            return False
        a, b = (apply_homography(e.G, self.target.points) for e in (one, other))
        away = np.hypot(*(a[:: max(1, len(a) // OUTLINE_POINTS), None] - b[None]).transpose(2, 0, 1)).min(axis=1)
        return bool(away.max() < allowed)

    def _expected_location(self, predictions: Predictions) -> Expected:
        """Where it is expected, how long it may have moved freely, and how large it would be."""
        state, target, numbers = self.state, self.target, self.state.numbers
        passed = max(1.0, state.steps)
        if not (state.lost or predictions.anew):
            unseen, adrift = passed * state.pace, 0.0 if predictions.background is not None else passed
        elif predictions.anew:
            unseen, adrift = state.wander * (state.adrift + passed), 0.0
        elif predictions.background is not None and state.anchored:
            unseen, adrift = state.unseen + state.wander, 0.0
        elif state.carried_by_belt() is not None:
            unseen, adrift = state.strayed, state.adrift + passed
        else:
            unseen, adrift = state.unseen + passed * state.pace, state.adrift + passed
        G = self._expected_pose(predictions)
        spread = math.hypot(numbers.stretch_rate, numbers.stretch_rate * unseen, numbers.swell * adrift)
        size = ExpectedSize.of(target, G, state.slope, spread)
        presence = min(max(state.presence * (1.0 - numbers.hazard), numbers.redetected), 1.0 - numbers.hazard)
        steps, taken = ANYWHERE_STEPS if state.gone else unseen, state.lost + passed if state.lost else 0.0
        rests = G is predictions.background and not state.gone
        expected = Expected(target.carried_contacts(G), presence, steps, size, taken, on_ground=rests, unseen=unseen)
        coasted = state.coasted() if state.lost else None
        if coasted is None:
            return expected
        return expected._replace(coasting=target.carried_contacts(coasted), strayed=state.strayed)

    def _expected_pose(self, predictions: Predictions) -> Floats:
        """(3, 3) where it is expected: as it moved, or, once it is lost, where the background has its place."""
        if not (self.state.lost or predictions.anew):
            return predictions.first[0].G
        if predictions.background is not None and (self.state.anchored or predictions.anew):
            return predictions.background
        carried = self.state.carried_by_belt()
        return self.state.expected if carried is None else carried

    def _look_if_gone(self, levels: list[Grey], predictions: Predictions, solutions: Solutions) -> None:
        """What is expected changes where its place is seen without it."""
        state = self.state
        if state.gone:
            return
        rests = predictions.background if state.anchored else None
        place = self._expected_pose(predictions) if rests is None else rests
        state.gone = has_gone_from(state, place, levels, predictions.even, on_ground=rests is not None)
        if state.gone:
            solutions.expected = solutions.expected._replace(steps=ANYWHERE_STEPS, on_ground=False)

    def _learn_from_image(self, levels: list[Grey], decision: Decision, predictions: Predictions) -> None:
        state, e = self.state, decision.estimate
        if not self.rivals.followed and self.rivals.shows_both(decision):
            state.note_lookalike()
        # what is followed is found, but not every contact
        roughly = decision.code in ("uncertain", "apart", "outline-open") and decision.evidence > 0.0
        if roughly and state.lost:  # what is found anew must be the object, wherever its contacts are
            roughly = any_of(1.0 - decision.presence, decision.exchanged, decision.alias) < state.numbers.risk
        if e is not None and (decision.is_accepted or roughly):
            learn(state, levels, decision, e, predictions)
        else:
            beside = state.lookalike or not self._alone
            alike = not state.lost and (beside or self.rivals.shows_equals(state.located))
            lose(state, levels, decision, predictions, lookalike=alike)
