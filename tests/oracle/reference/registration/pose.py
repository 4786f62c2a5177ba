# SPDX-License-Identifier: Apache-2.0
"""Where a target's edges are in an image; what the pose of one makes least is defined in `objective`."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels import LEAST_HALF_WIDTH, MOST_HALF_WIDTH
from grasptrack.kernels.results import StrongestEdges
from grasptrack.typing import Floats
from reference.registration.edges import edge_width, find_candidates, sample_profiles
from reference.registration.objective import FARTHEST
from reference.registration.pyramid import Level, level_through
from reference.registration.target import INNER, INNER_FIRST

Grey = NDArray[np.uint8]

BESIDE = 1.5
"""Work px by which the strongest edge may lie farther away than half the filter's width."""


def strongest_edges(
    levels: Sequence[Grey], A: Floats, points: Floats, normals: Floats, noise: float, reach: int, half: int
) -> StrongestEdges:
    n, A = len(points), np.reshape(A, (3, 3))
    if not len(levels):
        raise ValueError("a pyramid has at least one level")
    if np.shape(normals) != (n, 2):
        raise ValueError("each point needs its normal")
    if not 0 <= reach <= FARTHEST:
        raise ValueError("the reach is from 0 to 1000")
    if not LEAST_HALF_WIDTH <= half <= MOST_HALF_WIDTH:
        raise ValueError("half a width is from 2 to 12")
    offset, step, inner, width = np.full(n, np.nan), np.zeros(n), np.zeros((n, INNER)), np.full(n, np.nan)
    if n == 0:
        return StrongestEdges(offset, step, inner, width)
    span = reach + 2 * MOST_HALF_WIDTH
    with np.errstate(all="ignore"):
        level, H = level_through([Level(level) for level in levels], A, points.mean(axis=0), 1.0)
        values, inside = sample_profiles(level, H, points, normals, span)
        for i in np.flatnonzero(inside):
            near = [(x, g) for x, g in find_candidates(values[i], reach, noise, half) if abs(x) < half + BESIDE]
            if near:
                offset[i], step[i] = max(
                    near, key=lambda edge: abs(edge[1]) * np.exp(-(edge[0] ** 2) / (2 * half * half))
                )
            first = span + INNER_FIRST - (half - LEAST_HALF_WIDTH)
            inner[i], width[i] = values[i, first : first + INNER], edge_width(values[i], half)
    return StrongestEdges(offset, step, inner, width)
