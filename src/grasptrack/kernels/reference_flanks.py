# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of what lies on the two sides of an outline: a cover, a notch or a tab."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_light import grey_differences

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

OTHER, OTHER_GREY = 4.0, 5.0
"""What differs from the reference by more than so many times the noise, and by more grey levels, is something else."""
CLEARLY = 0.4
"""What has the other side's level differs by this share of the contrast between them at least."""
MOST_OF_IT = 0.5
"""Of the places beside a sample, so many must be something else for the side to be."""
ACROSS = 3
"""Samples in a row, both sides of which must be something else for a cover to lie across the outline, ..."""
MOSTLY = 0.4
"""... and so much of all that are odd there: a stripe of the ground may meet a notch."""
ASTRAY = 0.15
"""Where a side differs at more of the samples that show their edge, it is not the reference's, or the light not understood."""
FEWEST, GROWN = 2, 3
"""Samples in a row that make a notch, and a tab."""
COMPACT = 0.05
"""Of the outline, what touches so much at most from outside may have grown on it."""


def judge_flanks(
    coarse: NDArray[np.uint8],
    shrink: float,
    H: Floats,
    places: Floats,
    values: Floats,
    contrast: float,
    against: Bools,
    missed: Bools,
    ground: bool,
) -> tuple[Bools, Bools]:
    """(m,) samples that speak against the outline, when both sides have been looked at; (m,) samples under a cover.

    Args:
        coarse, shrink, H: as for `motion_equations`.
        places, values: (m * 2 d, 2) px and (m, 2 d) grey levels of the reference, NaN where not known: of each sample d
            places within the outline, then d beyond.
        contrast: grey levels between both sides.
        against: (m,) those that seem to, by their grey levels.
        missed: (m,) those without an edge.
        ground: the ground moves along with the object, so that its side can be compared.

    Raises:
        ValueError: arrays of unlike number.
    """
    count, each = values.shape
    if each % 2 or len(places) != values.size or len(against) != count or len(missed) != count:
        raise ValueError("each sample needs its flags, and as many places within as beyond, with their values")
    flat, noise = grey_differences(coarse, shrink, H, places, values.ravel(), OTHER_GREY / OTHER)
    rest, half = flat.reshape(values.shape), each // 2
    sides = rest[:, :half], rest[:, half:]
    least = max(OTHER * noise, OTHER_GREY)
    within, beyond = (_changed(side, least) for side in sides)
    told_within, told_beyond = (np.isfinite(side).any(axis=1) for side in sides)
    cut, grown = (_changed(side, CLEARLY * contrast, any_of_it=True) for side in sides)
    if not ground or _astray(beyond, told_beyond & ~missed) or _astray(within, told_within & ~missed):
        return against.copy(), np.zeros(count, np.bool_)  # another ground, or other light: they tell nothing
    both, sure = within & beyond, told_within & told_beyond
    # where both sides are as they were, grey levels alone do not speak against the outline
    out, covered = against & ~(sure & ~within & ~beyond), np.zeros(count, np.bool_)
    odd = against | missed | within | beyond
    for run in runs(np.flatnonzero(odd), count):
        if longest(both[run]) >= ACROSS and np.count_nonzero(both[run]) >= MOSTLY * len(run):
            out[run] = False
            covered[run] = missed[run]
        else:
            tab = (beyond & grown & ~within & sure)[run]
            if GROWN <= np.count_nonzero(tab) <= COMPACT * count:
                out[run] |= tab
            notch = (within & cut & ~beyond & sure & missed)[run]
            if np.count_nonzero(notch) >= FEWEST:
                out[run] |= notch
    return out, covered


def _astray(changed: Bools, shown: Bools) -> bool:
    """A side has changed beside too many of the samples that show their edge."""
    return int(np.count_nonzero(changed & shown)) > ASTRAY * int(np.count_nonzero(shown))


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


def runs(index: NDArray[np.intp], count: int) -> list[NDArray[np.intp]]:
    """Samples that follow one another round the outline, with gaps of at most one."""
    if not len(index):
        return []
    pieces = np.split(index, np.flatnonzero(np.diff(index) > 2) + 1)
    if len(pieces) > 1 and index[0] + count - index[-1] <= 2:
        pieces[0] = np.concatenate([pieces.pop(), pieces[0]])
    return pieces
