# SPDX-License-Identifier: Apache-2.0
"""A pinhole camera that a hand carries, and the rigid motions of both."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grasptrack import arguments
from grasptrack.equality import compared_by_value
from grasptrack.errors import InputError
from grasptrack.typing import Floats

POSE_ROUNDING = 1e-3
"""How far a pose that is handed in may be from a rigid motion: drivers report in single precision."""


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


def quaternion_of(R: Floats) -> Floats:
    """(4,) x, y, z, w of a rotation (3, 3); w is not negative."""
    # the largest of the four is found from the diagonal, the others by it (S. W. Shepperd 1978)
    xx, yy, zz = np.diag(R).tolist()
    four = np.array([
        [1.0 + xx - yy - zz, R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[2, 1] - R[1, 2]],
        [R[0, 1] + R[1, 0], 1.0 - xx + yy - zz, R[1, 2] + R[2, 1], R[0, 2] - R[2, 0]],
        [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], 1.0 - xx - yy + zz, R[1, 0] - R[0, 1]],
        [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 1.0 + xx + yy + zz],
    ])  # fmt: skip
    q = four[int(np.argmax(np.diag(four)))]
    return np.asarray(q / np.linalg.norm(q) * (-1.0 if q[3] < 0.0 else 1.0))


def rotation_of(quaternion: ArrayLike) -> Floats:
    """(3, 3), of x, y, z, w of about unit length."""
    x, y, z, w = (np.asarray(quaternion) / np.linalg.norm(quaternion)).tolist()
    return np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ])  # fmt: skip


def pose_of(rotation_: Floats, position: ArrayLike) -> Floats:
    """A pose (4, 4) from a rotation (3, 3) and a position (3,) in m."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation_, position
    return out


def inverse_pose(pose: Floats) -> Floats:
    """The inverse of a rigid motion (4, 4)."""
    R = pose[:3, :3].T
    return pose_of(R, -R @ pose[:3, 3])


def apply_twist(pose: Floats, twist: ArrayLike, seconds: float) -> Floats:
    """The pose (4, 4) after a twist (6,) in m/s and rad/s, told in the moving frame, has been held for `seconds`."""
    t = np.asarray(twist, dtype=np.float64) * seconds
    angle = float(np.sqrt(t[3:] @ t[3:]))
    K = skew_matrix(t[3:])
    if angle < 1e-6:
        V = np.eye(3) + 0.5 * K
    else:
        V = np.eye(3) + (1.0 - math.cos(angle)) / angle**2 * K + (angle - math.sin(angle)) / angle**3 * K @ K
    return pose @ pose_of(rotation_matrix(t[3:]), V @ t[:3])


def twist_in_base(pose: Floats, twist: ArrayLike) -> Floats:
    """A twist (6,) of the hand at a pose (4, 4), told along the base's axes: the same motion of the same point."""
    return np.asarray((np.asarray(twist, dtype=np.float64).reshape(2, 3) @ pose[:3, :3].T).reshape(6))


def interpolate_pose(first: Floats, second: Floats, share: float) -> Floats:
    """The pose that lies the given share of the way from the first (0) to the second (1), or beyond."""
    turn = rotation_vector(first[:3, :3].T @ second[:3, :3])
    at = first[:3, 3] + share * (second[:3, 3] - first[:3, 3])
    return pose_of(first[:3, :3] @ rotation_matrix(share * turn), at)


def check_pose(pose: ArrayLike) -> Floats:
    """A pose as it was handed in, as float64.

    Raises:
        InputError: not (4, 4), not finite, or not rigid.
    """
    given = np.asarray(pose, dtype=np.float64)
    if given.shape != (4, 4) or not np.isfinite(given).all():
        raise InputError("a pose is a finite 4 x 4 matrix", shape=given.shape)
    (a, b, c, _), (d, e, f, _), (g, h, i, _), (p, q, r, s) = given.tolist()
    off = (
        a * a + b * b + c * c - 1.0, d * d + e * e + f * f - 1.0, g * g + h * h + i * i - 1.0,
        a * d + b * e + c * f, a * g + b * h + c * i, d * g + e * h + f * i, p, q, r, s - 1.0,
    )  # fmt: skip
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    if max(map(abs, off)) > POSE_ROUNDING or determinant < 0.0:
        raise InputError("a pose is a rotation and a position above the row 0 0 0 1", pose=given.tolist())
    return given


def turn_between(first: Floats, second: Floats) -> float:
    """The turn in rad that brings points (k, 2 or more) as near to others as a rigid motion of the plane can."""
    z, w = complex_numbers(first), complex_numbers(second)
    a, b = sum(z) / len(z), sum(w) / len(w)
    return cmath.phase(sum((v - b) * (u - a).conjugate() for u, v in zip(z, w, strict=True)))


def align_rigid(shape: Floats, onto: Floats) -> tuple[Floats, float]:
    """Points (k, 2) moved rigidly to lie best on others, and the turn in rad that it took."""
    z, w, turn = complex_numbers(shape), complex_numbers(onto), turn_between(shape, onto)
    a, b, by = sum(z) / len(z), sum(w) / len(w), cmath.rect(1.0, turn)
    there = [(u - a) * by + b for u in z]
    return np.array([(p.real, p.imag) for p in there]), turn


def complex_numbers(points: Floats) -> list[complex]:
    """x + iy of points (k, 2 or more). Of two or three points Python's own numbers are quicker than arrays."""
    return [complex(p[0], p[1]) for p in points.tolist()]


NEAREST_DEPTH = 1e-3
"""m in front of the camera within which nothing is projected."""


@compared_by_value
@dataclass(frozen=True)
class HandCamera:
    """Camera and mounting.

    Attributes:
        focal: px.
        centre: (2,) px, where the optical axis meets the image.
        turn: (3, 3), directions of the camera to those of the hand.
        offset: (3,) m, the camera in the hand's frame.
    """

    focal: float
    centre: Floats
    turn: Floats
    offset: Floats

    def from_hand(self, points: Floats) -> Floats:
        """Points (N, 3) m of the hand's frame in the camera's."""
        return np.asarray((points - self.offset) @ self.turn)

    def project(self, points: Floats) -> Floats:
        """What is seen, (N, 2) px, of points (N, 3) m of the hand's frame; NaN behind the camera."""
        P = self.from_hand(points)
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = self.focal * P[:, :2] / P[:, 2:] + self.centre
        return np.where(P[:, 2:] > NEAREST_DEPTH, seen, np.nan)

    def ray_directions(self, pixels: Floats) -> Floats:
        """Directions (N, 3) in the hand's frame of what is seen at pixels (N, 2), of depth 1 along the optical axis."""
        flat = (np.asarray(pixels) - self.centre) / self.focal
        return np.asarray(flat @ self.turn[:, :2].T + self.turn[:, 2])

    def interaction_matrices(self, points: Floats) -> Floats:
        """Interaction matrices (N, 2, 6): px/s of still points for the hand's twist in m/s and rad/s.

        A still point moves by -v - w x P in the hand's frame (Chaumette and Hutchinson 2006, eq. 6).
        """
        P = self.from_hand(points)
        axes = self.turn.T  # rows: the camera's in the hand's frame
        by_point = (self.focal / P[:, 2:])[:, None] * (axes[:2] - (P[:, :2] / P[:, 2:])[..., None] * axes[2])
        return np.concatenate([-by_point, by_point @ skew_matrices(points)], axis=2)


@arguments.checked(arguments.finite, mounting=arguments.optional(arguments.array(4, 4)))
@compared_by_value
@dataclass(frozen=True)
class NominalCamera:
    """What somebody believes about the camera: enough to begin without exploratory moves.

    Args:
        focal: px.
        mounting: (4, 4), the camera's pose in the hand's frame; by default it looks along the approach direction from
            the hand's origin, its x along the closing direction.
        distance: m from the camera to the object at the start; a guess within a factor of 2.

    Raises:
        InputError: a length that is not positive, or a mounting that is no pose.
    """

    focal: float
    mounting: ArrayLike | None = None
    distance: float = 0.4

    def __repr__(self) -> str:
        at = " ".join(f"{v:g}" for v in self.pose()[:3, 3].tolist())
        return f"NominalCamera({self.focal:g} px, {self.distance:g} m away, mounted at {at} m)"

    def __post_init__(self) -> None:
        if not (self.focal > 0.0 and self.distance > 0.0):
            raise InputError("focal length and distance are positive", focal=self.focal, distance=self.distance)
        self.pose()

    def pose(self) -> Floats:
        """The mounting, (4, 4)."""
        return np.eye(4) if self.mounting is None else check_pose(self.mounting)

    def camera(self, centre: Floats) -> HandCamera:
        """As a camera on the hand, with its optical axis at `centre` (2,) px."""
        pose = self.pose()
        return HandCamera(float(self.focal), centre, pose[:3, :3], pose[:3, 3])
