# SPDX-License-Identifier: Apache-2.0
"""Camera and object: what is unknown, and in which order; what is seen of it, and how it goes on.

A *state* is one array (39 + 2n,): focal length px; centre (2) px; the camera's turn (9), its directions to those of the hand,
row after row, and offset (3) m in the hand's frame; the object's turn (9), its plane's axes and normal in the base, and place
(3) m; its velocity (3) m/s along axes (9) in the base; its points (n, 2) m in its plane. A *step* of all unknowns is
(16 + 2n,): log focal length; the camera's turn (rad, in its own frame) and offset; the object's place, turn (rad, in its own
frame) and velocity; its points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasptrack.servo.camera import NEAREST_DEPTH, HandCamera, rotation_matrix, rotation_vector, skew_matrices
from grasptrack.typing import Floats

CENTRE, CAMERA, CAMERA_AT, OBJECT = slice(1, 3), slice(3, 12), slice(12, 15), slice(15, 24)
OBJECT_AT, GOING, AXES, POINTS = slice(24, 27), slice(27, 30), slice(30, 39), 39
"""Where in a state; its first entry is the focal length."""
FOCAL, TURN, OFFSET, PLACE, POSE = 0, slice(1, 4), slice(4, 7), slice(7, 10), slice(10, 13)
SPEED, SHAPE = slice(13, 16), 16
"""Where in a step."""
MAX_FOCAL_STEP = 0.5
"""Most by which a step changes the log of the focal length."""


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

    def predict_after(self, seconds: float) -> Placed:
        """The object when it has gone on for some time, or back."""
        return Placed(self.points, self.turn, self.place + seconds * self.velocity(), self.speed, self.axes)


def pack_state(camera: HandCamera, object_: Placed) -> Floats:
    """Both as a state, (39 + 2n,)."""
    o = object_
    parts = ((camera.focal,), camera.centre, camera.turn, camera.offset, o.turn, o.place, o.speed, o.axes, o.points)
    return np.concatenate([np.ravel(part) for part in parts])


def unpack_state(state: Floats) -> tuple[HandCamera, Placed]:
    """The inverse of `pack_state`."""
    camera = HandCamera(float(state[0]), state[1:3], state[3:12].reshape(3, 3), state[12:15])
    turn, axes = state[15:24].reshape(3, 3), state[30:39].reshape(3, 3)
    return camera, Placed(state[39:].reshape(-1, 2), turn, state[24:27], state[27:30], axes)


def retract_state(state: Floats, step: Floats) -> Floats:
    """The state (39 + 2n,) after a step (16 + 2n,); the log focal length changes by at most 0.5."""
    out = state.copy()
    out[0] *= np.exp(np.clip(step[FOCAL], -MAX_FOCAL_STEP, MAX_FOCAL_STEP))
    out[CAMERA] = (state[CAMERA].reshape(3, 3) @ rotation_matrix(step[TURN])).ravel()
    out[OBJECT] = (state[OBJECT].reshape(3, 3) @ rotation_matrix(step[POSE])).ravel()
    out[CAMERA_AT] += step[OFFSET]
    out[OBJECT_AT] += step[PLACE]
    out[GOING] += step[SPEED]
    out[POINTS:] += step[SHAPE:]
    return out


def state_difference(first: Floats, second: Floats) -> Floats:
    """The step (16 + 2n,) that takes one state to another."""
    d = np.zeros(len(first) - POINTS + SHAPE)
    d[FOCAL] = np.log(second[0] / first[0])
    d[TURN] = rotation_vector(first[CAMERA].reshape(3, 3).T @ second[CAMERA].reshape(3, 3))
    d[POSE] = rotation_vector(first[OBJECT].reshape(3, 3).T @ second[OBJECT].reshape(3, 3))
    d[OFFSET], d[PLACE] = second[CAMERA_AT] - first[CAMERA_AT], second[OBJECT_AT] - first[OBJECT_AT]
    d[SPEED], d[SHAPE:] = second[GOING] - first[GOING], second[POINTS:] - first[POINTS:]
    return d


def expected_sightings(state: Floats, hands: Floats, later: Floats) -> tuple[Floats, Floats]:
    """What is seen from poses (N, 4, 4) of the hand, (N,) s after the time of the state, and how it changes with all unknowns.

    Pixels (N n, 2), NaN behind the camera, and derivatives (2 N n, 16 + 2n); of points behind the camera these say nothing.
    """
    n, N = (len(state) - POINTS) // 2, len(hands)
    focal, points, axes = float(state[0]), state[POINTS:].reshape(n, 2), state[AXES].reshape(3, 3)
    turn, pose = state[CAMERA].reshape(3, 3), state[OBJECT].reshape(3, 3)
    base = points @ pose[:, :2].T + state[OBJECT_AT]
    moved = base[None] + (later[:, None] * (axes @ state[GOING]))[:, None]
    in_hand = (moved - hands[:, None, :3, 3]) @ hands[:, :3, :3]
    P = (in_hand.reshape(-1, 3) - state[CAMERA_AT]) @ turn
    out, A = np.zeros((N, n, 2, SHAPE + 2 * n)), np.zeros((N * n, 2, 3))
    with np.errstate(all="ignore"):
        pixels = np.where(P[:, 2:] > NEAREST_DEPTH, focal * P[:, :2] / P[:, 2:] + state[CENTRE], np.nan)
        A[:, 0, 0] = A[:, 1, 1] = focal / P[:, 2]
        A[:, :, 2] = -focal * P[:, :2] / P[:, 2:] ** 2
        out[..., FOCAL] = (pixels - state[CENTRE]).reshape(N, n, 2)
        out[..., TURN] = (A @ skew_matrices(P)).reshape(N, n, 2, 3)
        out[..., OFFSET] = (-A @ turn.T).reshape(N, n, 2, 3)
        to_camera = turn.T @ np.swapaxes(hands[:, :3, :3], 1, 2)
        by_place = A.reshape(N, n, 2, 3) @ to_camera[:, None]
        out[..., PLACE] = by_place
        out[..., POSE] = -by_place @ (pose @ skew_matrices(np.column_stack([points, np.zeros(n)])))
        out[..., SPEED] = by_place @ axes * later[:, None, None, None]
        by_shape = by_place @ pose[:, :2]
        for i in range(n):
            out[:, i, :, SHAPE + 2 * i : SHAPE + 2 * i + 2] = by_shape[:, i]
    return pixels, out.reshape(2 * N * n, -1)


def advance_state(
    state: Floats, covariance: Floats, seconds: float, drift: float, wander: float, twirl: float
) -> tuple[Floats, Floats]:
    """State and covariance after some time in which the object goes on.

    Args:
        state: (39 + 2n,) before.
        covariance: (16 + 2n, 16 + 2n) of its error.
        seconds: how long.
        drift: m^2/s by which the object may creep.
        wander: (m/s)^2/s by which its velocity may change.
        twirl: rad^2/s by which it may turn about its plane's normal.
    """
    state, P, axes = state.copy(), covariance.copy(), state[AXES].reshape(3, 3)
    state[OBJECT_AT] += seconds * axes @ state[GOING]
    P[PLACE] += seconds * axes @ P[SPEED]
    P[:, PLACE] += seconds * P[:, SPEED] @ axes.T
    P[PLACE, PLACE] += axes @ axes.T * (drift * seconds + wander * seconds**3 / 3.0)
    P[SPEED, SPEED] += np.eye(3) * wander * seconds
    P[PLACE, SPEED] += axes * (wander * seconds**2 / 2.0)
    P[SPEED, PLACE] += axes.T * (wander * seconds**2 / 2.0)
    P[POSE.stop - 1, POSE.stop - 1] += twirl * seconds
    return state, P
