# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of the first step of a match without a prior: whitened outlines, aligned at every shift."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_curve import resample
from grasptrack.kernels.reference_inertia import inertia
from grasptrack.typing import Floats

IN_FRONT = 0.25
"""A bend that magnifies a part of the outline by more than the inverse of this is not tried."""


def initial_alignments(first: Floats, second: Floats, bends: Floats, count: int, apart: float, most: int) -> Floats:
    """Homographies that may lay one closed contour on another, without a prior.

    The first contour is whitened: its area gets its mean at 0 and unit second moments. There it is bent by
    (x, y) / (1 + g x + h y), for each bend (g, h), and whitened again. If the bend is right, it then differs from the
    whitened second contour by a turn. Both are sampled at `count` equal steps of their arc length there, and a cyclic
    correlation of the complex samples gives for each shift the best turn, and what it leaves.

    Args:
        first, second: (N, 2), (N', 2) px, of positive signed area.
        bends: (T, 2).
        count: samples, a power of 2, at least 4.
        apart: lengths of the outline; of alignments whose shifts differ by less only the best is kept.
        most: alignments that are kept.

    Returns:
        (k, 11), k <= most: the share of the second outline's norm that is left, the shift in lengths of the outline, and
        the homography first -> second by rows, its last element 1. What leaves least comes first.

    Raises:
        ValueError: no such count, or a contour without area.
    """
    if count < 4 or count & (count - 1):
        raise ValueError(f"count must be a power of 2, at least 4, not {count}")
    to_first, to_second = _whitening_transform(first), _whitening_transform(second)
    white = first @ to_first[:2, :2].T + to_first[:2, 2]
    b = np.fft.fft(_normalized_samples(second @ to_second[:2, :2].T + to_second[:2, 2], count))
    back = np.linalg.inv(to_second)
    rows = []
    for bend in bends:
        w = white @ bend + 1.0
        if w.min() < IN_FRONT:
            continue
        bent = np.ascontiguousarray(white / w[:, None])
        again = _whitening_transform(bent)
        c = np.fft.ifft(b * np.conj(np.fft.fft(_normalized_samples(bent @ again[:2, :2].T + again[:2, 2], count))))
        square = c.real**2 + c.imag**2
        projective = np.eye(3)
        projective[2, :2] = bend
        for k in np.flatnonzero((square >= np.roll(square, 1)) & (square > np.roll(square, -1))).tolist():
            size = math.sqrt(float(square[k]))
            cos, sin = c[k].real / size, c[k].imag / size
            H = back @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ again @ projective @ to_first
            rows.append([math.sqrt(max(1.0 - float(square[k]), 0.0)), k / count, *(H / H[2, 2]).ravel().tolist()])
    rows.sort(key=lambda row: row[0])
    kept: list[list[float]] = []
    for row in rows:
        if len(kept) < most and all(abs((row[1] - other[1] + 0.5) % 1.0 - 0.5) >= apart for other in kept):
            kept.append(row)
    return np.array(kept, dtype=np.float64).reshape(-1, 11)


def _whitening_transform(points: Floats) -> Floats:
    """(3, 3) the affine map after which the area within has mean 0 and unit second moments, without a turn."""
    _, x, y, theta, major, minor, *_ = inertia(points, np.array([0, len(points)], dtype=np.int64))
    if not minor > 0.0:
        raise ValueError("a contour must enclose an area")
    c, s = math.cos(theta), math.sin(theta)
    a, b = 1.0 / math.sqrt(major), 1.0 / math.sqrt(minor)
    xx, xy, yy = a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c
    return np.array([[xx, xy, -xx * x - xy * y], [xy, yy, -xy * x - yy * y], [0.0, 0.0, 1.0]])


def _normalized_samples(points: Floats, count: int) -> NDArray[np.complex128]:
    at = resample(np.ascontiguousarray(points), count, 0.0)
    z = at[:, 0] + 1j * at[:, 1]
    z -= z.mean()
    out: NDArray[np.complex128] = z / np.sqrt((z * z.conj()).real.sum())
    return out
