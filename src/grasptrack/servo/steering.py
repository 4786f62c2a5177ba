# SPDX-License-Identifier: Apache-2.0
"""From tracked grasps to twists at a steady rate: when a hand may move, and that it ends with standing."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from grasptrack.servo.clock import CLOCK_GAP
from grasptrack.servo.command import Command
from grasptrack.servo.controller import GraspServo
from grasptrack.servo.watchdog import Limits
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats

SLOW = Limits(linear=0.05, angular=0.3, linear_acceleration=0.25, angular_acceleration=1.0)
"""Of an arm of which nothing is known."""
OLD = 0.1
"""s from which on a pose of the hand is not where the hand is."""
WAITING = 30
"""Answers of images that are newer than the hand's pose; they wait for it."""
PAUSE = 2.0 * CLOCK_GAP
"""s that the servo is told to have passed while the hand stood: a gap, after which it compares nothing with what was before."""


class Steering:
    """A servo that is ticked.

    Twists are given while it is enabled, until the approach is over and the hand has braked; then `zero_twists` zero ones; then
    None: whoever else moves the arm is not disturbed.

    Args:
        make_servo: makes the servo of an approach.
        zero_twists: how many zero twists end an approach, so that one that is lost does no harm.

    Attributes:
        servo: of this approach.
        command: its last one; None before the first.
        enabled: it may move.
        why: why an enabled hand stands without the servo being asked; empty where it is asked.

    Raises:
        InputError: what `make_servo` raises.
    """

    def __init__(self, make_servo: Callable[[], GraspServo], zero_twists: int) -> None:
        self._make_servo, self._zero_twists = make_servo, zero_twists
        self.enabled, self._zeros, self._seen = False, 0, False
        self.reset()

    def reset(self) -> None:
        """A new approach; what was learnt of the camera is learnt anew. It has to be enabled again."""
        self.servo = self._make_servo()
        self._told = 0.0  # s, the servo's time at its last call, and how often it was called since it was enabled
        self._calls = 0
        self._origin: float | None = None
        self._now = self._at = -np.inf  # of the last tick
        self._newest = -np.inf  # images that are no newer do not count
        self._sent = np.zeros(6)
        self._waiting: deque[tuple[float, TrackResult]] = deque(maxlen=WAITING)
        self.command: Command | None = None
        self.stand_still()

    def enable(self, now: float) -> str:
        """Let it move from now (s) on, by images that are taken from now on. Returns why it does not; empty when it does."""
        if self.servo.over:
            return f"the approach is over ({self.servo.state}: {self.servo.reason}): reset it first"
        self.enabled, self._newest, self._seen = True, now, False
        self._origin = None
        self._waiting.clear()
        return ""

    def stand_still(self) -> None:
        """Make it stand at once; `enable` lets it go on."""
        if self.enabled:
            self._zeros = self._zero_twists
        self.enabled, self.why = False, ""

    def take_result(self, result: TrackResult, taken: float) -> None:
        """An answer of the tracker, of an image taken at a time in s; it counts where it is newer than what counted before."""
        if taken > self._newest:
            self._waiting.append((taken, result))

    def next_twist(self, now: float, pose: Floats | None, at: float) -> Floats | None:
        """The twist (6,) in the hand's frame to give now, m/s and rad/s; None for none.

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
        twist = self._choose_twist(now, pose, at)
        if self.servo.over and not twist.any():
            self.stand_still()
        return twist

    def _choose_twist(self, now: float, pose: Floats | None, at: float) -> Floats:
        step, moved = now - self._now, at > self._at
        self._now, self._at = now, at
        self.why = self._why_not(step, pose, at)
        if self.why:
            self._sent = np.zeros(6)
            return self._sent
        if moved or self.command is None:  # a pose that was told before is no news
            assert pose is not None
            self.command = self._ask_servo(pose, at)
        # it may have stood meanwhile, of which the servo knows nothing
        self._sent = self.servo.limits.reachable(self.command.twist, self._sent, min(step, OLD))
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

    def _ask_servo(self, pose: Floats, at: float) -> Command:
        """The servo's, with the newest answer whose image was taken while the way of the hand was known."""
        if self._origin is None:  # one call alone moved nothing, and many gaps in a row are a wrong clock
            passed = 0.0 if self.command is None else PAUSE if self._calls > 1 else OLD
            self._origin, self._calls = at - self._told - passed, 0
        origin, self._calls = self._origin, self._calls + 1
        self._told = at - origin
        known = [told for told in self._waiting if told[0] <= at]
        if not known:
            return self.servo.between(time=self._told, pose=pose)
        taken, result = max(known, key=lambda told: told[0])
        self._newest, self._seen = taken, True
        self._waiting = deque((told for told in self._waiting if told[0] > at), maxlen=WAITING)
        return self.servo.update(result, time=self._told, pose=pose, taken=taken - origin)
