# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of rotations and cross products."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from grasptrack.typing import Floats


def skew_matrix(v: ArrayLike) -> Floats:
    """[v]x, the matrix (3, 3) for which [v]x u is the cross product of v and u."""
    x, y, z = np.asarray(v, dtype=np.float64).tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def skew_matrices(points: Floats) -> Floats:
    """[p]x of every point, (N, 3) to (N, 3, 3)."""
    out = np.zeros((len(points), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -points[:, 2], points[:, 1], -points[:, 0]
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = points[:, 2], -points[:, 1], points[:, 0]
    return out


def rotation_matrix(vector: ArrayLike) -> Floats:
    """The rotation (3, 3) about `vector` by its length in rad (Rodrigues)."""
    v = np.asarray(vector, dtype=np.float64)
    angle = float(np.sqrt(v @ v))
    K = skew_matrix(v)
    if angle < 1e-6:
        return np.asarray(np.eye(3) + K + 0.5 * K @ K)
    return np.asarray(np.eye(3) + math.sin(angle) / angle * K + (1.0 - math.cos(angle)) / angle**2 * K @ K)


def rotation_vector(R: Floats) -> Floats:
    """The inverse of `rotation_matrix`, (3,) rad, for turns below half a turn."""
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = 0.5 * float(np.sqrt(axis @ axis)), 0.5 * (float(np.trace(R)) - 1.0)
    angle = math.atan2(sine, cosine)
    return np.asarray(0.5 * axis * (angle / sine if sine > 1e-9 else 1.0))
