# SPDX-License-Identifier: Apache-2.0
"""What lies beside the outline where its edge is not seen, and in which stretches that comes.

It may be the object's own inside and the background outside, something in front, or another shape: background where the
object should be (a notch), or the object where it should end (a tab).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grasptrack.kernels import FIRST_CELLS, LEAST_SPREAD, NEAR_SAMPLES, REGION_CELLS
from grasptrack.statistics import MAD_TO_SD
from grasptrack.typing import Bools, Floats
from reference.registration.edges import Candidates, Light
from reference.registration.pyramid import (
    Pyramid,
    clamp_to_int,
    level_through,
    transform_points,
    upper_median,
)
from reference.registration.target import Target

SEEN = 0.7
"""Probability of an edge from which on a sample counts as seen by its neighbours."""
ENOUGH, ASKED = 4, 12
"""Seen samples on each side that must be there, and samples that are asked."""
EDGE, BEHIND = 1, 2
"""Cells of a notch's or tab's boundary, and beyond it."""
CLOSE, FAINT = 2.0, 0.25
"""Work px from where an edge is expected, and share of the first contrast, from which on a boundary is one."""
SEEN_ODDS, BOUNDED_ODDS = 20.0, 0.3
"""Likelihood ratios, against an occluder, of the object's edge where it is seen, and of another shape at some boundary."""
AMISS = 0.05
"""Share of a notch's or tab's stretch that does not look like one: its own corners."""
IMITATED = 0.05
"""Probability that what covers the object looks like the ground, or like the object itself."""
BESIDE = 1e-3
"""Factor: an occluder begins just where a notch or tab ends."""
MOST_LOG = 20.0
"""Of the log of a sample's likelihood ratio."""
NEVER = 1e-12
"""Share of a state that is left out."""


class RegionNumbers(NamedTuple):
    """What is believed of the cells beside the outline.

    Attributes:
        unlikely: share of cells that nothing explains.
        far: share of the size within which the outline must be seen, for a notch or tab on both sides.
        power: of a sample's agreement: a shape is as sure as the least sure of what it asks for.
        cover: grey levels, by which what covers a side differs from it.
        shallow: work px: what differs less deeply is the same shape.
    """

    unlikely: np.float64
    far: np.float64
    power: np.float64
    cover: np.float64
    shallow: float


class Chain(NamedTuple):
    """Explanations of the outline's samples: a Markov chain along it.

    Attributes:
        states: (n, 3) probabilities: the object's edge, an occluder, another shape.
        log_likelihood: of all samples.
    """

    states: Floats
    log_likelihood: np.float64


def forward_backward(
    object_: Floats, other: Floats, power: float, share: Floats, stay: float, mixed: float = 1.0
) -> Chain:
    """Forward and backward along the outline.

    Args:
        object_, other: (n,) likelihood ratios of the object's edge and of another shape against an occluder.
        power: how much of an independent measurement a sample is.
        share: (3,) prior shares of the states.
        stay: probability that a sample's state is simply the one before's; else it is drawn from the shares.
        mixed: factor of the probability that an occluder and another shape lie side by side, no edge of the object's between.
    """
    n = len(object_)
    likelihood = np.column_stack([object_**power, np.ones(n), other**power])
    step = stay * np.eye(3) + (1.0 - stay) * share
    step[[1, 2], [2, 1]] *= mixed
    states, log_likelihood, before = np.zeros((n, 3)), np.float64(0.0), share
    for i in range(n):
        a = (before if i == 0 else before @ step) * likelihood[i]
        total = a.sum()
        states[i] = before = a / total
        log_likelihood += np.log(total)
    b = np.ones(3)
    for i in reversed(range(n)):
        if i + 1 < n:
            b = step @ (likelihood[i + 1] * b)
            b *= 3.0 / b.sum()
        states[i] *= b
        states[i] /= states[i].sum()
    return Chain(states, log_likelihood)


def has_boundary(view: Candidates, contrast: Floats) -> Bools:
    """(n,) whether a sample shows a boundary where its edge is expected, of whatever sign: what lies there ends there.

    Args:
        view: candidates of the samples.
        contrast: (n,) grey levels, in the reference. Samples outside the image count as bounded.
    """
    near = (np.abs(view.offset) < CLOSE) & (np.abs(view.step) > FAINT * np.abs(contrast)[:, None])
    return np.asarray((near & view.there()).any(axis=1) | ~view.inside)


def other_shape(
    target: Target,
    pyramid: Pyramid,
    G: Floats,
    places: Floats,
    visible: Floats,
    ends: Bools,
    blur: Floats,
    light: Light,
    numbers: RegionNumbers,
    share: Floats,
    stay: float,
    power: float,
) -> tuple[float, Floats]:
    """Log-likelihood ratio of "some stretch shows another shape" against "this shape, partly occluded".

    Args:
        target, pyramid, G: an image seen through a pose (3, 3).
        places: (n, 2) work px, of the samples' edges.
        visible: (n,) probability that each sample's edge was seen; 0 where one was seen, but too faint to bound anything.
        ends: (n,) of `has_boundary`.
        blur: (n,) work px, half of what moves across each sample while it is exposed: so far both sides are mixed.
        light: of the surface.
        numbers: see there.
        share, stay, power: of `forward_backward`.

    Returns:
        The ratio, -1 where no sample tells, 0 of no samples; and (n,) probability of another shape at each.
    """
    n = len(target.points)
    if n == 0:
        return 0.0, np.zeros(0)
    level, H = level_through(pyramid, G, target.centre, 1.0)
    inner, outer = (
        level.at(
            *transform_points(H, *np.moveaxis(places[:, None] + d[:, None] * target.normals[:, None], 2, 0)), margin=1.0
        )
        for d in (-target.depth, target.depth)
    )
    mixed = target.depth[None] < blur[:, None]
    inner, outer = np.where(mixed, np.nan, inner), np.where(mixed, np.nan, outer)
    shallow = int(np.searchsorted(target.depth, numbers.shallow))
    # the inside less what it was, the outside where it is outside: light and background as they are here and now
    expected = light.gain * target.inside + light.bias
    material, beyond = np.where(np.isnan(target.inside), np.nan, inner), np.where(target.outside > 0, outer, np.nan)
    changed = inner - expected
    gaps = np.hypot(*(target.points - np.roll(target.points, -1, axis=0)).T)
    length = np.minimum(gaps, target.radius).sum()
    far = clamp_to_int(numbers.far * 2.0 * target.radius * n / length, 8, n)
    same, differs = np.where(visible > 0.5, SEEN_ODDS, 1.0), np.where(~(visible > 0.5) & ends, BOUNDED_ODDS, 1.0)
    opened = np.vstack([differs, differs])
    told, least = False, float(np.log(numbers.unlikely))
    for i in np.flatnonzero(~((visible > 0.5) | ends)):
        back, shift = _levels_near(int(i), visible, beyond, far), _levels_near(int(i), visible, changed, far)
        if back is None or shift is None:
            continue
        # the object's material as it varies here: what is nearly of its level is not of it
        here = _levels_near(int(i), visible, material, far)
        varied = np.float64(0.0) if here is None else here.spread
        own = light.gain * (target.inner[i] / target.inner.shape[1]).sum() + light.bias + shift.level
        own_in = _log_cells(material[i], expected[i] + shift.level, shift.spread, numbers)
        back_in = _log_cells(material[i], back.level, back.spread, numbers)
        own_out = _log_cells(beyond[i], own, varied, numbers)
        back_out = _log_cells(beyond[i], back.level, back.spread, numbers)
        as_inside, as_outside = _known_mean(own_in[:FIRST_CELLS], 0.0), _known_mean(back_out[:FIRST_CELLS], 0.0)
        notch = min(_best_depth_score(back_in, own_in, shallow, least), as_outside)
        tab = min(_best_depth_score(own_out, back_out, shallow, least), as_inside)
        ground, more = (
            min(_known_mean(back_in[:FIRST_CELLS], least), as_outside),
            min(_known_mean(own_out[:FIRST_CELLS], least), as_inside),
        )
        agreement = np.array([min(as_inside, as_outside), max(notch, tab), ground, more])
        ratio = np.exp(np.clip(numbers.power * agreement, -MOST_LOG, MOST_LOG))
        same[i], ratio = ratio[0], AMISS + (1.0 - AMISS) * ratio
        if back.between and shift.between:
            differs[i] = ratio[1]
        opened[:, i] = ratio[2:]
        told = True
    if not told:
        return -1.0, np.zeros(n)
    chain = forward_backward(same, differs, power, share, stay, BESIDE)
    without = np.array([share[0] + share[2], share[1], NEVER])
    simply = forward_backward(same, differs, power, without, stay, BESIDE)
    # ground where the object should be and the object where it should end, without an end of their own: one alone may be cover
    either = (forward_backward(same, side, power, share, stay, BESIDE).log_likelihood for side in opened)
    open_ = sum(min(max(float(each - simply.log_likelihood), 0.0), -math.log(IMITATED)) for each in either)
    closing = float(chain.log_likelihood - simply.log_likelihood)
    return max(closing, open_) if open_ > 0.0 else closing, chain.states[:, 2]


class _Levels(NamedTuple):
    """Median and spread of grey levels; `between`: of both sides of a stretch."""

    level: np.float64
    spread: np.float64
    between: bool


def _levels_near(i: int, visible: Floats, cells: Floats, far: int) -> _Levels | None:
    """Levels of the first cells (n, REGION_CELLS) of the nearest visible samples, beyond the stretch that is not seen.

    NaN where a cell does not count. A side on which the stretch goes on for `far` samples tells nothing: what lies far from
    all that fits is not known. None where neither side tells.
    """
    n = len(visible)
    asked: list[int] = []
    sides = 0
    for side in (-1, 1):
        first = next((step for step in range(1, n) if not visible[(i + side * step) % n] <= 0.5), n)
        if first > far:
            continue
        around = [(i + side * step) % n for step in range(first, min(first + ASKED, n))]
        found = [j for j in around if not visible[j] < SEEN][:NEAR_SAMPLES]
        sides += len(found) >= ENOUGH
        asked += found
    levels = cells[asked, :FIRST_CELLS].ravel()
    levels = levels[~np.isnan(levels)]
    if not sides or len(levels) < 3 * FIRST_CELLS:
        return None
    level = upper_median(levels)
    return _Levels(level, MAD_TO_SD * upper_median(np.abs(levels - level)) + LEAST_SPREAD, sides == 2)


def _log_cells(values: Floats, level: Floats | np.float64, spread: np.float64, numbers: RegionNumbers) -> Floats:
    """(k,) nats by which grey levels (k,) are `level` as it varies, rather than one of what covers it; NaN stays."""
    own = spread * spread
    cover = own + numbers.cover * numbers.cover
    ratio = np.sqrt(cover / own) * np.exp(0.5 * (values - level) ** 2 * (1.0 / cover - 1.0 / own))
    return np.asarray(np.log((1.0 - numbers.unlikely) * ratio + numbers.unlikely))


def _known_mean(cells: Floats, none: float) -> float:
    """Mean of the cells that count; `none` of none."""
    known = cells[~np.isnan(cells)]
    return float(known.sum() / len(known)) if len(known) else none


def _best_depth_score(strange: Floats, usual: Floats, shallow: int, least: float) -> float:
    """How well a notch or tab of the best depth explains one side, nats a cell.

    Something else lies from the outline on, up to a boundary of its own, and beyond that what should be there. What lies in
    front of the object goes on.

    Args:
        strange, usual: (REGION_CELLS,) nats of either; NaN where a cell does not count.
        shallow: cells, the least depth.
        least: of a side without cells.
    """
    ways = (
        min(_known_mean(strange[:d], least), _known_mean(usual[d + EDGE : d + EDGE + BEHIND], 0.0))
        for d in range(shallow, REGION_CELLS - BEHIND)
    )
    return max(ways, default=-math.inf)
