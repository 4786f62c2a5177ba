# SPDX-License-Identifier: Apache-2.0
"""What may be taken for the object: its equals, parts of another size or lighter and darker ones, and how an image tells."""

import math

import cv2
import numpy as np

from grasptrack.tracking.decision import Decision, other_size_probability
from grasptrack.tracking.equals import SHOWN_RIGHT, Shows, Way, alias_probability, complete_row
from grasptrack.tracking.estimator import estimate_pose
from grasptrack.tracking.evidence import MAX_EXPONENT, pose_evidence, wrong_object_probability
from grasptrack.tracking.hypotheses import Predictions, located_ground
from grasptrack.tracking.placements import SCORE_SAMPLES
from grasptrack.tracking.pose import (
    CONTINUOUS,
    TRIED,
    Hypothesis,
    Look,
    PoseEstimate,
    carried_in_front,
    is_at,
    max_contact_distance,
    mean_point,
    share_in_view,
)
from grasptrack.tracking.redetection import Redetection
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Grey, Target
from grasptrack.typing import Floats

LOOKALIKE_EVIDENCE = 0.5
"""Share of the evidence for the object that something has to show to be just like it."""
ALIKE_SHARE = 0.75
"""Share of the edges that the object shows, from which on a place shows a part."""
OVERLAP, CELLS = 0.1, 64
"""Share of its area that a part has in common with another one in its plane, at most: poses err. Cells of its width."""
EITHER_SIGN = 0.5
"""Probability that an edge of another part is one from dark to light."""


class Rivals:
    """Tells an object from others.

    Args:
        state: of the object.
        redetection: finds outlines and edges of it.

    Attributes:
        followed: states of its equals that are followed beside it, and known to be others.
    """

    def __init__(self, state: TrackState, redetection: Redetection) -> None:
        self.redetection = redetection
        self.state = state
        self.followed: list[TrackState] = []
        self._looked_at: Look | None = None

    def against_equals(
        self, decision: Decision, levels: list[Grey], predictions: Predictions, pose: Floats, steps: float
    ) -> Decision:
        """A decision against the equals of the object, one of which may have come to its place.

        What rests on the ground, and moved as that did, is no other.

        Args:
            decision: of an image.
            levels: the image's pyramid.
            predictions: where continuity has the object.
            pose: (3, 3) where it is expected.
            steps: how long it may have gone unseen, in frames of free motion.
        """
        state, e = self.state, decision.estimate
        if e is None:
            return decision
        ground = predictions.background if state.anchored or predictions.anew or not state.lost else None
        if ground is not None:
            if max_contact_distance(e.contacts, state.target.carried_contacts(ground)) < decision.tolerance:
                return decision
            if (state.lost or predictions.anew) and self._lay_there(e, ground):
                return decision.with_alias(SHOWN_RIGHT)
        if self.followed and not state.lost:  # what of all of them is most probable is decided by all of them
            return decision
        if not (len(state.equals) or (e.origin not in CONTINUOUS and self.shows_equals(state.located))):
            return decision
        way = self.expected_way(predictions, pose, steps)
        return decision.with_alias(alias_probability(state, e, way, self._parts_shown(levels[0], e.G)))

    def expected_way(self, predictions: Predictions, pose: Floats, steps: float) -> Way:
        """Where the object would be that moved as is expected; arguments as of `against_equals`."""
        state, even = self.state, predictions.even
        if (carried := state.carried_by_belt()) is not None:
            return Way(carried, state.located.G, (state.numbers.travel * state.strayed) ** 2)
        if state.lost:
            return Way(pose, pose, (state.numbers.travel * steps) ** 2)
        spread = None if even is None else state.agility * state.drifted
        ground, rests = predictions.background, None
        if ground is not None:
            rests = ground, max((state.numbers.travel * state.wander) ** 2, state.drifted)
        return Way(state.last.G if even is None else even, state.last.G, spread, rests)

    def against_other_sizes(self, decision: Decision, levels: list[Grey]) -> Decision:
        """A decision after a loss against a larger or smaller part of the same shape: the ground tells which size is right."""
        state, e = self.state, decision.estimate
        if e is None or not state.lost or decision.evidence <= 0.0 or (ground := located_ground(state, levels)) is None:
            return decision
        return decision.with_alias(other_size_probability(state, e, ground), "other-shape")

    def against_other_looks(self, decision: Decision, levels: list[Grey], predictions: Predictions) -> Decision:
        """A decision after a loss against a part that is lighter than the ground where the object is darker, or the reverse.

        On the ground on which it lay no light makes that of the object.
        """
        state, e, numbers = self.state, decision.estimate, self.state.numbers
        ground = predictions.background if state.anchored or predictions.anew else None
        if e is None or not (state.lost or predictions.anew) or ground is None:
            return decision
        if not is_at(e, mean_point(self.state.target.carried_contacts(ground))):
            return decision
        share, look = self.redetection.samples.edge_share, state.located
        same, before = share(levels[0], e.G), share(look.levels[0], look.G)
        other = share(levels[0], e.G, turned=True) - share(look.levels[0], look.G, turned=True)
        turned = SCORE_SAMPLES * max(0.0, min(other, before - same))  # grained ground has edges of either sign
        told = turned * math.log(EITHER_SIGN / (1.0 - numbers.same_sign))
        told += SCORE_SAMPLES * same * math.log(EITHER_SIGN / numbers.same_sign)
        exchanged = numbers.exchanged * math.exp(min(numbers.temper * told, MAX_EXPONENT))
        return decision.with_alias(exchanged / (1.0 + exchanged), "other-surface")

    def shows_both(self, decision: Decision) -> bool:
        """Whether one image shows the object where it was, and something that looks just like it elsewhere."""
        state, one, other = self.state, decision.estimate, decision.rival
        if one is None or other is None or is_at(one, other.middle):
            return False
        less, more = sorted(pose_evidence(state, e) for e in (one, other))
        if not less > LOOKALIKE_EVIDENCE * more > 0.0:
            return False
        place = mean_point(self.state.target.carried_contacts(state.expected))
        away = max(one, other, key=lambda e: math.dist(e.middle, place))
        return wrong_object_probability(state, away, 1.0) < 0.5

    def shows_equals(self, look: Look) -> bool:
        """Whether a look at the object shows equals of it, which are then known; each look is asked once."""
        state = self.state
        if self._looked_at is not look:
            self._looked_at = look
            middles = [e.middle for e in self._find_lookalikes(look)]
            if middles and not len(state.equals):
                state.equals = complete_row(
                    self.state.target, look.G, middles, self._parts_shown(look.levels[0], look.G)
                )
        return bool(len(state.equals))

    def forget_equals(self) -> None:
        """Look for them anew."""
        self._looked_at, self.state.equals = None, np.empty((0, 2))

    def _find_lookalikes(self, look: Look) -> list[PoseEstimate]:
        """What a look at the object shows elsewhere that is just like it."""
        state = self.state
        own = estimate_pose(state, look.levels, Hypothesis("at rest", look.G, state.P))
        if own is None:
            return []
        found: list[PoseEstimate] = []
        seen = [each for each in self.followed if each.located.levels[0] is look.levels[0]]
        beside = [mean_point(each.target.carried_contacts(each.located.G)) for each in seen]
        for hypothesis in self.redetection.find_lookalikes(state, look):
            other = estimate_pose(state, look.levels, hypothesis, still=True)
            if other is None or is_at(own, other.middle) or any(is_at(other, e.middle) for e in found):
                continue
            if any(is_at(other, place) for place in beside):
                continue
            if wrong_object_probability(state, other, 1.0) > 0.5:  # of the same outline, but not of its looks
                continue
            held = share_in_view(other.G, state.target.outline, look.levels[0])
            if not pose_evidence(state, other) > LOOKALIKE_EVIDENCE * held * pose_evidence(state, own) > 0.0:
                continue
            if _shared_area(state.target, other.G, look.G) <= OVERLAP:  # else it is seen by the edges of the object
                found.append(other)
        return found

    def _lay_there(self, estimate: PoseEstimate, ground: Floats) -> bool:
        """Whether the last look at the object shows it, and what an estimate found as well, where the ground has that then."""
        state, look = self.state, self.state.located
        G = look.G @ np.linalg.inv(ground) @ estimate.G
        then = estimate_pose(
            state, look.levels, Hypothesis(TRIED, G / G[2, 2], self.state.target.noise_of_motion), still=True
        )
        if then is None or is_at(then, mean_point(self.state.target.carried_contacts(look.G))):
            return False
        return pose_evidence(state, then) > LOOKALIKE_EVIDENCE * pose_evidence(state, estimate) > 0.0

    def _parts_shown(self, grey: Grey, own: Floats) -> Shows:
        """Whether an image that shows the object at a pose shows a part at another one."""
        enough, share = (
            ALIKE_SHARE * self.redetection.samples.edge_share(grey, own),
            self.redetection.samples.edge_share,
        )
        return lambda G: share(grey, G) >= enough


def _shared_area(target: Target, one: Floats, other: Floats) -> float:
    """Share of the object's area that two poses (3, 3) of it have in common."""
    low, high = target.outline.min(axis=0), target.outline.max(axis=0)
    to_other = np.asarray(np.linalg.inv(other) @ one, dtype=np.float64)
    masks = []
    for points in (target.outline, carried_in_front(to_other / to_other[2, 2], target.outline)):
        cells = CELLS * (points[np.isfinite(points[:, 0])] - low) / (high - low)
        mask: Grey = np.zeros((CELLS, CELLS), np.uint8)
        cv2.fillPoly(mask, [np.round(np.clip(cells, -CELLS, 2 * CELLS)).astype(np.int32)], 1)
        masks.append(mask)
    return float((masks[0] & masks[1]).sum()) / max(float(masks[0].sum()), 1.0)
