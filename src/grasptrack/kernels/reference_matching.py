# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of the kernels that match curvature between two outlines (Section IV-C.1)."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_curve import resample

Floats = NDArray[np.float64]

MAX_PEAKS = 8
GRID = 2048
"""Largest number of equal steps of arc length at which eq. (3) looks up the second curvature vector."""


def curvature_peaks(curvature: Floats, arc: Floats, separation: float, prominence: float) -> NDArray[np.int64]:
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
        for direction in (1, -1):
            low, j, travelled = v[i], i, 0.0
            while travelled <= 3.0 * separation and travelled < length:
                k = (j + direction) % n
                a = j if direction > 0 else k
                travelled += arc[a + 1] - arc[a]
                j = k
                if v[j] < low:
                    low = v[j]
            rises.append(v[i] - low)
        if min(rises) >= prominence:
            peaks.append(i)
        if len(peaks) == MAX_PEAKS:
            break
    return np.array(peaks, dtype=np.int64)


def best_quadrilateral(points: Floats, weights: Floats) -> tuple[int, int, int, int, float]:
    """Four of m points that fix a homography best, and the smallest area (px^2) of a triangle among them.

    The smallest triangle, times the root of the smallest weight, decides; the first in order of the list wins a tie.
    Indices come in rising order. With m < 4 the indices are -1.
    """
    best, score, area = (-1, -1, -1, -1), -1.0, 0.0
    for four in combinations(range(len(points)), 4):
        p = points[list(four)]
        triangles = []
        for a, b, c in combinations(range(4), 3):
            u, w = p[b] - p[a], p[c] - p[a]
            triangles.append(0.5 * abs(u[0] * w[1] - u[1] * w[0]))
        value = min(triangles) * np.sqrt(weights[list(four)].min())
        if value > score * (1.0 + 1e-9):
            best, score, area = four, value, min(triangles)  # type: ignore[assignment]
    return (*best, float(area))


def _on_grid(curvature: Floats, arc: Floats, count: int) -> Floats:
    """Curvature at `count` equal steps of arc length, linear between samples."""
    closed = np.append(curvature, curvature[0])
    out: Floats = np.interp(np.arange(count) * (arc[-1] / count), arc, closed)
    return out


def align_outlines(points1: Floats, points2: Floats, count: int) -> Floats:
    """How well two closed contours agree, up to a similarity, for each cyclic shift of the one along the other.

    Both are sampled at `count` equal steps of arc length and centred: a_i, b_i as complex numbers, each of unit norm.

    Returns:
        (count, 2) real and imaginary part of c_k = sum_i conj(a_i) b_(i + k). The best similarity for shift k turns by
        arg c_k, and what it leaves is sqrt(1 - |c_k|^2) of the second outline's norm.
    """
    a, b = _centred(points1, count), _centred(points2, count)
    c = np.fft.ifft(np.fft.fft(b) * np.conj(np.fft.fft(a)))
    return np.column_stack([c.real, c.imag])


def _centred(points: Floats, count: int) -> NDArray[np.complex128]:
    p = resample(points, count, 0.0)
    z = p[:, 0] + 1j * p[:, 1]
    z -= z.mean()
    out: NDArray[np.complex128] = z / np.sqrt((z * z.conj()).real.sum())
    return out


def match_curvature(
    v1: Floats,
    arc1: Floats,
    indices: NDArray[np.int64],
    v2: Floats,
    arc2: Floats,
    centres: Floats,
    kappa: float,
    reach: float,
    radius: int,
    step: float,
) -> Floats:
    """Eq. (3): the sample j of the second contour whose neighbourhood is most like that of sample i of the first.

    Args:
        v1, v2: (N,), (N',) scale-free curvature vectors.
        arc1, arc2: (N + 1,), (N' + 1,) arc length, px.
        indices: (m,) samples i of the first contour.
        centres: (m,) px: the arc length in the second contour about which each search is centred.
        kappa: the second contour's length over the first's.
        reach: xi in px of the first contour: the search runs over centre +- kappa xi.
        radius: n: neighbourhoods have 2 n + 1 values.
        step: px of the first contour between two of them (kappa step in the second).

    Returns:
        (m, 2): the sample j, or -1 where no sample was comparable, and its matching error divided by 2 n + 1.
    """
    count = int(min(4 * len(v2), GRID))
    grid2 = _on_grid(v2, arc2, count)
    length1, length2 = arc1[-1], arc2[-1]
    k = np.arange(-radius, radius + 1)
    closed1 = np.append(v1, v1[0])
    out = np.empty((len(indices), 2))
    for row, (i, centre) in enumerate(zip(indices.tolist(), centres.tolist(), strict=True)):
        wanted = np.interp(np.mod(arc1[i] + k * step, length1), arc1, closed1)
        gap = np.mod(arc2[:-1] - centre + 0.5 * length2, length2) - 0.5 * length2
        window = np.flatnonzero(np.abs(gap) <= kappa * reach)
        at = np.mod(arc2[window][:, None] + kappa * step * k, length2) * (count / length2)
        low = np.minimum(at.astype(np.int64), count - 1)
        found = grid2[low] + (at - low) * (grid2[(low + 1) % count] - grid2[low])
        error = np.abs(wanted - found).mean(axis=1)
        error[np.isnan(error)] = np.inf
        best = int(np.argmin(error)) if len(window) else -1
        usable = best >= 0 and np.isfinite(error[best])
        out[row] = (float(window[best]), error[best]) if usable else (-1.0, np.inf)
    return out
