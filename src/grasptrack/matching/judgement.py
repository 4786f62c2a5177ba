# SPDX-License-Identifier: Apache-2.0
"""What hypotheses of a match amount to: matched, ambiguous, or none."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from grasptrack.matching.rating import Match

LEAST_SHARE = 0.6
"""Of both outlines, at least so much must lie on the other: a third may be covered or cut."""
ALIKE = 0.005
"""Share of sqrt(area): a hypothesis whose cost exceeds the least by less, in squares, fits alike. Half of the tolerance
within which an object counts as its own twin."""
ALIKE_NOISE = 0.75
"""The same in least costs: what is left by the best one, noise of the outlines or a piece that is missing, may hide as
much."""
ALIKE_PX = 0.2
"""px, the same: no outline is known better."""

SLIDES, SLIDES_NOISE = 0.0015, 0.5
"""Share of sqrt(area), and of the residual: an outline that parts by less when a contact moves by 4 % of sqrt(area) is free
to slide along itself. Discs, ellipses, eggs and crescents part by 0.1 % at most, built-in shapes else by 0.35 % at least."""

PARTIAL = 0.01
"""Share of sqrt(area): where the misfit is larger a piece is missing, or the outline is another one, ..."""
ROUGH, ROUGH_PX = 0.0025, 0.3
"""... and where the rest does not fit to this share of sqrt(area), or so many px, nothing is sure."""


class MatchOutcome(NamedTuple):
    """What hypotheses amount to.

    Attributes:
        status: "matched" when one fits and no other fits alike; "ambiguous" when others do, or when it is free to slide;
            "none" when none fits.
        best: the hypothesis to take; of several that fit alike the one that asks for the least tilt. None when none fits.
        others: those that fit alike, the least tilt first.
        reason: empty when matched.
    """

    status: Literal["matched", "ambiguous", "none"]
    best: Match | None
    others: list[Match]
    reason: str


def judge_hypotheses(found: list[Match]) -> MatchOutcome:
    """What the hypotheses of one match amount to."""
    if not found:
        return MatchOutcome("none", None, [], "no view of the outline looks like this")
    least = min(found, key=lambda m: m.cost)
    if least.share < LEAST_SHARE:
        return MatchOutcome("none", None, [], f"only {100 * least.share:.0f} % of the outlines lie on each other")
    if least.misfit > PARTIAL * least.size and least.residual > max(ROUGH * least.size, ROUGH_PX):
        reason = f"a piece of the outline does not fit, and the rest only to {least.residual:.1f} px"
        return MatchOutcome("ambiguous", least, [m for m in found if m is not least and fits_alike(m, least)], reason)
    alike = sorted((m for m in found if fits_alike(m, least)), key=lambda m: m.stretch)
    if len(alike) == 1 and least.slack <= max(SLIDES * least.size, SLIDES_NOISE * least.residual):
        return MatchOutcome(
            "ambiguous", least, [], "the outline slides along itself: nothing tells how far it turned or tilted"
        )
    if len(alike) == 1:
        return MatchOutcome("matched", least, [], "")
    ways = len(alike)
    return MatchOutcome("ambiguous", alike[0], alike[1:], f"the outline fits in {ways} ways that cannot be told apart")


def fits_alike(one: Match, least: Match) -> bool:
    """Whether a hypothesis fits as well as the one of the least cost, as far as noise and tolerance let it be told."""
    excess = math.sqrt(max(one.cost**2 - least.cost**2, 0.0))
    return excess <= max(ALIKE * least.size, ALIKE_NOISE * least.cost, ALIKE_PX)
