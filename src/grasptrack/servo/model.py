# SPDX-License-Identifier: Apache-2.0
"""What a camera on a hand sees of points on a plane that may move, and the derivatives by everything that is unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasptrack.servo.camera import HandCamera
from grasptrack.servo.geometry import rotation, skews

Floats = NDArray[np.float64]

FOCAL, TURN, OFFSET, PLACE, POSE = 0, slice(1, 4), slice(4, 7), slice(7, 10), slice(10, 13)
SPEED, SHAPE = slice(13, 16), 16
"""Where in an error of all unknowns: log focal length; the camera's turn (rad, in its own frame) and offset (m); the object's
place (m, base), turn (rad, its own frame) and velocity (m/s); then x, y of its points (m)."""


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


def changed(camera: HandCamera, object_: Placed, by: Floats) -> tuple[HandCamera, Placed]:
    """Camera and object after a step (16 + 2n,) of all unknowns."""
    o = object_
    moved = Placed(
        o.points + by[SHAPE:].reshape(-1, 2),
        o.turn @ rotation(by[POSE]),
        o.place + by[PLACE],
        o.speed + by[SPEED],
        o.axes,
    )
    return camera.changed(float(np.clip(by[FOCAL], -0.5, 0.5)), by[TURN], by[OFFSET]), moved


def expected(camera: HandCamera, object_: Placed, hands: Floats, later: Floats) -> tuple[Floats, Floats]:
    """What is seen from many poses of the hand, and how it changes with all unknowns.

    Args:
        camera: the camera.
        object_: the object.
        hands: (N, 4, 4) poses in the base.
        later: (N,) s, of each pose after the time at which the object is where it is said to be.

    Returns:
        Pixels (N, n, 2), NaN behind the camera, and derivatives (N, n, 2, 16 + 2n).
    """
    N, n = len(hands), len(object_.points)
    way = later[:, None] * object_.velocity()
    base = object_.in_base()[None] + way[:, None]
    in_hand = (base - hands[:, None, :3, 3]) @ hands[:, :3, :3]
    flat = in_hand.reshape(-1, 3)
    pixels = camera.project(flat).reshape(N, n, 2)
    P = camera.from_hand(flat)
    A = camera.slopes(flat)
    out = np.zeros((N, n, 2, SHAPE + 2 * n))
    out[..., FOCAL] = pixels - camera.centre
    out[..., TURN] = (A @ skews(P)).reshape(N, n, 2, 3)
    out[..., OFFSET] = (-A @ camera.turn.T).reshape(N, n, 2, 3)
    to_camera = camera.turn.T @ np.swapaxes(hands[:, :3, :3], 1, 2)
    by_place = A.reshape(N, n, 2, 3) @ to_camera[:, None]
    out[..., PLACE] = by_place
    local = np.column_stack([object_.points, np.zeros(n)])
    out[..., POSE] = -by_place @ (object_.turn @ skews(local))
    out[..., SPEED] = by_place @ object_.axes * later[:, None, None, None]
    by_shape = by_place @ object_.turn[:, :2]
    for i in range(n):
        out[:, i, :, SHAPE + 2 * i : SHAPE + 2 * i + 2] = by_shape[:, i]
    return pixels, out
