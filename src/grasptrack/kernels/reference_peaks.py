# SPDX-License-Identifier: Apache-2.0
"""Peaks of curvature, and the four of them that fix a homography best (Section IV-C)."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from grasptrack.typing import Floats, Ints

MAX_PEAKS = 8


def curvature_peaks(curvature: Floats, arc: Floats, separation: float, prominence: float) -> Ints:
    """Local maxima of the absolute curvature of one closed contour, strongest first, at most 8.

    Args:
        curvature: (N,) curvature vector; a NaN is never a peak and no neighbour of one.
        arc: (N + 1,) arc length, px.
        separation: px along the contour between two peaks, at least.
        prominence: least rise of a peak above the lowest curvature within 3 separations, on either side.
    """
    v = np.abs(curvature)
    length = arc[-1]
    n = len(v)
    with np.errstate(invalid="ignore"):
        crest = np.flatnonzero((v >= np.roll(v, 1)) & (v > np.roll(v, -1)))
    peaks: list[int] = []
    for i in sorted(crest.tolist(), key=lambda i: (-v[i], i)):
        if any(min(abs(arc[i] - arc[p]), length - abs(arc[i] - arc[p])) < separation for p in peaks):
            continue
        rises = []
        for way in (1, -1):
            low, j = v[i], i
            # the sample that lies beyond the reach is still looked at
            while abs(j - i) < n and abs(_unwrapped_arc_length(arc, j) - arc[i]) <= 3.0 * separation:
                j += way
                low = np.fmin(low, v[j % n])
            rises.append(v[i] - low)
        if min(rises) >= prominence:
            peaks.append(i)
        if len(peaks) == MAX_PEAKS:
            break
    return np.array(peaks, dtype=np.int64)


def _unwrapped_arc_length(arc: Floats, i: int) -> float:
    """Arc length of a sample whose index may run on beyond either end."""
    lap, j = divmod(i, len(arc) - 1)
    return float(arc[j] + lap * arc[-1])


def best_quadrilateral(points: Floats, weights: Floats) -> tuple[int, int, int, int, float]:
    """Four of m points that fix a homography best, and the smallest area (px^2) of a triangle among them.

    The smallest triangle, times the root of the smallest weight, decides; the first in order of the list wins a tie.
    Indices come in rising order. With m < 4 the indices are -1.
    """
    best, score, area = (-1, -1, -1, -1), -1.0, 0.0
    for a, b, c, d in combinations(range(len(points)), 4):
        least = min(_triangle_area(points[[i, j, k]]) for i, j, k in ((a, b, c), (a, b, d), (a, c, d), (b, c, d)))
        value = least * np.sqrt(weights[[a, b, c, d]].min())
        if value > score * (1.0 + 1e-9):
            best, score, area = (a, b, c, d), value, least
    return (*best, area)


def _triangle_area(p: Floats) -> float:
    u, w = p[1] - p[0], p[2] - p[0]
    return 0.5 * abs(float(u[0] * w[1] - u[1] * w[0]))


def select_points(
    points: Floats, arc: Floats, curvature: Floats, separation: float, prominence: float
) -> tuple[list[int], float]:
    """The four points of a contour by which a homography is found, and what else may serve.

    Args:
        points: (N, 2) px.
        arc: (N + 1,) arc length, px.
        curvature: (N,) curvature vector, also the points' weight.
        separation, prominence: see `curvature_peaks`.

    Returns:
        Indices of the peaks, the best four first in rising order of strength rank, then the others, strongest
        first; and the smallest triangle of the four in px^2. With fewer than four peaks, these and 0.
    """
    peaks = curvature_peaks(curvature, arc, separation, prominence)
    if len(peaks) < 4:
        return peaks.tolist(), 0.0
    *four, triangle = best_quadrilateral(points[peaks], np.abs(curvature[peaks]))
    return [*peaks[four].tolist(), *np.delete(peaks, four).tolist()], triangle
