# SPDX-License-Identifier: Apache-2.0
"""Small exploratory moves: one axis at a time, there and back, at rest at both ends."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grasptrack.errors import InputError
from grasptrack.typing import Floats

ORDER = {4: (0, 2, 5, 1), 6: (0, 2, 5, 1, 3, 4)}
"""Components of the twist in turn. The first alone tells mounting angle and length, so that a moving object can be followed."""


@dataclass(frozen=True)
class Exploration:
    """How the moves are made.

    Args:
        way: m, of shifts.
        turn: rad, of turns.
        seconds: of each move, there and back.

    Raises:
        InputError: one of them is not positive.
    """

    way: float = 0.008
    turn: float = 0.05
    seconds: float = 0.24

    def __post_init__(self) -> None:
        if not (self.way > 0.0 and self.turn > 0.0 and self.seconds > 0.0):
            raise InputError("exploratory moves are positive", exploration=repr(self))

    def twist(self, axis: int, elapsed: float, larger: float) -> Floats:
        """(6,) at a time since the move along an axis began, 0 after its end; `larger` multiplies the way."""
        out = np.zeros(6)
        if 0.0 <= elapsed < self.seconds:
            way = larger * (self.way if axis < 3 else self.turn)
            out[axis] = way * math.pi / self.seconds * math.sin(2.0 * math.pi * elapsed / self.seconds)
        return out
