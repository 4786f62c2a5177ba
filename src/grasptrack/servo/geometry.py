# SPDX-License-Identifier: Apache-2.0
"""Rotations and poses: what the other files of the servo need of rigid motions."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.errors import InputError

Floats = NDArray[np.float64]

ROUNDING = 1e-3
"""How far a pose that is handed in may be from a rigid motion: drivers report in single precision."""


def skew(v: ArrayLike) -> Floats:
    """[v]x, the matrix (3, 3) for which [v]x u is the cross product of v and u."""
    x, y, z = np.asarray(v, dtype=np.float64).tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def skews(points: Floats) -> Floats:
    """[p]x of every point, (N, 3) to (N, 3, 3)."""
    out = np.zeros((len(points), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -points[:, 2], points[:, 1], -points[:, 0]
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = points[:, 2], -points[:, 1], points[:, 0]
    return out


def rotation(vector: ArrayLike) -> Floats:
    """The rotation (3, 3) about `vector` by its length in rad (Rodrigues)."""
    v = np.asarray(vector, dtype=np.float64)
    angle = float(np.sqrt(v @ v))
    K = skew(v)
    if angle < 1e-6:
        return np.asarray(np.eye(3) + K + 0.5 * K @ K)
    return np.asarray(np.eye(3) + math.sin(angle) / angle * K + (1.0 - math.cos(angle)) / angle**2 * K @ K)


def rotation_vector(R: Floats) -> Floats:
    """The inverse of `rotation`, (3,) rad, for turns below half a turn."""
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = 0.5 * float(np.sqrt(axis @ axis)), 0.5 * (float(np.trace(R)) - 1.0)
    angle = math.atan2(sine, cosine)
    return np.asarray(0.5 * axis * (angle / sine if sine > 1e-9 else 1.0))


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
