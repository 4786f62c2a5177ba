# SPDX-License-Identifier: Apache-2.0
"""What a hand cannot do: stable grasps that are refused, and why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.geometry.contours import Outline, View, as_view
from grasptrack.grasp.hand import HandPx
from grasptrack.grasp.synthesis.candidates import Candidates
from grasptrack.grasp.synthesis.rectangles import fingers_overlap
from grasptrack.grasp.synthesis.terms import Stable
from grasptrack.typing import Floats, Ints

NOT_FLAT = "the outline under a finger is not flat"
ASKEW = "a finger would stand askew on the outline"
NO_ROOM = "no room for a finger beside the object"
NEIGHBOUR = "no room for a finger: a neighbour is in the way"
CROWDED = "no room for the fingers: they would touch each other"


class Limits(NamedTuple):
    """How uneven the outline under a finger may be; infinite values ask nothing.

    Attributes:
        roughness: rms distance from a straight line, in finger widths, as `Candidates.roughness` has it. A
            right-angled corner has 0.10, a circle as wide as 20 fingers 0.004.
        protrusion: how far the outline within a finger's width of the contact may reach behind the face of the pad,
            in finger widths. With 0.25 a pad may lean on a straight edge by 26 degrees.
    """

    roughness: float = 0.04
    protrusion: float = 0.25


def reject_infeasible(
    found: Stable, at: Candidates, view: View, hand: HandPx, neighbours: Sequence[Outline], limits: Limits
) -> tuple[Ints, dict[str, int]]:
    """Rows of the stable candidates that a hand can do, and how many others each reason removed.

    A candidate that fails in several ways counts under the first: opening, flatness, room beside the object, room
    beside the neighbours, room for each other.
    """
    left = np.arange(len(found))
    counts: dict[str, int] = {}

    def drop(bad: NDArray[np.bool_], reason: str) -> None:
        nonlocal left
        if bad.any():
            counts[reason] = int(bad.sum())
            left = left[~bad]

    drop(found.opening[left] > hand.max_opening, too_wide(hand))
    drop(found.opening[left] < hand.min_opening, too_narrow(hand))
    drop(found.roughness[left] > limits.roughness, NOT_FLAT)
    depth = hand.finger_thickness + hand.clearance
    protrusion, nearest = _finger_clearances(view, found, left, at.places, hand.finger_width, depth)
    askew, blocked = protrusion > limits.protrusion * hand.finger_width, np.isfinite(nearest)
    drop(askew, ASKEW)
    drop(blocked[~askew], NO_ROOM)
    for neighbour in neighbours:
        outer = View(as_view(neighbour).outer)
        _, nearest = _finger_clearances(outer, found, left, None, hand.finger_width, depth)
        in_the_way = np.isfinite(nearest)
        counts[NEIGHBOUR] = counts.get(NEIGHBOUR, 0) + int(in_the_way.sum())
        left = left[~in_the_way]
    drop(fingers_overlap(found.contacts[left], found.directions[left], hand.finger_width, depth), CROWDED)
    return left, {reason: n for reason, n in sorted(counts.items(), key=lambda item: -item[1]) if n}


def _finger_clearances(
    view: View, found: Stable, rows: Ints, places: Floats | None, width: float, depth: float
) -> tuple[Floats, Floats]:
    """(g,) largest protrusion under any finger of a grasp, and least distance of what else is in its way, in px."""
    k = found.index.shape[1]
    rooms = kernels.finger_clearance(
        view.points,
        view.offsets,
        found.contacts[rows].reshape(-1, 2),
        found.directions[rows].reshape(-1, 2),
        None if places is None else places[found.index[rows].ravel()],
        width,
        depth,
        width,
    ).reshape(-1, k, 2)
    return rooms[..., 0].max(axis=1), rooms[..., 1].min(axis=1)


def too_wide(hand: HandPx) -> str:
    """Reason: beyond the largest opening."""
    return f"too wide for the opening of {hand.max_opening:.0f} px"


def too_narrow(hand: HandPx) -> str:
    """Reason: below the least opening."""
    return f"narrower than the least opening of {hand.min_opening:.0f} px"
