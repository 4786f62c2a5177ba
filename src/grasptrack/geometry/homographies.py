# SPDX-License-Identifier: Apache-2.0
"""Homographies of the plane: estimate, apply, compose, judge (Section III-C, eqs. 1 and 2)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from grasptrack import kernels
from grasptrack.errors import ConditioningError
from grasptrack.typing import Floats

MAX_SHEAR = 8.0
"""Largest ratio of the two local magnifications that a believable view of a flat object shows (82 degrees of tilt)."""
HORIZON = 1e-9
"""lambda of eq. (2) at and below which a point counts as sent to infinity, or behind the camera."""
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


def apply_homography(H: ArrayLike, points: ArrayLike) -> Floats:
    """Eq. (2): points (..., 2) of one view carried to the other by H (3, 3).

    Raises:
        ConditioningError: a point lies on or behind the line that H sends to infinity.
    """
    h, p = np.ascontiguousarray(H, dtype=np.float64), np.ascontiguousarray(points, dtype=np.float64)
    carried, in_front = kernels.carry_points(h, p.reshape(-1, 2))
    check_in_front(h, in_front)
    return carried.reshape(p.shape)


def homography_jacobian(H: Floats, x: float, y: float) -> tuple[float, float, float, float]:
    """The four derivatives dx'/dx, dx'/dy, dy'/dx, dy'/dy of eq. (2) at one point."""
    (a, b, c), (d, e, f), (g, h, i) = H.tolist()
    w = g * x + h * y + i
    u, v = (a * x + b * y + c) / w, (d * x + e * y + f) / w
    return (a - g * u) / w, (b - h * u) / w, (d - g * v) / w, (e - h * v) / w


def rotation_at(H: Floats, x: float, y: float) -> float:
    """rad by which a homography (3, 3) turns what lies at a point."""
    a, b, c, d = homography_jacobian(H, x, y)
    return math.atan2(c - b, a + d)


def similarity_transform(
    scale: float, angle: float, source: tuple[float, float], target: tuple[float, float]
) -> Floats:
    """The similarity (3, 3) that turns by `angle` rad, scales, and takes the point `source` to `target`."""
    c, s = scale * math.cos(angle), scale * math.sin(angle)
    return np.array(
        [
            [c, -s, target[0] - c * source[0] + s * source[1]],
            [s, c, target[1] - s * source[0] - c * source[1]],
            [0.0, 0.0, 1.0],
        ]
    )


def rotation_about_z(angle: float) -> Floats:
    """(3, 3) rotation by an angle in rad: of the plane about its origin, or of space about z."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def judge_distortion(H: Floats, in_front: float, determinant: float, ratio: float) -> None:
    """Refuse a homography that no view of a flat object could give.

    Args:
        H: (3, 3) reference to current.
        in_front, determinant, ratio: its worst distortion of points of the object, as `kernels.distortion` has it.

    Raises:
        ConditioningError: not finite, mirrors the object, sends part of it to infinity, or flattens it beyond
            MAX_SHEAR.
    """
    if in_front > HORIZON and determinant > 0.0 and ratio <= MAX_SHEAR:
        return
    if math.isnan(in_front):
        raise ConditioningError("the homography is not finite")
    check_in_front(H, in_front)
    if determinant <= 0.0:
        raise ConditioningError("the homography mirrors the object", determinant=determinant)
    raise ConditioningError("the homography is badly conditioned: it flattens the object to a line", ratio=ratio)


def check_in_front(H: Floats, in_front: float) -> None:
    """Refuse a homography that carries points to infinity or behind the camera."""
    if not in_front > HORIZON:
        raise behind_camera_error(H)


def behind_camera_error(H: Floats) -> ConditioningError:
    """The error of a homography (3, 3) that carries points to infinity or behind the camera."""
    return ConditioningError("the homography sends part of the object to infinity", homography=H.tolist())


def normalize_homography(H: Floats) -> Floats:
    """H with its last entry 1, the form in which homographies are given out."""
    out: Floats = H / H[2, 2]
    return out


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

    Its parameters (8,) are in radii, of so many px, about a centre (2,) px.
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
