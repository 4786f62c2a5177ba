# SPDX-License-Identifier: Apache-2.0
"""What a hand cannot do: stable grasps that are refused, and one sentence that says why none is left."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.geometry.contours import Outline, View, as_view
from grasptrack.grasp.hand import HandPx
from grasptrack.grasp.synthesis.candidates import Candidates, Stable
from grasptrack.typing import Bools, Floats, Ints


def finger_rectangles(contacts: Floats, directions: Floats, width: float, depth: float) -> Floats:
    """(..., 4, 2) px, corners of the rectangles of fingers: both ends of the pad, then the far side, going round.

    A pad, px wide, has its middle at a contact (..., 2) px and pushes in a direction (..., 2), unit; px `depth` lie behind it.
    """
    across = 0.5 * width * np.stack([-directions[..., 1], directions[..., 0]], axis=-1)
    back = contacts - depth * directions
    corners: Floats = np.stack([contacts + across, contacts - across, back - across, back + across], axis=-2)
    return corners


def fingers_overlap(contacts: Floats, directions: Floats, width: float, depth: float) -> Bools:
    """(g,) whether any two fingers of a grasp overlap, by the axes that would separate their rectangles."""
    clash = np.zeros(len(contacts), dtype=np.bool_)
    middles = contacts - 0.5 * depth * directions
    for i, j in itertools.combinations(range(contacts.shape[1]), 2):
        gap = middles[:, j] - middles[:, i]
        # only what is nearer than two circles round the rectangles can overlap
        near = np.flatnonzero((gap**2).sum(axis=1) < width**2 + depth**2)
        between, u, v = gap[near], directions[near, i], directions[near, j]
        along = np.abs((u * v).sum(axis=1))
        aslant = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        apart = np.zeros(len(near), dtype=np.bool_)
        for axis in (u, v):
            deep = np.abs((between * axis).sum(axis=1))
            wide = np.abs(between[:, 0] * axis[:, 1] - between[:, 1] * axis[:, 0])
            apart |= deep >= 0.5 * (depth + depth * along + width * aslant)
            apart |= wide >= 0.5 * (width + width * along + depth * aslant)
        clash[near] |= ~apart
    return clash


NOT_FLAT = "the outline under a finger is not flat"
ASKEW = "a finger would stand askew on the outline"
NO_ROOM = "no room for a finger beside the object"
NEIGHBOUR = "no room for a finger: a neighbour is in the way"
CROWDED = "no room for the fingers: they would touch each other"


class UnevennessLimits(NamedTuple):
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
    found: Stable, at: Candidates, view: View, hand: HandPx, neighbours: Sequence[Outline], limits: UnevennessLimits
) -> tuple[Ints, dict[str, int]]:
    """Rows of the stable candidates that a hand can do, and how many others each reason removed.

    A candidate that fails in several ways counts under the first: opening, flatness, room beside the object, room
    beside the neighbours, room for each other.
    """
    left = np.arange(len(found))
    counts: dict[str, int] = {}

    def drop_candidates(bad: NDArray[np.bool_], reason: str) -> None:
        nonlocal left
        if bad.any():
            counts[reason] = int(bad.sum())
            left = left[~bad]

    drop_candidates(found.opening[left] > hand.max_opening, too_wide(hand))
    drop_candidates(found.opening[left] < hand.min_opening, too_narrow(hand))
    drop_candidates(found.roughness[left] > limits.roughness, NOT_FLAT)
    depth = hand.finger_thickness + hand.clearance
    protrusion, nearest = _finger_clearances(view, found, left, at.places, hand.finger_width, depth)
    askew, blocked = protrusion > limits.protrusion * hand.finger_width, np.isfinite(nearest)
    drop_candidates(askew, ASKEW)
    drop_candidates(blocked[~askew], NO_ROOM)
    for neighbour in neighbours:
        outer = View(as_view(neighbour).outer)
        _, nearest = _finger_clearances(outer, found, left, None, hand.finger_width, depth)
        in_the_way = np.isfinite(nearest)
        counts[NEIGHBOUR] = counts.get(NEIGHBOUR, 0) + int(in_the_way.sum())
        left = left[~in_the_way]
    drop_candidates(fingers_overlap(found.contacts[left], found.directions[left], hand.finger_width, depth), CROWDED)
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


SMALLER = (0.5, 0.25)
"""Shares of its size at which a finger that finds no place is tried again."""


class Tried(NamedTuple):
    """What became of all stable candidates."""

    openings: NDArray[np.float64]
    refused: dict[str, int]
    hand: HandPx
    px_per_mm: float | None


def why_none(
    tried: Tried, left_with: Callable[[HandPx], NDArray[np.int64]], finds_any: Callable[[HandPx], bool]
) -> str:
    """Why no stable candidate is left.

    The opening is named where another opening alone would leave some, whatever else removed more; then the most
    frequent refusal, and whether smaller fingers would find a place.
    """
    openings, refused, hand, scale = tried
    wider, narrower = hand._replace(max_opening=math.inf), hand._replace(min_opening=0.0)
    for reason, limit, free, sign, words in (
        (too_wide(hand), hand.max_opening, wider, 1.0, "the narrowest stable grasp needs"),
        (too_narrow(hand), hand.min_opening, narrower, -1.0, "the widest stable grasp has"),
    ):
        rows = left_with(free) if reason in refused else np.zeros(0, dtype=np.int64)
        if len(rows):
            nearest = float((sign * openings[rows]).min())
            asked = "" if scale is None else f" ({limit / scale:.4g} mm)"
            return f"{reason}{asked}: {words} {format_length(nearest, sign, scale)}"
    most = next(iter(refused))
    if most in (too_wide(hand), too_narrow(hand)):
        return f"{most}, and no other opening would do"
    for share in SMALLER:
        width, thickness = share * hand.finger_width, share * hand.finger_thickness
        small = hand._replace(finger_width=width, finger_thickness=thickness)
        if finds_any(small):
            wide, thick = (format_length(v, -1.0, scale) for v in (-width, -thickness))
            return f"{most}; fingers {wide} wide and {thick} thick would find a place"
    return f"{most}, not even with fingers a quarter as large"


def format_length(value: float, sign: float, px_per_mm: float | None) -> str:
    """A length of px, `sign` times the value, in words, in mm too where the scale is known.

    It is rounded up for a sign of 1, down for -1: to the side that leaves the sentence true.
    """
    px = f"{abs(math.ceil(value - 1e-9))} px"
    if px_per_mm is None:
        return px
    return f"{px} ({abs(math.ceil(10.0 * value / px_per_mm - 1e-9)) / 10.0:g} mm)"
