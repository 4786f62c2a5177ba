# SPDX-License-Identifier: Apache-2.0
"""Where the reference outline is expected next: the motion of the last two frames, carried on for as long as it took."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.projective import applied, jacobian, normalised

Floats = NDArray[np.float64]

MEMORY = 25
"""Frames after a loss during which the last pose still says where the object may lie."""
UNSTEADY = math.radians(3.0)
"""rad a frame by which an object may turn more than it did of late."""
FADING = 0.9
"""Share of the fastest turn that is still expected one frame later."""
LONGEST = 2.0
"""A motion is carried on for at most so many times the interval in which it was seen."""
CARRIED = 6
"""Frames after a loss in which the object may also have gone on as before."""
WHOLE = 1e-9
"""Intervals by which a power may differ from a whole number and be taken for it."""
SCALE = 300.0
"""px, unit of the coordinates in which powers of a homography are taken: parts of it are then alike."""


class Motion:
    """Constant velocity in the group of homographies; at rest while the object is lost.

    Args:
        centre: (x, y) px of the object in the reference, where turns are measured.
    """

    def __init__(self, centre: tuple[float, float] = (0.0, 0.0)) -> None:
        self._centre = centre
        self._pose: Floats = np.eye(3)
        self._step: Floats = np.eye(3)
        self._turning = 0.0
        self._now: float | None = None  # s, of the image at hand, of the last pose, and from the one before to it
        self._time: float | None = None
        self._interval: float | None = None
        self._expected: Floats = np.eye(3)
        self.missed = 0
        self._adrift = 0  # frames without a pose that the ground did not bridge
        self._coasting = False
        self._still = True
        self._speed = 0.0, 0.0  # px a frame of the centre, as last seen
        self._since = 0  # frames since the pose was learned

    def begin(self, time: float | None) -> None:
        """The reference image, taken at a time in s."""
        self._time = time

    def look(self, time: float | None) -> None:
        """A new image, taken at a time in s, or one frame after the last where times are not known."""
        self._now = time
        self._expected = self._pose
        if self.missed == 0:
            self._expected = normalised(power(self._step, self._ratio(), self._place()) @ self._pose)

    def predict(self) -> Floats:
        """(3, 3) H_current_reference expected in the image at hand: at constant velocity, or at rest after a loss."""
        return self._expected

    @property
    def carried(self) -> Floats | None:
        """(3, 3) expected in the image at hand if it went on as before the loss; None where that is not known."""
        if not 0 < self.missed <= CARRIED or self._still:
            return None
        times = self.missed + 1.0
        if self._now is not None and self._time is not None and self._interval is not None:
            times = (self._now - self._time) / self._interval
        if not 0.0 < times <= LONGEST * (CARRIED + 1):
            return None
        return normalised(power(self._step, times, self._place()) @ self._pose)

    @property
    def drift(self) -> tuple[float, float]:
        """(x, y) px that the centre has gone from the last pose until the image at hand, if it went on as it did."""
        times = self._since + 1.0
        return self._speed[0] * times, self._speed[1] * times

    @property
    def last(self) -> Floats:
        """(3, 3) of the last image that showed it, or to which it has coasted since."""
        return self._pose

    def _ratio(self) -> float:
        """How many times the interval in which the motion was seen has passed since."""
        if self._now is None or self._time is None or self._interval is None:
            return 1.0
        ratio = (self._now - self._time) / self._interval
        return min(ratio, LONGEST) if ratio > 0.0 else 1.0  # clocks that stand still or run backwards say nothing

    def _place(self) -> tuple[float, float]:
        """(x, y) px of the object's centre in the last image."""
        return applied(self._pose, *self._centre)

    @property
    def remembered(self) -> bool:
        """Whether the last pose is recent enough to say anything."""
        return self._adrift <= MEMORY

    @property
    def turn(self) -> float:
        """rad by which the object may have turned away from the prediction, if it went on as it did of late."""
        return min(math.pi, (self._turning + UNSTEADY) * (self.missed + 1))

    def angle(self, H: Floats) -> float:
        """rad by which a homography turns the object at its centre."""
        a, b, c, d = jacobian(H, *self._centre)
        return math.atan2(c - b, a + d)

    def found(self, H: Floats) -> None:
        """Learn the pose (3, 3) of this frame."""
        turned = abs(wrapped(self.angle(H) - self.angle(self._pose))) / (self.missed + 1)
        self._learn_speed(H)
        self._turning = max(turned, FADING * self._turning)
        self._step = H @ np.linalg.inv(self._pose) if self.missed == 0 else np.eye(3)
        self._still = self.missed > 0
        self._pose = normalised(H)
        self._interval = None
        if self._now is not None and self._time is not None and self._now > self._time:
            self._interval = self._now - self._time
        self._time = self._now
        self.missed = self._adrift = 0

    def coast(self, H: Floats) -> None:
        """The pose (3, 3) that the object must have if it moved on with the ground, in a frame that does not show it."""
        if self._since == 0:  # else the ground was out of sight as well, and what it shows may be another stretch of it
            self._learn_speed(H)
        self._pose = normalised(H)
        self._step = np.eye(3)
        self._still = self._coasting = True

    def lost(self) -> None:
        """This frame gave none."""
        self.missed += 1
        if not self._coasting:
            self._adrift += 1
        if not self._coasting or self._since:
            self._since += 1
        self._coasting = False

    def _learn_speed(self, H: Floats) -> None:
        """From the pose that was learned last to this one (3, 3)."""
        (x, y), (u, v) = self._place(), applied(H, *self._centre)
        self._speed = (u - x) / (self._since + 1.0), (v - y) / (self._since + 1.0)
        self._since = 0


def power(H: Floats, exponent: float, place: tuple[float, float]) -> Floats:
    """A homography (3, 3) near the identity to a power that need not be whole.

    Args:
        H: the motion in one interval.
        exponent: intervals, 0 or more.
        place: (x, y) px, about which it is near the identity.
    """
    step = H / np.cbrt(_determinant(H))
    whole = round(exponent) if abs(exponent - round(exponent)) < WHOLE else int(exponent)
    rest = exponent - whole
    out = np.linalg.matrix_power(step, whole) if whole != 1 else step
    if abs(rest) < WHOLE:
        return np.asarray(out, dtype=np.float64)
    there = np.array([[1.0, 0.0, -place[0]], [0.0, 1.0, -place[1]], [0.0, 0.0, SCALE]]) / SCALE
    back = np.array([[SCALE, 0.0, place[0]], [0.0, SCALE, place[1]], [0.0, 0.0, 1.0]])
    one = np.eye(3)
    beyond = there @ step @ back - one
    root = one
    for k in range(8, 0, -1):  # binomial series of (1 + E)^rest, from its end
        root = one + (beyond @ root) * ((rest - k + 1) / k)
    return np.asarray(back @ root @ there @ out, dtype=np.float64)


def _determinant(H: Floats) -> float:
    (a, b, c), (d, e, f), (g, h, i) = H.tolist()
    return float(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))


def wrapped(angle: float) -> float:
    """The angle in rad brought to -pi..pi."""
    return math.remainder(angle, 2.0 * math.pi)
