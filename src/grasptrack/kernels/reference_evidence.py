# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of the kernels round edge search: what to search, and what to make of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats


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
        determinant. NaN for points that lie on or behind the horizon, seen from the mean of all: where the image's own
        origin lies is of no account, and -H does what H does.
    """
    x, y = points[:, 0], points[:, 1]
    w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
    if len(w):
        with np.errstate(invalid="ignore", divide="ignore"):
            w = np.where(w / (w.sum() / len(w)) > 1e-9, w, np.nan)
    u, v = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / w, (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / w
    a, b = (H[0, 0] - H[2, 0] * u) / w, (H[0, 1] - H[2, 1] * u) / w
    c, d = (H[1, 0] - H[2, 0] * v) / w, (H[1, 1] - H[2, 1] * v) / w
    nx, ny = d * normals[:, 0] - c * normals[:, 1], a * normals[:, 1] - b * normals[:, 0]
    determinant = a * d - b * c
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.sqrt(nx * nx + ny * ny) * np.sign(determinant)
        return np.column_stack([u, v, nx / size, ny / size, determinant])


SLIGHT = 1e-6
"""Motions that displace the outline by less than the root of this, relative to the largest, are none of their own."""


MOTIONS = np.zeros((8, 3, 3))
"""To each parameter the part of a homography near the identity that is linear in it."""
MOTIONS[0, 0, 2] = MOTIONS[1, 1, 2] = 1.0  # shifts
MOTIONS[2, (0, 1), (0, 1)] = 1.0  # scale
MOTIONS[3, (0, 1), (1, 0)] = -1.0, 1.0  # turn
MOTIONS[4, (0, 1), (0, 1)] = 1.0, -1.0  # stretches
MOTIONS[5, (0, 1), (1, 0)] = 1.0
MOTIONS[6, 2, 0] = MOTIONS[7, 2, 1] = -1.0  # bends


def displacement_fields(points: Floats) -> Floats:
    """(m, 2, 8): how the 8 parameters of a homography near the identity move points (m, 2), per unit of each.

    Translation; scale and rotation; the two shears of an affine map; the two bends of perspective.
    """
    x, y = points[:, 0], points[:, 1]
    one, zero = np.ones_like(x), np.zeros_like(x)
    return np.stack(
        [
            np.stack([one, zero, x, -y, x, y, x * x, x * y], axis=1),
            np.stack([zero, one, y, x, -y, x, x * y, y * y], axis=1),
        ],
        axis=1,
    )


def near_identity(x: Floats, centre: Floats, radius: float) -> Floats:
    """(3, 3) the homography near the identity whose displacements are those of `displacement_fields`.

    Args:
        x: (8,) parameters, in radii.
        centre: (2,) px.
        radius: px.
    """
    M = np.eye(3) + np.tensordot(x, MOTIONS, 1)
    N = np.array([[1.0, 0.0, -centre[0]], [0.0, 1.0, -centre[1]], [0.0, 0.0, radius]]) / radius
    back = np.array([[radius, 0.0, centre[0]], [0.0, radius, centre[1]], [0.0, 0.0, 1.0]])
    return np.asarray(back @ M @ N, dtype=np.float64)


def whitening_matrix(fields: Floats) -> Floats:
    """(n, n) parameters of as many motions that each displace points by 1 px rms, the least of them bounded."""
    if not len(fields):
        return np.eye(fields.shape[2])
    size, V = np.linalg.eigh(np.einsum("mik,mil->kl", fields, fields) / len(fields))
    return np.asarray(V / np.sqrt(np.maximum(size, SLIGHT * size[-1])))


def lower_median(values: Floats) -> float:
    """The middle value, of two the lower one; 0 of none."""
    return float(np.sort(values)[(len(values) - 1) // 2]) if len(values) else 0.0
