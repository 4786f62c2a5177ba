# SPDX-License-Identifier: Apache-2.0
"""Which part of one outline is which part of another: the similarity and the cyclic shift that bring them together.

Contours do not start at corresponding points by themselves, and eq. (3) has to know where to search.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from grasptrack import kernels
from grasptrack.errors import AmbiguousError
from grasptrack.geometry.contours import Contour
from grasptrack.geometry.homographies import similarity_transform
from grasptrack.typing import Floats

GRID = 64
"""Points at which the outlines are compared."""
TIE = 0.02
"""Alignments whose rms distances differ by less than this fraction of sqrt(area) fit alike."""
NEARER = 0.5
"""Among alignments that fit alike one is taken when it moves the outline less than this share of what the next does."""


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


def choose_alignment(found: list[Alignment], expected_angle: float = 0.0) -> Alignment:
    """The one meant of some alignments that fit alike: the best, or the one with the smallest turn.

    Args:
        found: the alignments.
        expected_angle: rad; turns are measured from it.

    Raises:
        AmbiguousError: several fit alike and none turns clearly less than the others.
    """
    if not found:
        raise AmbiguousError("the outline fits itself in every turn: nothing tells how far it turned")
    if len(found) == 1:
        return found[0]
    turns = sorted((abs(math.sin(0.5 * (a.angle - expected_angle))), i) for i, a in enumerate(found))
    if turns[0][0] > NEARER * turns[1][0]:
        raise AmbiguousError("the outline fits itself in more than one way and the motion does not tell which is meant")
    return found[turns[0][1]]


def as_similarity(alignment: Alignment, first: Contour, second: Contour) -> Floats:
    """(3, 3) the similarity of an alignment, from the first outline to the second."""
    area1, x1, y1, *_ = kernels.polygon_moments(first.points, first.offsets)
    area2, x2, y2, *_ = kernels.polygon_moments(second.points, second.offsets)
    return similarity_transform(math.sqrt(area2 / area1), alignment.angle, (x1, y1), (x2, y2))
