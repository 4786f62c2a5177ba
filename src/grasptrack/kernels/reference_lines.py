# SPDX-License-Identifier: Apache-2.0
"""Where a straight line meets the contours."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats


def crossings(points: Floats, offsets: NDArray[np.int64], x: float, y: float, ux: float, uy: float) -> Floats:
    """Where the infinite line through (x, y) along u crosses the contours.

    A vertex exactly on the line counts once when the contour changes sides there and not at all when it only touches;
    of a stretch that lies along the line and changes sides, the end with the smaller t counts.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).
        x: px, a point of the line.
        y: px.
        ux: unit direction of the line.
        uy: its second coordinate.

    Returns:
        (M, 3) contour, position, t in px along u from (x, y), sorted by t.
    """
    rows: list[tuple[float, float, float]] = []
    for c in range(len(offsets) - 1):
        relative = points[offsets[c] : offsets[c + 1]] - (x, y)
        n = len(relative)
        t = relative[:, 0] * ux + relative[:, 1] * uy
        d = relative[:, 1] * ux - relative[:, 0] * uy
        off = np.flatnonzero(d)
        if len(off) == 0:
            continue
        following = np.roll(off, -1)
        for i, j in zip(off, following, strict=True):
            if (d[i] > 0) == (d[j] > 0):
                continue
            first, last = (i + 1) % n, (j - 1) % n
            if first == j:
                f = d[i] / (d[i] - d[j])
                place, along = i + f, t[i] + f * (t[j] - t[i])
            else:
                at = first if t[first] <= t[last] else last
                place, along = at, t[at]
            rows.append((c, place if place < n else 0.0, along))
    rows.sort(key=lambda row: row[2])
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def nearest_crossings(
    points: Floats, offsets: NDArray[np.int64], x: float, y: float, ux: float, uy: float, t1: float, t2: float
) -> tuple[float, float, float, float]:
    """The crossing nearest to t1 and the one nearest to t2, px along u from (x, y); ties go to the smaller t.

    Returns:
        x1, y1, x2, y2 in px; NaN where the line meets no contour. One crossing may be nearest to both.
    """
    t = crossings(points, offsets, x, y, ux, uy)[:, 2]
    if len(t) == 0:
        return math.nan, math.nan, math.nan, math.nan
    a = float(t[np.argmin(np.abs(t - t1))])
    b = float(t[np.argmin(np.abs(t - t2))])
    return x + a * ux, y + a * uy, x + b * ux, y + b * uy
