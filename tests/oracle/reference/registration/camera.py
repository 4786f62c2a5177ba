# SPDX-License-Identifier: Apache-2.0
"""What a pinhole lets a rigid plane do in the image, and where the lower face of a thick part shows."""

from typing import NamedTuple

import numpy as np

from grasptrack.typing import Floats
from reference.registration.pyramid import inverse_homography
from reference.registration.target import Target

POSE_STEP, CAMERA_STEP = 0.1, 1e-3
"""Of the differences that stand for derivatives: work px, and units of theta."""
THICK = 5.0
"""Work px of thickness at which the lower face's parallax is taken."""


class PinholeRows(NamedTuple):
    """How far a pose is from a view of a rigid plane."""

    valid: bool  # whether the camera shows the reference view at all, and the misfit is finite
    misfit: Floats  # (2,) cosine of the angle of the plane's axes, and log of the ratio of their lengths: both 0 in such a view
    by_pose: Floats  # by_pose, by_camera: (2, 8) and (2, 3), derivatives by the pose's error and by theta
    by_camera: Floats


class Pinhole:
    """A camera and the plane that it looked at first.

    Args:
        target: what lies in the plane.
        theta: (3,) log of the focal length in image widths, and the first view's normal (theta_1, theta_2, 1).
        width, height: px of the image.
        aspect: width of a px for each unit of its height.

    Attributes:
        valid: whether it shows the reference view: the plane before the camera, and all maps invertible.
    """

    def __init__(self, target: Target, theta: Floats, width: float, height: float, aspect: float = 1.0) -> None:
        f = width * np.exp(theta[0])
        self.K = np.array([[f, 0.0, width / 2], [0.0, aspect * f, height / 2], [0.0, 0.0, 1.0]])
        self.back = np.linalg.inv(self.K)
        normal = _unit_vector(np.array([theta[1], theta[2], 1.0]))
        first = _unit_vector(np.array([normal[2], 0.0, -normal[0]]))
        ray = self.back @ (target.A @ np.array([*target.centre, 1.0]))
        depth = 1.0 / (normal @ ray)
        plane = np.column_stack([first, np.cross(normal, first), ray * depth])
        self.unit = plane[2, 2] / f * target.A[0, 0]
        inverse = inverse_homography(target.A)
        self.to_work = np.zeros((3, 3)) if inverse is None else inverse @ (self.K @ plane)
        self.from_work = inverse_homography(self.to_work)
        self.valid = inverse is not None and bool(depth > 0) and self.from_work is not None

    def posed(self, G: Floats) -> Floats:
        """(3, 3) the plane's axes and the target's middle in the current camera, as columns."""
        return np.asarray(self.back @ (G @ self.to_work))

    def misfit(self, G: Floats) -> Floats:
        """(2,) see `PinholeRows`."""
        a, b = self.posed(G).T[:2]
        length_a, length_b = np.sqrt(a @ a), np.sqrt(b @ b)
        return np.array([(a @ b) / (length_a * length_b), np.log(length_a / length_b)])

    def lower_face(self, target: Target, G: Floats) -> Floats:
        """(n,) work px by which the lower face's outline lies outside the upper one's, for each work px of thickness."""
        out = np.zeros(len(target.points))
        inverse = inverse_homography(G)
        if not self.valid or self.from_work is None or inverse is None:
            return out
        B = self.posed(G)
        length = 0.5 * (np.sqrt(B[:, 0] @ B[:, 0]) + np.sqrt(B[:, 1] @ B[:, 1]))
        B = B * ((-1.0 if B[2, 2] < 0 else 1.0) / length)
        down = _unit_vector(np.cross(B[:, 0], B[:, 1]))
        if down @ B[:, 2] < 0:
            down = -down
        at = np.column_stack([target.points, np.ones(len(out))]) @ self.from_work.T
        upper = np.column_stack([at[:, :2] / at[:, 2:], np.ones(len(out))]) @ B.T
        lower = (upper + THICK * self.unit * down) @ (inverse @ self.K).T
        shift = lower[:, :2] / lower[:, 2:] - target.points
        offset = shift[:, 0] * target.normals[:, 0] + shift[:, 1] * target.normals[:, 1]
        return np.where(np.isfinite(offset), np.maximum(offset, 0.0) / THICK, 0.0)


def pinhole_rows(
    target: Target, G: Floats, theta: Floats, width: float, height: float, aspect: float = 1.0
) -> PinholeRows:
    """How far the pose G (3, 3) is from a view of a rigid plane, and how that changes; `theta` as in `Pinhole`."""
    camera = Pinhole(target, theta, width, height, aspect)
    if not camera.valid:
        return PinholeRows(False, np.full(2, np.nan), np.zeros((2, 8)), np.zeros((2, 3)))
    misfit = camera.misfit(G)
    by_pose = [camera.misfit(target.moved(G, d)) - misfit for d in POSE_STEP * np.eye(8)]
    by_camera = [Pinhole(target, theta + d, width, height, aspect).misfit(G) - misfit for d in CAMERA_STEP * np.eye(3)]
    return PinholeRows(
        bool(np.isfinite(misfit).all()), misfit, np.array(by_pose).T / POSE_STEP, np.array(by_camera).T / CAMERA_STEP
    )


def _unit_vector(a: Floats) -> Floats:
    return np.asarray(a * (1.0 / np.sqrt(a @ a)))
