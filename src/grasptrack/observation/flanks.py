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
from grasptrack.kernels.reference_fusion import quiet, tukey
from grasptrack.observation.images import Grey

Floats = NDArray[np.float64]

DEPTHS = (0.03, 0.045, 0.06)
"""Fractions of sqrt(area) from the outline at which its sides are looked at, ..."""
LEAST_DEPTH = 4.0
"""... and px at least, for the first."""
OTHER, OTHER_GREY = 4.0, 5.0
"""What differs from the reference by more than so many times the noise, and by more grey levels, is something else."""
MOST_OF_IT = 0.5
"""Of the places beside a sample, so many must be something else for the side to be."""
ACROSS = 3
"""Samples in a row, both sides of which must be something else for a cover to lie across the outline."""
FEWEST, GROWN = 2, 3
"""Samples in a row that make a notch, and a tab."""
COMPACT = 0.05
"""Of the outline, what touches so much at most from outside may have grown on it."""
WEIGHINGS = 3


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
        self._places: Floats = points[:, None, :] + offsets[None, :, None] * normals[:, None, :]
        self._values = levels_at(grey, self._places)

    def judged(self, grey: Grey, H: Floats, against: Bools, missed: Bools, ground: bool) -> tuple[Bools, Bools]:
        """(m,) samples that speak against the outline, when both sides have been looked at; (m,) samples under a cover.

        Args:
            grey: (H, W).
            H: (3, 3) reference to current.
            against: (m,) those that seem to, by their grey levels.
            missed: (m,) those without an edge.
            ground: the ground moves along with the object, so that its side can be compared.
        """
        shape = self._values.shape
        flat = np.ascontiguousarray(self._places.reshape(-1, 2))
        at = kernels.carry_normals(H, flat, np.ones_like(flat))[:, :2].reshape(*shape, 2)
        seen = levels_at(grey, np.where(np.isfinite(at), at, -1.0))
        other, told = _other(seen, self._values, at)
        half = shape[1] // 2
        (within, told_within), (beyond, told_beyond) = (
            _changed(other[:, side], told[:, side]) for side in (slice(None, half), slice(half, None))
        )
        both, sure = within & beyond, told_within & told_beyond
        out, covered = against.copy(), np.zeros(len(against), np.bool_)
        odd = against | missed | within | beyond if ground else against
        for run in runs(np.flatnonzero(odd), len(against)):
            if longest(both[run]) >= ACROSS:
                out[run] = False
                covered[run] = missed[run]
            elif ground:
                grown, cut = (
                    beyond[run] & ~within[run] & sure[run],
                    within[run] & ~beyond[run] & sure[run] & missed[run],
                )
                if GROWN <= np.count_nonzero(grown) <= COMPACT * len(against):
                    out[run] |= grown
                if np.count_nonzero(cut) >= FEWEST:
                    out[run] |= cut
        return out, covered


def longest(flags: Bools) -> int:
    """How many in a row are true at most."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max()) if len(edges) else 0


def _changed(other: Bools, told: Bools) -> tuple[Bools, Bools]:
    """(m,) where a side shows something else, and where that can be told."""
    count = told.sum(axis=1)
    return (other & told).sum(axis=1) >= np.maximum(MOST_OF_IT * count, 1), count > 0


def _other(seen: Floats, wanted: Floats, at: Floats) -> tuple[Bools, Bools]:
    """(m, d) what differs from the reference, light allowed for; and where that can be told."""
    told = np.isfinite(seen) & np.isfinite(wanted)
    other = np.zeros(seen.shape, np.bool_)
    if np.count_nonzero(told) < 24:
        return other, np.zeros(seen.shape, np.bool_)
    s, w, place = seen[told], wanted[told], at[told]
    place = (place - place.mean(axis=0)) / max(float(place.std()), 1.0)
    R = np.column_stack([w - w.mean(), np.ones(len(s)), place])
    middle = float(np.median(w))
    dark, light = (float(np.median((s)[part])) for part in (w <= middle, w >= middle))
    before = float(np.median(w[w >= middle]) - np.median(w[w <= middle]))
    gain = (light - dark) / before if before > OTHER_GREY else 1.0
    rest = s - gain * w
    rest = rest - float(np.median(rest))
    noise = OTHER_GREY
    for _ in range(WEIGHINGS):
        noise = max(quiet(np.abs(rest)), OTHER_GREY / OTHER)
        weight = tukey(rest / noise)
        Q = R.T @ (weight[:, None] * R) + 1e-9 * np.eye(4)
        rest = s - R @ np.linalg.solve(Q, R.T @ (weight * s))
    other[told] = np.abs(rest) > max(OTHER * noise, OTHER_GREY)
    return other, told


def levels_at(grey: Grey, points: Floats) -> Floats:
    """(...) grey levels, each the mean of 3 x 3 pixels at points (..., 2) px; NaN at the border and beyond."""
    column, row = np.rint(points[..., 0]).astype(np.intp), np.rint(points[..., 1]).astype(np.intp)
    out = (column < 1) | (row < 1) | (column >= grey.shape[1] - 1) | (row >= grey.shape[0] - 1)
    column[out] = row[out] = 1
    total = np.zeros(column.shape)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            total += grey[row + dy, column + dx]
    return np.asarray(np.where(out, math.nan, total / 9.0))


def runs(index: NDArray[np.intp], count: int) -> list[NDArray[np.intp]]:
    """Samples that follow one another round the outline, with gaps of at most one."""
    if not len(index):
        return []
    pieces = np.split(index, np.flatnonzero(np.diff(index) > 2) + 1)
    if len(pieces) > 1 and index[0] + count - index[-1] <= 2:
        pieces[0] = np.concatenate([pieces.pop(), pieces[0]])
    return pieces
