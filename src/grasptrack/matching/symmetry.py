# SPDX-License-Identifier: Apache-2.0
"""The turns that map an object's outline to itself, or nearly."""

from __future__ import annotations

import math
from typing import NamedTuple

from grasptrack import kernels
from grasptrack.geometry.contours import Outline
from grasptrack.geometry.homographies import rotation_about_z
from grasptrack.matching.rating import rate_homography
from grasptrack.matching.samples import Sampled, as_sampled

TOLERANCE = 0.01
"""Share of sqrt(area), rms: an outline that is turned and differs by no more from what it was is its own twin."""
NEAR_TOLERANCE = 0.04
"""The same of a near symmetry."""
PEAKS = 256
"""Steps of the outline at which it is laid on itself."""
LOOSE = 0.12
"""Share of the outline's rms radius, rms, that a turn may leave before it is looked at more closely."""
PROBES = 12
"""Turns that are no part of a full turn: where all of them fit, every turn does."""
WITHIN, HALVINGS = math.radians(1.5), 7
"""rad about a turn in which the best one is looked for, and steps of that search."""
BESIDE = math.radians(2.5)
"""rad; a symmetry leaves less than what lies so far beside it, and none is nearer to another or to no turn at all."""
GOLDEN = math.pi * (3.0 - math.sqrt(5.0))


class SymmetryTurn(NamedTuple):
    """A turn, rad in (-pi, pi] from x to y, and px rms by which the outline then lies beside itself."""

    turn: float
    residual: float


class Symmetries(NamedTuple):
    """An outline's own symmetries, without the turn by nothing.

    Attributes:
        turns: those within `TOLERANCE`, by their size; empty where the outline fits itself in every turn.
        near: those within `NEAR_TOLERANCE` only, the best first.
        continuous: the outline fits itself in every turn, as a disc and a ring do.
    """

    turns: list[SymmetryTurn]
    near: list[SymmetryTurn]
    continuous: bool


def find_symmetries(outline: Outline | Sampled) -> Symmetries:
    """The turns that map an outline, holes included, to itself within 1 % of sqrt(area), and those that nearly do.

    As seen from the front: a tilted view shows other turns, or none. Mirror images are not looked for: no camera turns an
    object over.
    """
    a = as_sampled(outline)
    if all(_rotation_residual(a, (k + 1) * GOLDEN) <= TOLERANCE * a.size for k in range(PROBES)):
        return Symmetries([], [], True)
    arc = kernels.arc_length(a.outer)
    found: list[SymmetryTurn] = []
    for _, turn, _ in kernels.align_outlines(a.outer, arc, a.outer, arc, PEAKS, LOOSE):
        if abs(math.remainder(turn, 2.0 * math.pi)) <= BESIDE:
            continue
        one = _refine_rotation(a, turn)
        if one is not None and all(abs(math.remainder(one.turn - s.turn, 2.0 * math.pi)) > BESIDE for s in found):
            found.append(one)
    exact = sorted((s for s in found if s.residual <= TOLERANCE * a.size), key=lambda s: abs(s.turn))
    near = sorted((s for s in found if s.residual > TOLERANCE * a.size), key=lambda s: s.residual)
    return Symmetries(exact, near, False)


def _rotation_residual(a: Sampled, turn: float) -> float:
    """px rms that a turn about the centroid leaves."""
    found = rate_homography(rotation_about_z(turn), a, a)
    return math.inf if found is None else found.misfit


def _refine_rotation(a: Sampled, turn: float) -> SymmetryTurn | None:
    """The turn nearby that leaves least; None on a slope, where turns still nearer to another one leave less."""
    low, high = turn - WITHIN, turn + WITHIN
    for _ in range(HALVINGS):
        one, other = low + (high - low) / 3.0, high - (high - low) / 3.0
        low, high = (low, other) if _rotation_residual(a, one) < _rotation_residual(a, other) else (one, high)
    best = 0.5 * (low + high)
    least = _rotation_residual(a, best)
    if (
        least > NEAR_TOLERANCE * a.size
        or min(_rotation_residual(a, best - BESIDE), _rotation_residual(a, best + BESIDE)) <= least
    ):
        return None
    return SymmetryTurn(math.remainder(best, 2.0 * math.pi), least)
