# SPDX-License-Identifier: Apache-2.0
"""From tracked grasps to twists at a steady rate, without ROS: when a hand may move, and that it ends with standing."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import grasptrack as gt
from grasptrack.errors import InputError
from grasptrack.typing import Floats

OLD = 0.1
"""s from which on a pose of the hand is not where the hand is."""
WAITING = 30
"""Answers of images that are newer than the hand's pose; they wait for it."""


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
        max_age: s, the oldest image that counts, by its stamp; 0 for three times what lies between images, at least 0.3 s.
        retries: how often it tries again after closing on nothing.
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
    max_age: float = 0.0
    retries: int = 0
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

    Twists are given while it is enabled, until the approach is over and the hand has braked; then `zero_twists` zero ones; then
    None: whoever else moves the arm is not disturbed.

    Args:
        parameters: what it is told.

    Attributes:
        servo: of this approach.
        command: its last one; None before the first.
        enabled: it may move.
        why: why an enabled hand stands without the servo being asked; empty where it is asked.

    Raises:
        InputError: parameters that the servo refuses.
    """

    def __init__(self, parameters: ServoParameters) -> None:
        self._asked = parameters
        self.enabled, self._zeros, self._seen = False, 0, False
        self.reset()

    def reset(self) -> None:
        """A new approach; what was learnt of the camera is learnt anew. It has to be enabled again."""
        asked = self._asked
        self._limits = gt.Limits(asked.linear, asked.angular, asked.linear_acceleration, asked.angular_acceleration)
        self.servo = gt.GraspServo(
            asked.make_goal(),
            asked.dof,
            size=(asked.width, asked.height),
            limits=self._limits,
            time_limit=asked.time_limit,
            max_age=asked.max_age or None,
            retries=asked.retries,
        )
        self._origin: float | None = None
        self._now = self._at = -np.inf  # of the last tick
        self._newest = -np.inf  # images that are no newer do not count
        self._sent = np.zeros(6)
        self._waiting: deque[tuple[float, gt.TrackResult]] = deque(maxlen=WAITING)
        self.command: gt.Command | None = None
        self.stand()

    def enable(self, now: float) -> str:
        """Let it move from now (s) on, by images that are taken from now on. Returns why it does not; empty when it does."""
        if self.servo.over:
            return f"the approach is over ({self.servo.state}: {self.servo.reason}): reset it first"
        self.enabled, self._newest, self._seen = True, now, False
        self._waiting.clear()
        return ""

    def stand(self) -> None:
        """Make it stand at once; `enable` lets it go on."""
        if self.enabled:
            self._zeros = self._asked.zero_twists
        self.enabled, self.why = False, ""

    def take_result(self, result: gt.TrackResult, taken: float) -> None:
        """An answer of the tracker, of an image taken at a time in s; it counts where it is newer than what counted before."""
        if taken > self._newest:
            self._waiting.append((taken, result))

    def tick(self, now: float, pose: Floats | None, at: float) -> Floats | None:
        """The twist (6,) in the hand's frame to publish now, m/s and rad/s; None for none.

        Args:
            now: s, on the clock of the stamps.
            pose: (4, 4) of the hand in the base; None where it is not known: then it stands.
            at: s, when the hand was there, by the stamp of the pose.

        Raises:
            InputError: a pose that is none.
        """
        if not self.enabled:
            if self._zeros > 0:
                self._zeros -= 1
                return np.zeros(6)
            return None
        twist = self._twist(now, pose, at)
        if self.servo.over and not twist.any():
            self.stand()
        return twist

    def _twist(self, now: float, pose: Floats | None, at: float) -> Floats:
        step, moved = now - self._now, at > self._at
        self._now, self._at = now, at
        self.why = self._why_not(step, pose, at)
        if self.why:
            self._sent = np.zeros(6)
            return self._sent
        if moved or self.command is None:  # a pose that was told before is no news
            assert pose is not None
            self.command = self._command(pose, at)
        # it may have stood meanwhile, of which the servo knows nothing
        self._sent = self._limits.reachable(self.command.twist, self._sent, min(step, OLD))
        return self._sent

    def _why_not(self, step: float, pose: Floats | None, at: float) -> str:
        if pose is None:
            return "nobody knows where it is"
        if abs(self._now - at) > OLD:
            return f"its pose is of {self._now - at:.2f} s ago, and may be of {OLD:g} s ago, on this clock"
        if not step > 0.0:
            return "time stands still"
        if not self._seen and not any(taken <= at for taken, _ in self._waiting):
            return "no grasp of an image since it was enabled"
        return ""

    def _command(self, pose: Floats, at: float) -> gt.Command:
        """The servo's, with the newest answer whose image was taken while the way of the hand was known."""
        origin = self._origin = at if self._origin is None else self._origin
        known = [told for told in self._waiting if told[0] <= at]
        if not known:
            return self.servo.between(time=at - origin, pose=pose)
        taken, result = max(known, key=lambda told: told[0])
        self._newest, self._seen = taken, True
        self._waiting = deque((told for told in self._waiting if told[0] > at), maxlen=WAITING)
        return self.servo.update(result, time=at - origin, pose=pose, taken=taken - origin)
