# SPDX-License-Identifier: Apache-2.0
"""What the hand does while nothing is seen that fits: the policy on loss, made into states, sentences and twists."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from grasptrack.servo.aim import Aim
from grasptrack.servo.command import Intent
from grasptrack.servo.limits import Limits
from grasptrack.servo.loss import LossPolicy
from grasptrack.typing import Floats

BLINK = 0.25
"""s without the grasp that do not interrupt an exploratory move."""


class LossHandler:
    """Knows when the grasp was seen last, and how far the hand has moved back since.

    Args:
        policy: what is done, and for how long.
        limits: of velocity: following a moving object comes before them.
    """

    def __init__(self, policy: LossPolicy, limits: Limits) -> None:
        self.policy, self._limits = policy, limits
        self._last, self._retreated = math.nan, 0.0

    def seen(self, time: float) -> None:
        """The grasp is seen at a time, s."""
        self._last, self._retreated = time, 0.0

    def blinks(self, time: float) -> bool:
        """Whether it was seen a moment ago."""
        return time - self._last < BLINK

    def intent(
        self,
        why: str,
        time: float,
        waited: float,
        step: float,
        carried: Floats,
        coasting: Callable[[], Aim | None] | None,
    ) -> Intent:
        """What to do.

        Args:
            why: nothing is seen.
            time: s, now.
            waited: s since the servo began.
            step: s since the last call.
            carried: (6,) the twist that keeps the hand with the object.
            coasting: the step toward the goal as predicted; None where nothing is known that could predict it.
        """
        if math.isnan(self._last):
            if waited > self.policy.start:
                return Intent("failed", f"no grasp within {self.policy.start:g} s: {why}")
            return Intent("searching", f"waits for a grasp: {why}")
        lost = time - self._last
        along = carried if lost < self.policy.follow else np.zeros(6)
        stays = "goes along" if along.any() else "stands"
        match self.policy.step(lost, coasting is not None):
            case "coast":
                found = coasting() if coasting is not None else None
                twist = np.zeros(6) if found is None else found.twist.copy()
                twist[2] = min(twist[2], 0.0)
                doing = f"not seen for {lost:.2f} s, goes on as predicted: {why}"
                return Intent("holding", doing, self._limits.joined(twist, along), found)
            case "hold":
                return Intent("holding", f"not seen for {lost:.2f} s, {stays}: {why}", along)
            case "back off":
                twist = np.zeros(6)
                if self._retreated < self.policy.away:
                    twist[2] = -self.policy.speed
                    self._retreated += self.policy.speed * step
                doing = f"not seen for {lost:.2f} s, {stays}, moves back and looks: {why}"
                return Intent("searching", doing, self._limits.joined(twist, along))
            case _:
                return Intent("failed", f"not found again within {lost:.1f} s: {why}")
