# SPDX-License-Identifier: Apache-2.0
"""How much of each pixel polygons cover, and the sides of a thick part: edges exactly where the polygons say."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats, Floats32, Ints

REACH = 4.0  # sigmas; beyond, coverage differs from 0 or 1 by less than 4e-5, a hundredth of a grey level
PIECE = 4.0  # px; long edges are cut so that each piece looks only at the pixels around itself

_GRID = np.linspace(-REACH, REACH, 2049)
_PHI = np.array([0.5 * (1.0 + math.erf(z / math.sqrt(2.0))) for z in _GRID])
_PHI[0], _PHI[-1] = 0.0, 1.0


def pixel_coverage(polygons: Sequence[Floats], width: int, height: int, sigma: float) -> NDArray[np.float32]:
    """(height, width) 0 to 1, how much of each pixel the polygons cover (holes by the even-odd rule).

    cv2.fillPoly also draws the pixels that the edge touches: an outline drawn with it lies half a sub-pixel too far out. Here
    the edge is where the polygon says it is: along a straight edge the coverage is Phi(d / sigma), the exact convolution of
    a half plane with the blur, and at corners its value 1/2 stays on the polygon.

    Args:
        polygons: (N, 2) px each, the outer one and its holes.
        width, height: px.
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


FINER = 3
"""Sub-pixels along each axis. The sides' own outer edge carries no truth; the upper face's edge is drawn exactly."""
SUN = math.radians(-60.0)
"""Direction in the image from which the light falls that makes the sides differ."""


def side_faces(
    top: Sequence[Floats], foot: Sequence[Floats], width: int, height: int, sigma: float, relief: Floats32 | None = None
) -> tuple[Floats32, Floats32] | None:
    """How much of each pixel the visible sides cover, and that share times their brightness; both (height, width).

    They are disjoint from the upper face, so that behind the same blur both shares add up to 1 where the two meet.

    Args:
        top: polygons (N, 2) px of the upper face, outer first.
        foot: those of the lower face, point by point.
        width, height: px.
        sigma: px, of the blur.
        relief: (R, C) brightness around 1 of a print on them: rows from the top down, a column for each piece of the
            polygons, again and again. None is plain.

    Returns:
        None where no side is seen. The brightness is 1 on average and differs by the side's direction.
    """
    faces: list[tuple[float, int, Ints]] = []
    print_on = np.ones((1, 1), np.float32) if relief is None else relief
    down = np.linspace(0.0, 1.0, len(print_on) + 1)[:, None]
    for upper, lower in zip(top, foot, strict=True):
        a, b = upper, np.roll(upper, -1, axis=0)
        c, d = np.roll(lower, -1, axis=0), lower
        diagonal, other = c - a, d - b
        seen = diagonal[:, 0] * other[:, 1] - diagonal[:, 1] * other[:, 0]  # twice the area; the near side is negative
        side = b - a
        lit = np.cos(np.arctan2(-side[:, 0], side[:, 1]) - SUN)
        way = 0.5 * (c + d - a - b)
        depth = ((a + b) * way).sum(axis=1) / np.maximum(1e-12, np.hypot(way[:, 0], way[:, 1]))
        i = np.flatnonzero(seen < -1e-9)
        left, right = (p[i, None] + down * (q - p)[i, None] for p, q in ((a, d), (b, c)))
        pieces = np.stack([left[:, :-1], right[:, :-1], right[:, 1:], left[:, 1:]], axis=2)
        corners = np.rint(((pieces + 0.5) * FINER - 0.5) * 16.0).astype(np.int32)
        tones = print_on[:, i % print_on.shape[1]].T.astype(np.float64)
        levels = np.clip(np.rint(200.0 * (1.0 + 0.2 * lit[i])[:, None] * tones), 1, 255).astype(int)
        for k in range(len(i)):
            faces += zip([float(depth[i[k]])] * len(down[1:]), levels[k].tolist(), corners[k], strict=True)
    if not faces:
        return None
    shape = (height * FINER, width * FINER)
    bright = np.zeros(shape, np.uint8)
    for _, level, corner in sorted(faces, key=lambda f: f[0]):  # the nearer ones last
        cv2.fillPoly(bright, [corner], level, shift=4)
    upper_face = inside_mask([(p + 0.5) * FINER - 0.5 for p in top], shape[1], shape[0])
    bright[upper_face] = 0
    drawn = np.where(bright > 0, np.uint8(255), np.uint8(0))  # no side is black
    return _downsample_field(drawn, width, height, sigma) / np.float32(255.0), _downsample_field(
        bright, width, height, sigma
    ) / np.float32(200.0)


def _downsample_field(field: NDArray[np.uint8], width: int, height: int, sigma: float) -> Floats32:
    small = cv2.resize(field.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)


def subdivide_polygon(polygon: Floats, step: float) -> Floats:
    """The same polygon with its sides cut into equal pieces no longer than `step`."""
    return sample_outline([polygon], step, at=0.0)[0]


def sample_outline(polygons: Sequence[Floats], step: float, at: float = 0.5) -> tuple[Floats, Floats]:
    """Points (N, 2) along all sides of polygons, one at a share of each of the equal pieces, no longer than `step`, that the
    sides are cut into; and the length (N,) that each stands for."""
    starts = np.concatenate(polygons)
    sides = np.concatenate([np.roll(p, -1, axis=0) - p for p in polygons])
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    count = np.maximum(1, np.ceil(lengths / step)).astype(np.int64)
    side, piece = _expand_counts(count)
    return starts[side] + ((piece + at) / count[side])[:, None] * sides[side], lengths[side] / count[side]
