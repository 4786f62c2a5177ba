# SPDX-License-Identifier: Apache-2.0
"""Camera and object: what is unknown, and in which order. What is seen of it is said in `kernels.expected_sightings`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasptrack.kernels.reference_sightings import FOCAL, OFFSET, PLACE, POSE, SHAPE, SPEED, TURN
from grasptrack.servo.camera import HandCamera
from grasptrack.typing import Floats

__all__ = [
    "FOCAL",
    "OFFSET",
    "PLACE",
    "POSE",
    "SHAPE",
    "SPEED",
    "TURN",
    "Placed",
    "pack_state",
    "unpack_state",
]
"""Those in capitals say where in an error of all unknowns: log focal length; the camera's turn (rad, in its own frame) and
offset (m); the object's place (m, base), turn (rad, its own frame) and velocity (m/s); then x, y of its points (m)."""


@dataclass
class Placed:
    """The object.

    Attributes:
        points: (n, 2) m in its plane.
        turn: (3, 3), its plane's axes and normal in the base.
        place: (3,) m in the base.
        speed: (3,) m/s along `axes`.
        axes: (3, 3) in the base; the third, off the plane of motion, is short where that is known.
    """

    points: Floats
    turn: Floats
    place: Floats
    speed: Floats
    axes: Floats

    def in_base(self) -> Floats:
        """The points, (n, 3) m."""
        return np.asarray(self.points @ self.turn[:, :2].T + self.place)

    def velocity(self) -> Floats:
        """(3,) m/s in the base."""
        return np.asarray(self.axes @ self.speed)

    def later(self, seconds: float) -> Placed:
        """The object when it has gone on for some time, or back."""
        return Placed(self.points, self.turn, self.place + seconds * self.velocity(), self.speed, self.axes)


def pack_state(camera: HandCamera, object_: Placed) -> Floats:
    """Both as the kernels want them, (39 + 2n,): see `grasptrack.kernels.reference_sightings`."""
    o = object_
    parts = ((camera.focal,), camera.centre, camera.turn, camera.offset, o.turn, o.place, o.speed, o.axes, o.points)
    return np.concatenate([np.ravel(part) for part in parts])


def unpack_state(state: Floats) -> tuple[HandCamera, Placed]:
    """The inverse of `pack_state`."""
    camera = HandCamera(float(state[0]), state[1:3], state[3:12].reshape(3, 3), state[12:15])
    turn, axes = state[15:24].reshape(3, 3), state[30:39].reshape(3, 3)
    return camera, Placed(state[39:].reshape(-1, 2), turn, state[24:27], state[27:30], axes)
