# SPDX-License-Identifier: Apache-2.0
"""How well and how firmly a homography lays one outline on another, and what such hypotheses amount to."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.geometry.homographies import near_identity
from grasptrack.matching.samples import Sampled
from grasptrack.typing import Floats

REACH = 0.1
"""sqrt(area); distances are counted up to this."""
CAP = 0.03
"""sqrt(area); the same where hypotheses are compared."""
NEAR, NEAR_PX = 0.02, 1.0
"""Share of sqrt(area), or px, whichever is more: what is as near as this lies on the other outline."""
TELLING = 0.04
"""sqrt(area): contacts that are off by more are wrong."""
MAX_STRETCH = 3.0
"""Largest ratio of the two magnifications at any point of the outline: 2.6 arises at 60 degrees, strong perspective."""
MAX_DEPTH = 2.2
"""Largest ratio of the distances of two points of the outline from the camera: 1.9 arises then."""


SLIDES, SLIDES_NOISE = 0.0015, 0.5
"""Share of sqrt(area), and of the residual: an outline that parts by less when a contact moves by 4 % of sqrt(area) is free
to slide along itself. Discs, ellipses, eggs and crescents part by 0.1 % at most, built-in shapes else by 0.35 % at least."""


class Match(NamedTuple):
    """One way in which the first outline lies on the second.

    Attributes:
        homography: (3, 3) first -> second, its last element 1.
        misfit: px rms in the second view between the outlines, both ways, each distance counted up to a tenth of
            sqrt(area).
        cost: px, the same with each distance counted up to 3 % of sqrt(area) only: what hypotheses are ordered by. Of two that
            leave out a piece, the one that lies better on the rest is better.
        residual: px rms of those distances that are small (`NEAR`).
        share: 0 to 1, how much of both outlines is so near the other.
        stretch: 1 and more, the largest ratio of the two magnifications at any point: the tilt that it takes.
        size: px, sqrt(area) of the second outline.
        slack: px rms by which the outlines part when the motion that they show least moves a point by `TELLING`: near 0
            the outline slides along itself, as that of a disc or an ellipse. Of the best hypothesis; NaN of others.
    """

    homography: Floats
    misfit: float
    cost: float
    residual: float
    share: float
    stretch: float
    size: float
    slack: float = math.nan

    @property
    def can_slide(self) -> bool:
        """Whether the outline is free to slide along itself; False where the slack is not known."""
        return self.slack <= max(SLIDES * self.size, SLIDES_NOISE * self.residual)


def rate_homography(H: Floats, a: Sampled, b: Sampled) -> Match | None:
    """How well a homography (3, 3) lays one outline on another; None when no camera could have seen it so."""
    in_front, determinant, ratio = kernels.distortion(H, a.points)
    if not (in_front > 1e-9 and determinant > 0.0 and ratio <= MAX_STRETCH):
        return None
    depth = np.abs(a.points @ H[2, :2] + H[2, 2])
    if depth.max() > MAX_DEPTH * depth.min():
        return None
    moved = kernels.carry_normals(H, a.points, a.normals)
    at, along = np.ascontiguousarray(moved[:, :2]), np.ascontiguousarray(moved[:, 2:4])
    reach = REACH * b.size
    gaps = np.concatenate(
        [
            kernels.outline_gaps(at, along, b.points, b.normals, b.offsets, reach),
            kernels.outline_gaps(b.points, b.normals, at, along, a.offsets, reach),
        ]
    )
    capped = np.minimum(gaps, CAP * b.size)
    near = gaps[gaps <= max(NEAR * b.size, NEAR_PX)]
    return Match(
        H / H[2, 2],
        math.sqrt(float(gaps @ gaps) / len(gaps)),
        math.sqrt(float(capped @ capped) / len(gaps)),
        math.sqrt(float(near @ near) / len(near)) if len(near) else math.inf,
        len(near) / len(gaps),
        ratio,
        b.size,
    )


def lies_on(H: Floats, a: Sampled, b: Sampled) -> bool:
    """Whether a camera may see one outline so, between centres, that most of it lies on another, whatever else that has."""
    in_front, determinant, ratio = kernels.distortion(H, a.points)
    if not (in_front > 1e-9 and determinant > 0.0 and ratio <= MAX_STRETCH):
        return False
    moved = kernels.carry_normals(H, a.points, a.normals)
    at, along = np.ascontiguousarray(moved[:, :2]), np.ascontiguousarray(moved[:, 2:4])
    size = math.sqrt(max(0.0, kernels.seen_area(H, a.outer)))
    gaps = kernels.outline_gaps(at, along, b.points, b.normals, b.offsets, REACH * size)
    return bool((gaps <= max(NEAR * size, NEAR_PX)).mean() >= LEAST_SHARE)


def measure_observability(found: Match, a: Sampled, b: Sampled) -> float:
    """px rms by which the outlines part when they are moved a little along what fixes them least; between centres."""
    nearby = [
        rate_homography(row.reshape(3, 3), a, b) for row in perturb_homography(found.homography, a, (-TELLING, TELLING))
    ]
    apart = [math.sqrt(max(m.misfit**2 - found.misfit**2, 0.0)) for m in nearby if m is not None]
    return min(apart, default=math.inf)


STEPS = 16
"""Of the motion that an outline shows least: a turn by many small steps stays a turn."""


def perturb_homography(H: Floats, a: Sampled, shares: tuple[float, ...]) -> Floats:
    """(k, 9) a homography (3, 3) after the motion of the first outline that its normals show least.

    It moves the farthest point by each of the `shares` of sqrt(area). What is free to slide, a disc, an ellipse, stays
    on itself.
    """
    centre, radius, softest = a.softest_direction
    rows = []
    for share in shares:
        little = near_identity(share * a.size / STEPS * softest, centre, radius)
        rows.append((H @ np.linalg.matrix_power(little, STEPS)).ravel())
    return np.array(rows)


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
    if len(alike) == 1 and least.can_slide:
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
