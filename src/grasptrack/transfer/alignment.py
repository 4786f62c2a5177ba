# SPDX-License-Identifier: Apache-2.0
"""Which part of one outline is which part of another: the similarity and the cyclic shift that bring them together.

Contours do not start at corresponding points by themselves, and eq. (3) has to know where to search.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.errors import AmbiguousError
from grasptrack.geometry.contours import Contour, Outline, View
from grasptrack.geometry.homographies import apply_homography, similarity_transform
from grasptrack.matching import judge_hypotheses, refine_homographies
from grasptrack.typing import Floats

GRID = 64
"""Points at which the outlines are compared."""
TIE = 0.02
"""Alignments whose rms distances differ by less than this fraction of sqrt(area) fit alike."""
ROUND_TURNS = 12
"""Turns in which an outline that has no shape of its own is tried."""
TURN_GRID = 4096
"""Ways along an outline by which it is laid on itself: those of a tooth among twenty fit, too."""
SAME_TURN = 1e-3
"""rad within which an alignment is no turn."""


class Alignment(NamedTuple):
    """One way to lay the first outline on the second.

    Attributes:
        shift: arc length in the second outline of the first one's first point, in lengths of the outline.
        angle: rad of the turn, from x to y.
        residual: px rms between the outlines under the best similarity.
    """

    shift: float
    angle: float
    residual: float


def find_alignments(first: Contour, second: Contour) -> list[Alignment]:
    """All alignments that fit as well as the best one, the best first; several where the outline has symmetries."""
    return alignments_of_points(first.points, first.arc_length, second.points, second.arc_length, second.area)


def alignments_of_points(points1: Floats, arc1: Floats, points2: Floats, arc2: Floats, area2: float) -> list[Alignment]:
    """`find_alignments` of points whose arc lengths (N + 1,) px and area px^2 are known already."""
    # the outline's rms radius, close enough, turns the share of the norm that is left into px
    radius = arc2.item(-1) / (2.0 * math.pi)
    found = kernels.align_outlines(points1, arc1, points2, arc2, GRID, TIE * math.sqrt(area2) / radius)
    return [Alignment(shift, angle, radius * left) for shift, angle, left in found]


def turns_onto_itself(view: View) -> tuple[list[Floats], bool]:
    """(3, 3) px -> px each, turns of an outline onto itself; of a disc some, and whether it is one."""
    if view.is_clipped:
        return [], False
    area, x, y, *_ = kernels.polygon_moments(view.outer.points, view.outer.offsets)
    radii = np.hypot(*(view.outer.points - (x, y)).T)
    # turned anyhow it differs from itself by less than what alignments that fit alike do
    is_round = float(np.std(radii)) * math.sqrt(2.0) < TIE * math.sqrt(area)
    if is_round:
        angles = np.arange(1, ROUND_TURNS) * (2.0 * math.pi / ROUND_TURNS)
        found = [similarity_transform(1.0, float(angle), (x, y), (x, y)) for angle in angles]
    else:
        points, arc = view.outer.points, view.outer.arc_length
        tie = TIE * math.sqrt(area) / math.hypot(*np.std(points, axis=0))
        fits = kernels.align_outlines(points, arc, points, arc, TURN_GRID, tie)
        found = [similarity_transform(1.0, fit.angle, (x, y), (x, y)) for fit in fits if abs(fit.angle) > SAME_TURN]
    return found, is_round


def choose_alignment(found: list[Alignment], first: Outline, second: Outline) -> Alignment:
    """The right one of some alignments of the outer contours that fit alike.

    Raises:
        AmbiguousError: none at all, or several that the noise of the match does not tell apart.
    """
    if not found:
        raise AmbiguousError("the outline fits itself in every turn: nothing tells how far it turned")
    if len(found) == 1:
        return found[0]
    outer = first.contours[0], second.contours[0]
    return found[choose_way([as_similarity(a, *outer) for a in found], first, second)]


def choose_way(ways: list[Floats], first: Outline, second: Outline) -> int:
    """Which of some homographies (3, 3) lays one outline on another, holes included.

    Each is made to fit. What is left of the best is the noise of the match, by which the others are judged.

    Raises:
        AmbiguousError: several fit alike, or none fits.
    """
    outcome = judge_hypotheses(refine_homographies(np.array(ways), first, second))
    if outcome.best is None or outcome.status != "matched":
        raise AmbiguousError(f"{outcome.reason}, and there is no prior")
    points = first.contours[0].points
    there = apply_homography(outcome.best.homography, points)
    off = [float(((apply_homography(way, points) - there) ** 2).sum()) for way in ways]
    return int(np.argmin(off))


def as_similarity(alignment: Alignment, first: Contour, second: Contour) -> Floats:
    """(3, 3) the similarity of an alignment, from the first outline to the second."""
    area1, x1, y1, *_ = kernels.polygon_moments(first.points, first.offsets)
    area2, x2, y2, *_ = kernels.polygon_moments(second.points, second.offsets)
    return similarity_transform(math.sqrt(area2 / area1), alignment.angle, (x1, y1), (x2, y2))
