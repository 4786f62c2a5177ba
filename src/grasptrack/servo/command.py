# SPDX-License-Identifier: Apache-2.0
"""What the servo answers to every image, and what it wants before limits."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from grasptrack.servo.aim import Aim
from grasptrack.typing import Floats

State = Literal["approaching", "converged", "holding", "searching", "closing", "done", "failed"]
OVER: tuple[State, ...] = ("done", "failed")


@dataclass(frozen=True)
class Command:
    """One answer.

    Attributes:
        twist: (6,) m/s and rad/s in the hand's frame.
        state: approaching (moves toward the grasp, the first exploratory moves included), converged (at the grasp, making
            sure), holding (sees nothing it believes: stands, or goes on as predicted), searching (looks for the object),
            closing, done, failed.
        reason: what it does and why, a short sentence.
        close: whether the hand shall close now; true in one command only.
        error: features less those of the goal (x/l, y/l, l*/l, angle in rad; with 6 DoF the normal's two components
            across the approach besides); NaN where not known.
        error_px: the farthest contact from its goal in the image, px; NaN where not known.
        height: m to go along the approach direction; NaN where not known.
        goal: (k, 2) px, where the contacts are wanted in the end; None where not known.
    """

    twist: Floats
    state: State
    reason: str
    close: bool = False
    error: Floats = field(default_factory=lambda: np.full(4, math.nan))
    error_px: float = math.nan
    height: float = math.nan
    goal: Floats | None = None


@dataclass(frozen=True)
class Intent:
    """What is wanted.

    Attributes:
        state, reason, close: as of the command.
        twist: (6,) m/s and rad/s in the hand's frame, before the limits of acceleration.
        found: the step toward the goal; None where there is none.
    """

    state: State
    reason: str
    twist: Floats = field(default_factory=lambda: np.zeros(6))
    found: Aim | None = None
    close: bool = False

    def command(self, twist: Floats) -> Command:
        """The command with the twist (6,) that limits allow."""
        f = self.found
        if f is None:
            return Command(twist, self.state, self.reason, self.close)
        return Command(twist, self.state, self.reason, self.close, f.error, f.error_px, f.height, f.final)
