# SPDX-License-Identifier: Apache-2.0
"""A rough outline drawn to the edges beside it: one offset for each of its points, all chosen together."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.segmentation.silhouettes import Silhouette, trace_silhouettes
from grasptrack.typing import Floats

STEP = 2.0
"""px between the points that are moved."""
ENOUGH = 4.0
"""Units of grain: a stronger edge draws no more."""
NOTHING = 1.0
"""Units: grain alone has as much."""
BEND = 0.6
"""Units: cost of a step of one px from a point's offset to the next."""
AWAY = 0.1
"""Units for each px: of two edges the nearer, and where there is none the outline stays."""


def snap_polygon(
    strength: NDArray[np.float32], shrink: int, polygon: Floats, reach: float, shift: float = 0.0
) -> Floats:
    """A closed polygon (n, 2) px moved onto the edges beside it; where there is no edge it stays.

    Args:
        strength: (h, w) slopes in units of the image's grain, of the image made smaller by `shrink`.
        shrink: a whole number.
        polygon: (n, 2) px.
        reach: px on either side in which edges are looked for.
        shift: px by which it may be off as a whole; it is moved as a whole first.

    Returns:
        (m, 2) px, points about STEP px apart.
    """
    soft = np.asarray(cv2.dilate(cv2.GaussianBlur(strength, (0, 0), 0.7), np.ones((2, 2), np.uint8)), dtype=np.float32)
    points, normals = _spaced(polygon, STEP * max(1, shrink))
    if shift > 0.0:
        points = points + _best_shift(soft, shrink, points, shift)
    count = math.ceil(reach / shrink)
    steps = np.arange(-count, count + 1)
    at = (points[:, None, :] + (shrink * steps)[None, :, None] * normals[:, None, :]) / shrink
    gain = np.clip(_bilinear(soft, at), NOTHING, ENOUGH) - NOTHING - AWAY * np.abs(steps) * shrink
    chosen = steps[_smoothest_path(gain)] * float(shrink)
    return np.asarray(points + chosen[:, None] * normals, dtype=np.float64)


def outline_agreement(shape: Silhouette, polygon: Floats, tolerance: float) -> float:
    """Share of a region's outline within some px of a polygon (n, 2), or of the polygon beside the region: the less."""
    x, y, w, h = shape.box
    low = np.floor(np.minimum(polygon.min(axis=0), (x, y)) - tolerance - 2.0).astype(np.int32)
    high = np.ceil(np.maximum(polygon.max(axis=0), (x + w, y + h)) + tolerance + 2.0).astype(np.int32)
    drawn, found = np.rint(polygon - low).astype(np.int32), (shape.outer - low).astype(np.int32)
    points = np.rint(_spaced(polygon, STEP)[0] - low).astype(np.int32)
    shares = []
    for chain, asked in ((drawn, found), (found, points)):
        plane = np.full((high[1] - low[1], high[0] - low[0]), 255, np.uint8)
        cv2.polylines(plane, [chain.reshape(-1, 1, 2)], True, (0,), 1)
        away = np.asarray(cv2.distanceTransform(plane, cv2.DIST_L2, 5))
        shares.append(float((away[asked[:, 1], asked[:, 0]] <= tolerance).mean()))
    return min(shares)


def polygon_silhouette(polygon: Floats, size: tuple[int, ...]) -> Silhouette | None:
    """The region within a polygon, as far as it lies in an image of (height, width); None where nothing does."""
    mask = np.zeros(size[:2], np.uint8)
    cv2.fillPoly(mask, [np.rint(polygon * 16.0).astype(np.int32)], (255,), cv2.LINE_8, 4)
    found = trace_silhouettes(mask, 8.0, holes=False)
    return found[0] if found else None


def _spaced(polygon: Floats, step: float) -> tuple[Floats, Floats]:
    """Points along a closed polygon, `step` px apart, and its unit normals, of a tangent over a few points."""
    closed = np.vstack([polygon, polygon[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    n = max(16, round(along[-1] / step))
    t = np.arange(n) * (along[-1] / n)
    points = np.column_stack([np.interp(t, along, closed[:, 0]), np.interp(t, along, closed[:, 1])])
    tangents = np.roll(points, -2, axis=0) - np.roll(points, 2, axis=0)
    normals = np.column_stack([tangents[:, 1], -tangents[:, 0]])
    return points, normals / np.maximum(np.hypot(*normals.T), 1e-9)[:, None]


def _best_shift(strength: NDArray[np.float32], shrink: int, points: Floats, most: float) -> Floats:
    """(2,) px by which a polygon as a whole lies best on edges."""
    grid = np.arange(-most, most + 0.5, 2.0)
    shifts = np.array([(x, y) for x in grid for y in grid if math.hypot(x, y) <= most + 0.5])
    at = (points[None, ::2, :] + shifts[:, None, :]) / shrink
    worth = (np.clip(_bilinear(strength, at), NOTHING, ENOUGH) - NOTHING).mean(axis=1) - 0.01 * np.hypot(*shifts.T)
    return np.asarray(shifts[int(np.argmax(worth))])


def _smoothest_path(gain: Floats) -> NDArray[np.intp]:
    """(n,) column of each row of (n, m), the sum of gains less the cost of steps being largest, round a closed curve.

    Dynamic programming over the rows twice round; the second half of the doubled path starts where it ends.
    """
    n, m = gain.shape
    doubled = np.vstack([gain, gain])
    columns = np.arange(m)
    cost = BEND * np.abs(columns[:, None] - columns[None, :])
    best = doubled[0].copy()
    came = np.zeros((2 * n, m), dtype=np.intp)
    for k in range(1, 2 * n):
        total = best[None, :] - cost
        came[k] = np.argmax(total, axis=1)
        best = total[columns, came[k]] + doubled[k]
    path = np.zeros(2 * n, dtype=np.intp)
    path[-1] = int(np.argmax(best))
    for k in range(2 * n - 1, 0, -1):
        path[k - 1] = came[k, path[k]]
    middle = n // 2
    return np.roll(path[middle : middle + n], middle)


def _bilinear(plane: NDArray[np.float32], at: Floats) -> Floats:
    """Values of a plane (h, w) at points (n, m, 2), 0 beyond its border."""
    x, y = at[..., 0].astype(np.float32), at[..., 1].astype(np.float32)
    return np.asarray(cv2.remap(plane, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT), dtype=np.float64)
