# SPDX-License-Identifier: Apache-2.0
"""The cyclic shifts under which one outline lies on another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats


def align_outlines(
    points1: Floats, arc1: Floats, points2: Floats, arc2: Floats, count: int, tie: float
) -> list[tuple[float, float, float]]:
    """The cyclic shifts by which one closed contour agrees best with another, up to a similarity.

    Both are sampled at `count` equal steps of arc length and centred: a_i, b_i as complex numbers, each of unit norm.
    With c_k = sum_i conj(a_i) b_(i + k), the best similarity for shift k turns by arg c_k and leaves the share
    sqrt(1 - |c_k|^2) of the second outline's norm.

    Args:
        points1, points2: (N, 2), (N', 2) px.
        arc1, arc2: (N + 1,), (N' + 1,) arc length, px.
        count: number of shifts, a power of 2, at least 4.
        tie: what may be left beyond the least that is left by any shift.

    Returns:
        Of each local maximum of |c_k| within the tie: shift k / count, angle in rad and what is left, the best first.

    Raises:
        ValueError: no such count, or arc lengths of another contour.
    """
    if count < 4 or count & (count - 1):
        raise ValueError(f"count must be a power of 2, at least 4, not {count}")
    a, b = _normalized_samples(points1, arc1, count), _normalized_samples(points2, arc2, count)
    c = np.fft.ifft(np.fft.fft(b) * np.conj(np.fft.fft(a)))
    square = c.real**2 + c.imag**2
    left = np.sqrt(np.maximum(1.0 - square, 0.0))
    peak = (left <= left.min() + tie) & (square >= np.roll(square, 1)) & (square > np.roll(square, -1))
    found = [(k / count, float(np.angle(c[k])), float(left[k])) for k in np.flatnonzero(peak).tolist()]
    return sorted(found, key=lambda fit: fit[2])


def _normalized_samples(points: Floats, arc: Floats, count: int) -> NDArray[np.complex128]:
    if len(arc) != len(points) + 1:
        raise ValueError("arc needs one entry more than the contour has points")
    closed = np.append(points, points[:1], axis=0) - points[0]
    s = np.arange(count) * (arc[-1] / count)
    z = np.interp(s, arc, closed[:, 0]) + 1j * np.interp(s, arc, closed[:, 1])
    z -= z.mean()
    out: NDArray[np.complex128] = z / np.sqrt((z * z.conj()).real.sum())
    return out
