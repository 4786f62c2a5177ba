# SPDX-License-Identifier: Apache-2.0
"""RRP coordinates: contacts by their place among the reference points of a tracked outline (Sections III-A and IV-A).

Nothing is measured here: point i of one outline is taken to be the same physical point as point i of the other, as it
is when a snake (`grasptrack.snake.active_contour`) moves the outline as a whole.
"""

from __future__ import annotations

import math

import numpy as np

from grasptrack import kernels
from grasptrack.errors import StrategyError
from grasptrack.geometry.contours import Outline
from grasptrack.grasp.contacts import Grasp
from grasptrack.transfer.base import Transfer
from grasptrack.typing import Floats, Ints

INTERPOLATED = 6
"""Points of the outline per segment between reference points, as in Table IV: p = 6 ref + interp. A reference point is every
so many-th point; contacts are printed by them."""


class RRPDescription:
    """RRP coordinates (c, ref, interp) of any number of contacts.

    Args:
        places: (k, >= 2) contour index, position p (point index plus the fraction of the side that follows).
        offsets: (C + 1,) first point of each contour of the outline: what another outline must have in common.
        quality: of the grasp, carried along.
    """

    __slots__ = ("offsets", "places", "quality")

    def __init__(self, places: Floats, offsets: Ints, quality: float = math.nan) -> None:
        self.places = places
        self.offsets = offsets
        self.quality = quality

    def paper(self) -> list[tuple[int, int, int]]:
        """(c, ref, interp) of each contact as the paper prints them: the nearest point of the outline."""
        counts = np.diff(self.offsets)
        rows = []
        for c, p in self.places[:, :2].tolist():
            nearest = round(p) % int(counts[int(c)])
            rows.append((int(c), nearest // INTERPOLATED, nearest % INTERPOLATED))
        return rows

    def __repr__(self) -> str:
        """The coordinates as the paper prints them."""
        return "RRP(" + " ".join(f"({c}, {r}, {i})" for c, r, i in self.paper()) + ")"


def describe(grasp: Grasp, view: Outline) -> RRPDescription:
    """RRP coordinates of a grasp, each contact at the place of the outline nearest to it.

    Args:
        grasp: any number of contacts, on the outline; one beside it is described by the nearest point of the outline.
        view: the outline in whose points they are expressed.
    """
    # Places lie on a grid of 2**-32, so that the rounding of one transfer cannot move the next: there and back ends on
    # the very same floats.
    places = kernels.fixed_places(view.points, view.offsets, grasp.contacts)
    return RRPDescription(places, view.offsets, grasp.quality)


def apply(description: RRPDescription, view: Outline, prior: Floats | None = None) -> Transfer:
    """The grasp with those RRP coordinates on another outline (Fig. 7).

    Raises:
        StrategyError: the outlines differ in their number of contours or points.
    """
    try:
        contacts = kernels.carry_places(description.places, description.offsets, view.points, view.offsets)
    except ValueError:
        raise StrategyError(
            "RRP needs outlines whose points correspond one to one, not contours of "
            f"{_format_counts(description.offsets)} and {_format_counts(view.offsets)} points",
            reference=description.offsets.tolist(),
            current=view.offsets.tolist(),
        ) from None
    return Transfer(Grasp.of(contacts, description.quality), None, None, math.nan)


def _format_counts(offsets: Ints) -> str:
    return "+".join(str(n) for n in np.diff(offsets).tolist())
