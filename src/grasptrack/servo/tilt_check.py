# SPDX-License-Identifier: Apache-2.0
"""Whether a hand of 4 degrees of freedom may take the part as it lies: one that is tilted against the hand it meets askew.

The estimate of such a hand takes the plane to be square to the approach direction. Here the same sightings are explained with
the plane left free, until its tilt is known as well as matters for the fingertips.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from grasptrack.servo.estimate import Estimate, normalized_residual
from grasptrack.servo.features import rms_diameter
from grasptrack.servo.first_estimate import FirstEstimate, UnexploredError, initialize_calibration
from grasptrack.servo.model import POSE
from grasptrack.servo.observation import Observation
from grasptrack.typing import Floats

EVERY = 3
"""Sightings from one look to the next."""
FREE = 0.3
"""rad by which the plane may be tilted."""
ALIKE = 2.0
"""px by which points are off alike in all images, as those of a thick part are: more images do not make that less."""
CORRELATED, ODDS = 5, 1e3
"""Sightings in a row that count as one, since their errors are much the same; odds at which a tilted plane is believed."""
LEFT = 0.7
"""Share of what is not explained that a tilted plane leaves at most: the tracker's small errors are left by either."""
NOISE = 0.5
"""Variance of what it leaves, over that of a sighting, at most: a part that is moved meanwhile is explained by no plane."""
MOST = 25.0
"""Squared standard deviations that a sighting counts at most."""
SURE = 3.0
"""Standard deviations by which the fingertips' error has to lie below or above what is forgiven."""


class Tilt(NamedTuple):
    """A plane that was left free.

    Attributes:
        found: what explains the sightings so.
        angle, sd: rad, of its normal to the approach direction.
        width: m between the first two contacts.
    """

    found: FirstEstimate
    angle: float
    sd: float
    width: float

    @property
    def tips_error(self) -> float:
        """m along the approach direction by which a fingertip and its contact are apart when the hand is right on average."""
        return 0.5 * self.width * math.sin(self.angle)

    @property
    def tips_sd(self) -> float:
        """m, its standard deviation."""
        return 0.5 * self.width * self.sd


class TiltCheck:
    """Looks now and then until the tilt is known.

    Args:
        forgiven: m by which a fingertip may be off along the approach direction.
    """

    def __init__(self, forgiven: float) -> None:
        self._forgiven = forgiven
        self._count, self._known = 0, False

    def look(self, seen: Sequence[Observation], square: Estimate, centre: Floats, side: float) -> Tilt | None:
        """The tilt, once it is known to be less than what is forgiven, or more; None before, and afterwards.

        Args:
            seen: sightings of an object that rests or moves evenly, those of the exploratory moves among them.
            square: the estimate so far, which takes the plane to be square to the hand.
            centre: (2,) px, the middle of the image.
            side: px, its larger side.
        """
        self._count += 1
        if self._known or self._count % EVERY or len(seen[-1].points) == seen[-1].contacts:
            return None
        try:
            found = initialize_calibration(seen, centre, side, FREE)
        except (UnexploredError, ValueError, np.linalg.LinAlgError):
            return None
        known = found.estimate
        normal, spread = known.normal(seen[-1].hand), known.covariance[POSE, POSE][:2, :2]
        width = math.dist(*known.shape()[:2].tolist())
        alike = ALIKE / rms_diameter(seen[-1].points[: seen[-1].contacts])
        sd = math.sqrt(float(np.trace(spread)) + alike**2)
        tilt = Tilt(found, math.acos(min(1.0, float(normal[2]))), sd, width)
        decided = abs(tilt.tips_error - self._forgiven) > SURE * tilt.tips_sd
        self._known = decided and (tilt.angle < SURE * sd or _is_likelier(known, square, seen))
        return tilt if self._known else None

    def is_too_large(self, tilt: Tilt) -> bool:
        """Whether the fingertips would be off by more than is forgiven."""
        return tilt.tips_error > self._forgiven


def _is_likelier(one: Estimate, other: Estimate, seen: Sequence[Observation]) -> bool:
    """Whether the sightings speak clearly for one estimate: it leaves less of them, and not just of their small errors."""
    left, instead = (_unexplained(each, seen) for each in (one, other))
    explains = left < NOISE * 2 * sum(len(each.points) for each in seen)
    return explains and instead - left > 2.0 * CORRELATED * math.log(ODDS) and left < LEFT * instead


def _unexplained(known: Estimate, seen: Sequence[Observation]) -> float:
    """What is left of all sightings, in squared standard deviations."""
    sizes = [normalized_residual(known, one) ** 2 for one in seen]
    return sum(2 * len(one.points) * min(size, MOST) for one, size in zip(seen, sizes, strict=True))
