# SPDX-License-Identifier: Apache-2.0
"""Where the object may be when continuity does not tell: shifted from its last look, by its keypoints or its outline."""

import math
import sys
from typing import Any, NamedTuple

import cv2
import numpy as np

from grasptrack import kernels
from grasptrack.errors import InputError
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import HORIZON
from grasptrack.matching import MatchOutcome, Sampled, judge_hypotheses, match_outlines
from grasptrack.matching.samples import BENDS
from grasptrack.segmentation.candidate import Candidate, outward_normals, polarity_of
from grasptrack.segmentation.outline_detector import OutlineDetector
from grasptrack.segmentation.silhouettes import Silhouette
from grasptrack.segmentation.work import THRESHOLDED, AreaCost, WorkBudget
from grasptrack.tracking.evidence import pose_evidence, wrong_object_probability
from grasptrack.tracking.placements import MAX_SOLVED, SIDE_REACH, OutlineSamples, edges_in_plane, find_placements
from grasptrack.tracking.pose import CONTINUOUS, TURNED, Hypothesis, Look, PoseEstimate, carried_in_front, sane_area
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import GUESSED_TILT, Grey, Target, as_grey
from grasptrack.transfer.alignment import as_similarity, find_alignments
from grasptrack.typing import Floats

MIN_KEYPOINTS = 8
"""Keypoints that a pose must rest on."""
MAX_KEYPOINTS, KEYPOINT_CONTRAST = 2000, 0.02
"""Keypoints of an image, the strongest ones, and the contrast of one at least: half of SIFT's own, for small print."""
MAX_SHOWN = 600
"""Keypoints of the last look, the strongest ones."""
BETTER_MATCH = 0.8
"""Distance of a match over that to the second best, at most."""
KEYPOINT_REACH = 4.0
"""px within which a keypoint agrees with a pose."""
SHIFT_SIZE, LEAST_SHIFT_SIDE = 28.0, 8
"""px, size of the object on the image on which a shift is looked for, and the least side of that image."""
SHIFT_BLUR = 0.8
"""px, standard deviation of the smoothing of that image."""
MIN_LOOK_SIDE = 6
"""px, side of a look that can be found again."""
MAX_SHIFTS = 3
"""Places of the last look that are tried."""
MIN_LIKENESS = 0.4
"""Correlation of a look at a place that is tried."""
MAX_UNLIKE = 0.35
"""Share of their norm by which whitened outlines differ that are of different objects, whatever the tilt."""
WHITENED_SAMPLES, CHAIN_SAMPLES, WHITENED_APART = 64, 200, 0.1
"""Samples of an outline, and of a chain of pixels, for that, and lengths of the outline between two starts."""
GUESSED_SHAPE = 0.03
"""Share of sqrt(area), standard deviation of place and shape of a pose that was found."""
MATCHED = "matched"
"""Origin of a hypothesis that lays the whole outline on one that was found."""
KEYPOINT_SIZES = 31.0, 62.0
"""px, sqrt(area) that is left to an object when images are halved for keypoints: SIFT doubles them, so that print has a
hundred of them; and what is left for one that has become smaller, which takes four times as long."""
FINE_TURNS = 8
"""One of so many images of a loss, and its second, is searched for a smaller one."""
MAX_WAYS = 6
"""Poses that are solved for outlines: the ways in which one fits itself are rivals, and all have to be heard."""
DETECTED, DESCRIBED = AreaCost(90.0), 0.01
"""ms of keypoints, as `WorkBudget` counts: of the image that is searched, and of each that is found."""
SHIFTED, MATCHED_OUTLINE, SOLVED = 1.0, 4.0, 2.5
"""ms of a look that is shifted, of an outline that is matched, and of a pose that is solved, with its second solution."""
WHOLE = slice(0, sys.maxsize)
"""All rows of an image."""
FARTHEST = 5.0
"""Sizes of the object within which others just like it are looked for."""


class _DueSearch(NamedTuple):
    """For "outlines", thorough by all that may show them; a "shifted" look; or "keypoints", thorough of a smaller object.

    Attributes:
        strip, strips: of keypoints, that which is next of so many; 0 is before their number is known.
    """

    kind: str
    thorough: bool = False
    strip: int = 0
    strips: int = 0


class _Keypoints(NamedTuple):
    """Keypoints: (n, 2) px of the image, descriptions (n, 128) or None where there are none, px of their level, and cost."""

    points: Floats
    descriptions: Any
    unit: float
    cost: AreaCost


class Keypoints:
    """Keypoints of the object in the first image, and of all that the last look at it shows, to be found anywhere.

    Args:
        target: the object.
        levels: pyramid of the first image; they are looked for in the levels that show the object large enough.
    """

    def __init__(self, target: Target, levels: list[Grey]) -> None:
        halved = [math.log2(max(1.0, math.sqrt(target.area) / size)) for size in KEYPOINT_SIZES]
        self._coarse, self._fine = (min(int(level), len(levels) - 1) for level in halved)
        self._target, self._own = target, dict[int, _Keypoints]()
        for level in {self._coarse, self._fine}:
            mask = np.zeros_like(levels[level])
            cv2.fillPoly(mask, [np.round(target.view.outer.points / 2.0**level).astype(np.int32)], 255)
            mask = as_grey(cv2.dilate(mask, np.ones((9, 9), np.uint8)))
            self._own[level] = _detect_keypoints(levels[level], level, mask)
        self._look: Look | None = None
        self._shown = self._own[self._coarse]  # by the look
        self._image, self._found = levels, self._shown  # the last image that was searched

    def find_pose(self, levels: list[Grey], *, fine: bool, rows: slice = WHOLE) -> Floats | None:
        """(3, 3) a pose on which enough keypoints of an image's pyramid agree, or None.

        Args:
            levels: the pyramid.
            fine: the object may have become smaller.
            rows: px, those that are searched.
        """
        H = self._find_motion(self._own[self._fine if fine else self._coarse], levels, fine, rows)
        return None if H is None else self._target.pose(H)

    def are_of(self, levels: list[Grey]) -> bool:
        """Whether this pyramid was searched last."""
        return self._image is levels

    def cost(self, levels: list[Grey], *, fine: bool) -> float:
        """ms of a search of a whole pyramid in which keypoints are as dense as in the last one."""
        return self._found.cost.of(levels[self._fine if fine else self._coarse].size)

    def find_ground(self, look: Look, levels: list[Grey], *, fine: bool, rows: slice = WHOLE) -> Floats | None:
        """(3, 3) the pose of what lies as it lay in a look, by all that this shows; None where too little of it is found."""
        if self._look is not look:
            self._look = look
            self._shown = _detect_keypoints(look.levels[self._coarse], self._coarse, most=MAX_SHOWN)
        H = self._find_motion(self._shown, levels, fine, rows)
        return None if H is None else H @ look.G

    def _find_motion(self, known: _Keypoints, levels: list[Grey], fine: bool, rows: slice = WHOLE) -> Floats | None:
        """(3, 3) from the image of some keypoints to that of a pyramid, on which enough of them agree, or None."""
        if known.descriptions is None or len(known.points) < MIN_KEYPOINTS:
            return None
        if not self.are_of(levels):
            level = self._fine if fine else self._coarse
            self._image, self._found = levels, _detect_keypoints(levels[level], level, rows=rows)
        found = self._found
        if found.descriptions is None or len(found.points) < MIN_KEYPOINTS:
            return None
        pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(known.descriptions, found.descriptions, k=2)
        good = [a for a, b in (p for p in pairs if len(p) == 2) if a.distance < BETTER_MATCH * b.distance]
        if len(good) < MIN_KEYPOINTS:
            return None
        source = known.points[[m.queryIdx for m in good]]
        place = found.points[[m.trainIdx for m in good]]
        H, inliers = cv2.findHomography(source, place, cv2.USAC_FAST, KEYPOINT_REACH * found.unit)
        if H is None or inliers.sum() < MIN_KEYPOINTS:
            return None
        return np.asarray(H, dtype=np.float64)


def _detect_keypoints(
    grey: Grey, level: int, mask: Grey | None = None, most: int = MAX_KEYPOINTS, rows: slice = WHOLE
) -> _Keypoints:
    """Keypoints of a level of an image's pyramid (H, W), in some rows, px, of the image."""
    corner, part = np.array([0, rows.start >> level]), grey[rows.start >> level : rows.stop >> level]
    if mask is not None:  # what lies farther away than the object is large changes nothing of its keypoints
        x, y, width, height = cv2.boundingRect(mask)
        margin = max(width, height)
        corner = np.maximum([x - margin, y - margin], 0)
        window = (slice(corner[1], y + height + margin), slice(corner[0], x + width + margin))
        part, mask = as_grey(part[window]), as_grey(mask[window])
    found, descriptions = cv2.SIFT.create(most, contrastThreshold=KEYPOINT_CONTRAST).detectAndCompute(part, mask)
    points = np.array([point.pt for point in found]).reshape(-1, 2) + corner
    cost = AreaCost(DETECTED + DESCRIBED * len(found) / AreaCost(1.0).of(part.size))
    return _Keypoints(points * 2.0**level, descriptions, 2.0**level, cost)


def shifted_looks(target: Target, look: Look, levels: list[Grey]) -> list[Floats]:
    """Poses (3, 3) at which the last look fits again, moved as a whole, the best first."""
    outline, in_front = kernels.carry_points(look.G, target.outline)
    if not in_front > HORIZON:
        return []
    size = math.sqrt(abs(cv2.contourArea(outline.astype(np.float32))) + 1.0)
    scale = min(1.0, SHIFT_SIZE / size)
    height, width = levels[0].shape
    small = (max(LEAST_SHIFT_SIDE, int(width * scale)), max(LEAST_SHIFT_SIDE, int(height * scale)))
    level = 0
    while level + 1 < len(levels) and min(levels[level + 1].shape) >= min(small):
        level += 1
    before, now = (
        cv2.GaussianBlur(cv2.resize(pyramid[level], small, interpolation=cv2.INTER_AREA), (0, 0), SHIFT_BLUR)
        for pyramid in (look.levels, levels)
    )
    mask: Grey = np.zeros(before.shape, np.uint8)
    cv2.fillPoly(mask, [np.round(outline * scale).astype(np.int32)], 255)
    mask = as_grey(cv2.dilate(mask, np.ones((5, 5), np.uint8)))
    x, y, w, h = cv2.boundingRect(mask)
    if min(w, h) < MIN_LOOK_SIDE:
        return []
    pad = max(w, h) // 2
    wide = cv2.copyMakeBorder(now, pad, pad, pad, pad, cv2.BORDER_REPLICATE).astype(np.float32)
    patch, weight = before[y : y + h, x : x + w].astype(np.float32), (mask[y : y + h, x : x + w] > 0).astype(np.float32)
    likeness = cv2.matchTemplate(wide, patch, cv2.TM_CCOEFF_NORMED, mask=weight)
    likeness[~np.isfinite(likeness)] = -1.0
    poses = []
    for _ in range(MAX_SHIFTS):
        _, best, _, (i, j) = cv2.minMaxLoc(likeness)
        if best < MIN_LIKENESS:
            break
        T = np.eye(3)
        T[:2, 2] = (i - pad - x) / scale, (j - pad - y) / scale
        poses.append(T @ look.G)
        cv2.circle(likeness, (i, j), max(3, min(w, h) // 3), -1.0, -1)
    return poses


class Outlines:
    """Finds the outline of one object anywhere in an image.

    The observer has been told which object is meant, and has looked at each image that is searched. Without one, grey levels
    of the first image tell the object from the background, where it is darker all round, or lighter.
    """

    def __init__(self, target: Target, grey: Grey, observer: OutlineDetector | None, hidden: Grey | None) -> None:
        self._target = target
        self._observer = None if target.view.is_clipped else observer or make_detector(grey, target.view, hidden)
        self._outline: Sampled | None = None  # made at the first loss
        self.matched = 0  # by the last search

    def find_poses(self, grey: Grey, H: Floats, turn: int, *, thorough: bool) -> list[Floats]:
        """(3, 3) each, the poses at which the outline lies on one of an image: all ways in which the best of them fits.

        Args:
            grey: (H, W).
            H: (3, 3) from the first image to where the object was located last. What slides along itself keeps that tilt.
            turn: number of this search: of the thresholds that an image suggests each search tries the next.
            thorough: where the learned grey levels find nothing, try what else there is, which takes longer.
        """
        self.matched = 0
        if self._observer is None or not (thorough or self._observer.polarity):
            return []
        if self._outline is None:
            self._outline = Sampled(self._target.view)
        own, (height, width) = self._outline, grey.shape

        def unlike(shape: Silhouette) -> float:
            x, y, w, h = shape.box
            if min(x, y, width - x - w, height - y - h) <= 0:
                return math.inf
            return shape_difference(own, shape.boundary_points(CHAIN_SAMPLES))

        first = self._target.view.contours[0]
        for views in self._observer.views_anywhere(grey, abs(kernels.seen_area(H, first.points)), turn, None, unlike):
            told = [
                (judge_hypotheses(match_outlines(own, view, thorough=False)), view)
                for view in views
                if not view.is_clipped
            ]
            self.matched += len(told)
            fits = [(best.cost / best.size, t, view) for t, view in told if (best := t.best) is not None]
            if fits:
                fits.sort(key=lambda fit: fit[0])
                last = first.transformed(H)
                return [
                    self._target.pose(way) for _, t, view in fits for way in _match_homographies(t, view.outer, last, H)
                ]
            if not thorough:
                break
        return []


def _match_homographies(told: MatchOutcome, outline: Contour, last: Contour, H: Floats) -> list[Floats]:
    """(3, 3) each, first image -> image: the ways in which the object lies on an outline, `last` being where H had it."""
    assert told.best is not None
    if not told.best.can_slide or told.others:
        return [m.homography for m in (told.best, *told.others)]
    found = [as_similarity(fit, last, outline) @ H for fit in find_alignments(last, outline)]
    return found or [told.best.homography]


def make_detector(grey: Grey, view: View, hidden: Grey | None) -> OutlineDetector | None:
    """What finds an object by the grey levels on both sides of its outline; None where they do not tell."""
    polarity = polarity_of(grey, view.outer)
    if not polarity:
        return None
    points = view.outer.points
    normals = np.ascontiguousarray(outward_normals(points, 1))
    sides = kernels.search_along_normals(grey, points, normals, SIDE_REACH, polarity)[:, 2:]
    inside, outside = np.nanmedian(sides, axis=0).tolist() if np.isfinite(sides).any() else (math.nan, math.nan)
    if not (outside - inside) * polarity > 0.0:
        return None
    observer = OutlineDetector(hidden)
    observer.set_image(grey)
    observer.choose_object(Candidate(view, polarity, inside, outside))
    return observer


def shape_difference(a: Sampled, outline: Floats) -> float:
    """Share of the whitened outline's norm by which an outline (N, 2) differs at least; infinite for another object's."""
    try:
        found = kernels.initial_alignments(a.outer, outline, BENDS, WHITENED_SAMPLES, WHITENED_APART, 1)
    except ValueError:  # a hair, or a tangle: so few of its points enclose nothing
        return math.inf
    share = float(found[0, 0]) if len(found) else 0.0
    return share if share <= MAX_UNLIKE else math.inf


def check_search_ms(search_ms: float | None, name: str = "search_ms") -> float | None:
    """The work that a search for a lost object may do in an image, ms; None is no bound. A message calls it by the name.

    Raises:
        InputError: not above 0.
    """
    if search_ms is not None and not search_ms > 0.0:
        raise InputError(f"{name} is a number of ms above 0, not {search_ms:g}", search_ms=search_ms)
    return search_ms


def wide_prior(target: Target) -> Floats:
    """(8, 8) covariance of a pose that was found, work px^2."""
    return np.asarray(
        np.diag([GUESSED_SHAPE * target.size] * 6 + [GUESSED_TILT * target.size] * 2) ** 2, dtype=np.float64
    )


class Redetection:
    """Looks for an object that was lost, by turns, so that no image costs much more than another.

    Args:
        target: the object.
        levels: pyramid of the first image.
        observer: finds outlines; it has been told which object is meant. Without one it is made from the image.
        hidden: (H, W) nonzero where nothing belongs to the scene.
    """

    def __init__(
        self, target: Target, levels: list[Grey], observer: OutlineDetector | None = None, hidden: Grey | None = None
    ) -> None:
        self._target = target
        self._keypoints = Keypoints(target, levels)
        self._outlines = Outlines(target, levels[0], observer, hidden)
        self.samples = OutlineSamples(target, levels[0], target.A)
        self._waiting: list[_DueSearch] = []
        self._rows = WHOLE  # of the last search for keypoints

    def search_image(self, state: TrackState, levels: list[Grey], work: WorkBudget) -> list[Hypothesis]:
        """Hypotheses that continuity did not give, worth solving, the most promising first.

        What was sighted in the image before, and outlines by the learned grey levels, cost little and are looked at in each
        image. Keypoints are looked for in the first two images of a loss and in every other one, the last look and what else
        may show outlines in every third. What does not fit into the bound waits for the next images: that which has waited
        longest comes first, and is done in any case. What one image shows is decided as a whole, for rivals have to be heard.

        Args:
            state: of the object.
            levels: the image's pyramid.
            work: that may be done.
        """
        wide, turn = wide_prior(self._target), state.lost
        due = [_DueSearch("outlines", turn % 3 == 2)] + [_DueSearch("shifted")] * (turn % 3 == 0)
        due += [_DueSearch("keypoints", _is_fine_turn(turn))] * _is_turn_of_keypoints(turn)
        if math.isinf(work.limit_ms):  # all that is due is done, whatever an image before had no time for
            self._waiting.clear()
        waiting = {each[:2] for each in self._waiting}
        self._waiting += [each for each in due if each[:2] not in waiting]
        found, first, done = list[Hypothesis](), self._waiting[0], set[str]()
        others = [] if state.sighted is None else [Hypothesis("sighted", state.sighted, wide)]
        for search in tuple(self._waiting):
            kind, thorough, strip, strips = search
            strips = strips or self._strips(search, state, levels, work.limit_ms)
            solved = SOLVED * (len(found) + min(len(others), MAX_SOLVED))
            fits = work.allows(solved + self._cost(search, levels) / strips)
            if search is not first and (kind in done or not fits):  # an image has one of a kind
                continue
            self._waiting.remove(search)
            done.add(kind)
            if kind == "outlines":
                matches = self.matches_in(state.located, levels, turn, thorough=thorough)
                found += self.samples.promising(levels[0], matches, MAX_WAYS, found)
            elif kind == "shifted":
                others += [Hypothesis("shifted", G, wide) for G in shifted_looks(self._target, state.located, levels)]
            else:
                self._waiting += [search._replace(strip=strip + 1, strips=strips)] * (strip + 1 < strips)
                height, lap = len(levels[0]) / strips, self._size(state) / 2.0  # for an object between two strips
                self._rows = slice(int(max(0.0, strip * height - lap)), int((strip + 1) * height + lap))
                G = self._keypoints.find_pose(levels, fine=thorough, rows=self._rows)
                others += [] if G is None else [Hypothesis("keypoints", G, wide)]
            work.spend(self._cost(search, levels) / strips)  # by what was found
        return found + self.samples.promising(levels[0], others, known=found)

    def _cost(self, search: _DueSearch, levels: list[Grey]) -> float:
        """ms of a search of the whole image, if it finds as much as the last one did."""
        if search.kind == "shifted":
            return SHIFTED
        if search.kind == "outlines":
            return THRESHOLDED.of(levels[0].size) + MATCHED_OUTLINE * self._outlines.matched
        return self._keypoints.cost(levels, fine=search.thorough)

    def _strips(self, search: _DueSearch, state: TrackState, levels: list[Grey], limit_ms: float) -> int:
        """In how many strips an image is searched for keypoints, so that one fits into a bound and may show the object."""
        fitting = math.ceil(self._cost(search, levels) / limit_ms) if search.kind == "keypoints" else 1
        return max(1, min(fitting, int(len(levels[0]) / max(self._size(state), 1.0))))

    def _size(self, state: TrackState) -> float:
        """px, sqrt(area) of the object in the last look."""
        return math.sqrt(sane_area(self._target, state.located.G))

    def matches_in(self, look: Look, levels: list[Grey], turn: int = 0, *, thorough: bool = True) -> list[Hypothesis]:
        """All ways in which the outline lies on those of an image, given the last look at the object: `Outlines.find_poses`."""
        poses = self._outlines.find_poses(levels[0], self._target.homography(look.G), turn, thorough=thorough)
        return [Hypothesis(MATCHED, G, wide_prior(self._target)) for G in poses]

    def find_lookalikes(self, state: TrackState, look: Look) -> list[Hypothesis]:
        """Where a look may show something just like the object, whole or in its plane; its own place may be among it."""
        plane, wide = state.plane.rectifications.best @ self._target.A, wide_prior(self._target)
        own = carried_in_front(look.G, self.samples.points)
        own = own[np.isfinite(own).all(axis=1)]
        edges, known = edges_in_plane(look.levels, look.G @ np.linalg.inv(plane), own), own.mean(axis=0, keepdims=True)
        found = find_placements(edges, plane, self.samples, known, farthest=FARTHEST)
        places = [Hypothesis("placed", G, wide) for G in found]
        places += self.matches_in(look, look.levels)
        return self.samples.promising(look.levels[0], places, len(places))

    def worth_solving(self, levels: list[Grey], hypotheses: list[Hypothesis]) -> list[Hypothesis]:
        """Of hypotheses of continuity after a loss those that are worth solving, and the first in any case."""
        return self.samples.promising(levels[0], hypotheses) or hypotheses[:1]

    def find_ground(self, state: TrackState, levels: list[Grey]) -> Floats | None:
        """(3, 3) where what lies as it lay in the last look has the object, by keypoints; None in images that get no search."""
        wait = any(search.kind == "keypoints" for search in self._waiting)
        if not self._keypoints.are_of(levels) and (wait or not _is_turn_of_keypoints(state.lost)):
            return None
        return self._keypoints.find_ground(state.located, levels, fine=_is_fine_turn(state.lost), rows=self._rows)


def _is_turn_of_keypoints(lost: int) -> bool:
    return lost < 2 or lost % 2 == 0


def _is_fine_turn(lost: int) -> bool:
    return lost == 1 or lost % FINE_TURNS == FINE_TURNS // 2


def best_sighted_pose(state: TrackState, estimates: list[PoseEstimate], steps: float) -> Floats | None:
    """(3, 3) of what continuity did not give and may be the object, the pose for which there is most evidence; or None.

    The object may have gone unseen for so many steps, frames of free motion.
    """
    found = [
        (pose_evidence(state, e), e)
        for e in estimates
        if e.origin not in (*CONTINUOUS, TURNED) and wrong_object_probability(state, e, steps) < 0.5
    ]
    best = max(found, key=lambda pair: pair[0], default=None)
    return None if best is None or best[0] <= 0.0 else best[1].G
