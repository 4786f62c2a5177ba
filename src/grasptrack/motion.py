# SPDX-License-Identifier: Apache-2.0
"""Where the reference outline is expected next: the motion of the last two frames, carried on."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.projective import jacobian, normalised

Floats = NDArray[np.float64]

MEMORY = 25
"""Frames after a loss during which the last pose still says where the object may lie."""
UNSTEADY = math.radians(3.0)
"""rad a frame by which an object may turn more than it did of late."""
FADING = 0.9
"""Share of the fastest turn that is still expected one frame later."""


class Motion:
    """Constant velocity in the group of homographies; at rest while the object is lost.

    Args:
        centre: (x, y) px of the object in the reference, where turns are measured.
    """

    def __init__(self, centre: tuple[float, float] = (0.0, 0.0)) -> None:
        self._centre = centre
        self._pose: Floats = np.eye(3)
        self._step: Floats = np.eye(3)
        self._turning = 0.0
        self.missed = 0

    def predict(self) -> Floats:
        """(3, 3) H_current_reference expected for the next frame."""
        return normalised(self._step @ self._pose) if self.missed == 0 else self._pose

    @property
    def remembered(self) -> bool:
        """Whether the last pose is recent enough to say anything."""
        return self.missed <= MEMORY

    @property
    def turn(self) -> float:
        """rad by which the object may have turned away from the prediction, if it went on as it did of late."""
        return min(math.pi, (self._turning + UNSTEADY) * (self.missed + 1))

    def angle(self, H: Floats) -> float:
        """rad by which a homography turns the object at its centre."""
        a, b, c, d = jacobian(H, *self._centre)
        return math.atan2(c - b, a + d)

    def found(self, H: Floats) -> None:
        """Learn the pose (3, 3) of this frame."""
        turned = abs(wrapped(self.angle(H) - self.angle(self._pose))) / (self.missed + 1)
        self._turning = max(turned, FADING * self._turning)
        self._step = H @ np.linalg.inv(self._pose) if self.missed == 0 else np.eye(3)
        self._pose = normalised(H)
        self.missed = 0

    def lost(self) -> None:
        """This frame gave none."""
        self.missed += 1


def wrapped(angle: float) -> float:
    """The angle in rad brought to -pi..pi."""
    return math.remainder(angle, 2.0 * math.pi)
