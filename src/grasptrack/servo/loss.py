# SPDX-License-Identifier: Apache-2.0
"""What the hand does while the grasp is not seen: an explicit policy with time-outs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from grasptrack.errors import InputError

Step = Literal["coast", "hold", "back off", "give up"]


@dataclass(frozen=True)
class LossPolicy:
    """Steps after a loss, each for its time, in this order.

    Args:
        coast: s for which it goes on as predicted, without going down. 0 where it does not know how to.
        hold: s for which it then stands.
        back_off: s for which it then moves back to see more, and looks.
        speed: m/s of moving back.
        away: m that it moves back at most.
        follow: s for which it stays with an object that moved, through all these steps.
        start: s for which it waits for a first grasp.

    Raises:
        InputError: a time below 0, or a speed that is not positive.
    """

    coast: float = 1.0
    hold: float = 0.5
    back_off: float = 6.0
    speed: float = 0.06
    away: float = 0.15
    follow: float = 3.0
    start: float = 5.0

    def __post_init__(self) -> None:
        if min(self.coast, self.hold, self.back_off, self.away, self.follow, self.start) < 0.0 or not self.speed > 0.0:
            raise InputError("times of a loss policy are 0 or more, its speed positive", policy=repr(self))

    def step(self, lost: float, can_coast: bool) -> Step:
        """What to do after `lost` s without the grasp."""
        coast = self.coast if can_coast else 0.0
        if lost < coast:
            return "coast"
        if lost < coast + self.hold:
            return "hold"
        if lost < coast + self.hold + self.back_off:
            return "back off"
        return "give up"
