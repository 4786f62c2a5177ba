# SPDX-License-Identifier: Apache-2.0
"""Whether the image follows the hand: each move foretells what the image does, and an image that stands still is another's.

A filter believes an object that moves along with the hand if it is only told so long enough. So what was believed a moment ago,
before any of it, is what foretells; and what is compared with it is that the image shows no motion at all.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from grasptrack.servo.estimate import DRIFT, FAR, Estimate
from grasptrack.servo.model import AXES, PLACE, expected_sightings
from grasptrack.servo.observation import Observation, block_diagonal
from grasptrack.typing import Floats

IMAGES = 3
"""Images in which it has to stand still."""
SPAN = 1.0
"""s back to which images are compared."""
STILL = 2.0
"""Standard deviations rms within which two sightings are of the same place."""


class _Sighting(NamedTuple):
    """A sighting, and what was believed before it: see `Estimate`."""

    seen: Observation
    state: Floats
    covariance: Floats
    time: float
    wander: float


class ImageCheck:
    """Remembers sightings, and what was believed before each."""

    def __init__(self) -> None:
        self._kept: deque[_Sighting] = deque()

    def forget(self) -> None:
        """What was seen before is no longer compared: another grasp, or another estimate."""
        self._kept.clear()

    def why_not(self, seen: Observation, known: Estimate) -> str:
        """Why a sighting cannot be believed: the object stands still in the image while the hand moves. Empty otherwise.

        Args:
            seen: the sighting.
            known: what is believed of camera and object before it.
        """
        if self._kept and len(self._kept[-1].seen.points) != len(seen.points):
            self._kept.clear()
        while self._kept and self._kept[0].seen.time < seen.time - SPAN:
            self._kept.popleft()
        still = []
        for one in reversed(self._kept):  # the longest row of sightings of the same place
            if not _rms_size(seen.points - one.seen.points, seen.noise + one.seen.noise) <= STILL:
                break
            still.append(one)
        self._kept.append(_Sighting(seen, known.packed_state, known.covariance, known.time, known.wander_at(seen.time)))
        if any(_contradicts(first, seen) for first in still[IMAGES - 2 :]):
            return (
                "the image does not follow the hand: the object stands still in it while the hand moves, as in that of another "
                "camera, of one that hangs, or where the object moves along with the hand"
            )
        return ""


def _contradicts(before: _Sighting, seen: Observation) -> bool:
    """Whether it is all but impossible, by what was believed before, that the image shows no motion now."""
    n, first = len(seen.points), before.seen
    hands = np.stack([first.hand, seen.hand])
    pixels, slopes = expected_sightings(before.state, hands, np.array([first.time, seen.time]) - before.time)
    shift = (pixels[n:] - pixels[:n]).ravel()
    if not np.isfinite(shift).all():
        return False
    slope = slopes[2 * n :] - slopes[: 2 * n]
    apart, axes = max(seen.time - before.time, 0.0), slopes[2 * n :, PLACE] @ before.state[AXES].reshape(3, 3)
    strays = DRIFT**2 * apart + before.wander**2 * apart**3 / 3.0
    spread = slope @ before.covariance @ slope.T + strays * axes @ axes.T + block_diagonal(first.noise + seen.noise)
    return bool(np.sqrt(shift @ np.linalg.solve(spread, shift) / len(shift)) > FAR)


def _rms_size(off: Floats, noise: Floats) -> float:
    """In standard deviations, (n, 2) px of covariances (n, 2, 2)."""
    squares = np.einsum("ni,nij,nj->n", off, np.linalg.inv(noise), off)
    return float(np.sqrt(squares.mean() / 2.0))
