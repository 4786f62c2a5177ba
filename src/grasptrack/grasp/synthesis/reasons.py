# SPDX-License-Identifier: Apache-2.0
"""Why a hand can do no grasp, in one sentence that also says what would be right."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.grasp.hand import HandPx
from grasptrack.grasp.synthesis.limits import too_narrow, too_wide

SMALLER = (0.5, 0.25)
"""Shares of its size at which a finger that finds no place is tried again."""


class Tried(NamedTuple):
    """What became of all stable candidates.

    Attributes:
        openings: (g,) px of all that are stable, g above 0.
        refused: how many each reason removed, the most frequent first.
        hand: that none of them suits.
        px_per_mm: scale for the sentence, or None.
    """

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

    Args:
        tried: the candidates and the hand.
        left_with: indices of those that another hand leaves.
        finds_any: whether a search for another hand finds a grasp.
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
    """A length in words, rounded to the side that leaves the sentence true.

    Args:
        value: `sign` times the length in px.
        sign: 1 to round the length up, -1 to round it down.
        px_per_mm: scale; the length is told in mm too.
    """
    px = f"{abs(math.ceil(value - 1e-9))} px"
    if px_per_mm is None:
        return px
    return f"{px} ({abs(math.ceil(10.0 * value / px_per_mm - 1e-9)) / 10.0:g} mm)"
