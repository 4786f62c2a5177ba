# SPDX-License-Identifier: Apache-2.0
"""An outline as the match looks at it: points at equal steps with the directions of the normals there."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.contour import Outline, as_view

Floats = NDArray[np.float64]

MOST = 400
"""Samples of an outline, holes included; ..."""
SPACING = 1.0
"""... fewer where they would lie nearer than so many px."""
SMOOTHING = 2.0
"""px or samples, whichever is more, over which a sample is the mean: what noise does to a normal stays below 10 degrees."""
FEWEST = 12
"""Samples of the least hole."""
SHAPE = 256
"""Points of the outer contour for the whitened alignment."""


class Sampled:
    """Samples of an outline. Making them once serves all matches of a view.

    Attributes:
        centre: (2,) px, the outer contour's centroid.
        points, normals: (m, 2) px from the centre, (m, 2) unit, out of the material; contour after contour.
        offsets: (C + 1,) where each contour begins.
        outer: (k, 2) px from the centre, fewer points of the outer contour.
        size: px, the square root of the outer contour's area.
    """

    __slots__ = ("centre", "normals", "offsets", "outer", "points", "size")

    def __init__(self, outline: Outline) -> None:
        view = as_view(outline)
        spacing = max(SPACING, sum(c.length for c in view.contours) / MOST)
        rings = []
        for contour in view.contours:
            count = max(FEWEST, round(contour.length / spacing))
            smooth = min(SMOOTHING * max(1.0, spacing), 0.25 * contour.length)
            rings.append(kernels.resample(contour.points, count, smooth))
        area, x, y, *_ = kernels.inertia(rings[0], np.array([0, len(rings[0])], dtype=np.int64))
        self.size: float = math.sqrt(area)
        self.centre: Floats = np.array([x, y])
        # from the centre: with strong perspective the image's own origin may lie beyond the horizon
        self.points: Floats = np.concatenate(rings) - self.centre
        self.normals: Floats = np.ascontiguousarray(np.concatenate([kernels.blend_normals(r) for r in rings]))
        self.offsets: NDArray[np.int64] = np.cumsum([0, *(len(r) for r in rings)], dtype=np.int64)
        outer = rings[0] if len(rings[0]) <= SHAPE else kernels.resample(rings[0], SHAPE, 0.0)
        self.outer: Floats = outer - self.centre


def sampled(outline: Outline | Sampled) -> Sampled:
    """The samples of an outline; samples come back as they are."""
    return outline if isinstance(outline, Sampled) else Sampled(outline)
