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
from grasptrack.kernels.reference_fusion import bilinear
from grasptrack.observation.images import Grey
from grasptrack.observation.surface import shrunk

Floats = NDArray[np.float64]

BY = 2
"""How many times the image is shrunk in which they are looked at."""
DEPTHS = (0.03, 0.045, 0.06)
"""Fractions of sqrt(area) from the outline at which its sides are looked at, ..."""
LEAST_DEPTH = 5.0
"""... and px at least, for the first."""
OTHER, OTHER_GREY = 4.0, 5.0
"""What differs from the reference by more than so many times the noise, and by more grey levels, is something else."""
CLEARLY = 0.4
"""What has the other side's level differs by this share of the contrast between them at least."""
MOST_OF_IT = 0.5
"""Of the places beside a sample, so many must be something else for the side to be."""
ACROSS = 3
"""Samples in a row, both sides of which must be something else for a cover to lie across the outline."""
FEWEST, GROWN = 2, 3
"""Samples in a row that make a notch, and a tab."""
COMPACT = 0.05
"""Of the outline, what touches so much at most from outside may have grown on it."""


class Flanks:
    """Grey levels on both sides of a reference outline.

    Args:
        points, normals: (m, 2) px and unit, outward, in the order of the outline.
        grey: (H, W) the image of it.
        size: px, sqrt(area).
    """

    def __init__(self, points: Floats, normals: Floats, grey: Grey, size: float) -> None:
        first = max(DEPTHS[0] * size, LEAST_DEPTH)
        depths = first / DEPTHS[0] * np.array(DEPTHS)
        offsets = np.concatenate([-depths, depths])
        places = points[:, None, :] + offsets[None, :, None] * normals[:, None, :]
        self._values = _levels(shrunk(grey, BY), places)
        self._places: Floats = np.ascontiguousarray(places.reshape(-1, 2))
        beyond = self._values[:, len(DEPTHS) :]
        beyond = np.abs(beyond - np.nanmedian(beyond)) if np.isfinite(beyond).any() else beyond
        self._even = bool(np.isfinite(beyond).any() and np.nanquantile(beyond, 0.9) <= OTHER_GREY)

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
        shape = self._values.shape
        flat, noise = kernels.grey_differences(
            coarse, float(BY), H, self._places, self._values.ravel(), OTHER_GREY / OTHER
        )
        rest, half = flat.reshape(shape), shape[1] // 2
        sides = rest[:, :half], rest[:, half:]
        least = max(OTHER * noise, OTHER_GREY)
        within, beyond = (_changed(side, least) for side in sides)
        told_within, told_beyond = (np.isfinite(side).any(axis=1) for side in sides)
        contrast = abs(float(np.nanmedian(self._values[:, half:])) - float(np.nanmedian(self._values[:, :half])))
        cut, grown = (_changed(side, CLEARLY * contrast, any_of_it=True) for side in sides)
        both, sure = within & beyond, told_within & told_beyond
        # where both sides are as they were, grey levels alone do not speak against the outline
        out, covered = against & ~(ground & sure & ~within & ~beyond), np.zeros(len(against), np.bool_)
        odd = against | missed | within | beyond if ground else against
        for run in runs(np.flatnonzero(odd), len(against)):
            if longest(both[run]) >= ACROSS:
                out[run] = False
                covered[run] = missed[run]
            elif ground:
                tab = (beyond & grown & ~within & sure)[run]
                if GROWN <= np.count_nonzero(tab) <= COMPACT * len(against):
                    out[run] |= tab
                notch = (within & cut & ~beyond & sure & missed)[run]
                if np.count_nonzero(notch) >= FEWEST:
                    out[run] |= notch
        return out, covered


def longest(flags: Bools) -> int:
    """How many in a row are true at most."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max()) if len(edges) else 0


def _changed(side: Floats, least: float, any_of_it: bool = False) -> Bools:
    """(m,) where most of what can be told of a side, or any of it, is something else."""
    told = np.isfinite(side)
    other = np.abs(np.where(told, side, 0.0)) > least
    wanted = 1 if any_of_it else np.maximum(MOST_OF_IT * told.sum(axis=1), 1)
    return np.asarray(other.sum(axis=1) >= wanted)


def _levels(coarse: Grey, points: Floats) -> Floats:
    """(...) grey levels of a shrunk image at points (..., 2) px of the full one; NaN at the border and beyond."""
    at = (points + 0.5) / BY - 0.5
    height, width = coarse.shape
    with np.errstate(invalid="ignore"):
        good: Bools = np.all((at >= 1.0) & (at < (width - 2.0, height - 2.0)), axis=-1)
    out = np.full(points.shape[:-1], math.nan)
    out[good] = bilinear(coarse, at[good])
    return out


def runs(index: NDArray[np.intp], count: int) -> list[NDArray[np.intp]]:
    """Samples that follow one another round the outline, with gaps of at most one."""
    if not len(index):
        return []
    pieces = np.split(index, np.flatnonzero(np.diff(index) > 2) + 1)
    if len(pieces) > 1 and index[0] + count - index[-1] <= 2:
        pieces[0] = np.concatenate([pieces.pop(), pieces[0]])
    return pieces
