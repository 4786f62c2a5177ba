# SPDX-License-Identifier: Apache-2.0
"""After a jump or a gap: what surrounded the object tells which of its equals it is, or which turn of its outline."""

import math
from collections.abc import Sequence

import numpy as np

from grasptrack.geometry.homographies import apply_homography
from grasptrack.kernels import PoseFlow, seen_area
from grasptrack.tracking.evidence import Agreement, pose_evidence
from grasptrack.tracking.hypotheses import MIN_PLACES, WIDER_START
from grasptrack.tracking.pose import SAME_PLACE, Look, PoseEstimate, is_at, sane_area, share_in_view
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Grey
from grasptrack.typing import Floats

MOST_PLACES = 3
"""Places in an image that may be the object's, of which the surroundings are looked at, those of the most evidence first."""
ASIDE = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
"""Sizes of the object by which a look is moved beside itself, for how much of it agrees by chance or as a pattern repeats."""


class Surroundings:
    """What surrounded an object in the last look at it, laid on later images.

    Args:
        state: of the object.
    """

    def __init__(self, state: TrackState) -> None:
        self._state = state
        self._beside: tuple[Look, Floats, float] | None = None  # the last answer of `_chance_agreement`, and of what

    def find_ground(
        self, levels: list[Grey], estimates: Sequence[PoseEstimate], ground: Floats | None
    ) -> Floats | None:
        """(3, 3) where the ground has an object that was lost with it, if it surely lies where one of the estimates has it.

        Args:
            levels: the image's pyramid.
            estimates: what may be the object in it.
            ground: (3, 3) a guess of where the ground has it; None where there is none.
        """
        target, numbers = self._state.target, self._state.numbers
        told: list[tuple[float, Floats]] = []
        starts = [estimate.G for estimate in _likeliest_places(self._state, estimates)]
        for start in starts if ground is None else [ground, *starts]:
            found = _laid_at(self._state, levels, start)
            if found is None or not sane_area(target, found.G):
                continue
            odds = _agreement(self._state, found).log_odds(self._chance_agreement())
            told.append((numbers.temper * odds, found.G))
        told.sort(key=lambda each: -each[0])
        needed = -math.log(numbers.risk)
        if not told or told[0][0] < needed:
            return None
        best, middle = told[0], target.centre[None]
        for odds, G in told[1:]:
            away = float(np.hypot(*(apply_homography(G, middle) - apply_homography(best[1], middle))[0]))
            if best[0] < odds + needed and away > SAME_PLACE * math.sqrt(abs(seen_area(best[1], target.outline))):
                return None
        return best[1]

    def _chance_agreement(self) -> float:
        """Share of the last look's surroundings that agrees with what lies beside them, or about the object's equals."""
        state = self._state
        target, look, most = state.target, state.located, 0.0
        if self._beside is not None and self._beside[0] is look and self._beside[1] is state.equals:
            return self._beside[2]
        row = [step for e in state.equals for step in (e, -e)]  # it goes on where the first view did not show it
        places = [np.array(way) * target.size for way in ASIDE] + row
        for x, y in places:
            found = _laid_at(state, look.levels, look.G @ np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]]))
            if found is None:
                continue
            came_back = float(np.hypot(*target.pose_difference(look.G, found.G)[:2])) < 0.5 * math.hypot(x, y)
            share = _agreement(state, found)
            if not came_back:
                most = max(most, share.agreeing / share.places)
        n = float(len(target.ring))
        self._beside = look, state.equals, (most * n + 1.0) / (n + 2.0)
        return self._beside[2]


def _likeliest_places(state: TrackState, estimates: Sequence[PoseEstimate]) -> list[PoseEstimate]:
    kept: list[PoseEstimate] = []
    rated = [(pose_evidence(state, e), e) for e in estimates]
    for evidence, e in sorted(rated, key=lambda each: -each[0]):
        if evidence > 0.0 and len(kept) < MOST_PLACES and not any(is_at(e, other.middle) for other in kept):
            kept.append(e)
    return kept


def _laid_at(state: TrackState, levels: list[Grey], G: Floats) -> PoseFlow | None:
    """The last look's surroundings laid on an image about a pose (3, 3), however few agree; None where that is impossible."""
    target, look, Q = state.target, state.located, state.target.noise_of_motion
    if len(target.ring) < MIN_PLACES:
        return None
    wide = Q * WIDER_START
    found: PoseFlow = target.handle.follow(look.levels, look.G, levels, G, wide, target.ring, target.corner_strides)
    return found if found.valid and seen_area(found.G, target.outline) > 0.0 else None


def _agreement(state: TrackState, found: PoseFlow) -> Agreement:
    """Of the places in both images those that agree."""
    look, ring = state.located, state.target.ring
    agreeing = found.agreeing * len(ring) * share_in_view(look.G, ring, look.levels[0])
    return Agreement(agreeing, max(agreeing, float(found.used)))
