# SPDX-License-Identifier: Apache-2.0
"""Rigid frames, (4, 4): the pose of one frame in another; and what a pinhole camera makes of them.

The world has z up and the table at z = 0. A camera's frame has x right, y down and z into the scene.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from grasptrack.geometry.homographies import rotation_about_z
from grasptrack.servo.camera import inverse_pose, pose_of, quaternion_of
from grasptrack.typing import Floats

__all__ = [
    "DOWN", "NEAR", "about_x", "about_y", "convex_silhouette", "inverse_pose", "plane_to_image", "pose_of", "project_points",
    "rotation_to_quaternion", "tilt_rotation",
]  # fmt: skip

DOWN: Floats = np.diag([1.0, -1.0, -1.0])
"""Rotation of a hand that points straight down and whose x is that of the world."""
NEAR = 0.01
"""m in front of a camera, nearer than which nothing is drawn."""


def about_x(angle: float) -> Floats:
    """(3, 3) rotation by an angle in rad."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def about_y(angle: float) -> Floats:
    """(3, 3) rotation by an angle in rad."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def tilt_rotation(angle: float, toward: float) -> Floats:
    """(3, 3) rotation by `angle` rad about the horizontal axis in direction `toward`."""
    return rotation_about_z(toward) @ about_x(angle) @ rotation_about_z(-toward)


def rotation_to_quaternion(R: Floats) -> Floats:
    """(4,) w x y z of a rotation (3, 3), as MuJoCo has it; w is not negative."""
    return np.roll(quaternion_of(R), 1)


def plane_to_image(K: Floats, camera_pose: Floats, plane: Floats, height: float = 0.0) -> Floats:
    """(3, 3) from a plane to ideal px: a point (u, v) of an outline, x right and y down from above, lies at (u, -v, height).

    Camera and plane have their poses (4, 4) in the world; the height is m along the body's z.
    """
    T = np.linalg.inv(camera_pose) @ plane
    H = K @ np.column_stack([T[:3, 0], -T[:3, 1], T[:3, 3] + height * T[:3, 2]])
    return np.asarray(H / H[2, 2], dtype=np.float64)


def project_points(K: Floats, to_camera: Floats, points: Floats) -> Floats:
    """(N, 2) px of points (N, 3), carried into the camera's frame by (4, 4)."""
    seen = points @ to_camera[:3, :3].T + to_camera[:3, 3]
    image = seen @ K.T
    return np.asarray(image[:, :2] / image[:, 2:], dtype=np.float64)


def convex_silhouette(K: Floats, to_camera: Floats, corners: Floats) -> Floats | None:
    """(M, 2) px, the convex outline of a convex body; None where it is not all in front of the camera."""
    depth = corners @ to_camera[2, :3] + to_camera[2, 3]
    if depth.min() < NEAR:
        return None
    hull = cv2.convexHull(project_points(K, to_camera, corners).astype(np.float32))
    return np.asarray(hull[:, 0], dtype=np.float64)
