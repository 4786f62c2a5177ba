# SPDX-License-Identifier: Apache-2.0
"""The servo's own time: it goes on with the caller's, never goes back, and takes a jump of that clock for a short gap."""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import NamedTuple

GAP = 1.0
"""s between two calls from which on the caller's clock has jumped, or the caller has paused: no loop of control is so slow."""
STALLED = 3
"""So many calls in a row may come with the same time, as those of a clock coarser than the loop; then time is taken to pass."""
USUAL = 0.04
"""s of a call where no step was seen yet."""
LONGEST_STEP = 0.2
"""s that count as one step of control at most: after a pause the acceleration limit holds all the same."""
KEPT = 9
"""Steps of which the usual one is the median."""


class Tick(NamedTuple):
    """One call.

    Attributes:
        now: s, the servo's own time, 0 at the first call.
        step: s that count for the limits of acceleration: the usual step at most, since a longer one may be the clock's.
        goes_on: the caller's time is later than at the last call, or the clock has jumped.
        jump: s by which the caller's clock jumped; 0 where it did not.
    """

    now: float
    step: float
    goes_on: bool
    jump: float = 0.0


class ServoClock:
    """Makes the servo's time of the caller's.

    Attributes:
        jumps: how often in a row the caller's clock has jumped.
    """

    def __init__(self) -> None:
        self._told: float | None = None
        self._now = 0.0
        self._steps: deque[float] = deque(maxlen=KEPT)
        self._stalled = 0
        self.jumps = 0

    @property
    def pace(self) -> float:
        """s, the usual step; 0 before there is one."""
        return median(self._steps) if self._steps else 0.0

    @property
    def now(self) -> float:
        """s, the servo's own time at the last call."""
        return self._now

    def advance(self, told: float) -> Tick:
        """A call at a time of the caller's clock, s."""
        last, self._told = self._told, told
        if last is None:
            return Tick(0.0, 0.0, True)
        step = told - last
        if abs(step) > GAP:
            self._stalled, self.jumps = 0, self.jumps + 1
            self._now += self.pace
            return Tick(self._now, min(self.pace, LONGEST_STEP), True, step)
        self.jumps = 0
        if step <= 0.0:
            self._told = last  # a time that was a little earlier than the last one does not count twice
            self._stalled += 1
            passed = (self.pace or USUAL) if self._stalled > STALLED else 0.0
            self._now += passed
            return Tick(self._now, min(passed, LONGEST_STEP), False)
        self._stalled = 0
        usual = self.pace or step  # as it was before this one, which may be the clock's
        self._steps.append(step)
        self._now += step
        return Tick(self._now, min(step, usual, LONGEST_STEP), True)
