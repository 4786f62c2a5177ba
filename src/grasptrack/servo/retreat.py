# SPDX-License-Identifier: Apache-2.0
"""The way back: a hand that closed on nothing goes back along its own path, where nothing was in its way."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from grasptrack.servo.camera import rotation_vector
from grasptrack.typing import Floats

APART = 0.004
"""m between the places that are remembered."""
KEPT = 400
"""Places."""
GAIN = 4.0
"""1/s at which the hand turns and goes to the next place, up to its speed."""


class _Place(NamedTuple):
    time: float
    pose: Floats


class Trail:
    """The places where the hand has been, as seen from the object: one on a belt has gone on since.

    Args:
        speed: m/s of going back.
        far: m from where it closed at which it has gone back far enough.
    """

    def __init__(self, speed: float, far: float) -> None:
        self._speed, self._far = speed, far
        self._places: deque[_Place] = deque(maxlen=KEPT)
        self._from: _Place | None = None

    def add(self, now: float, hand: Floats) -> None:
        """The hand (4, 4) is at a place, s."""
        if not self._places or math.dist(self._places[-1].pose[:3, 3], hand[:3, 3]) > APART:
            self._places.append(_Place(now, hand))

    def begin(self, now: float, hand: Floats) -> None:
        """From here it goes back."""
        self._from = _Place(now, hand)

    def twist_back(self, now: float, hand: Floats, velocity: Floats) -> Floats | None:
        """The twist (6,) toward the place before, less what carries the hand along with the object; None once it is there.

        Args:
            now: s.
            hand: (4, 4).
            velocity: (3,) m/s of the object in the base.
        """
        start = self._from
        if start is None or math.dist(_carried(start, now, velocity), hand[:3, 3]) >= self._far:
            return None
        while self._places:
            way = _carried(self._places[-1], now, velocity) - hand[:3, 3]
            if float(np.sqrt(way @ way)) > APART:
                turn = rotation_vector(hand[:3, :3].T @ self._places[-1].pose[:3, :3])
                size = float(np.sqrt(way @ way))
                back = hand[:3, :3].T @ way * min(GAIN, self._speed / size)
                return np.concatenate([back, GAIN * turn])
            self._places.pop()
        return None


def _carried(place: _Place, now: float, velocity: Floats) -> Floats:
    """(3,) m, where a place of the object's surroundings is by now."""
    return np.asarray(place.pose[:3, 3] + (now - place.time) * velocity)
