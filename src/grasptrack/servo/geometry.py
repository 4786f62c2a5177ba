# SPDX-License-Identifier: Apache-2.0
"""Rotations and poses: what the other files of the servo need of rigid motions."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.errors import InputError
from grasptrack.kernels.reference_rigid import rotation, rotation_vector, skew, skews

Floats = NDArray[np.float64]

__all__ = [
    "between",
    "check_pose",
    "inverse",
    "laid",
    "moved",
    "pose_of",
    "rotation",
    "rotation_vector",
    "skew",
    "skews",
]

ROUNDING = 1e-3
"""How far a pose that is handed in may be from a rigid motion: drivers report in single precision."""


def pose_of(rotation_: Floats, position: ArrayLike) -> Floats:
    """A pose (4, 4) from a rotation (3, 3) and a position (3,) in m."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation_, position
    return out


def inverse(pose: Floats) -> Floats:
    """The inverse of a rigid motion (4, 4)."""
    R = pose[:3, :3].T
    return pose_of(R, -R @ pose[:3, 3])


def moved(pose: Floats, twist: ArrayLike, seconds: float) -> Floats:
    """The pose (4, 4) after a twist (6,) in m/s and rad/s, told in the moving frame, has been held for `seconds`."""
    t = np.asarray(twist, dtype=np.float64) * seconds
    angle = float(np.sqrt(t[3:] @ t[3:]))
    K = skew(t[3:])
    if angle < 1e-6:
        V = np.eye(3) + 0.5 * K
    else:
        V = np.eye(3) + (1.0 - math.cos(angle)) / angle**2 * K + (angle - math.sin(angle)) / angle**3 * K @ K
    return pose @ pose_of(rotation(t[3:]), V @ t[:3])


def between(first: Floats, second: Floats, share: float) -> Floats:
    """The pose that lies the given share of the way from the first (0) to the second (1), or beyond."""
    turn = rotation_vector(first[:3, :3].T @ second[:3, :3])
    at = first[:3, 3] + share * (second[:3, 3] - first[:3, 3])
    return pose_of(first[:3, :3] @ rotation(share * turn), at)


def check_pose(pose: ArrayLike) -> Floats:
    """A pose as it was handed in, as float64.

    Raises:
        InputError: not (4, 4), not finite, or not rigid.
    """
    given = np.asarray(pose, dtype=np.float64)
    if given.shape != (4, 4) or not np.isfinite(given).all():
        raise InputError("a pose is a finite 4 x 4 matrix", shape=given.shape)
    R = given[:3, :3]
    off = float(np.abs(R @ R.T - np.eye(3)).max())
    if off > ROUNDING or np.linalg.det(R) < 0.0 or float(np.abs(given[3] - (0.0, 0.0, 0.0, 1.0)).max()) > ROUNDING:
        raise InputError("a pose is a rotation and a position above the row 0 0 0 1", pose=given.tolist())
    return given


def laid(shape: Floats, onto: Floats) -> tuple[Floats, float]:
    """Points (k, 2) moved rigidly to lie best on others, and the turn in rad that it took."""
    z, w = (p[:, 0] + 1j * p[:, 1] for p in (shape, onto))
    turn = np.angle(((w - w.mean()) * (z - z.mean()).conj()).sum())
    out = (z - z.mean()) * np.exp(1j * turn) + w.mean()
    return np.column_stack([out.real, out.imag]), float(turn)
