# SPDX-License-Identifier: Apache-2.0
"""How much of each pixel a polygon covers behind a Gaussian lens blur, from the exact distance to its edge.

cv2.fillPoly also draws the pixels that the edge touches, so an outline rendered with it lies about half a sub-pixel too
far out. Here the edge is where the polygon says it is: along a straight edge the coverage is Phi(d / sigma), the exact
convolution of a half plane with the blur, and at corners its value 1/2 stays on the polygon.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats

REACH = 4.0  # sigmas; beyond, coverage differs from 0 or 1 by less than 4e-5, a hundredth of a grey level
PIECE = 4.0  # px; long edges are cut so that each piece looks only at the pixels around itself

_GRID = np.linspace(-REACH, REACH, 2049)
_PHI = np.array([0.5 * (1.0 + math.erf(z / math.sqrt(2.0))) for z in _GRID])
_PHI[0], _PHI[-1] = 0.0, 1.0


def pixel_coverage(polygons: Sequence[Floats], width: int, height: int, sigma: float) -> NDArray[np.float32]:
    """(height, width) 0 to 1, how much of each pixel the polygons cover (holes by the even-odd rule).

    Args:
        polygons: (N, 2) px each, the outer one and its holes.
        width: px.
        height: px.
        sigma: px, of the blur of lens and pixel together; at least 0.4, below which pixels would alias.
    """
    if sigma < 0.4:
        raise ValueError(f"a blur of {sigma} px would alias; 0.4 px is the least")
    inside = inside_mask(polygons, width, height)
    field = inside.astype(np.float32)
    index, distance = edge_distance(polygons, width, height, REACH * sigma)
    signed = np.where(inside.ravel()[index], distance, -distance)
    field.ravel()[index] = np.interp(signed / sigma, _GRID, _PHI)
    return field


def inside_mask(polygons: Sequence[Floats], width: int, height: int) -> NDArray[np.bool_]:
    """(height, width) whether each pixel's centre lies inside, exactly, by the crossings of each row with the edges."""
    toggles = np.zeros((height, width + 1), dtype=np.uint8)
    for polygon in polygons:
        a, b = polygon, np.roll(polygon, -1, axis=0)
        low, high = np.minimum(a[:, 1], b[:, 1]), np.maximum(a[:, 1], b[:, 1])
        first = np.clip(np.ceil(low), 0, height).astype(np.int64)
        count = np.clip(np.ceil(high), 0, height).astype(np.int64) - first  # rows y with low <= y < high
        edge, step = _expand_counts(count)
        row = first[edge] + step
        slope = (b[edge, 0] - a[edge, 0]) / (b[edge, 1] - a[edge, 1])
        x = a[edge, 0] + (row - a[edge, 1]) * slope
        np.add.at(toggles, (row, np.clip(np.ceil(x), 0, width).astype(np.int64)), 1)
    return (np.cumsum(toggles[:, :-1], axis=1, dtype=np.uint8) & 1).astype(np.bool_)


def inside_polygons(polygons: Sequence[Floats], points: Floats) -> NDArray[np.bool_]:
    """(k,) whether points (k, 2) px lie inside, by the even-odd rule."""
    odd = np.zeros(len(points), dtype=np.bool_)
    for polygon in polygons:
        near = np.flatnonzero(np.all((points >= polygon.min(axis=0)) & (points <= polygon.max(axis=0)), axis=1))
        a, b = polygon, np.roll(polygon, -1, axis=0)
        x, y = points[near, 0, None], points[near, 1, None]
        spans = (a[:, 1] <= y) != (b[:, 1] <= y)
        rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
        crossing = a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / rise
        odd[near] ^= (np.count_nonzero(spans & (crossing <= x), axis=1) & 1).astype(np.bool_)
    return odd


def edge_distance(
    polygons: Sequence[Floats], width: int, height: int, reach: float
) -> tuple[NDArray[np.int64], Floats]:
    """The pixels within `reach` px of the edge: (M,) flat indices, and (M,) exact distances in px."""
    starts = np.concatenate(polygons)
    sides = np.concatenate([np.roll(p, -1, axis=0) - p for p in polygons])
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    edge, step = _expand_counts(np.maximum(1, np.ceil(lengths / PIECE)).astype(np.int64))
    share = 1.0 / np.maximum(1, np.ceil(lengths / PIECE))[edge]
    middle = starts[edge] + ((step + 0.5) * share)[:, None] * sides[edge]

    radius = math.ceil(reach + 0.5 * PIECE + 0.5)
    near = np.all((middle > -radius - 1) & (middle < np.array([width, height]) + radius), axis=1)
    edge, middle = edge[near], middle[near]
    window = np.arange(-radius, radius + 1)
    x = np.rint(middle[:, 0]).astype(np.int64)[:, None, None] + window
    y = np.rint(middle[:, 1]).astype(np.int64)[:, None, None] + window[:, None]
    dx, dy = x - starts[edge, 0, None, None], y - starts[edge, 1, None, None]
    sx, sy = sides[edge, 0, None, None], sides[edge, 1, None, None]
    along = np.clip((dx * sx + dy * sy) / np.maximum(lengths[edge] ** 2, 1e-300)[:, None, None], 0.0, 1.0)
    squared = (dx - along * sx) ** 2 + (dy - along * sy) ** 2

    use = (squared <= reach * reach) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
    least = np.full(width * height, np.inf)
    np.minimum.at(least, (y * width + x)[use], squared[use])
    index = np.flatnonzero(np.isfinite(least))
    return index, np.sqrt(least[index])


def _expand_counts(count: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For counts (N,): which item each of their sum belongs to, and its number within the item."""
    item = np.repeat(np.arange(len(count)), count)
    return item, np.arange(len(item)) - np.repeat(np.cumsum(count) - count, count)
