# SPDX-License-Identifier: Apache-2.0
"""Where the hand was when an image was taken."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque

from grasptrack.servo.geometry import interpolate_pose
from grasptrack.typing import Floats


class Poses:
    """The last poses that the robot reported, and those between them.

    Args:
        kept: how many.
    """

    def __init__(self, kept: int = 100) -> None:
        self._times: deque[float] = deque(maxlen=kept)
        self._poses: deque[Floats] = deque(maxlen=kept)

    def add(self, time: float, pose: Floats) -> None:
        """A pose (4, 4) at a time, s, later than those before."""
        self._times.append(time)
        self._poses.append(pose)

    def at(self, time: float) -> Floats:
        """The pose at a time; before the first that is kept, and after the last, that one."""
        i = bisect_left(self._times, time)
        if i == 0:
            return self._poses[0]
        if i == len(self._times):
            return self._poses[-1]
        before, after = self._times[i - 1], self._times[i]
        if time == after:
            return self._poses[i]
        return interpolate_pose(self._poses[i - 1], self._poses[i], (time - before) / (after - before))
