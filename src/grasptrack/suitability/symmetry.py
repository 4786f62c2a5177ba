# SPDX-License-Identifier: Apache-2.0
"""Turns under which an outline fits itself, and objects beside it that have the same outline."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.contour import View
from grasptrack.errors import ConditioningError
from grasptrack.matching import Sampled, symmetries
from grasptrack.observation.candidate import Candidate
from grasptrack.observation.images import Grey
from grasptrack.observation.support import OutlineSamples
from grasptrack.projective import similarity
from grasptrack.reference import SYMMETRIC
from grasptrack.search import EQUAL
from grasptrack.transfer.alignment import alignments


class Symmetry(NamedTuple):
    """How often an outline fits itself.

    Attributes:
        turns: degrees, ascending, other than none; the image shows the outline again when it is turned so.
        every: it fits itself in every turn, as a disc does.
        known: False where the border cuts the object, so that nobody can tell.
    """

    turns: tuple[float, ...]
    every: bool
    known: bool

    @property
    def order(self) -> int:
        """In how many ways it fits itself; 0 for every turn."""
        return 0 if self.every else len(self.turns) + 1


def symmetry_of(
    view: View, grey: Grey, samples: OutlineSamples, contacts: NDArray[np.float64], turn_shown: bool = True
) -> Symmetry:
    """Turns of an outline into itself, holes included, that its image bears out as the tracker asks (`reference:SYMMETRIC`).

    Args:
        view: the outline.
        grey: (H, W) its image.
        samples: of the outline in that image.
        contacts: (k, 2) px, on it.
        turn_shown: False where a turn moves the outline along itself throughout.
    """
    if view.is_clipped:
        return Symmetry((), False, False)
    if not turn_shown:
        return Symmetry((), True, True)
    outline = Sampled(view)
    own = symmetries(outline)
    if own.continuous:
        return Symmetry((), True, True)
    centre = (float(outline.centre[0]), float(outline.centre[1]))
    turns: list[float] = []
    for way in (*own.turns, *own.near):
        try:
            support = samples.support(grey, similarity(1.0, way.turn, centre, centre), contacts)
        except ConditioningError:
            continue
        if support.share >= SYMMETRIC:
            turns.append(math.degrees(way.turn) % 360.0)
    return Symmetry(tuple(sorted(turns)), False, True)


def equals_of(candidate: Candidate, others: list[Candidate]) -> list[View]:
    """Outlines beside an object that are its equals (`search:EQUAL`)."""
    outer = candidate.view.outer
    if candidate.view.is_clipped:
        return []
    alike = []
    for other in others:
        if other.polarity * candidate.polarity >= 0 and not other.view.is_clipped:
            ways = alignments(outer, other.view.outer)
            if not ways or ways[0].residual <= EQUAL * math.sqrt(other.view.outer.area):
                alike.append(other.view)
    return alike
