# SPDX-License-Identifier: Apache-2.0
"""A rolling shutter: where it shows what moves, and how long its rows take, as the images so far let it be known."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.target import Target
from grasptrack.typing import Floats

NO_BEND = np.zeros((3, 8))
"""Of what does not move, or moves nobody knows how."""
FAR = 500.0
"""Log of odds beyond which nothing changes."""


class Readout(NamedTuple):
    """Share of a usual interval between two images in which rows are read out, first to last, and the variance of that."""

    share: float
    variance: float


class Shutter:
    """How the object moves and moved when it was seen first, and what is known of the readout.

    Rows are exposed one after another, so that each place is seen at the time of its own row. To first order it lies beside
    where all would be seen at once by its speed times the time between its row and that of the object's middle, in the first
    view as in this one. Most of this a pose's error makes as well; the rest is what tells of the readout.

    Args:
        A: (3, 3) the pose in the first view.
        height: px of the image.
        numbers: the core's.

    Attributes:
        readout: as it is believed. Either all rows are exposed at once, or of a readout that there is the images told.
        shown: (3, 8) the bend of the last image in which the object was found.
    """

    def __init__(self, A: Floats, height: int, numbers: Numbers) -> None:
        self._height, self._numbers = height, numbers
        self._rigid, self.shown = A, NO_BEND
        self._velocity: Floats | None = None
        self._first: Floats | None = None
        self._information, self._views, self._sums = 0.0, 0, (0.0, 0.0, 0.0)
        self.readout = self._believed()

    def bend(self, target: Target, G: Floats, steps: float) -> Floats:
        """(3, 8) where places are seen beside the pose, for a readout of 1, as `kernels.PoseTarget.solve` takes it.

        The pose is the homography that carries the contacts exactly, up to four of them, and the outline as well as it can.

        Args:
            target: the object.
            G: (3, 3) the pose through which it is seen, roughly.
            steps: time since the last image in usual intervals.
        """
        velocity = self._speed(target, target.handle.moved(G, self.readout.share * self.shown[0]), steps)
        if velocity is None:
            return NO_BEND
        first = velocity if self._first is None else self._first
        if self._velocity is not None:  # between two images it is that in the middle of them, and goes on changing
            velocity = velocity + (velocity - self._velocity) * (steps / (steps + 1.0))
        bend = np.outer(self._rows(target, G), velocity) - np.outer(self._rows(target, target.A), first)
        bend[0] = -(target.error_of_bend @ bend[1:].ravel())
        return bend

    def follow(self, target: Target, G: Floats, bend: Floats, steps: float) -> Floats:
        """Where the object was found: its pose (3, 3), and the bend (3, 8) of that.

        Returns:
            (3, 3) the pose in which it would be seen if all rows were exposed at once.
        """
        rigid = np.asarray(target.handle.moved(G, self.readout.share * bend[0]), dtype=np.float64)
        self._velocity = self._speed(target, rigid, steps)
        self._rigid, self.shown = rigid, bend
        if self._first is None:
            self._first = self._velocity
        return rigid

    def lose(self) -> None:
        """It was not found: how it moves is not known."""
        self._rigid, self._velocity, self.shown = np.full((3, 3), math.nan), None, NO_BEND
        if self._first is None:
            self._first = np.zeros(8)

    def learn(self, share: float, variance: float, new: float) -> None:
        """What an image tells of the readout, of which the share `new` (0 to 1) is new: near views err alike.

        The mean is that of all images. What is known of it is the better of what was known and what is told, and of the other
        one that which is new; and all the less, the more the images contradict each other.
        """
        if not (variance > 0.0 and math.isfinite(variance) and math.isfinite(share)):
            return
        known, told = self._information, 1.0 / variance
        self._information = known + told - (1.0 - new) * min(known, told)
        self._views += 1
        weight, first, second = self._sums
        self._sums = weight + told, first + told * share, second + told * share**2
        self.readout = self._believed()

    def _believed(self) -> Readout:
        prior, rolling = self._numbers.readout_sd**2, self._numbers.rolling
        if not self._views:
            return Readout(0.0, rolling * prior)
        weight, first, second = self._sums
        told = first / weight
        uneven = max(1.0, (second - weight * told**2) / self._views)
        information = self._information / uneven
        variance = 1.0 / (information + 1.0 / prior)
        mean = variance * information * told
        odds = 0.5 * (mean**2 / variance + math.log(variance / prior)) + math.log(rolling / (1.0 - rolling))
        some = 1.0 / (1.0 + math.exp(min(-odds, FAR)))
        return Readout(some * mean, some * (variance + mean**2) - (some * mean) ** 2)

    def _speed(self, target: Target, rigid: Floats, steps: float) -> Floats | None:
        """(8,) the pose's change in a usual interval; None where it is not known."""
        velocity = target.difference(self._rigid, rigid) / max(steps, 1e-3)
        return velocity if math.isfinite(float(velocity @ velocity)) else None

    def _rows(self, target: Target, G: Floats) -> tuple[float, float, float]:
        """0, and the share of the image's rows by which places lie lower, at the middle, half a size to the right, and down."""
        _, (a, b, c), (d, e, f) = G.tolist()
        x, y = target.centre.tolist()
        w = d * x + e * y + f
        row, unit = (a * x + b * y + c) / w, 0.5 * target.size / self._height / w
        return 0.0, (a - row * d) * unit, (b - row * e) * unit
