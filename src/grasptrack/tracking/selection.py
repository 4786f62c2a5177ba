# SPDX-License-Identifier: Apache-2.0
"""What of the first view is followed: samples of its outline with their edges, and a target with its surface too."""

import math
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack import kernels
from grasptrack.geometry.contours import View
from grasptrack.kernels import (
    FINE_LEVELS,
    FIRST_CELLS,
    LEAST_HALF_WIDTH,
    LEAST_SPREAD,
    MOST_HALF_WIDTH,
    NEAR_SAMPLES,
    PATCH_SIDE,
    REGION_CELLS,
)
from grasptrack.matching.samples import EVEN_SPACING, sample_evenly
from grasptrack.statistics import MAD_TO_SD
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.patches import (
    camera_noise,
    rectify_image,
    select_textured_patches,
    surface_samples,
)
from grasptrack.tracking.target import Grey, Recipe, Target, as_grey, hidden_levels
from grasptrack.transfer.alignment import turns_onto_itself
from grasptrack.typing import Bools, Floats

MAX_PATCHES, MIN_PATCHES = 120, 30
"""Patches of texture at most on the finest level, half as many on each coarser one, but never fewer than these."""
PATCHES_ACROSS = 16.0
"""Pixels of a level's patches to the object's size, at least."""
COARSEST_CORNERS = 5
"""Levels of the pyramid that corners are looked at on, at most."""
MAX_CORNERS = 80
"""Places at which a look is laid on the next image, at most."""
MARGIN, MARGIN_PX = 0.2, 12.0
"""Share of sqrt(area), and work px, of the first view that are kept round the object."""
RING_BEYOND = 0.5
"""Image sizes beyond the border of the first image up to which the ground is looked for."""
RING_PLACES = 7.0
"""Places along the side of the first view, at which the background is looked at."""
EDGE_REACH = 2
"""Work px beyond half a filter's width within which the first view's edges are looked for."""
NORMAL_REACH, SAME_SIDE, NORMAL_SDS = 2.0, 0.5, 6.0
"""Spacings of samples within which edges beside one tell its normal, least cosine between normals of one side of a part, and
standard deviations by which both may differ."""
NORMALS_TWICE = 2.0
"""Standard deviations by which noise is allowed to turn normals: it is measured by a factor of that."""
FIRST_CELL, REGION, CELL_POWER = 2.0, 0.45, 1.6
"""Cells beside the outline, from so many work px up to this share of sqrt(area), ever wider by this power: a notch or tab ends
within it."""
THIN, LEAST_THIN, SOLID = 0.02, 1.5, 0.8
"""Half the width, share of sqrt(area) and work px at least, below which a part of an object is thin, and share of its area
from which on what is not makes it solid."""
LEVEL_SPREADS = 3.0
"""Spreads within which a cell has the level of a side."""


class WorkFrame(NamedTuple):
    """Work px of a first view: their map (3, 3) to its own, width and height, the middle (2,) and sqrt(area) of the object."""

    A: Floats
    crop: tuple[int, int]
    centre: Floats
    size: float


def frame_about(view: View, numbers: Numbers) -> WorkFrame:
    """Work px about an outline of the first view."""
    outer = view.outer.points
    length = math.sqrt(view.outer.area)
    s = min(1.0, numbers.work_size / length)
    margin = MARGIN * length + MARGIN_PX / s
    # whole px: between them interpolation takes up to three quarters of the noise, which would not be measured
    low, high = np.floor(outer.min(axis=0) - margin), outer.max(axis=0) + margin
    width, height = (int(v) for v in np.ceil((high - low) * s))
    A = np.array([[1.0 / s, 0.0, low[0]], [0.0, 1.0 / s, low[1]], [0.0, 0.0, 1.0]])
    return WorkFrame(A, (width, height), ((outer - low) * s).mean(axis=0), length * s)


def _whole_frame(image: Grey) -> tuple[float, float, float]:
    """The origin of an image that was cut out of none."""
    height, width = image.shape
    return float(width), width / 2.0, height / 2.0


def make_target(
    levels: list[Grey],
    view: View,
    contacts: Floats,
    numbers: Numbers,
    hidden: Grey | None = None,
    origin: tuple[float, float, float] | None = None,
) -> Target:
    """A target of the first view.

    Args:
        levels: pyramid of the first image.
        view, contacts: the object's outline in it, and (k, 2) px.
        numbers: the core's.
        hidden: (H, W) nonzero where no image shows anything of the scene.
        origin: width and middle (x, y) of the image that the first one was cut out of, px of that piece; None of a whole one.
    """
    frame = frame_about(view, numbers)
    A, (width, height), size = frame.A, frame.crop, frame.size
    s, low = 1.0 / A[0, 0], A[:2, 2]
    image = rectify_image(levels, A, (width, height))
    noise = camera_noise(image)
    work = [((c.points - low) * s, c.hole, c.clipped) for c in view.contours]
    samples = sample_evenly(work)
    normal_noise = _normal_noise(samples.noise, numbers)
    mask: Grey = np.zeros((height, width), np.uint8)
    cv2.fillPoly(mask, [np.round(p).astype(np.int32) for p, _, _ in work], 255)
    solid = _beside_solid(mask, samples.points, size)
    edges = _detect_edges(levels, A, samples.points[solid], samples.normals[solid], noise)
    edges = edges.select(_normal_errors(edges.points, edges.normals) < NORMAL_SDS * normal_noise)
    points, normals = edges.points, edges.normals
    outline = work[0][0]
    beyond = 2 * edges.half + 3  # the outline's own edge, as wide as it is, is no surface
    surface_mask = as_grey(cv2.erode(mask, np.ones((beyond, beyond), np.uint8)))
    surface = surface_samples(surface_mask)
    work_contacts = (contacts - low) * s
    arguments = (
        numbers.kernel_table(),
        A,
        np.ascontiguousarray(frame.centre),
        size / 2.0,
        noise,
        float(edges.half),
        np.full(len(points), normal_noise),
        np.ascontiguousarray(points),
        np.ascontiguousarray(normals),
        np.ascontiguousarray(edges.contrast),
        np.ascontiguousarray(edges.inner),
        surface,
        image[surface[:, 1].astype(int), surface[:, 0].astype(int)].astype(np.float64),
        np.ascontiguousarray(work_contacts),
        *_region_cells(image, mask, points, normals, size),
    )
    covered = hidden_levels(hidden) if hidden is not None and hidden.any() else None
    recipe = Recipe(arguments, origin or _whole_frame(levels[0]), covered)
    target = recipe.build_target()
    counts = []
    stride, reduced, count = 1, image, MAX_PATCHES
    while stride == 1 or stride <= size / PATCHES_ACROSS:
        inside = as_grey(cv2.erode(surface_mask, np.ones((3, 3), np.uint8)))
        side = PATCH_SIDE * stride + 2 * (stride - 1)  # a pixel of a halved image takes in its neighbours
        inside = as_grey(cv2.erode(inside, np.ones((side, side), np.uint8), borderValue=0))
        centres = select_textured_patches(
            reduced, inside, stride, kernels.patch_noise(noise, stride), numbers.texture_contrast, count
        )
        texture = levels, centres, float(stride)
        recipe.textures.append(texture)
        counts.append(target.add_texture(*texture))
        reduced, stride, count = as_grey(cv2.pyrDown(reduced)), 2 * stride, max(MIN_PATCHES, count // 2)
    turns, is_round = turns_onto_itself(view)
    back = np.linalg.inv(A)
    # the outline of a disc turns on itself: beside it only the ground would tell, which need not turn with it
    around = np.ones((2 * PATCH_SIDE + 1, 2 * PATCH_SIDE + 1) if is_round else (9, 9), np.uint8)
    followed = as_grey(cv2.erode(mask, around, borderValue=0) if is_round else cv2.dilate(mask, around))
    half = as_grey(cv2.pyrDown(image))
    corners = select_textured_patches(
        half, followed, 2, kernels.patch_noise(noise, 2.0), numbers.texture_contrast, MAX_CORNERS
    )
    strides = [float(1 << k) for k in range(1, COARSEST_CORNERS) if k == 1 or (1 << k) <= size / PATCHES_ACROSS]
    return Target(
        view,
        contacts,
        view.outer.area,
        A,
        frame.crop,
        frame.centre,
        size,
        work_contacts,
        outline,
        points,
        normals,
        corners,
        np.array(strides),
        _background_ring_points(mask),
        tuple(np.asarray(back @ H @ A, dtype=np.float64) for H in turns),
        is_round,
        (image, surface_mask),
        tuple(counts[:FINE_LEVELS]),
        samples.spacing,
        edges.share,
        edges.width,
        noise,
        numbers,
        target,
        recipe,
    )


def _beside_solid(mask: Grey, points: Floats, size: float) -> Bools:
    """(n,) which samples of an outline lie beside what is solid of the object; all where most of it is thin.

    What is thin on a solid object is a line that the first outline ran along, as of a crosshair or of letters, more often than
    a part of its own; and of one that is, the rest tells where it lies.
    """
    radius = max(LEAST_THIN, THIN * size)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * math.ceil(radius) + 1,) * 2)
    solid = cv2.morphologyEx(mask, cv2.MORPH_OPEN, disc)
    if np.count_nonzero(solid) < SOLID * np.count_nonzero(mask):
        return np.ones(len(points), dtype=np.bool_)
    away = cv2.distanceTransform(cv2.bitwise_not(solid), cv2.DIST_L2, 5)
    x, y = np.clip(np.round(points).astype(int), 0, [mask.shape[1] - 1, mask.shape[0] - 1]).T
    return np.asarray(away[y, x] <= radius + 1.0)


class _Edges(NamedTuple):
    """Edges of the first view: places and what they show there (n, ...), how wide they are, by and for which filter."""

    points: Floats
    normals: Floats
    contrast: Floats
    inner: Floats
    share: float
    width: float
    half: int
    wanted: int

    def select(self, kept: Bools) -> "_Edges":
        """Some of them (n,)."""
        points, normals, contrast, inner = (values[kept] for values in self[:4])
        return self._replace(points=points, normals=normals, contrast=contrast, inner=inner)


def _detect_edges(levels: list[Grey], A: Floats, points: Floats, normals: Floats, noise: float) -> _Edges:
    """The edges near samples of the outline, by a filter as wide as they are: a narrow one finds only noise on a wide edge."""
    half, wanted = 0, LEAST_HALF_WIDTH
    while half < wanted:  # by the outline as it was found: where a narrow filter answers, noise is steep
        half = wanted
        wanted = _filter_half_width(
            kernels.strongest_edges(levels, A, points, normals, noise, half + EDGE_REACH, half).width, half
        )
    while True:
        edges = _edges_by(levels, A, points, normals, noise, half)
        if edges.wanted >= half:
            return edges
        half = edges.wanted


def _filter_half_width(width: Floats, half: int) -> int:
    """Work px on each side of edges (n,) so wide that tell where they are: two standard deviations."""
    told = width[np.isfinite(width)]
    return min(max(int(2.0 * float(np.median(told))), LEAST_HALF_WIDTH), MOST_HALF_WIDTH) if len(told) else half


def _edges_by(levels: list[Grey], A: Floats, points: Floats, normals: Floats, noise: float, half: int) -> _Edges:
    """The same by a filter of which half is so wide, work px."""
    reach = half + EDGE_REACH
    offset, contrast, inner, width = kernels.strongest_edges(levels, A, points, normals, noise, reach, half)
    found = np.isfinite(offset)
    share = float(found.mean()) if len(found) else 0.0
    points, normals = points[found] + offset[found, None] * normals[found], normals[found]
    # again at the edges themselves: sub-pixel positions from the same phase as all later ones
    if len(points):
        offset, contrast, inner, width = kernels.strongest_edges(levels, A, points, normals, noise, reach, half)
        found = np.isfinite(offset) & (np.abs(offset) < 1.0) & np.isfinite(inner).all(axis=1)
        points, normals = points[found] + offset[found, None] * normals[found], normals[found]
        contrast, inner, width = contrast[found], inner[found], width[found]
    told = width[np.isfinite(width)]
    typical = float(np.median(told)) if len(told) else math.nan
    return _Edges(points, normals, contrast, inner, share, typical, half, _filter_half_width(width, half))


def _normal_errors(points: Floats, normals: Floats) -> Floats:
    """(n,) rad between each normal and that of the edges beside it, as on a spur of the outline or at a sharp corner.

    By a normal that is none an outline seems to tell how far it slid along itself.
    """
    if not len(points):
        return np.zeros(0)
    x, y = points.T
    near = (x[:, None] - x) ** 2 + (y[:, None] - y) ** 2 < (NORMAL_REACH * EVEN_SPACING) ** 2
    near &= normals @ normals.T > SAME_SIDE
    weight = near / near.sum(axis=1)[:, None]
    mean_x, mean_y = (weight @ points).T
    xx, xy, yy = weight @ (x * x) - mean_x**2, weight @ (x * y) - mean_x * mean_y, weight @ (y * y) - mean_y**2
    along = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    across = np.abs(np.cos(along) * normals[:, 0] + np.sin(along) * normals[:, 1])
    return np.asarray(np.where(near.sum(axis=1) > 1, np.arcsin(np.minimum(1.0, across)), 0.0))


def _normal_noise(noise: float, numbers: Numbers) -> float:
    """rad, by which noise may turn normals that come from points EVEN_SPACING to either side, each off by this variance.

    No edge is known better than `Numbers.edge_noise`: pixels err alike along it.
    """
    return NORMALS_TWICE * math.sqrt(2.0 * (noise + numbers.edge_noise**2)) / (2.0 * EVEN_SPACING)


def _region_cells(
    image: Grey, mask: Grey, points: Floats, normals: Floats, size: float
) -> tuple[Floats, Floats, Floats]:
    """(16,) depths, work px; (N, 16) grey levels so deep inside, NaN off the material; (N, 16) whether it ends so far out."""
    last = max(2.0 * FIRST_CELL, REGION * size)
    depth = FIRST_CELL + (last - FIRST_CELL) * np.linspace(0.0, 1.0, REGION_CELLS) ** CELL_POWER
    height, width = mask.shape

    def grey_at(signed: Floats, values: Grey) -> Floats:
        at = points[:, None] + signed[None, :, None] * normals[:, None]
        x, y = (np.clip(np.round(at[..., k]).astype(int), 0, limit - 1) for k, limit in ((0, width), (1, height)))
        return np.asarray(values[y, x], dtype=np.float64)

    smooth, square = as_grey(cv2.blur(image, (3, 3))), np.ones((3, 3), np.uint8)
    inside = np.where(grey_at(-depth, as_grey(cv2.erode(mask, square))) > 0, grey_at(-depth, smooth), np.nan)
    outside = np.where(grey_at(depth, as_grey(cv2.dilate(mask, square))) == 0, grey_at(depth, smooth), np.nan)
    # what looked like the other side from the first tells of no notch and no tab
    own, ground = _level_along(inside), _level_along(outside)
    inside = np.where(np.abs(inside - ground[0][:, None]) < ground[1][:, None], np.nan, inside)
    told = np.abs(outside - own[0][:, None]) >= own[1][:, None]
    return depth, np.ascontiguousarray(inside), np.ascontiguousarray(told.astype(np.float64))


def _level_along(cells: Floats) -> tuple[Floats, Floats]:
    """(N,) median of the first cells (N, 16) of a sample and its neighbours; (N,) how far off a cell is not of that."""
    n, near = len(cells), np.arange(-NEAR_SAMPLES, NEAR_SAMPLES + 1)
    if n == 0:
        return np.zeros(0), np.zeros(0)
    around = cells[(np.arange(n)[:, None] + near) % n, :FIRST_CELLS].reshape(n, -1)
    known = np.asarray(np.isfinite(around).any(axis=1))
    around = np.where(known[:, None], around, 0.0)
    level = _row_medians(around)
    spread = MAD_TO_SD * _row_medians(np.abs(around - level[:, None])) + LEAST_SPREAD
    return np.where(known, level, np.nan), LEVEL_SPREADS * spread


def _row_medians(values: Floats) -> Floats:
    """(N,) of the numbers in each row (N, k), which has some; NaN does not count."""
    ordered, count = np.sort(values, axis=1), np.count_nonzero(np.isfinite(values), axis=1)
    row = np.arange(len(values))
    return np.asarray(0.5 * (ordered[row, (count - 1) // 2] + ordered[row, count // 2]), dtype=np.float64)


def _background_ring_points(mask: Grey) -> Floats:
    """(n, 2) work px: a grid round the object, as far as the image of the first view is wide."""
    height, width = mask.shape
    step = max(PATCH_SIDE, math.sqrt(width * height) / RING_PLACES)
    x, y = np.meshgrid(*(np.arange(-RING_BEYOND * side, (1.0 + RING_BEYOND) * side, step) for side in (width, height)))
    places = np.column_stack([x.ravel(), y.ravel()])
    reach = 2 * PATCH_SIDE + 1
    grown = cv2.dilate(
        cv2.copyMakeBorder(mask, reach, reach, reach, reach, cv2.BORDER_CONSTANT), np.ones((reach, reach), np.uint8)
    )
    i = np.clip(np.round(places).astype(int) + reach, 0, [width + 2 * reach - 1, height + 2 * reach - 1])
    inside = (places > -reach).all(axis=1) & (places < [width + reach, height + reach]).all(axis=1)
    kept = places[~(inside & (grown[i[:, 1], i[:, 0]] > 0))]
    # the first of them, which is what coarse levels look at, lie all round
    return np.ascontiguousarray(np.random.default_rng(0).permutation(kept))
