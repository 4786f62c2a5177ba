# SPDX-License-Identifier: Apache-2.0
"""The servo's own time, and what counts as a new image.

Time goes on with the caller's, never goes back, and takes a jump of that clock for a short gap. An image is new pixels and
a new time, young enough; an answer that was given before is no news. The same pixels again are news while the hand stands
where it stood when they came first: a camera without noise sees nothing else then. If it has moved, the camera hangs.
"""

from __future__ import annotations

import math
from collections import deque
from statistics import median
from typing import NamedTuple

import numpy as np

from grasptrack.servo.camera import rotation_vector
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats

CLOCK_GAP = 1.0
"""s between two calls from which on the caller's clock has jumped, or the caller has paused: no loop of control is so slow."""
MAX_STALLED = 3
"""So many calls in a row may come with the same time, as those of a clock coarser than the loop; then time is taken to pass."""
MAX_JUMPS = 3
"""So many jumps of the caller's clock in a row, and its times are in no seconds."""
USUAL_STEP = 0.04
"""s of a call where no step was seen yet."""
LONGEST_STEP = 0.2
"""s that count as one step of control at most: after a pause the acceleration limit holds all the same."""
USUAL_STEPS = 9
"""Steps of which the usual one is the median, and intervals between images that tell the usual one."""
PATIENCE_IMAGES = 3
"""Intervals between images for which the hand may go on without a new one."""


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
    """Makes the servo's time of the caller's."""

    def __init__(self) -> None:
        self._told: float | None = None
        self._now = 0.0
        self._steps: deque[float] = deque(maxlen=USUAL_STEPS)
        self._stalled = 0
        self._jumps = 0

    @property
    def is_in_no_seconds(self) -> bool:
        """Whether the caller's clock has jumped in each of the last calls."""
        return self._jumps >= MAX_JUMPS

    @property
    def usual_step(self) -> float:
        """s, the usual step; 0 before there is one."""
        return median(self._steps) if self._steps else 0.0

    def advance(self, told: float) -> Tick:
        """A call at a time of the caller's clock, s."""
        last, self._told = self._told, told
        if last is None:
            return Tick(0.0, 0.0, True)
        step = told - last
        if abs(step) > CLOCK_GAP:
            self._stalled, self._jumps = 0, self._jumps + 1
            self._now += self.usual_step
            return Tick(self._now, min(self.usual_step, LONGEST_STEP), True, step)
        self._jumps = 0
        if step <= 0.0:
            self._told = last  # a time that was a little earlier than the last one does not count twice
            self._stalled += 1
            passed = (self.usual_step or USUAL_STEP) if self._stalled > MAX_STALLED else 0.0
            self._now += passed
            return Tick(self._now, min(passed, LONGEST_STEP), False)
        self._stalled = 0
        usual = self.usual_step or step  # as it was before this one, which may be the clock's
        self._steps.append(step)
        self._now += step
        return Tick(self._now, min(step, usual, LONGEST_STEP), True)


MAX_STANDING_MOTION = 2e-4
"""m, and 5 times as many rad, within which a hand stands: it shows in fewer px than a contact is known to."""
NO_IMAGE, SAME_IMAGE = "no image", "the camera gives the same image again"
TIME_STANDS = "its time is the last one's"


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
        self._intervals: deque[float] = deque(maxlen=USUAL_STEPS)
        self._came = math.nan
        self._frame: int | None = None
        self._time: float | None = None
        self._taken: float | None = None
        self._pixels_from: Floats | None = None  # the hand, when these pixels came first
        self._lags: deque[float] = deque(maxlen=USUAL_STEPS)  # s of the last images' times behind the caller's
        self.refusal = NO_IMAGE

    @property
    def image_interval(self) -> float:
        """s from one new image to the next, where none is missing; 0 before there were two.

        The lower quartile: one that were the median would grow with the images that are missing, and with it the time for
        which the hand goes on without any.
        """
        return sorted(self._intervals)[len(self._intervals) // 4] if self._intervals else 0.0

    def greatest_age(self) -> float:
        """s."""
        usual = max(self._least_age, PATIENCE_IMAGES * self.image_interval) + self._latency
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
        self.refusal = why or NO_IMAGE
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
        if result.repeated and not _is_standing(self._pixels_from, hand):
            return SAME_IMAGE
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


def _is_standing(before: Floats | None, hand: Floats) -> bool:
    """Whether the hand (4, 4) is where it was."""
    if before is None:
        return True
    turn, most = rotation_vector(before[:3, :3].T @ hand[:3, :3]), MAX_STANDING_MOTION
    return math.dist(before[:3, 3], hand[:3, 3]) < most and float(np.sqrt(turn @ turn)) < 5.0 * most
