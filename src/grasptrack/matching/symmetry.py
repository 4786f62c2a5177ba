# SPDX-License-Identifier: Apache-2.0
"""The turns that map an object's outline to itself, or nearly."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.contour import Outline
from grasptrack.matching.hypotheses import COARSE_NOISE, FINE, rated
from grasptrack.matching.samples import Sampled, sampled

Floats = NDArray[np.float64]

TOLERANCE = 0.01
"""Share of sqrt(area), rms: an outline that is turned and differs by no more from what it was is its own twin."""
NEAR_TOLERANCE = 0.04
"""The same of a near symmetry."""
PEAKS = 256
"""Steps of the outline at which it is laid on itself."""
LOOSE = 0.25
"""Share of the outline's rms radius, rms, that a turn may leave before it is looked at more closely."""
PROBES = 12
"""Turns that are no part of a full turn: where all of them fit, every turn does."""
GOLDEN = math.pi * (3.0 - math.sqrt(5.0))


class Symmetry(NamedTuple):
    """A turn of the object after which its outline lies on itself, or nearly.

    Attributes:
        turn: rad, from x to y, in (-pi, pi].
        residual: px rms between the outline and itself turned.
    """

    turn: float
    residual: float


class Symmetries(NamedTuple):
    """An outline's own symmetries, without the turn by nothing.

    Attributes:
        turns: those within `TOLERANCE`, by their size; empty where the outline fits itself in every turn.
        near: those within `NEAR_TOLERANCE` only, the best first.
        continuous: the outline fits itself in every turn, as a disc and a ring do.
    """

    turns: list[Symmetry]
    near: list[Symmetry]
    continuous: bool

    @property
    def order(self) -> int:
        """In how many ways the outline fits itself, 1 without symmetry; 0 for infinitely many."""
        return 0 if self.continuous else 1 + len(self.turns)


def symmetries(outline: Outline | Sampled) -> Symmetries:
    """The turns that map an outline, holes included, to itself within 1 % of sqrt(area), and those that nearly do.

    Mirror images are not looked for: no camera turns an object over.

    Args:
        outline: as seen from the front; a tilted view shows other turns, or none.
    """
    a = sampled(outline)
    if all(_left(a, (k + 1) * GOLDEN) <= TOLERANCE * a.size for k in range(PROBES)):
        return Symmetries([], [], True)
    arc = kernels.arc_length(a.outer)
    turns: list[float] = []
    for _, turn, _ in kernels.align_outlines(a.outer, arc, a.outer, arc, PEAKS, LOOSE):
        refined = _refined(a, turn)
        best = min((turn, refined), key=lambda t: _left(a, t))
        if all(abs(math.remainder(best - t, 2.0 * math.pi)) > 0.03 for t in [0.0, *turns]):
            turns.append(math.remainder(best, 2.0 * math.pi))
    found = [Symmetry(turn, _left(a, turn)) for turn in turns]
    exact = sorted((s for s in found if s.residual <= TOLERANCE * a.size), key=lambda s: abs(s.turn))
    near = sorted(
        (s for s in found if TOLERANCE * a.size < s.residual <= NEAR_TOLERANCE * a.size), key=lambda s: s.residual
    )
    return Symmetries(exact, near, False)


def _turned(turn: float) -> Floats:
    c, s = math.cos(turn), math.sin(turn)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _left(a: Sampled, turn: float) -> float:
    """px rms that a turn about the centroid leaves."""
    found = rated(_turned(turn), a, a)
    return math.inf if found is None else found.misfit


def _refined(a: Sampled, turn: float) -> float:
    """The turn of the homography that lays the turned outline on itself best."""
    reaches, damping = FINE
    strides = np.full(len(reaches), 2, dtype=np.int64)
    start = _turned(turn).reshape(1, 9)
    found = kernels.lay_outlines(
        start, a.points, a.normals, a.points, a.normals, a.offsets, reaches * a.size, damping + 1e-2, strides,
        COARSE_NOISE * a.size,
    )  # fmt: skip
    if not math.isfinite(found[0, 9]):
        return turn
    h = found[0, :9]
    return math.atan2(h[3] - h[1], h[0] + h[4])
