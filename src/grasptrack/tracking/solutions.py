# SPDX-License-Identifier: Apache-2.0
"""What an image makes of hypotheses: each made exact, its surface held against its outline and the ground."""

import math
from collections.abc import Callable

import numpy as np

from grasptrack.geometry.homographies import apply_homography
from grasptrack.kernels import PoseFlow
from grasptrack.tracking.decision import NOTHING, Decision, Expected, decide_pose
from grasptrack.tracking.estimator import SHARP, WHOLE_WAY, estimate_pose
from grasptrack.tracking.evidence import (
    STILL_FROM,
    astray_share,
    expected_texture,
    is_surface_proven,
    outline_evidence,
    pose_evidence,
    stands_at,
    texture_evidence,
    wrong_object_probability,
)
from grasptrack.tracking.fixed_patches import ALONE, against_fixed_surface, estimate_at_rest, false_piece_log_odds
from grasptrack.tracking.hypotheses import AGREE_DISTANCE
from grasptrack.tracking.pose import (
    CONTINUOUS,
    SAME_PLACE,
    FixedMarks,
    Hypothesis,
    PoseEstimate,
    changed_estimate,
    contact_tolerance,
    largest_sigma,
    lead_alike,
    max_contact_distance,
    mixed_estimate,
    sane_area,
    worst_variance,
)
from grasptrack.tracking.state import MAX_LOG_ODDS, TrackState
from grasptrack.tracking.surroundings import cover_log_odds, newcomer_beside
from grasptrack.tracking.target import Grey
from grasptrack.typing import Bools, Floats

STILL_SHARE = 0.25
"""Share of what something else has moved that is rest."""
LEAST_OF_USUAL = 0.5
"""Share of the usual evidence of the surface below which a second solution is looked for."""
DISAGREE_FROM = 2.0
"""Squared distance, by what is known of both, from which on an answer lies elsewhere than where outline and ground have it."""
PUSHED = 1e-4
"""Probability that an object at rest is pushed from one image to the next, and in just the way in which its outline slides."""
MOST_OF_GROUND = 0.5
"""Share of the ground's places beyond which it is the ground that moved, and nothing that came over it."""
ROOM = 0.5
"""Share of the standard deviation that an answer may have, up to which the outline alone fixes every contact: that the surface
says otherwise comes on top."""


class Solutions:
    """What is found of the object in one image.

    Args:
        state: what is known of it so far.
        levels: the image's pyramid.
        expected: what continuity says of the image.
        hypotheses: to begin with.
        ground: where the ground has the object, as far as this image tells; None where it does not.
        is_taken: whether another object surely lies where an estimate has this one; None where no other is followed.

    Attributes:
        found: one estimate of each hypothesis that has one.
        expected: as given; more may become known.
        sharp_gain: log-odds of this image that the shutter is open but for a moment, against as long as believed.
        marks: see `Decision`.
    """

    def __init__(
        self,
        state: TrackState,
        levels: list[Grey],
        expected: Expected,
        hypotheses: list[Hypothesis],
        ground: PoseFlow | None = None,
        is_taken: Callable[[PoseEstimate], bool] | None = None,
    ) -> None:
        self._ground, self._is_taken = ground, is_taken
        self.found: list[PoseEstimate] = []
        self.expected = expected
        self._state, self._levels = state, levels
        self.marks = None if state.marks is None else state.marks._replace(object_pose=None)
        self._second: list[tuple[PoseEstimate, PoseEstimate | None]] = []
        self._sharpest, self.sharp_gain = -math.inf, 0.0
        self._at_rest: PoseEstimate | None = None
        self._beside: list[tuple[Floats, Bools]] = []  # the answers of `newcomer_beside`, and of what contacts
        self._short: tuple[PoseEstimate, bool] | None = None  # the last answer of `falls_short`
        self._asked, self._decision = list[object](), NOTHING  # what was decided last, and of what
        self.add(hypotheses)

    def decide_among(self) -> Decision:
        """What is decided of all that is found."""
        asked: list[object] = [*self.found, self.expected, self.marks]
        if len(asked) != len(self._asked) or any(a is not b for a, b in zip(asked, self._asked, strict=True)):
            self._decision = decide_pose(self._state, self.found, self.expected, self.marks)
            self._asked = asked
        return self._decision

    def add(self, hypotheses: list[Hypothesis], *, goes_on: bool = False) -> None:
        """Make hypotheses exact; of a lost object those that do not lead to what was found already."""
        state = self._state
        for hypothesis in hypotheses:
            if state.lost and self._is_answered(hypothesis):
                continue
            # where it was a moment ago does not tell how it moves
            still = bool(state.lost) or not (goes_on or hypothesis.origin in CONTINUOUS)
            estimate = estimate_pose(state, self._levels, hypothesis, still=still)
            if estimate is None or (self._is_taken is not None and self._is_taken(estimate)):
                continue
            # of a lost object only what shows it can be nearly right
            lost = state.lost and pose_evidence(state, estimate) < 0.0
            # what lay elsewhere a moment ago, whatever was tried, lies there still
            more = estimate.elsewhere - (0.0 if state.lost else state.elsewhere)
            if (more > state.numbers.elsewhere or self.falls_short(estimate)) and not lost:
                other = self._from_farther(estimate, still=still)
                score = self._score_estimate
                if other is not None and score(other, hypothesis) > score(estimate, hypothesis):
                    estimate = other
                else:
                    estimate = changed_estimate(estimate, confirmed=True)
            if not still and estimate.hidden > state.numbers.elsewhere:
                estimate = self._against_shutter(estimate, hypothesis)
            estimate = self._against_outline(estimate, hypothesis.G, still=still)
            estimate = self._against_ground(estimate, still=still)
            self.found.append(self._against_false_pieces(self._against_fixed_surface(estimate, still=still)))

    def _against_shutter(self, estimate: PoseEstimate, hypothesis: Hypothesis) -> PoseEstimate:
        """An estimate, or the one through a shutter that is open but for a moment, if this and former images speak for that.

        One that is believed to be open for longer lets edges be blurred far and wide, and whatever texture lies there bears it
        out.
        """
        state = self._state
        way = max_contact_distance(estimate.contacts, state.target.carried_contacts(state.last.G))
        if state.blur_share * way < state.edge_width:  # blur would not show
            return estimate
        sharp = estimate_pose(state, self._levels, hypothesis, blur_share=SHARP)
        if sharp is None:
            return estimate
        score = self._score_estimate(sharp, hypothesis)
        gain = score - self._score_estimate(estimate, hypothesis)
        if score > self._sharpest:
            self._sharpest, self.sharp_gain = score, gain
        return sharp if state.sharp + gain > 0.0 else estimate

    def add_around(self, hypotheses: list[Hypothesis]) -> None:
        """The same of those that lie about where continuity has the object, so that its last pose tells how it moves."""
        target, expected = self._state.target, self.expected.contacts

        def goes_on(hypothesis: Hypothesis) -> bool:
            away = max_contact_distance(target.carried_contacts(hypothesis.G), expected)
            return away < SAME_PLACE * math.sqrt(sane_area(target, hypothesis.G))

        self.add([hypothesis for hypothesis in hypotheses if goes_on(hypothesis)], goes_on=True)

    def _is_answered(self, hypothesis: Hypothesis) -> bool:
        """Whether an answer that shows the object lies where a hypothesis would lead."""
        state = self._state
        return any(lead_alike(state.target, hypothesis, e) and pose_evidence(state, e) > 0.0 for e in self.found)

    def _from_farther(self, estimate: PoseEstimate, *, still: bool) -> PoseEstimate | None:
        """A second solution; answers that lead to the same one share it."""
        target = self._state.target
        for first, second in self._second:
            if lead_alike(target, first, estimate):
                return None if second is None else changed_estimate(second, origin=estimate.origin)
        P, reach = estimate.P + target.noise_of_motion, target.numbers.wide * target.size
        farther = Hypothesis(estimate.origin, estimate.G, P, reach)
        found = estimate_pose(self._state, self._levels, farther, blur_share=WHOLE_WAY, still=still)
        self._second.append((estimate, found))
        if found is not None:
            self._second.append((found, found))
        return found

    def _against_outline(self, estimate: PoseEstimate, begun: Floats, *, still: bool) -> PoseEstimate:
        """An estimate that much of the outline contradicts, or what the outline says alone; with the spread of both.

        Surface and outline are two witnesses, either of which may fail as a whole: compression, a reflection or dirt holds
        the one where it was, a cover or a shadow carries the other off. What later views seldom showed of the first outline
        is no witness; where less of the rest lies elsewhere it agrees with the surface.
        """
        state, target, numbers = self._state, self._state.target, self._state.numbers
        own, least = astray_share(state, estimate), numbers.contradicted
        ground = self._ground_moved_on(estimate)
        # else nothing was taken for its surface, or what comes back does not show what moved meanwhile
        shown = not state.lost and texture_evidence(state, estimate) > 0.0
        if ground is not None and not state.lost:
            self._note_marks(estimate, ground, still=True, on_ground=True)
        if (own < least and ground is None) or not estimate.texture_agreeing:
            return estimate
        start = estimate.G
        if ground is not None or self._stands_still(estimate, state.last.G):
            start = state.last.G if ground is None else ground
        other = self._outline_alone(estimate, [start, begun], still=still)
        if other is None or lead_alike(target, other, estimate):
            return estimate
        if shown and self._is_whole(other):
            self._note_marks(estimate, other.G, still=False)
        gain, fails = outline_evidence(other, numbers) - outline_evidence(estimate, numbers), numbers.risk
        covered = max(estimate.hidden, other.hidden) > numbers.elsewhere and gain < -math.log(fails)
        if ground is not None or (not covered and self._stands_still(estimate, other.G)):
            # what is fixed in the image explains a surface at rest as well as the object does
            if gain < math.log(fails):
                return estimate
        elif not self._is_whole(other):
            return estimate
        else:
            gain, fails = pose_evidence(state, other) - pose_evidence(state, estimate), numbers.witness_fails
        gain = min(max(gain, -MAX_LOG_ODDS), MAX_LOG_ODDS)
        right = min(max(1.0 / (1.0 + math.exp(-gain)), fails), 1.0 - fails)
        if right > 0.5 and shown and self._stands_still(estimate, other.G):
            self._note_marks(estimate, other.G, still=True)
        found = mixed_estimate(target, [estimate, other], [math.log(1.0 - right), math.log(right)])
        found.confirmed = estimate.confirmed
        if max_contact_distance(other.contacts, estimate.contacts) > contact_tolerance(other.area, numbers):
            found.slipped = right
        return found

    def _against_ground(self, estimate: PoseEstimate, *, still: bool) -> PoseEstimate:
        """An estimate of an outline that slides along itself, or what outline and ground say without the surface.

        Where an encoder carries blocks of a plain surface along, nothing but the ground on which it rests tells how far it
        slid: that it was pushed in just this way is less probable than that its surface fails.
        """
        state, target, numbers, ground = self._state, self._state.target, self._state.numbers, self._ground
        if ground is None or not target.slides or not estimate.texture_agreeing:
            return estimate
        if state.lost or state.wander >= numbers.predicted:  # it need not rest where it did
            return estimate
        P = target.noise_of_motion * state.wander**2 + state.P
        resting = Hypothesis(estimate.origin, ground.G, P)
        other = estimate_pose(state, self._levels, resting, still=still, surface=False)
        if other is None or target.handle.joined(other.G, other.P, estimate.G, estimate.P)[0] < DISAGREE_FROM:
            return estimate
        gain = outline_evidence(other, numbers) - outline_evidence(estimate, numbers)
        gain += numbers.temper * min(0.0, texture_evidence(state, other) - texture_evidence(state, estimate))
        gain += math.log(numbers.witness_fails / PUSHED)
        gain = min(max(gain, -MAX_LOG_ODDS), MAX_LOG_ODDS)
        found = mixed_estimate(target, [estimate, other], [-gain, 0.0])
        found.confirmed = estimate.confirmed
        return found

    def _against_fixed_surface(self, estimate: PoseEstimate, *, still: bool) -> PoseEstimate:
        """An estimate, against a surface that may all be fixed in the image: its patches have not moved, the outline has."""
        state, target, numbers = self._state, self._state.target, self._state.numbers
        way = max_contact_distance(estimate.contacts, target.carried_contacts(target.A))
        if is_surface_proven(state) or way < STILL_FROM or texture_evidence(state, estimate) <= 0.0:
            return estimate
        self._at_rest = self._at_rest or estimate_at_rest(state, self._levels)
        if self._at_rest is None:
            return estimate
        if outline_evidence(estimate, numbers) - outline_evidence(self._at_rest, numbers) < -math.log(numbers.fixed):
            return estimate
        return against_fixed_surface(state, self._levels, estimate, self._at_rest, still=still)

    def _against_false_pieces(self, estimate: PoseEstimate) -> PoseEstimate:
        """An estimate, of another shape only as far as the pieces that differ are none that the first outline took in.

        So may be a line over the image, or a letter, that joined the object there and still lies where the first image had it,
        or the edge of a glare. Nor is it what came over the ground beside it, as a finger that touches the object.
        """
        if not estimate.other_shape > 0.0:
            return estimate
        found, odds, state = changed_estimate(estimate), [], self._state
        beside = self._newcomer_beside(estimate)
        for piece in (estimate.closed_piece, estimate.open_piece):
            taken_in = false_piece_log_odds(state, self._levels, estimate.G, piece.samples > 0.5)
            covered = cover_log_odds(beside, np.asarray(piece.samples), estimate, state.numbers)
            false = float(np.logaddexp(taken_in, covered))
            odds.append(piece.log_odds - math.log1p(math.exp(min(piece.log_odds + false, MAX_LOG_ODDS))))
        found.other_shape = max(odds)
        return found

    def _newcomer_beside(self, estimate: PoseEstimate) -> Bools:
        """That of an estimate, asked where it is less sure than usual; poses within a pixel of each other share it."""
        state = self._state
        if wrong_object_probability(state, estimate, self.expected.steps) < state.numbers.exchanged:
            return np.zeros(len(estimate.visible), dtype=bool)
        for contacts, beside in self._beside:
            if max_contact_distance(contacts, estimate.contacts) < STILL_FROM:
                return beside
        self._beside.append((estimate.contacts, newcomer_beside(state, self._levels, estimate)))
        return self._beside[-1][1]

    def _outline_alone(self, estimate: PoseEstimate, starts: list[Floats], *, still: bool) -> PoseEstimate | None:
        """What the outline says alone from poses (3, 3), or from where it was when it contradicted the same surface before."""
        state, marks = self._state, self._state.marks
        if marks is not None and marks.object_pose is not None and stands_at(state.target, estimate.G, marks.G):
            starts.append(marks.object_pose)
        P, found = estimate.P + ALONE**2 * state.target.noise_of_motion, list[PoseEstimate]()
        for G in starts:
            alone = Hypothesis(estimate.origin, G, P)
            other = estimate_pose(state, self._levels, alone, still=still, surface=False)
            found += [] if other is None else [other]
        return max(found, key=lambda other: outline_evidence(other, state.numbers), default=None)

    def _note_marks(self, estimate: PoseEstimate, there: Floats, *, still: bool, on_ground: bool = False) -> None:
        """Take what an estimate shows as fixed in the image, the object being elsewhere: surely, if it alone stands still."""
        marks, before, target = self.marks, self._state.marks, self._state.target
        left = (0.0, 0.0) if before is None or not stands_at(target, estimate.G, before.G) else before.left
        if on_ground:
            (x, y), (u, v) = (apply_homography(G, target.centre[None])[0] for G in (there, self._state.last.G))
            left = left[0] + x - u, left[1] + y - v
        if marks is not None and stands_at(target, estimate.G, marks.G):
            self.marks = FixedMarks(marks.G, there, marks.still or still, left if on_ground else marks.left)
        else:
            self.marks = FixedMarks(estimate.G, there, still, left)

    def _ground_moved_on(self, estimate: PoseEstimate) -> Floats | None:
        """(3, 3) where the ground has the object, if it surely moves on from an estimate that stands still.

        Most of it: a hand over a table moves on, too.
        """
        ground = self._ground
        if ground is None or ground.agreeing <= MOST_OF_GROUND or not self._stands_still(estimate, ground.G):
            return None
        away = self._state.target.handle.joined(ground.G, ground.P, estimate.G, estimate.P)[0]
        return ground.G if away > AGREE_DISTANCE else None

    def _stands_still(self, estimate: PoseEstimate, elsewhere: Floats) -> bool:
        """Whether an answer leaves the object where the first or last image had it, while another pose (3, 3) moves it on."""
        target = self._state.target
        middle = target.centre[None]

        def at(G: Floats) -> Floats:
            return np.asarray(apply_homography(G, middle)[0])

        now, there = at(estimate.G), at(elsewhere)
        ways = ((math.dist(there, before), math.dist(now, before)) for before in (at(self._state.last.G), at(target.A)))
        return any(way > STILL_FROM and own < STILL_SHARE * way for way, own in ways)

    def _is_whole(self, outline: PoseEstimate) -> bool:
        """Whether what the outline says alone hangs together, and fixes every contact: else it is no witness."""
        numbers = self._state.numbers
        fixed = math.sqrt(worst_variance(outline.covariance)) < ROOM * largest_sigma(outline.area, numbers)
        return fixed and outline.elsewhere < numbers.elsewhere

    def missing_texture(self, estimate: PoseEstimate) -> float:
        """By how much the evidence of the surface falls short of what it would be if its patches looked as usual."""
        return expected_texture(self._state, estimate) - texture_evidence(self._state, estimate)

    def falls_short(self, estimate: PoseEstimate) -> bool:
        """Whether much less of the surface is seen than usual, as where only its coarse patches found their place."""
        if self._short is None or self._short[0] is not estimate:  # it is asked for again and again
            state, least = self._state, LEAST_OF_USUAL
            short = sum(state.target.counts) > 0 and texture_evidence(state, estimate) < least * expected_texture(
                state, estimate
            )
            self._short = estimate, short
        return self._short[1]

    def may_have_slid(self, estimate: PoseEstimate) -> bool:
        """Whether less of the surface is seen than usual, or all at once much of the outline lies elsewhere or is hidden."""
        state, least = self._state, self._state.numbers.elsewhere
        hidden = 0.0
        if len(state.visible) == len(estimate.visible):
            hidden = float(np.maximum(state.visible - estimate.visible, 0.0).mean())
        return self.falls_short(estimate) or max(hidden, estimate.elsewhere - state.elsewhere) > least

    def _score_estimate(self, estimate: PoseEstimate, hypothesis: Hypothesis) -> float:
        """Evidence for an estimate, and how far it went from the hypothesis that it was made from."""
        away: Floats = self._state.target.pose_difference(hypothesis.G, estimate.G)
        distance = float(away @ np.linalg.solve(hypothesis.P, away))
        freedom = self._state.numbers.prior_freedom
        prior = -0.5 * (freedom + len(away)) * math.log1p(distance / freedom)
        return pose_evidence(self._state, estimate) + prior
