# SPDX-License-Identifier: Apache-2.0
"""The homographies that lay one outline on another, without a prior: any turn, any start, any scale, strong tilt."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import islice

import numpy as np

from grasptrack import kernels
from grasptrack.geometry.contours import Outline
from grasptrack.kernels.results import AlignmentSteps
from grasptrack.matching.rating import LEAST_SHARE, NEAR, REACH, Match, lies_on, measure_observability, rate_homography
from grasptrack.matching.samples import (
    STARTS_PIECES,
    STARTS_WHOLE,
    Sampled,
    Starts,
    align_parts,
    align_wholes,
    as_sampled,
    pooled_starts,
)
from grasptrack.typing import Floats

Steps = tuple[Floats, Floats]

COARSE: tuple[Steps, ...] = (
    (np.array([0.3, 0.25, 0.2, 0.15]), np.full(4, 1e-3)),
    (np.array([0.12, 0.1, 0.1, 0.1]), np.full(4, 1e-4)),
)
"""Step by step: reach in sqrt(area), damping. Few samples, of every start, and of those that are not hopeless."""
QUICK: tuple[Steps, ...] = ((COARSE[0][0][:1], COARSE[0][1][:1]), (COARSE[0][0][1:], COARSE[0][1][1:]), COARSE[1])
"""The same where outlines compete: what is hopeless is given up after the first step."""
QUICK_SAMPLES = 32
HOPELESS, HOPELESS_SHARE = 3.0, 0.03
"""What is left with more than so many times the least misfit, and more than this share of sqrt(area) beyond it, is given
up after the first coarse steps."""
COARSE_SAMPLES = 64
COARSE_NOISE = 0.02
"""sqrt(area), of the coarse steps: what is off by ten times as much has a say, as the hole in a disc must have."""
FINE: Steps = np.array([0.08, 0.06, 0.06, 0.05]), np.array([1e-5, 1e-6, 1e-6, 1e-6])
"""The same of what is promising; half of the samples, all in the last step."""
PROMISING, PROMISING_SHARE = 3.0, 0.02
"""What is left with more than so many times the least misfit, and more than this share of sqrt(area) beyond it, is given
up after the coarse steps."""
WHOLE = 0.8
"""A share of both outlines that lies on the other where one of several is laid on the whole of one, ..."""
MOST_LEFT = math.sqrt(WHOLE * NEAR**2 + (1.0 - WHOLE) * REACH**2)
"""... and share of sqrt(area) that is left then at most."""
MOST_LEFT_PARTLY = math.sqrt(LEAST_SHARE * NEAR**2 + (1.0 - LEAST_SHARE) * REACH**2)
"""The same of sqrt(area) of what most of one outline is laid on a part of."""
FINAL = 7
"""Hypotheses that are refined on all samples."""
SETTLED, SETTLED_SHARE = 3.0, 0.005
"""Hypotheses with less than so many times the least misfit, or less than this share of sqrt(area) beyond it, are refined
until they are one or stay apart."""
FITS = 0.93
"""A share of both outlines that need not be bettered; below it, parts and stronger perspective are tried as well."""
LEAST_NOISE = 0.1
"""px; outlines are never believed to be better than this."""
SAME = 0.03
"""Hypotheses that put all points within this share of sqrt(area) of each other are one."""


def match_outlines(
    first: Outline | Sampled, second: Outline | Sampled, most: int = 4, *, thorough: bool = True
) -> list[Match]:
    """The homographies that may lay one outline on another, the best first.

    Args:
        first, second: the outlines, or samples of them made before. Any first point and direction; holes help.
        most: hypotheses given at most.
        thorough: where no hypothesis fits nearly everywhere, look for parts of the first outline and for stronger
            perspective as well. It takes several times as long.

    Returns:
        Distinct hypotheses, never a mirror image, none that asks for more tilt than `MAX_STRETCH` and `MAX_DEPTH` allow,
        the least cost first. Empty where nothing fits at all. `judge_hypotheses` says what they amount to.
    """
    a, b = as_sampled(first), as_sampled(second)
    found = _refine_starts(align_wholes(a, b), a, b)
    if thorough and not (found and found[0].share >= FITS):
        again = np.concatenate([align_wholes(a, b, more=True), align_parts(a, b)])
        found = _merge_duplicates(found + _refine_starts(again, a, b), a)
    if found:
        found[0] = found[0]._replace(slack=measure_observability(found[0], a, b))
    return [_to_image_coordinates(m, a, b) for m in found[:most]]


def may_match(firsts: Sequence[Sampled], second: Sampled, limit: float) -> bool:
    """Whether one of several outlines differs from another, whitened, by no more than a share of their norm."""
    return bool(len(pooled_starts([a.whitened_bent for a in firsts], second.whitened_outline, 1, limit).left))


def match_several(firsts: Sequence[Sampled], second: Sampled, limit: float = 1.0) -> list[list[Match]]:
    """The homographies that may lay each of several outlines on the whole of one, those of each the best first.

    What one of them leaves is held against what the others do, as the ways of one outline are held against each other: the
    work hardly grows with their number. The slack is not measured.

    Args:
        firsts: samples of the outlines.
        second: samples of the one that they are laid on.
        limit: share of their norm by which whitened outlines differ at most that may be one.
    """
    starts = pooled_starts([a.whitened_bent for a in firsts], second.whitened_outline, STARTS_WHOLE, limit)
    coarse = _promising_rows(starts, firsts, second, MOST_LEFT * second.size)
    found = [_refine_rows(rows, a, second) for a, rows in zip(firsts, coarse, strict=True)]
    found = [[m for m in ways if m.share >= WHOLE] for ways in found]
    most = _settled_limit(min((ways[0].misfit for ways in found if ways), default=0.0), second)
    return [
        [_to_image_coordinates(m, a, second) for m in ways if m.misfit <= most]
        for a, ways in zip(firsts, found, strict=True)
    ]


def lay_several(firsts: Sequence[Sampled], second: Sampled, limit: float = 1.0, most: int = 3) -> list[list[Floats]]:
    """Homographies (3, 3) that lay most of each of several outlines on a part of one, as on that of parts that touch.

    What else the second one has is not looked at, so that nothing but its image says whether one of them is right. They are
    distinct, `most` at most of each, those that leave least first. Whitened pieces that differ by more than `limit`, a share of
    their norm, are others.
    """
    starts = pooled_starts([a.whitened_outline for a in firsts], second.whitened_pieces, STARTS_PIECES, limit)
    found: list[list[Floats]] = []
    for a, rows in zip(firsts, _promising_rows(starts, firsts, second, MOST_LEFT_PARTLY * second.size), strict=True):
        begun = np.ascontiguousarray(rows[: 4 * most, :9])
        fine = _align_starts(begun, a, second, FINE, [2] * len(FINE[0])) if len(begun) else rows
        fine = fine[np.argsort(fine[:, 9], kind="stable")]
        ways = (fine[i, :9].reshape(3, 3) for i in (_distinct_indices(fine, a, a.size) if len(fine) else []))
        found.append([_between_images(H, a, second) for H in islice((H for H in ways if lies_on(H, a, second)), most)])
    return found


def _promising_rows(starts: Starts, firsts: Sequence[Sampled], b: Sampled, most: float) -> list[Floats]:
    """(k, 10) for each of several outlines, as `_refine_coarse` gives them, those that promise something beside the best and
    leave no more than so many px."""
    coarse = [_refine_coarse(starts.of(i), a, b, QUICK, QUICK_SAMPLES) for i, a in enumerate(firsts)]
    least = min((float(rows[0, 9]) for rows in coarse if len(rows)), default=0.0)
    limit = min(most, max(PROMISING * least, least + PROMISING_SHARE * b.size))
    return [rows[rows[:, 9] <= limit] for rows in coarse]


def refine_homographies(starts: Floats, first: Outline | Sampled, second: Outline | Sampled) -> list[Match]:
    """The homographies that given ones (k, 3, 3), near to what is meant, lead to when they are made to fit, the best first.

    Distinct hypotheses, as `match_outlines` gives them; the slack is not measured.
    """
    a, b = as_sampled(first), as_sampled(second)
    return [_to_image_coordinates(m, a, b) for m in _refine_starts(_between_centres(starts, a, b), a, b)]


def settle_homographies(starts: Floats, first: Outline | Sampled, second: Outline | Sampled) -> Floats | None:
    """(3, 3) the one of some homographies (k, 3, 3) that fits best when each takes two steps toward the second outline.

    What the outlines hardly show stays as it was. None where no start comes to anything.
    """
    a, b = as_sampled(first), as_sampled(second)
    reaches, damping = FINE
    found = _align_starts(_between_centres(starts, a, b), a, b, (reaches[-2:], damping[-2:]), [4, 2])
    return _between_images(found[np.argmin(found[:, 9]), :9].reshape(3, 3), a, b) if len(found) else None


def _between_centres(starts: Floats, a: Sampled, b: Sampled) -> Floats:
    """(k, 9) homographies (k, 3, 3) between the images as such between the centres."""
    to, back = np.eye(3), np.eye(3)
    to[:2, 2], back[:2, 2] = a.centre, -b.centre
    centred = back @ starts @ to
    return np.ascontiguousarray((centred / centred[:, 2:, 2:]).reshape(-1, 9))


def _between_images(H: Floats, a: Sampled, b: Sampled) -> Floats:
    """(3, 3) a homography between the centres as one between the images."""
    to, back = np.eye(3), np.eye(3)
    to[:2, 2], back[:2, 2] = -a.centre, b.centre
    moved = back @ H @ to
    return moved / moved[2, 2] if abs(moved[2, 2]) > 1e-9 else moved


def _to_image_coordinates(m: Match, a: Sampled, b: Sampled) -> Match:
    """The same between the images; so far it was between the centres."""
    return m._replace(homography=_between_images(m.homography, a, b))


def _refine_starts(begun: Floats, a: Sampled, b: Sampled) -> list[Match]:
    """Distinct hypotheses that starts (k, 9) lead to, the least misfit first."""
    return _refine_rows(_refine_coarse(begun, a, b), a, b)


def _refine_rows(coarse: Floats, a: Sampled, b: Sampled) -> list[Match]:
    """The same of what is left of the starts after the coarse steps (k, 10)."""
    found = _refine_fine(coarse, a, b)
    if found and len(a.self_alignments):  # what nearly lies on itself must lie there in the best of its ways
        best = found[0].homography
        ways = (best @ a.self_alignments.reshape(-1, 3, 3)).reshape(-1, 9)
        found = _merge_duplicates(found + _refine_fine(_refine_coarse(ways / ways[:, 8:], a, b), a, b, len(ways)), a)
    return found if len(found) < 2 else _refine_to_convergence(found, a, b)


def _refine_to_convergence(found: list[Match], a: Sampled, b: Sampled) -> list[Match]:
    """Those that are left when all that come near the best one are refined to the end: slow ones join it."""
    limit = _settled_limit(found[0].misfit, b)
    near = [m for m in found if m.misfit <= limit]
    reaches, damping = FINE
    rows = np.array([m.homography.ravel() for m in near])
    for _ in range(2):
        rows = _align_starts(np.ascontiguousarray(rows[:, :9]), a, b, (reaches[-3:], damping[-3:]), [1, 1, 1])
        if len(rows) < 2 or len(_distinct_indices(rows, a, b.size)) == 1:
            break
    refined = [m for row in rows if (m := rate_homography(row[:9].reshape(3, 3), a, b)) is not None]
    return _merge_duplicates(refined + [m for m in found if m.misfit > limit], a)


def _settled_limit(least: float, b: Sampled) -> float:
    """px, misfit up to which a hypothesis may turn out to be as good as the best one."""
    return max(SETTLED * least, least + SETTLED_SHARE * b.size)


def _refine_coarse(
    begun: Floats, a: Sampled, b: Sampled, way: tuple[Steps, ...] = COARSE, samples: int = COARSE_SAMPLES
) -> Floats:
    """(k, 10) distinct homographies, on few samples, the least misfit first."""
    stride = max(1, len(a.points) // samples)
    if not len(begun):
        return np.zeros((0, 10))
    found, noise = begun, max(COARSE_NOISE * b.size, LEAST_NOISE)
    for steps in way:
        found = _align_starts(np.ascontiguousarray(found[:, :9]), a, b, steps, [stride] * len(steps[0]), noise)
        if len(found):
            least = float(found[:, 9].min())
            found = found[found[:, 9] <= max(HOPELESS * least, least + HOPELESS_SHARE * b.size)]
    found = found[np.argsort(found[:, 9], kind="stable")]
    return found[_distinct_indices(found, a, b.size)] if len(found) else found


def _refine_fine(coarse: Floats, a: Sampled, b: Sampled, most: int = FINAL) -> list[Match]:
    """Those that promise something, on all samples."""
    if not len(coarse):
        return []
    limit = max(PROMISING * coarse[0, 9], coarse[0, 9] + PROMISING_SHARE * b.size)
    promising = coarse[coarse[:, 9] <= limit][:most]
    fine = _align_starts(np.ascontiguousarray(promising[:, :9]), a, b, FINE, [2] * (len(FINE[0]) - 1) + [1])
    return _merge_duplicates([m for row in fine if (m := rate_homography(row[:9].reshape(3, 3), a, b)) is not None], a)


def _merge_duplicates(found: list[Match], a: Sampled) -> list[Match]:
    """The distinct ones, the least cost first."""
    if not found:
        return []
    ordered = sorted(found, key=lambda m: m.cost)
    kept = _distinct_indices(np.array([m.homography.ravel() for m in ordered]), a, ordered[0].size)
    return [ordered[i] for i in kept]


def _align_starts(
    begun: Floats, a: Sampled, b: Sampled, steps: Steps, strides: list[int], noise: float = LEAST_NOISE
) -> Floats:
    """(k, 10) those starts that come to anything, refined."""
    reaches, damping = steps
    found = kernels.align_projective(
        begun,
        a.points,
        a.normals,
        b.points,
        b.normals,
        b.offsets,
        AlignmentSteps(reaches * b.size, damping, np.array(strides, dtype=np.int64), noise),
    )
    return found[np.isfinite(found[:, 9])]


def _distinct_indices(rows: Floats, a: Sampled, size: float) -> list[int]:
    """Of homographies (k, 9 or more) that put the outline in the same place the first."""
    points = a.points[:: max(1, len(a.points) // 16)]
    h = rows[:, :9].reshape(-1, 1, 3, 3)
    w = h[..., 2, 0] * points[:, 0] + h[..., 2, 1] * points[:, 1] + h[..., 2, 2]
    at = (h[..., :2, :2] @ points[..., None])[..., 0] + h[..., :2, 2]
    at = at / w[..., None]
    kept: list[int] = []
    for i in range(len(rows)):
        if not kept or ((at[kept] - at[i]) ** 2).sum(axis=2).max(axis=1).min() > (SAME * size) ** 2:
            kept.append(i)
    return kept
