# SPDX-License-Identifier: Apache-2.0
"""How well a homography lays one outline on another, and how firmly."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.matching import starts
from grasptrack.matching.samples import Sampled
from grasptrack.typing import Floats

REACH = 0.1
"""sqrt(area); distances are counted up to this."""
CAP = 0.03
"""sqrt(area); the same where hypotheses are compared."""
NEAR, NEAR_PX = 0.02, 1.0
"""Share of sqrt(area), or px, whichever is more: what is as near as this lies on the other outline."""
TELLING = 0.04
"""sqrt(area): contacts that are off by more are wrong."""
MAX_STRETCH = 3.0
"""Largest ratio of the two magnifications at any point of the outline: 2.6 arises at 60 degrees, strong perspective."""
MAX_DEPTH = 2.2
"""Largest ratio of the distances of two points of the outline from the camera: 1.9 arises then."""


class Match(NamedTuple):
    """One way in which the first outline lies on the second.

    Attributes:
        homography: (3, 3) first -> second, its last element 1.
        misfit: px rms in the second view between the outlines, both ways, each distance counted up to a tenth of
            sqrt(area).
        cost: px, the same with each distance counted up to 3 % of sqrt(area) only: what hypotheses are ordered by. Of two that
            leave out a piece, the one that lies better on the rest is better.
        residual: px rms of those distances that are small (`NEAR`).
        share: 0 to 1, how much of both outlines is so near the other.
        worst: px, the largest distance, up to a tenth of sqrt(area).
        stretch: 1 and more, the largest ratio of the two magnifications at any point: the tilt that it takes.
        size: px, sqrt(area) of the second outline.
        slack: px rms by which the outlines part when the motion that they show least moves a point by `TELLING`: near 0
            the outline slides along itself, as that of a disc or an ellipse. Of the best hypothesis; NaN of others.
    """

    homography: Floats
    misfit: float
    cost: float
    residual: float
    share: float
    worst: float
    stretch: float
    size: float
    slack: float = math.nan


def rate_homography(H: Floats, a: Sampled, b: Sampled) -> Match | None:
    """How well a homography (3, 3) lays one outline on another; None when no camera could have seen it so."""
    in_front, determinant, ratio = kernels.distortion(H, a.points)
    if not (in_front > 1e-9 and determinant > 0.0 and ratio <= MAX_STRETCH):
        return None
    depth = np.abs(a.points @ H[2, :2] + H[2, 2])
    if depth.max() > MAX_DEPTH * depth.min():
        return None
    moved = kernels.carry_normals(H, a.points, a.normals)
    at, along = np.ascontiguousarray(moved[:, :2]), np.ascontiguousarray(moved[:, 2:4])
    reach = REACH * b.size
    gaps = np.concatenate(
        [
            kernels.outline_gaps(at, along, b.points, b.normals, b.offsets, reach),
            kernels.outline_gaps(b.points, b.normals, at, along, a.offsets, reach),
        ]
    )
    capped = np.minimum(gaps, CAP * b.size)
    near = gaps[gaps <= max(NEAR * b.size, NEAR_PX)]
    return Match(
        H / H[2, 2],
        math.sqrt(float(gaps @ gaps) / len(gaps)),
        math.sqrt(float(capped @ capped) / len(gaps)),
        math.sqrt(float(near @ near) / len(near)) if len(near) else math.inf,
        len(near) / len(gaps),
        float(gaps.max()),
        ratio,
        b.size,
    )


def measure_observability(found: Match, a: Sampled, b: Sampled) -> float:
    """px rms by which the outlines part when they are moved a little along what fixes them least; between centres."""
    nearby = [
        rate_homography(row.reshape(3, 3), a, b)
        for row in starts.perturb_homography(found.homography, a, (-TELLING, TELLING))
    ]
    apart = [math.sqrt(max(m.misfit**2 - found.misfit**2, 0.0)) for m in nearby if m is not None]
    return min(apart, default=math.inf)
