# SPDX-License-Identifier: Apache-2.0
"""From the pixel chain around a silhouette to a sub-pixel contour, and its holes: where the background is seen, not print."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np

from grasptrack import kernels
from grasptrack.errors import ContourError
from grasptrack.geometry.contours import Contour
from grasptrack.images import Grey
from grasptrack.kernels.results import TraceOptions
from grasptrack.segmentation.closed_edges import CHROMA, LIGHTNESS, Planes
from grasptrack.segmentation.silhouettes import MIN_AREA, Chain, Silhouette, fill_polygon, to_binary, trace_silhouettes
from grasptrack.statistics import robust_sd
from grasptrack.typing import Bools, Floats

SPACING = 1.0
"""px between contour points."""
MAX_POINTS = 1600
SMOOTHING = 4.0
"""px of outline over which the steps of the chain are averaged before the edge search."""
EDGE_REACH = 4.0
"""px on either side of the silhouette's boundary in which the edge is searched; thresholds are off by at most this."""
OUTLIER = 1.0
"""px; an edge farther from the median of its neighbours is a different edge."""
BORDER = 1.5
"""px; a point nearer to the image border counts as cut off."""
HIDDEN_MARGIN = 3.0
"""px; the same for ignored pixels, before which a silhouette ends a little early."""

MIN_SHARPNESS = 0.5
"""Least strength of a hole's edge relative to the outer one, ..."""
MOST_SHARP, MOSTLY_SHARP = 0.8, 0.7
"""... and the share of it, beside that of the outer one, that is as strong; print is seldom as sharp. If less of the outer one
is, as under a glare, it is no measure."""
HOLE_CONTRAST = 0.25
"""A hole shows the same background as around the object, within this fraction of the contrast."""
MAX_HOLES = 12
"""Holes that are examined, the largest first."""
MIN_HOLE_SHARE = 0.004
"""Smallest hole found by colour alone, as a share of its object."""
ALIKE = 3.0
"""The background in a hole differs from that around the object by at most this many times its noise."""
MIN_RIM = 3
"""px, least width of material between a hole and the outline; what reaches the outline is a notch, or enclosed
background."""
RIM_SAMPLES = 64
"""Points of a region's boundary, some, at which it is asked whether it lies within another."""
WINDOW_MARGIN = 12
"""px of background around the object that are examined."""
GROUND_SAMPLES = 2000
"""Patches of ground, some, that are looked at."""
PATCH, MOST_WITHIN, MOST_BESIDE = 9, 0.8, 0.97
"""px across of the patches of ground whose colours are compared; and the shares of them, in a hole and beside the object, that
are looked at: a seam that runs through a hole covers more of that than of the rest."""
REFITS = 8
"""Times that the surfaces of the ground's light are fitted, each time with less weight of what lies off them."""
TOLERANCE = 1e-6


class LocalizedContour(NamedTuple):
    """A contour with the median grey levels on its inner and outer side."""

    contour: Contour
    inside: float
    outside: float


def localize_contour(
    grey: Grey, chain: Chain, *, hole: bool, polarity: int, hidden: Grey | None = None, reach: float = EDGE_REACH
) -> LocalizedContour:
    """Sub-pixel contour from the chain (N, 2) of a silhouette's boundary pixels, each point moved along its normal.

    Args:
        grey: (H, W) image.
        chain: as cv2.findContours returns it: pixel centres just inside the material.
        hole: the chain runs around a hole.
        polarity: +1 for an object darker than its surroundings, -1 for a lighter one, 0 for either.
        hidden: (H, W) nonzero where pixels are ignored; points beside them count as cut off.
        reach: px on either side of the chain in which the edge is searched.

    Raises:
        ContourError: fewer than 8 points or no area.
    """
    how = TraceOptions(hole, polarity, SPACING, MAX_POINTS, SMOOTHING, reach, BORDER, OUTLIER)
    points, strength, cut, inside, outside = kernels.trace_edges(grey, chain, hidden, how)
    if hidden is not None:
        cut = cut | is_near_hidden(points, hidden)
    return LocalizedContour(Contour.trusted(points, hole=hole, strength=strength, clipped=cut), inside, outside)


def is_near_hidden(points: Floats, hidden: Grey) -> Bools:
    """(N,) whether a pixel within HIDDEN_MARGIN px along the axes is ignored. A silhouette ends just before such pixels."""
    height, width = hidden.shape
    found = np.zeros(len(points), dtype=np.bool_)
    for dx, dy in ((HIDDEN_MARGIN, 0.0), (-HIDDEN_MARGIN, 0.0), (0.0, HIDDEN_MARGIN), (0.0, -HIDDEN_MARGIN)):
        x = np.rint(np.clip(points[:, 0] + dx, 0, width - 1)).astype(np.intp)
        y = np.rint(np.clip(points[:, 1] + dy, 0, height - 1)).astype(np.intp)
        found |= hidden[y, x] != 0
    return found


def localize_holes(
    grey: Grey, chains: list[Chain], outer: LocalizedContour, polarity: int, hidden: Grey | None
) -> list[Contour]:
    """The holes whose edge is sharp and shows the background around the outer contour; print seldom does both."""
    found = (_localize_hole(grey, chain, outer, polarity, hidden) for chain in chains[:MAX_HOLES])
    return [hole for hole in found if hole is not None]


def _localize_hole(
    grey: Grey, chain: Chain, outer: LocalizedContour, polarity: int, hidden: Grey | None
) -> Contour | None:
    try:
        hole = localize_contour(grey, chain, hole=True, polarity=polarity, hidden=hidden)
    except ContourError:
        return None
    strength, reference = hole.contour.strength, outer.contour.strength
    if strength is None or reference is None:
        return None
    # noise leads points astray on both; where edges of either sign count grain has as many
    sharp, usual = (float((s >= MIN_SHARPNESS * np.median(reference)).mean()) for s in (strength, reference))
    if sharp < MOST_SHARP * (usual if polarity and usual > MOSTLY_SHARP else 1.0):
        return None
    if polarity and not abs(hole.outside - outer.outside) <= HOLE_CONTRAST * abs(outer.outside - outer.inside):
        return None
    return hole.contour


def background_within(image: Planes, shape: Silhouette) -> list[Chain]:
    """Pixel chains around the places within a silhouette that look like the background, the largest first.

    The background around the silhouette is extrapolated to its inside by a wide average.
    """
    left, top, right, bottom = shape.box_window(WINDOW_MARGIN, image.shape)
    window = np.ascontiguousarray(image[top:bottom, left:right])
    filled = shape.filled_window((left, top, right, bottom))
    outside = (cv2.dilate(filled, np.ones((7, 7), np.uint8)) == 0).astype(np.float32)
    if not outside.any():
        return []
    wide = (2 * (shape.longer_side // 2) + 1,) * 2  # a box filter: a Gaussian this wide is slow
    weight = cv2.blur(outside, wide) + TOLERANCE
    background = cv2.blur(window * outside[:, :, None], wide).reshape(window.shape) / weight[:, :, None]
    soft = cv2.GaussianBlur(window, (0, 0), 1.0).reshape(window.shape)
    away = np.sqrt(((soft - background) ** 2).sum(axis=2))
    grain = float(np.median(away[outside > 0]))
    deep = cv2.erode(filled, np.ones((2 * MIN_RIM + 1, 2 * MIN_RIM + 1), np.uint8))
    if not deep.any():
        return []
    limit = min(ALIKE * max(grain, 1.0), HOLE_CONTRAST * float(np.median(away[deep > 0])))
    three = np.ones((3, 3), np.uint8)
    alike = cv2.morphologyEx(to_binary((filled > 0) & (away <= limit)), cv2.MORPH_OPEN, three)
    # the chain of a hole runs through the adjacent material
    grown = np.asarray(cv2.dilate(alike, three), dtype=np.uint8)
    found = trace_silhouettes(grown, max(MIN_HOLE_SHARE * shape.area, MIN_AREA), holes=False)
    whole = [s for s in found if (deep[s.outer[:, 1], s.outer[:, 0]] > 0).all()]
    return [s.outer + np.array([left, top], np.int32) for s in whole[:MAX_HOLES]]


def enclosed_chains(
    shape: Silhouette, regions: Iterable[Silhouette], holes: Sequence[Contour], size: tuple[int, ...]
) -> list[Chain]:
    """Pixel chains of the regions well within a silhouette that may be holes of it, the largest first, none within another.

    Beside those that are known; in an image of (height, width).
    """
    taken = np.zeros(size[:2], np.uint8)
    for hole in holes:
        taken |= fill_polygon(hole.points, size)
    chains, (x, y, w, h) = list[Chain](), shape.box
    for inner in sorted(regions, key=lambda each: -each.area):
        u, v, p, q = inner.box
        within = x < u and y < v and u + p < x + w and v + q < y + h
        large = max(MIN_HOLE_SHARE * shape.area, MIN_AREA) <= inner.area < shape.area
        column, row = inner.outer.T
        if not within or not large or taken[row, column].any():
            continue
        if all(shape.depth_at(*at) > MIN_RIM for at in inner.boundary_points(RIM_SAMPLES).tolist()):
            chains.append(inner.outer)
            cv2.drawContours(taken, [inner.outer.reshape(-1, 1, 2)], -1, (255,), cv2.FILLED)
    return chains


def holes_on_ground(planes: Planes, shape: Silhouette, holes: Sequence[Contour]) -> list[Contour]:
    """Those holes of a silhouette whose inside is the ground: print has other colours, or several.

    How far patches of the ground differ is measured beside the silhouette.
    """
    left, top, right, bottom = window = shape.box_window(WINDOW_MARGIN, planes.shape)
    seen = np.ascontiguousarray(planes[top:bottom, left:right])
    patches = np.asarray(cv2.blur(seen, (PATCH, PATCH)), dtype=np.float32).reshape(seen.shape)
    around = cv2.dilate(shape.filled_window(window), np.ones((2 * PATCH - 3,) * 2, np.uint8)) == 0
    if not around.any():
        return list(holes)
    light = _fit_ground_light(patches, around)
    seen, patches = seen - light, patches - light
    beside = patches[around][:: max(1, np.count_nonzero(around) // GROUND_SAMPLES)]
    noise = np.hypot([robust_sd(plane) for plane in beside.T], [LIGHTNESS, CHROMA, CHROMA][: beside.shape[1]])

    def unlikeness(colours: Any) -> Floats:
        away = colours / noise
        return np.asarray(np.maximum(np.abs(away[..., 0]), np.hypot.reduce(away[..., 1:], axis=-1)), dtype=np.float64)

    usual = max(float(np.quantile(unlikeness(beside), MOST_BESIDE)), 1.0)
    kept = []
    for hole in holes:
        filled = fill_polygon(hole.points - (left, top), seen.shape)
        depth = cv2.distanceTransform(filled, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        inside, deep = depth > 0.5 * float(depth.max()), cv2.erode(filled, np.ones((PATCH + 4,) * 2, np.uint8)) > 0
        alike = not inside.any() or unlikeness(np.median(seen[inside], axis=0)) <= ALIKE
        if alike and (not deep.any() or np.quantile(unlikeness(patches[deep]), MOST_WITHIN) <= ALIKE * usual):
            kept.append(hole)
    return kept


def _fit_ground_light(patches: Planes, around: Bools) -> Planes:
    """(h, w, C) what light and lens make of the ground's colours (h, w, C): surfaces of second order in the image, fitted
    where the ground is seen; what lies on it counts little."""
    rows, columns = np.nonzero(around)
    step = max(1, len(rows) // GROUND_SAMPLES)
    height, width = around.shape
    y, x = (np.linspace(-1.0, 1.0, n) for n in (height, width))

    def quadratic_terms(u: Floats, v: Floats) -> Floats:
        return np.stack(np.broadcast_arrays(np.ones_like(u), u, v, u * u, u * v, v * v), axis=-1)

    at, seen = (
        quadratic_terms(x[columns[::step]], y[rows[::step]]),
        patches[rows[::step], columns[::step]].astype(np.float64),
    )
    fitted = np.zeros((at.shape[1], seen.shape[1]))
    for k in range(seen.shape[1]):
        weight, level = np.ones(len(at)), seen[:, k]
        fitted[0, k] = np.median(level)
        for _ in range(REFITS):
            away = level - at @ fitted[:, k]
            weight = 1.0 / (1.0 + (away / max(robust_sd(away), LIGHTNESS)) ** 2)
            normal = at.T @ (weight[:, None] * at) + TOLERANCE * len(at) * np.eye(at.shape[1])
            fitted[:, k] = np.linalg.solve(normal, at.T @ (weight * level))
    return np.asarray(quadratic_terms(*np.meshgrid(x, y)) @ fitted, dtype=np.float32)
