# SPDX-License-Identifier: Apache-2.0
"""What counts as an image: new pixels and a new time, young enough. An answer that was given before is no news.

The same pixels again are news of a hand that stands where it stood when they came first: a camera without noise sees nothing
else then. Of a hand that has moved they say that the camera hangs.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from grasptrack.servo.camera import rotation_vector
from grasptrack.servo.watchdog import IMAGES
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats

STANDING = 2e-4
"""m, and 5 times as many rad, within which a hand stands: it shows in fewer px than a contact is known to."""
NONE, SAME = "no image", "the camera gives the same image again"
KEPT = 9
"""Intervals between images that tell the usual one."""


class ImageGate:
    """Lets results pass that stand for a new image.

    Args:
        max_age: s between an image being taken and its answer being handed in; None for three intervals between images, and at
            least `least_age`.
        least_age: s.
        latency: s that an answer is old as a rule, which counts for nothing.

    Attributes:
        refusal: why the last result was no news; "no image" where none came since the last that was.
    """

    def __init__(self, max_age: float | None, least_age: float, latency: float) -> None:
        self._max_age, self._least_age, self._latency = max_age, least_age, latency
        self._intervals: deque[float] = deque(maxlen=KEPT)
        self._came = math.nan
        self._frame: int | None = None
        self._time: float | None = None
        self._taken: float | None = None
        self._pixels_from: Floats | None = None  # the hand, when these pixels came first
        self._lags: deque[float] = deque(maxlen=KEPT)  # s of the last images' times behind the caller's
        self.refusal = NONE

    @property
    def interval(self) -> float:
        """s from one new image to the next, where none is missing; 0 before there were two.

        The lower quartile: one that were the median would grow with the images that are missing, and with it the time for
        which the hand goes on without any.
        """
        return sorted(self._intervals)[len(self._intervals) // 4] if self._intervals else 0.0

    def greatest_age(self) -> float:
        """s."""
        usual = max(self._least_age, IMAGES * self.interval) + self._latency
        return usual if self._max_age is None else self._max_age

    def why_not(self, result: TrackResult, now: float, time: float, taken: float | None, hand: Floats) -> str:
        """Why a result is no news; empty where it is, which is then the last one.

        Args:
            result: the tracker's.
            now: s, the servo's time.
            time: s, the caller's.
            taken: s on the caller's clock, when the image was taken; None where nobody knows.
            hand: (4, 4), its pose when the image was taken.
        """
        why = self._find_fault(result, time, taken, hand)
        self.refusal = why or NONE
        if why:
            return why
        if now > self._came:
            self._intervals.append(now - self._came)
        if not result.repeated:
            self._pixels_from = hand
        if result.time is not None:
            self._lags.append(time - result.time)
        self._came, self._frame, self._time, self._taken = now, result.frame, result.time, taken
        return ""

    def break_interval(self) -> None:
        """The caller's clock stands, and time is only taken to pass: what runs until the next image tells no usual interval."""
        self._came = math.nan

    def forget_times(self) -> None:
        """The caller's clock has jumped: earlier times mean nothing any more."""
        self._taken = self._time = None
        self._came = math.nan
        self._lags.clear()

    def _find_fault(self, result: TrackResult, time: float, taken: float | None, hand: Floats) -> str:
        if result.repeated and not _stands(self._pixels_from, hand):
            return SAME
        if taken is not None:
            if self._taken is not None and taken <= self._taken:
                return f"an image of {self._taken - taken:.2f} s before the last one"
            if time - taken > self.greatest_age():
                return f"the image is {time - taken:.2f} s old"
        if self._frame is None:
            return ""
        if result.frame == self._frame:
            return "the same answer again"
        if result.time is not None and self._time is not None:
            if not result.time > self._time:
                return f"an answer for an image of {self._time - result.time:.2f} s before the last one"
        elif 0 < result.frame < self._frame:  # 0 is the first image of another tracker
            return f"an answer for frame {result.frame}, after that for frame {self._frame}"
        late = 0.0 if result.time is None or not self._lags else time - result.time - min(self._lags)
        if late > self.greatest_age() - self._latency:
            return f"the image is {late:.2f} s older than those before"
        return ""


def _stands(before: Floats | None, hand: Floats) -> bool:
    """Whether the hand (4, 4) is where it was."""
    if before is None:
        return True
    turn = rotation_vector(before[:3, :3].T @ hand[:3, :3])
    return math.dist(before[:3, 3], hand[:3, 3]) < STANDING and float(np.sqrt(turn @ turn)) < 5.0 * STANDING
