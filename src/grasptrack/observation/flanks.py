# SPDX-License-Identifier: Apache-2.0
"""The two sides of an outline: what lies in front of both is a cover, what changes one alone is another shape.

A notch shows ground where material was, and beside it the ground is as it was. A tab is material where ground was, and
beside it the material is as it was. What lies across the outline changes both.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.contour import Bools
from grasptrack.kernels.reference_light import bilinear
from grasptrack.kernels.reference_support import hidden_at
from grasptrack.observation.images import Grey
from grasptrack.observation.surface import shrunk
from grasptrack.projective import apply_homography

Floats = NDArray[np.float64]

BY = 2
"""How many times the image is shrunk in which they are looked at."""
DEPTHS = (0.03, 0.045, 0.06)
"""Fractions of sqrt(area) from the outline at which its sides are looked at, ..."""
LEAST_DEPTH = 5.0
"""... and px at least, for the first."""
EVEN = 5.0
"""Grey levels by which an even ground differs from its median at most: it looks the same wherever it lies."""


class Flanks:
    """Grey levels on both sides of a reference outline.

    Args:
        points, normals: (m, 2) px and unit, outward, in the order of the outline.
        grey: (H, W) the image of it.
        size: px, sqrt(area).
        clear: (H, W) px from each pixel to what is hidden, in all images; None where nothing is.
    """

    def __init__(self, points: Floats, normals: Floats, grey: Grey, size: float, clear: Grey | None = None) -> None:
        self._clear = clear
        first = max(DEPTHS[0] * size, LEAST_DEPTH)
        depths = first / DEPTHS[0] * np.array(DEPTHS)
        offsets = np.concatenate([-depths, depths])
        places = points[:, None, :] + offsets[None, :, None] * normals[:, None, :]
        self._values: Floats = np.ascontiguousarray(_levels(shrunk(grey, BY), places))
        within, beyond = self._values[:, : len(depths)], self._values[:, len(depths) :]
        self._contrast = abs(_median(beyond) - _median(within))
        self._places: Floats = np.ascontiguousarray(places.reshape(-1, 2))
        rough = np.abs(beyond[np.isfinite(beyond)] - _median(beyond))
        self._even = bool(len(rough) and np.quantile(rough, 0.9) <= EVEN)

    def judged(self, coarse: Grey, H: Floats, against: Bools, missed: Bools, ground: bool) -> tuple[Bools, Bools]:
        """(m,) samples that speak against the outline, when both sides have been looked at; (m,) samples under a cover.

        Args:
            coarse: (H / BY, W / BY), the image shrunk.
            H: (3, 3) reference to current.
            against: (m,) those that seem to, by their grey levels.
            missed: (m,) those without an edge.
            ground: the ground moves along with the object, so that its side can be compared; one that is even can always.
        """
        if not (ground or self._even):
            return against.copy(), np.zeros(len(against), np.bool_)  # the outer side tells nothing
        values = self._values
        if self._clear is not None:
            hidden = hidden_at(self._clear, apply_homography(H, self._places), 2.0 * BY)
            values = np.where(hidden.reshape(values.shape), math.nan, values)
        return kernels.judge_flanks(coarse, float(BY), H, self._places, values, self._contrast, against, missed, True)


def _median(levels: Floats) -> float:
    """Of those that are known; NaN without any."""
    known = levels[np.isfinite(levels)]
    return float(np.median(known)) if len(known) else math.nan


def _levels(coarse: Grey, points: Floats) -> Floats:
    """(...) grey levels of a shrunk image at points (..., 2) px of the full one; NaN at the border and beyond."""
    at = (points + 0.5) / BY - 0.5
    height, width = coarse.shape
    with np.errstate(invalid="ignore"):
        good: Bools = np.all((at >= 1.0) & (at < (width - 2.0, height - 2.0)), axis=-1)
    out = np.full(points.shape[:-1], math.nan)
    out[good] = bilinear(coarse, at[good])
    return out
