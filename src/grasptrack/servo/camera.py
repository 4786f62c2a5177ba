# SPDX-License-Identifier: Apache-2.0
"""A pinhole camera that a hand carries: what it sees of points, and how that changes with the hand's twist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grasptrack.errors import InputError
from grasptrack.servo.geometry import check_pose, skew_matrices
from grasptrack.typing import Floats

NEAREST = 1e-3
"""m in front of the camera within which nothing is projected."""


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
        return np.where(P[:, 2:] > NEAREST, seen, np.nan)

    def rays(self, pixels: Floats) -> Floats:
        """Directions (N, 3) in the hand's frame of what is seen at pixels (N, 2), of depth 1 along the optical axis."""
        flat = (np.asarray(pixels) - self.centre) / self.focal
        return np.asarray(flat @ self.turn[:, :2].T + self.turn[:, 2])

    def interaction(self, points: Floats) -> Floats:
        """Interaction matrices (N, 2, 6): px/s of still points for the hand's twist in m/s and rad/s.

        A still point moves by -v - w x P in the hand's frame (Chaumette and Hutchinson 2006, eq. 6).
        """
        P = self.from_hand(points)
        axes = self.turn.T  # rows: the camera's in the hand's frame
        by_point = (self.focal / P[:, 2:])[:, None] * (axes[:2] - (P[:, :2] / P[:, 2:])[..., None] * axes[2])
        return np.concatenate([-by_point, by_point @ skew_matrices(points)], axis=2)


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
