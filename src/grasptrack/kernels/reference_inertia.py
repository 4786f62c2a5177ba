# SPDX-License-Identifier: Apache-2.0
"""Area, centroid and inertia of the material inside contours, by Green's theorem (Section III-B)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Inertia = tuple[float, float, float, float, float, float, float, float, float, float]

# Below this a third moment, as a share of area^2.5, is that of a symmetric shape.
SYMMETRIC = 1e-9


def inertia(points: NDArray[np.float64], offsets: NDArray[np.int64]) -> Inertia:
    """Moments of the polygons up to the third order, exact; holes subtract by their sign.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).

    Returns:
        area (px^2), cx, cy (px), theta (rad, direction of the axis of least inertia, x toward y, in (-pi, pi]),
        lam_major, lam_minor (px^2, variances along and across that axis), t30, t21, t12, t03 (central third moments in
        the frame (u, v), u along theta and v 90 degrees on, divided by area^2.5). Of the axis' two directions the one
        with t30 + t12 >= 0 is taken; where that is within 1e-9 of zero, the one with t21 + t03 >= 0; where both are,
        the one in (-pi/2, pi/2]. Not finite where there is no area.
    """
    following = np.arange(1, len(points) + 1)
    following[offsets[1:] - 1] = offsets[:-1]
    x, y = (points - points[0]).T
    X, Y = x[following], y[following]
    a = x * Y - X * y
    with np.errstate(all="ignore"):
        m00 = a.sum() / 2
        gx, gy = (a * (x + X)).sum() / 6 / m00, (a * (y + Y)).sum() / 6 / m00
        m20 = (a * (x * x + x * X + X * X)).sum() / 12 / m00
        m02 = (a * (y * y + y * Y + Y * Y)).sum() / 12 / m00
        m11 = (a * (2 * x * y + x * Y + X * y + 2 * X * Y)).sum() / 24 / m00
        m30 = (a * (x + X) * (x * x + X * X)).sum() / 20 / m00
        m03 = (a * (y + Y) * (y * y + Y * Y)).sum() / 20 / m00
        m21 = (a * (x * x * (3 * y + Y) + 2 * x * X * (y + Y) + X * X * (y + 3 * Y))).sum() / 60 / m00
        m12 = (a * (y * y * (3 * x + X) + 2 * y * Y * (x + X) + Y * Y * (x + 3 * X))).sum() / 60 / m00
        # About the centroid.
        c20, c02, c11 = m20 - gx * gx, m02 - gy * gy, m11 - gx * gy
        c30 = m30 - 3 * gx * c20 - gx**3
        c03 = m03 - 3 * gy * c02 - gy**3
        c21 = m21 - gy * c20 - 2 * gx * c11 - gx * gx * gy
        c12 = m12 - gx * c02 - 2 * gy * c11 - gx * gy * gy
        mean, half, off = (c20 + c02) / 2, (c20 - c02) / 2, c11
        radius = math.hypot(half, off)
        theta = 0.5 * math.atan2(off, half)
        # Exactly upright, atan2 may answer -pi: the half-open interval keeps +pi/2.
        if theta <= -0.5 * math.pi:
            theta = 0.5 * math.pi
        c, s = math.cos(theta), math.sin(theta)
        size = abs(m00) ** 1.5
        t30 = (c**3 * c30 + 3 * c * c * s * c21 + 3 * c * s * s * c12 + s**3 * c03) / size
        t21 = (-c * c * s * c30 + (c**3 - 2 * c * s * s) * c21 + (2 * c * c * s - s**3) * c12 + c * s * s * c03) / size
        t12 = (c * s * s * c30 + (s**3 - 2 * c * c * s) * c21 + (c**3 - 2 * c * s * s) * c12 + c * c * s * c03) / size
        t03 = (-(s**3) * c30 + 3 * c * s * s * c21 - 3 * c * c * s * c12 + c**3 * c03) / size
    qu, qv = t30 + t12, t21 + t03
    if qu < -SYMMETRIC or (abs(qu) <= SYMMETRIC and qv < -SYMMETRIC):
        theta += -math.pi if theta > 0 else math.pi
        t30, t21, t12, t03 = -t30, -t21, -t12, -t03
    values = (m00, points[0, 0] + gx, points[0, 1] + gy, theta, mean + radius, mean - radius, t30, t21, t12, t03)
    return tuple(float(v) for v in values)  # type: ignore[return-value]
