# SPDX-License-Identifier: Apache-2.0
"""A first outline with a bite, a bridge or a highlight in it: found out by the views that follow, and mended once.

The first view defines the contacts and the plane in which poses are told; both stay. Its outline is only what one image
showed.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack import kernels
from grasptrack.errors import ObservationError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.kernels import LEAST_SPREAD
from grasptrack.segmentation.candidate import Candidate
from grasptrack.segmentation.first_look import find_candidates
from grasptrack.segmentation.silhouettes import SUBPIXEL_BITS
from grasptrack.statistics import robust_sd
from grasptrack.tracking.decision import Decision
from grasptrack.tracking.estimator import estimate_pose
from grasptrack.tracking.evidence import texture_evidence
from grasptrack.tracking.learning import FOLLOWED_PRESENCE
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.pose import Hypothesis, Look, PoseEstimate
from grasptrack.tracking.selection import make_target
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Grey, Target, as_grey, build_pyramid
from grasptrack.typing import Bools, Floats

VIEWS = 6
"""Later views of which a second look at the first view is made, ..."""
TRIALS = 3
"""... and those on which both outlines are then tried."""
LOOKS = 3
"""Second looks at most, each after twice as many views."""
ROOM = 0.5
"""Share of sqrt(area) round the outline that a second look shows."""
ROUND = 0.2
"""Share of sqrt(area) round what differs in which the sides are looked at."""
NEAR = 2.0
"""px within which an outline goes along where an edge was seen."""
BESIDE = 3
"""px from all outlines at which a side's grey levels are its own."""
CHANCE = 0.3
"""Share of an outline for which grained ground offers edges by chance."""
SURE = 20.0
"""Nats beyond which a look at grey levels says no more."""
SATURATED = 250
"""Grey level from which on an image shows nothing but light."""


class Mended(NamedTuple):
    """A first view with another outline than at first.

    Attributes:
        target: of it.
        levels: pyramid of the first image as later views show it.
        usual: of each patch of the target's three finest levels: its correlation.
        share: of the first outline that was none.
    """

    target: Target
    levels: list[Grey]
    usual: list[Floats]
    share: float


class _Trial(NamedTuple):
    """Another outline of the first view, to be tried on further views.

    Attributes:
        target: of it.
        levels: pyramid of the first image as later views show it.
        apart: (n,) which of its samples do not lie on the first outline.
        looks: nats, of what lies between both outlines: of object and ground as the other one has them, against a cover.
        lit: light alone tells why the first image shows another.
        seen: of each further view: the share of these samples that show their edge.
    """

    target: Target
    levels: list[Grey]
    apart: Bools
    looks: float
    lit: bool
    seen: list[float]

    def odds(self, numbers: Numbers) -> float:
        """Of this outline against the first one: its edges seen by chance, or those of something that covers the first one.

        The views show the same: they are no independent witnesses.
        """
        points = self.target.points
        spacing = float(np.median(np.hypot(*(np.roll(points, -1, axis=0) - points).T)))
        independent = float(self.apart.sum()) * min(1.0, spacing / numbers.sample_distance)
        seen, miss = float(np.mean(self.seen)), numbers.edge_missed
        edges = seen * math.log((1.0 - miss) / CHANCE) + (1.0 - seen) * math.log(miss / (1.0 - CHANCE))
        against = math.exp(-independent * edges) + numbers.share_occluded * math.exp(-self.looks)
        return self.prior_probability(numbers) / against

    def prior_probability(self, numbers: Numbers) -> float:
        """Probability that a first image such as this one shows another outline."""
        return 1.0 if self.lit else numbers.misled


class Mender:
    """Compares the first outline with the views that follow.

    Args:
        target: of the first view.
        levels: pyramid of the first image.
        hidden: (H, W) nonzero where no image shows anything of the scene.
    """

    def __init__(self, target: Target, levels: list[Grey], hidden: Grey | None = None) -> None:
        self._target, self._levels, self._hidden = target, levels, hidden
        self._agreed: Bools = np.zeros(len(target.points), dtype=np.bool_)
        self._views: list[Look] = []
        self._seen = self._accepted = self._looks = 0
        self._trial: _Trial | None = None
        self.is_over = target.view.is_clipped or not len(target.points)

    def examine_image(self, state: TrackState, levels: list[Grey], decision: Decision) -> Mended | None:
        """What another image says of the first outline: another one, once it is surely that; not to be asked once it is over.

        Args:
            state: of the object.
            levels: the image's pyramid.
            decision: of the image.
        """
        e = decision.estimate
        if e is None or not self._is_trusted(decision):
            return None
        self._seen += 1
        self._agreed |= e.visible > 0.5
        self._views = [*self._views[1 - VIEWS :], Look(levels, e.G)]
        if self._trial is not None:
            return self._try_outlines(state, levels, e)
        if self._seen < VIEWS << self._looks:
            return None
        self.is_over = self._looks == LOOKS or self._longest_open() < 2.0 * self._target.numbers.tolerance
        if not self.is_over:
            self._looks += 1
            self._trial = self._second_look()
        return None

    def _is_trusted(self, decision: Decision) -> bool:
        """Whether the pose is the object's: as believed; or, where nothing was believed yet, whatever its outline is."""
        if decision.is_accepted:
            self._accepted += 1
            return True
        placed = decision.presence > FOLLOWED_PRESENCE and 2.0 * decision.sigma < decision.tolerance
        doubted = decision.code == "outline-open" or (not self._accepted and decision.code == "other-shape")
        return doubted and placed

    def _longest_open(self) -> float:
        """The longest stretch of the first outline, as a share of sqrt(area), along which no later view showed its edge."""
        target = self._target
        every = max(1, len(target.outline) // len(target.points))  # no closer together than the samples
        return _longest_open_stretch(target.outline[::every], target.points[self._agreed]) / target.size

    # --- another look at the first view ----------------------------------------------------------

    def _second_look(self) -> _Trial | None:
        """The first view as the later ones show it, and the outline that it then has; None where that is no other."""
        target, grey = self._target, self._levels[0]
        x0, y0, x1, y1 = _window_bounds(target.view, grey.shape)
        shift = np.array([x0, y0], dtype=np.float64)
        first = np.ascontiguousarray(grey[y0:y1, x0:x1])
        seen = [_warp_to_first(view, target, first, shift) for view in self._views]
        shown = as_grey(np.round(np.asarray(np.median(np.array(seen), axis=0))))
        hidden = None if self._hidden is None else np.ascontiguousarray(self._hidden[y0:y1, x0:x1])
        try:
            found = find_candidates(shown, FirstImage(hidden=hidden))
        except ObservationError:
            return None
        edges = apply_homography(target.A, target.points[self._agreed]) - shift
        own = _shift_view(target.view, -shift)
        candidate = max(found, key=lambda c: _share_on_outline(c, edges))
        if _share_on_outline(candidate, edges) < 1.0 - target.numbers.elsewhere or candidate.view.is_clipped:
            return None
        samples = apply_homography(target.A, target.points) - shift
        gone = kernels.project_to_contour(candidate.view.points, candidate.view.offsets, samples)[:, 2] > NEAR
        if gone.any() and self._agreed[gone].mean() > CHANCE:  # what was seen once was right
            return None
        sides = _Sides(first, shown, own, candidate.view)
        looks = sides.appearance_log_odds(target.noise, target.numbers)
        if not looks > 0.0:
            return None
        whole = grey.copy()
        whole[y0:y1, x0:x1] = shown
        levels = build_pyramid(whole)
        view = _shift_view(candidate.view, shift)
        other = make_target(levels, view, target.contacts, target.numbers, self._hidden, like=target)
        lit = float(np.mean(first[sides.differ] >= SATURATED)) > 0.5
        return _Trial(other, levels, _outline_distances(other.points, target.outline) > NEAR, looks, lit, [])

    # --- which outline the views that follow show ------------------------------------------------

    def _try_outlines(self, state: TrackState, levels: list[Grey], e: PoseEstimate) -> Mended | None:
        """Another image for both outlines."""
        trial, numbers = self._trial, self._target.numbers
        assert trial is not None
        # the first outline may have drawn the pose along
        near = Hypothesis(e.origin, e.G, e.P + numbers.predicted**2 * self._target.noise_of_motion)
        other = estimate_pose(replace(state, target=trial.target), levels, near)
        if other is not None and trial.apart.any():
            trial.seen.append(float(other.visible[trial.apart].mean()))
            if len(trial.seen) < TRIALS:
                return None
        self._trial = None
        if other is None or not trial.seen or not trial.odds(numbers) > 1.0 / numbers.risk:
            return None
        if not self._is_same(trial, state, e):
            return None
        self.is_over = True
        usual = [np.clip(np.nan_to_num(r), 0.0, 1.0) for r in other.correlation]
        share = float(np.mean(_outline_distances(self._target.outline, trial.target.outline) > NEAR))
        return Mended(trial.target, trial.levels, usual, share)

    def _is_same(self, trial: _Trial, state: TrackState, e: PoseEstimate) -> bool:
        """Whether it is still the first view's object, and not another one that was brought before the second view.

        Where views were believed this is decided. Else both explain them, and the priors tell; another object need not
        have the surface of the first, and an image that shows only light there says why its outline was another.
        """
        if self._accepted >= TRIALS:
            return True
        numbers = self._target.numbers
        surface = texture_evidence(state, e)
        another = numbers.exchanged * max(numbers.same_surface, math.exp(-max(0.0, surface)))
        return another / (another + trial.prior_probability(numbers)) < numbers.risk


class _Sides:
    """What two outlines of one view differ by, and the grey levels that object and ground have beside that.

    Args:
        first, shown: (H, W) the view as the first image shows it, and as later ones do.
        own, other: the outlines, px.

    Attributes:
        differ: (H, W) material of one of them alone.
    """

    def __init__(self, first: Grey, shown: Grey, own: View, other: View) -> None:
        before, after = (_material_mask(view, shown.shape) for view in (own, other))
        square = np.ones((2 * BESIDE + 1, 2 * BESIDE + 1), np.uint8)
        self._inside = cv2.erode(before & after, square) > 0
        self._outside = cv2.dilate(before | after, square) == 0
        open_ = as_grey(cv2.morphologyEx(before ^ after, cv2.MORPH_OPEN, np.ones((BESIDE, BESIDE), np.uint8)))
        self._added, self._removed = (open_ & after) > 0, (open_ & before) > 0
        self.differ: Bools = np.asarray(self._added | self._removed, dtype=np.bool_)
        self._first, self._shown = first.astype(np.float64), shown.astype(np.float64)
        self._reach = max(2 * BESIDE, round(ROUND * math.sqrt(other.outer.area)))

    def appearance_log_odds(self, noise: float, numbers: Numbers) -> float:
        """Nats by which what they differ by looks like object or ground as the other one has them, rather than like something
        in front of both, which would not end where the first outline does; 0 where they do not differ.

        Args:
            noise: grey levels, of the camera.
            numbers: the core's.
        """
        parts = [(self._added, self._inside), (self._removed, self._outside)]
        told = [self._side_log_ratio(part, side, numbers) for part, side in parts if part.any()]
        if told:
            told.append(self._background_log_ratio(noise, numbers))
        return min(max(numbers.cell_power * min(told, default=0.0), -SURE), SURE)

    def _side_log_ratio(self, part: Bools, side: Bools, numbers: Numbers) -> float:
        """Nats a pixel by which a part has the grey levels of a side near it, rather than those of a cover."""
        own = self._shown[side & self._nearby_mask(part)]
        if not len(own):
            return 0.0
        level = float(np.median(own))
        spread = robust_sd(own - level) + LEAST_SPREAD
        return _mean_log_ratio(self._shown[part] - level, spread, numbers)

    def _background_log_ratio(self, noise: float, numbers: Numbers) -> float:
        """Nats a pixel by which the ground beside is as it was, as far as the first image showed it, rather than covered."""
        known = self._outside & (self._first < SATURATED)
        beside = known & self._nearby_mask(self.differ)
        if not beside.any():
            return 0.0
        changed = self._shown - self._first
        light = float(np.median(changed[known]))
        return _mean_log_ratio(changed[beside] - light, math.sqrt(2.0) * noise + LEAST_SPREAD, numbers)

    def _nearby_mask(self, part: Bools) -> Bools:
        square = np.ones((2 * self._reach + 1, 2 * self._reach + 1), np.uint8)
        return np.asarray(cv2.dilate(part.astype(np.uint8), square) > 0)


def _mean_log_ratio(off: Floats, spread: float, numbers: Numbers) -> float:
    """Mean log-likelihood ratio of grey levels that are so far off what is expected, (n,): of that, against a cover."""
    own, cover = spread**2, spread**2 + numbers.cell_cover**2
    ratio = math.sqrt(cover / own) * np.exp(0.5 * off**2 * (1.0 / cover - 1.0 / own))
    return float(np.mean(np.log((1.0 - numbers.cell_unlikely) * ratio + numbers.cell_unlikely)))


def _outline_distances(points: Floats, outline: Floats) -> Floats:
    """(n,) distance of points (n, 2) from a closed outline (N, 2), in their unit."""
    offsets = np.array([0, len(outline)], dtype=np.int64)
    return np.asarray(
        kernels.project_to_contour(outline, offsets, np.ascontiguousarray(points))[:, 2], dtype=np.float64
    )


def _longest_open_stretch(outline: Floats, edges: Floats) -> float:
    """Length of the longest stretch of a closed outline (N, 2) that lies by none of some places (n, 2), in their unit."""
    step = np.hypot(*(np.roll(outline, -1, axis=0) - outline).T)
    if not len(edges):
        return float(step.sum())
    apart = np.hypot(*(np.roll(edges, -1, axis=0) - edges).T)
    near = 2.0 * float(np.median(apart))
    bare = np.full(len(outline), True)
    for block in range(0, len(outline), 256):
        here = outline[block : block + 256, None] - edges[None]
        bare[block : block + 256] = (here**2).sum(axis=2).min(axis=1) > near**2
    if bare.all():
        return float(step.sum())
    start = int(np.flatnonzero(~bare)[0])
    longest = length = 0.0
    for is_bare, way in zip(np.roll(bare, -start).tolist(), np.roll(step, -start).tolist(), strict=True):
        length = length + way if is_bare else 0.0
        longest = max(longest, length)
    return longest


def _window_bounds(view: View, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Left, top, right and bottom px of the part of an image round an outline."""
    room = ROOM * math.sqrt(view.outer.area)
    (x0, y0), (x1, y1) = view.outer.bounds
    height, width = shape
    return max(0, int(x0 - room)), max(0, int(y0 - room)), min(width, int(x1 + room)), min(height, int(y1 + room))


def _warp_to_first(view: Look, target: Target, first: Grey, shift: Floats) -> Grey:
    """(h, w) a window of the first image as a later view shows it; what that does not hold stays as it is."""
    H = target.homography(view.G) @ np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]], [0.0, 0.0, 1.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = first.shape[1], first.shape[0]
    out = cv2.warpPerspective(view.levels[0], H, size, first.copy(), flags=flags, borderMode=cv2.BORDER_TRANSPARENT)
    return as_grey(out)


def _share_on_outline(candidate: Candidate, edges: Floats) -> float:
    """Share of edges (n, 2) px that lie on a candidate's outline."""
    view = candidate.view
    return float(
        np.mean(kernels.project_to_contour(view.points, view.offsets, np.ascontiguousarray(edges))[:, 2] < NEAR)
    )


def _shift_view(view: View, by: Floats) -> View:
    """The same outline moved by (x, y) px."""
    return View(
        [Contour.trusted(c.points + by, hole=c.hole, strength=c.strength, clipped=c.clipped) for c in view.contours]
    )


def _material_mask(view: View, shape: tuple[int, ...]) -> Grey:
    """(H, W) 1 on the material, else 0."""
    mask: Grey = np.zeros(shape[:2], np.uint8)
    corners = [np.round(c.points * 2.0**SUBPIXEL_BITS).astype(np.int32) for c in view.contours]
    cv2.fillPoly(mask, corners, (1,), shift=SUBPIXEL_BITS)
    return mask
