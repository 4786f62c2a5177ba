# SPDX-License-Identifier: Apache-2.0
"""What surrounded the object: after a jump it tells which of its equals it is; where it changes, something came over it."""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from grasptrack.geometry.homographies import apply_homography
from grasptrack.kernels import PoseFlow, seen_area
from grasptrack.statistics import robust_sd
from grasptrack.tracking.evidence import Agreement, pose_evidence
from grasptrack.tracking.hypotheses import MIN_PLACES, WIDER_START, align_look
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.pose import SAME_PLACE, Hypothesis, Look, PoseEstimate, is_at, sane_area, share_in_view
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Grey, Target
from grasptrack.typing import Bools, Floats, Pixels

MOST_PLACES = 3
"""Places in an image that may be the object's, of which the surroundings are looked at, those of the most evidence first."""
ASIDE = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
"""Sizes of the object by which a look is moved beside itself, for how much of it agrees by chance or as a pattern repeats."""
TO_COARSE = np.diag([0.25, 0.25, 1.0])
"""px to those of the images in which ground is compared: the third level of a pyramid."""
CHANGED = 3.0
"""Standard deviations from which on it counts as changed."""
CLEAR = 4.0
"""px of those images, within which of an outline ground is not compared, or hardly."""
FRAME = (3, 9)
"""px of those images, sides of the squares that hold nothing beyond what both show: where ground is compared, and within its
border."""
BRIDGED = 5
"""px of those images, across which what came is one on both sides of an outline."""
ROUNDING = 0.25
"""Grey levels by which a difference of two such images varies at least."""
IMITATED = 0.05
"""Probability that what covers the object looks like its ground, or like itself, as in `native/registration/occlusion.hpp`."""


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


def newcomer_beside(state: TrackState, levels: list[Grey], estimate: PoseEstimate) -> Bools:
    """(n,) whether something came over the ground beside each sample of the outline: none where that is not known.

    The ground of the first image is laid on this one, and what changed of it as one with the border of what both show came
    from beyond. What lay under the object tells nothing: a sample lies beside what came if that is no farther away than the
    object has moved over the ground. Ground without texture is the same wherever it lies.

    Args:
        state: of the object.
        levels: the image's pyramid.
        estimate: where the object lies in it.
    """
    target, Q, nothing = state.target, state.target.noise_of_motion, np.zeros(len(state.target.points), dtype=bool)
    look = Look(target.recipe.textures[0][0], target.A)
    if look.levels[0].shape != levels[0].shape or len(levels) < 3:  # that of a part on file
        return nothing
    guesses = [each for each in (state.resting, estimate.G, target.A) if each is not None]
    starts = [Hypothesis("background", G, Q) for G in guesses]
    ground = align_look(state, look, levels, starts, Q, target.clear_ring(estimate.visible))
    state.resting = state.resting if ground is None else ground.G
    rests = estimate.G if ground is None else ground.G
    came = _what_came(target, look, Look(levels, estimate.G), rests)
    if not came.any():
        return nothing
    away = cv2.distanceTransform(np.asarray(~came, dtype=np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    here, there = (apply_homography(TO_COARSE @ G, target.points) for G in (estimate.G, rests))
    x, y = np.rint(here).astype(int).T
    seen = (x >= 0) & (y >= 0) & (x < came.shape[1]) & (y < came.shape[0])
    near = away[np.where(seen, y, 0), np.where(seen, x, 0)] < CLEAR + np.hypot(*(here - there).T)
    return np.asarray(seen & near)


def _what_came(target: Target, first: Look, last: Look, rests: Floats) -> Bools:
    """(H, W) of a coarse image where ground and object have changed since the first one, as one with the border of both.

    Args:
        target: the object.
        first, last: the images, and where the object lies in them.
        rests: (3, 3) where the ground has what lay there in the first one.
    """
    before, now = (cv2.pyrDown(look.levels[1].astype(np.float32)) for look in (first, last))
    size, back = now.shape[::-1], np.linalg.inv(TO_COARSE @ first.G)
    by_ground, by_object = (TO_COARSE @ G @ back for G in (rests, last.G))
    outlines = [apply_homography(TO_COARSE @ look.G, target.outline) for look in (first, last)]
    left, lies = (_without_object(now.shape, outline) for outline in outlines)
    left, both = (_laid(each, by_ground, size) for each in (left, np.ones_like(left)))
    shown, inner = (_shrunk(both, side) for side in FRAME)
    within = _shrunk(1 - lies, 2 * FRAME[0] + 1)
    beyond = 0.5 * math.sqrt(abs(seen_area(TO_COARSE @ last.G, target.outline)))
    low, high = outlines[1].min(axis=0) - beyond, outlines[1].max(axis=0) + beyond
    across, down = (slice(max(0, int(start)), max(0, int(end))) for start, end in zip(low, high, strict=True))
    changed = np.zeros(now.shape, np.uint8)
    for H, compared in ((by_ground, (left > 0) & (lies > 0) & (shown > 0)), (by_object, (within > 0) & (shown > 0))):
        off = now - cv2.warpPerspective(before, H, size)
        usual = off[down, across][compared[down, across]]
        if len(usual) >= MIN_PLACES:
            middle = float(np.median(usual))
            varies = robust_sd(usual - middle) + ROUNDING
            changed |= np.asarray((np.abs(off - middle) > CHANGED * varies) & compared, np.uint8)
    changed = np.asarray(cv2.morphologyEx(changed, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)), np.uint8)
    count, labels = cv2.connectedComponents(cv2.dilate(changed, np.ones((BRIDGED, BRIDGED), np.uint8)))
    at_border = np.zeros(count, dtype=bool)
    at_border[labels[(inner == 0) & (changed > 0)]] = True
    return np.asarray(at_border[labels] & (changed > 0))


def cover_log_odds(beside: Bools, samples: Floats, estimate: PoseEstimate, numbers: Numbers) -> float:
    """Log odds that what differs of the outline is covered by what came beside it, against another shape.

    -inf where nothing tells that it came to each stretch that differs, and hardly to what is seen of the outline.

    Args:
        beside: (n,) as of `newcomer_beside`.
        samples: (n,) probability of each of the outline's samples to be one that differs.
        estimate: where the object lies.
        numbers: the core's.
    """
    which, clear = np.flatnonzero(samples > 0.5 * samples.max(initial=0.0)), beside[estimate.visible > 0.5]
    if not beside[which].any():
        return -math.inf
    chance = (np.count_nonzero(clear) + 1.0) / (len(clear) + 2.0)
    stretches = [beside[each] for each in np.split(which, np.flatnonzero(np.diff(which) > 1) + 1)]
    told = [(float(each.mean()), max(1.0, numbers.temper * len(each))) for each in stretches]
    found = min(Agreement(share * places, places).log_odds(chance) for share, places in told)
    return math.log(IMITATED * numbers.share_occluded) + found if found > 0.0 else -math.inf


def _without_object(shape: tuple[int, ...], outline: Floats) -> Pixels:
    """(H, W) 1 where an outline, px, does not lie, nor its border."""
    found = np.ones(shape, np.uint8)
    cv2.fillPoly(found, [np.rint(outline).astype(np.int32)], 0)
    return np.asarray(cv2.erode(found, np.ones((3, 3), np.uint8)), np.uint8)


def _laid(image: Pixels, H: Floats, size: tuple[int, ...]) -> Pixels:
    return np.asarray(cv2.warpPerspective(image, H, size, flags=cv2.INTER_NEAREST), dtype=np.uint8)


def _shrunk(mask: Pixels, side: int) -> Pixels:
    """A mask (H, W) but for what lies within half a side of its border, or of the image's."""
    square = np.ones((side, side), np.uint8)
    return np.asarray(cv2.erode(mask, square, borderType=cv2.BORDER_CONSTANT, borderValue=0), dtype=np.uint8)
