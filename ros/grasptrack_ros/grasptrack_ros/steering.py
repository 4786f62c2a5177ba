# SPDX-License-Identifier: Apache-2.0
"""From tracked grasps to twists at a steady rate, without ROS: when a hand may move, and that it ends with standing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import grasptrack as gt
from grasptrack.errors import InputError
from grasptrack.typing import Floats


@dataclass(frozen=True)
class ServoParameters:
    """What the servo is told, by the names of the node's parameters.

    Attributes:
        goal: a file of `Goal.save`, or of the live page's fingertips; empty where `fingertips` says it.
        fingertips: x1, y1, x2, y2, ... px of the open gripper's fingertips in the images.
        opening: m between the first two.
        beyond: m by which they shall reach past the contacts.
        dof: 4, or 6 with the tilt.
        width, height: px of the images.
        linear, angular: m/s and rad/s, the limits.
        linear_acceleration, angular_acceleration: m/s^2 and rad/s^2.
        time_limit: s after which it gives up.
        zero_twists: how many zero twists end an approach, so that one that is lost does no harm.
    """

    goal: str = ""
    fingertips: tuple[float, ...] = ()
    opening: float = 0.0
    beyond: float = 0.0
    dof: int = 4
    width: int = 640
    height: int = 480
    linear: float = 0.05
    angular: float = 0.3
    linear_acceleration: float = 0.25
    angular_acceleration: float = 1.0
    time_limit: float = 60.0
    zero_twists: int = 5

    def make_goal(self) -> gt.Goal:
        """The goal that the parameters name.

        Raises:
            InputError: none, two, or one that is none.
        """
        if bool(self.goal) == bool(self.fingertips):
            raise InputError("the servo needs one goal: the parameter goal (a file), or fingertips and opening")
        if self.goal:
            return gt.Goal.load(Path(self.goal))
        if len(self.fingertips) % 2:
            raise InputError(f"fingertips are x1, y1, x2, y2, ...: an even count, not {len(self.fingertips)}")
        points = [self.fingertips[i : i + 2] for i in range(0, len(self.fingertips), 2)]
        return gt.Goal.fingertips(points, self.opening, beyond_m=self.beyond)


class Steering:
    """A servo that is ticked.

    Twists are given while it is enabled and the approach is under way; then `zero_twists` zero ones; then None: whoever else
    moves the arm is not disturbed.

    Args:
        parameters: what it is told.

    Raises:
        InputError: parameters that the servo refuses.
    """

    def __init__(self, parameters: ServoParameters) -> None:
        self._asked = parameters
        self._enabled = False
        self._zeros = 0
        self.reset()

    def reset(self) -> None:
        """A new approach; what was learnt of the camera is learnt anew. It has to be enabled again."""
        asked = self._asked
        limits = gt.Limits(asked.linear, asked.angular, asked.linear_acceleration, asked.angular_acceleration)
        self.servo = gt.GraspServo(
            asked.make_goal(), asked.dof, size=(asked.width, asked.height), limits=limits, time_limit=asked.time_limit
        )
        self._origin: float | None = None
        self._latest = -np.inf
        self._result: tuple[gt.TrackResult, float] | None = None
        self.command: gt.Command | None = None
        self.enable(False)

    def enable(self, on: bool) -> str:
        """Let it move, or make it stand. Returns why it does not; empty when it does."""
        if on and self.servo.over:
            return f"the approach is over ({self.servo.state}: {self.servo.reason}): reset it first"
        if self._enabled and not on:
            self._zeros = self._asked.zero_twists
        self._enabled = on
        return ""

    def touched(self) -> None:
        """The hand felt something before it was to close."""
        self.servo.touched()

    def closed(self, held: bool) -> None:
        """What came of closing."""
        self.servo.closed(held)

    def take_result(self, result: gt.TrackResult, taken: float) -> None:
        """An answer of the tracker, of an image taken at a time in s; the newest one counts."""
        self._result = (result, taken)

    def tick(self, now: float, pose: Floats | None) -> Floats | None:
        """The twist (6,) in the hand's frame to publish now, m/s and rad/s; None for none.

        Args:
            now: s, on the clock of the stamps.
            pose: (4, 4) of the hand in the base; None where it is not known: then it stands.

        Raises:
            InputError: a grasp of another number of contacts than the goal has.
        """
        if not self._enabled:
            if self._zeros:
                self._zeros -= 1
                return np.zeros(6)
            return None
        if pose is None or now <= self._latest:  # where simulated time stands still, so does the hand
            return np.zeros(6)
        self._latest = now
        self._origin = now if self._origin is None else self._origin
        time = now - self._origin
        told, self._result = self._result, None
        if told is None:
            command = self.servo.between(time=time, pose=pose)
        else:
            result, taken = told
            command = self.servo.update(result, time=time, pose=pose, taken=min(taken - self._origin, time))
        self.command = command
        if self.servo.over or command.close:
            self._zeros = self._asked.zero_twists - 1
            self._enabled = False
            return np.zeros(6)
        return np.asarray(command.twist)
