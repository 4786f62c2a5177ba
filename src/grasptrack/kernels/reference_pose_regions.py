# SPDX-License-Identifier: Apache-2.0
"""What lies beside the outline where its edge is not seen, and in which stretches that comes.

It may be the object's own inside and the background outside, something in front, or another shape: background where the
object should be (a notch), or the object where it should end (a tab).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_pose_edges import Candidates, Light
from grasptrack.kernels.reference_pose_image import Pyramid, carried, level_through, middle, whole
from grasptrack.kernels.reference_pose_target import CELLS, Target

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

SEEN = 0.7
"""Probability of an edge from which on a sample counts as seen by its neighbours."""
NEAR, ENOUGH = 8, 4
"""Seen samples on each side that are asked what lies there, and that must be there."""
LEAST_SPREAD = 3.0
"""Grey levels that are added to any spread."""
CLOSE, FAINT = 2.0, 0.25
"""Work px from where an edge is expected, and share of the first contrast, from which on a boundary is one."""
NOTHING_TO_EXPLAIN = 0.05
"""Likelihood ratio of another shape where the edge is seen."""
MOST_LOG = 20.0
"""Of the log of a sample's likelihood ratio."""
NEVER = 1e-12
"""Share of a state that is left out."""


class RegionNumbers(NamedTuple):
    """What is believed of the cells beside the outline.

    Attributes:
        spread: grey levels, of the object's own inside from what it was.
        unlikely: share of cells that nothing explains.
        far: share of the size within which the outline must be seen on both sides.
        power: how much of an independent measurement a cell is.
    """

    spread: np.float64
    unlikely: np.float64
    far: np.float64
    power: np.float64


class Chain(NamedTuple):
    """Explanations of the outline's samples: a Markov chain along it.

    Attributes:
        states: (n, 3) probabilities: the object's edge, an occluder, another shape.
        log_likelihood: of all samples.
    """

    states: Floats
    log_likelihood: np.float64


def stretches(object_: Floats, other: Floats, power: float, share: Floats, stay: float) -> Chain:
    """Forward and backward along the outline.

    Args:
        object_, other: (n,) likelihood ratios of the object's edge and of another shape against an occluder.
        power: how much of an independent measurement a sample is.
        share: (3,) prior shares of the states.
        stay: probability that a sample's state is simply the one before's; else it is drawn from the shares.
    """
    n = len(object_)
    likelihood = np.column_stack([object_**power, np.ones(n), other**power])
    states, log_likelihood, before = np.zeros((n, 3)), np.float64(0.0), share
    for i in range(n):
        a = (before if i == 0 else stay * before + (1.0 - stay) * share) * likelihood[i]
        total = a.sum()
        states[i] = before = a / total
        log_likelihood += np.log(total)
    b = np.ones(3)
    for i in reversed(range(n)):
        if i + 1 < n:
            ahead = likelihood[i + 1] * b
            b = stay * ahead + (1.0 - stay) * (share * ahead).sum()
            b *= 3.0 / b.sum()
        states[i] *= b
        states[i] /= states[i].sum()
    return Chain(states, log_likelihood)


def bounded(view: Candidates, contrast: Floats) -> Bools:
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
    visible: Floats,
    ends: Bools,
    light: Light,
    numbers: RegionNumbers,
    share: Floats,
    stay: float,
    power: float,
) -> tuple[float, Floats]:
    """Log-likelihood ratio of "some stretch shows another shape" against "this shape, partly occluded".

    Args:
        target, pyramid, G: an image seen through a pose (3, 3).
        visible: (n,) probability that each sample's edge was seen.
        ends: (n,) of `bounded`.
        light: of the surface.
        numbers: see there.
        share, stay, power: of `stretches`.

    Returns:
        The ratio, -1 where no sample tells, 0 of no samples; and (n,) probability of another shape at each.
    """
    n = len(target.points)
    if n == 0:
        return 0.0, np.zeros(0)
    level, H = level_through(pyramid, G, target.centre, 1.0)
    inner, outer = (
        level.at(
            *carried(H, *np.moveaxis(target.points[:, None] + d[:, None] * target.normals[:, None], 2, 0)), margin=1.0
        )
        for d in (-target.depth, target.depth)
    )
    # the inside less what it was, the outside where it is outside: light and background as they are here and now
    expected = light.gain * target.inside + light.bias
    changed, beyond = inner - expected, np.where(target.outside > 0, outer, np.nan)
    gaps = np.hypot(*(target.points - np.roll(target.points, -1, axis=0)).T)
    length = np.minimum(gaps, target.radius).sum()
    far = whole(numbers.far * 2.0 * target.radius * n / length, 8, n)
    same, differs = np.ones(n), np.full(n, NOTHING_TO_EXPLAIN)
    told = False
    for i in np.flatnonzero(~((visible > 0.5) | ends)):
        back, shift = _levels_near(int(i), visible, beyond, far), _levels_near(int(i), visible, changed, far)
        differs[i] = 1.0
        if back is None or shift is None:
            continue
        spread = max(shift[1], numbers.spread)
        own = light.gain * (target.inner[i] / target.inner.shape[1]).sum() + light.bias + shift[0]
        inside = ~np.isnan(target.inside[i]) & ~np.isnan(inner[i])
        outside = (target.outside[i] > 0) & ~np.isnan(outer[i])
        seen_in, seen_out, lost = inner[i, inside], outer[i, outside], numbers.unlikely
        own_in = _log_cells(seen_in, expected[i, inside] + shift[0], spread, lost)
        back_in = _log_cells(seen_in, back[0], back[1], lost)
        own_out, back_out = _log_cells(seen_out, own, spread, lost), _log_cells(seen_out, back[0], back[1], lost)
        occluded = -np.log(256.0) * (len(seen_in) + len(seen_out))
        notch, tab = back_in + back_out - occluded, own_in + own_out - occluded
        same[i] = np.exp(np.clip(numbers.power * (own_in + back_out - occluded), -MOST_LOG, MOST_LOG))
        differs[i] = np.exp(np.clip(numbers.power * max(notch, tab), -MOST_LOG, MOST_LOG))
        told = True
    if not told:
        return -1.0, np.zeros(n)
    chain = stretches(same, differs, power, share, stay)
    without = np.array([share[0] + share[2], share[1], NEVER])
    here = stretches(same, differs, power, without, stay)
    return float(chain.log_likelihood - here.log_likelihood), chain.states[:, 2]


def _levels_near(i: int, visible: Floats, cells: Floats, far: int) -> tuple[np.float64, np.float64] | None:
    """Median and spread of the cells (n, CELLS) of the nearest visible samples; NaN where a cell does not count.

    None where the outline is not seen on both sides, at most `far` samples away: nothing is told of what lies far from
    all that fits.
    """
    n = len(visible)
    asked: list[int] = []
    for side in (-1, 1):
        around = [(i + side * step) % n for step in range(1, min(far, n // 2) + 1)]
        found = [j for j in around if not visible[j] < SEEN][:NEAR]
        if len(found) < ENOUGH:
            return None
        asked += found
    levels = cells[asked].ravel()
    levels = levels[~np.isnan(levels)]
    if len(levels) < 3 * CELLS:
        return None
    level = middle(levels)
    return level, 1.4826 * middle(np.abs(levels - level)) + LEAST_SPREAD


def _log_cells(values: Floats, level: Floats | np.float64, spread: np.float64, unlikely: np.float64) -> np.float64:
    """Log-likelihood of grey levels (k,) that are `level`, normal with a spread, or anything with a small share."""
    z = (values - level) / spread
    return np.float64(np.log((1.0 - unlikely) * np.exp(-0.5 * z * z) / (spread * 2.5066) + unlikely / 256.0).sum())
