# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of the kernels round edge search: what to search, and what to make of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def settle_edges(
    points: Floats, normals: Floats, edges: Floats, fixed: NDArray[np.bool_], fallback: float, outlier: float
) -> tuple[Floats, Floats]:
    """Points of one closed contour moved along their normals onto the edges that were found.

    Args:
        points, normals: (N, 2), N >= 5.
        edges: (N, >= 2) offset px along the normal (NaN where none was found) and signed strength.
        fixed: (N,) points that stay where they are, with strength 0.
        fallback: px, offset where no edge was found; its strength is 0.
        outlier: px; an offset that differs by more from the median of the five about it becomes that median, with
            strength 0: it is on some other edge.

    Returns:
        (N, 2) points and (N,) absolute strengths.
    """
    missing = np.isnan(edges[:, 0])
    offset = np.where(missing, fallback, edges[:, 0])
    around = np.median(np.stack([np.roll(offset, k) for k in range(-2, 3)]), axis=0)
    stray = np.abs(offset - around) > outlier
    offset = np.where(stray, around, offset)
    offset[fixed] = 0.0
    strength = np.where(missing | stray | fixed, 0.0, np.abs(edges[:, 1]))
    return points + offset[:, None] * normals, strength


def carry_normals(H: Floats, points: Floats, normals: Floats) -> Floats:
    """Points of a contour and their normals under a homography (3, 3), eq. (2).

    Returns:
        (N, 5): u, v px; the unit normal there (normals go by the inverse transpose of the Jacobian); the Jacobian's
        determinant. NaN for points that H does not keep in front of the camera (w <= 0 with H[2, 2] = 1).
    """
    h = H / H[2, 2]
    x, y = points[:, 0], points[:, 1]
    w = h[2, 0] * x + h[2, 1] * y + 1.0
    w = np.where(w > 1e-9, w, np.nan)
    u, v = (h[0, 0] * x + h[0, 1] * y + h[0, 2]) / w, (h[1, 0] * x + h[1, 1] * y + h[1, 2]) / w
    a, b = (h[0, 0] - h[2, 0] * u) / w, (h[0, 1] - h[2, 1] * u) / w
    c, d = (h[1, 0] - h[2, 0] * v) / w, (h[1, 1] - h[2, 1] * v) / w
    nx, ny = d * normals[:, 0] - c * normals[:, 1], a * normals[:, 1] - b * normals[:, 0]
    determinant = a * d - b * c
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.sqrt(nx * nx + ny * ny) * np.sign(determinant)
        return np.column_stack([u, v, nx / size, ny / size, determinant])
