# SPDX-License-Identifier: Apache-2.0
"""The plain textbook law, to compare with: a fixed nominal interaction matrix, no updates, nothing carried ahead.

The camera is taken to be the nominal one, and the contacts as far apart as they would be at the nominal distance in the
first image. The matrix is that of the features at the goal. Goal, limits and the end of the approach are the same as for the
other laws.
"""

from __future__ import annotations

import numpy as np

from grasptrack.servo.camera import NominalCamera
from grasptrack.servo.estimate import place_object
from grasptrack.servo.features import rms_diameter
from grasptrack.servo.sighting import Observation
from grasptrack.typing import Floats


class ClassicalIBVS:
    """Stands where `estimate.Estimate` stands: the object rests where the nominal camera saw it last.

    Args:
        seen: the first sighting.
        believed: the camera and the distance at that time.
        centre: (2,) px, the middle of the image.
    """

    linearised_at_goal = True
    """Whether the interaction matrix is that of the goal, and not that of where the points are."""

    def __init__(self, seen: Observation, believed: NominalCamera, centre: Floats) -> None:
        self.camera = believed.camera(centre)
        self._length = rms_diameter(seen.points[: seen.contacts]) * believed.distance / self.camera.focal
        self.observe(seen)

    def observe(self, seen: Observation) -> float:
        """Put the object where it is seen now; it always fits."""
        depth = self.camera.focal * self._length / rms_diameter(seen.points[: seen.contacts])
        self.object = place_object(self.camera, seen, depth, seen.hand[:3, :3])
        return 0.0

    def in_hand(self, hand: Floats, time: float | None = None) -> Floats:
        """The points (n, 3) m in the hand's frame."""
        return np.asarray((self.object.in_base() - hand[:3, 3]) @ hand[:3, :3])

    def shape(self) -> Floats:
        """The points in the object's plane, (n, 2) m."""
        return self.object.points

    def moving(self) -> Floats:
        """(3,) m/s: none is estimated."""
        return np.zeros(3)

    def normal(self, hand: Floats) -> Floats:
        """The plane's normal (3,) in the hand's frame: it is taken to face the hand as at the last sighting."""
        return np.asarray(hand[:3, :3].T @ self.object.turn[:, 2])

    def relative_error(self) -> float:
        """Nothing is doubted."""
        return 0.0
