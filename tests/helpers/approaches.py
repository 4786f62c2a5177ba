# SPDX-License-Identifier: Apache-2.0
"""Cameras that approach a part, with all that is unknown drawn as it is thought to be beforehand."""

import math

import numpy as np

from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.plane import outline_extent
from grasptrack_bench.simulation import SHAPES, Conditions, Path, Pinhole, Scene

WIDTH = 640.0
FRAMES = 14
PARTS = ("bracket", "key", "hook", "t-plate")


def approach(seed: int) -> tuple[Scene, float]:
    """Camera and first view drawn as they are thought to be beforehand; and the true length of the part."""
    rng, u = np.random.default_rng((seed, 41)), np.linspace(0.0, 1.0, FRAMES)
    focal = WIDTH * math.exp(rng.normal(0.0, NUMBERS.focal_sd))
    part = SHAPES[PARTS[seed % len(PARTS)]]()
    tilt = math.atan(math.hypot(*rng.normal(0.0, NUMBERS.normal_sd, 2)))
    path = Path(
        target=np.outer(1.0 - u, rng.normal(0.0, 0.2, 2)),
        distance=focal / (110.0 * 2.0**u),
        roll=0.6 * u,
        tilt=tilt * (1.0 - u),
        azimuth=np.full(FRAMES, rng.uniform(0.0, 2.0 * math.pi)),
    )
    conditions = Conditions(blur=0.8, noise=2.0, pooled=True)
    return Scene(part, path, camera=Pinhole(focal=focal), conditions=conditions, seed=seed), outline_extent(part.outer)
