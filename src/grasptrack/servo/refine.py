# SPDX-License-Identifier: Apache-2.0
"""Camera and object from all sightings at once: robust Levenberg-Marquardt, with what was known before as a prior.

The filter stays linearised where it was when a sighting came, and is then too sure of what it has. Here every sighting is
linearised anew at the present result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grasptrack import kernels
from grasptrack.servo.camera import HandCamera
from grasptrack.servo.estimate import ROBUST, Estimate
from grasptrack.servo.model import Placed, pack_state
from grasptrack.servo.sighting import Observation, stack_observations
from grasptrack.typing import Floats

SETTLED, HOPELESS = 1e-2, 1e6
"""Fall of the cost, in squared standard deviations, and damping at which a search ends."""


@dataclass(frozen=True)
class Origin:
    """What was known before.

    Attributes:
        camera: most likely.
        object: most likely, at `time`.
        covariance: (16 + 2n, 16 + 2n).
        time: s.
    """

    camera: HandCamera
    object: Placed
    covariance: Floats
    time: float

    @cached_property
    def known(self) -> Floats:
        """The inverse of the covariance."""
        return np.asarray(np.linalg.inv(self.covariance), dtype=np.float64)

    @cached_property
    def state(self) -> Floats:
        """Camera and object as `model.packed` makes them."""
        return pack_state(self.camera, self.object)


@dataclass(frozen=True)
class Search:
    """Where the search for the best camera and object has come to, at the origin's time.

    Attributes:
        state: (39 + 2n,), camera and object as `model.packed` makes them.
        damping: of the next step.
        settled: whether no step leads farther.
        scale: 1.5 times the median of the residuals, in standard deviations, or 1.
    """

    state: Floats
    damping: float = 1e-3
    settled: bool = False
    scale: float = 1.0


def refine_estimate(
    origin: Origin, seen: Sequence[Observation], start: Search | None = None, steps: int = 10
) -> tuple[Estimate, Search]:
    """The estimate from what was known before and all sightings, at the time of the last one.

    Args:
        origin: the prior.
        seen: sightings of an object that rests or moves evenly; some may be wrong.
        start: where an earlier search had come to; default the prior's camera and object.
        steps: most steps. A search that has not settled can go on from what is returned.
    """
    times, hands, points, noise = stack_observations(seen)
    now = start or Search(origin.state)
    state, covariance, damping, settled, scale = kernels.calibrate_batch(
        origin.state, origin.known, hands, times - origin.time, points, noise, now.state, now.damping, steps,
        ROBUST, SETTLED, HOPELESS,
    )  # fmt: skip
    made = Estimate(state, covariance, origin.time)
    made.advance(seen[-1].time, evenly=True)
    return made, Search(state, min(damping, 1.0), settled, scale)
