# SPDX-License-Identifier: Apache-2.0
"""Edges along the outline's normals: several candidates a sample, each with how much it looks like the object's own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from grasptrack.kernels import MOST_HALF_WIDTH
from grasptrack.typing import Bools, Floats, Ints
from reference.registration.pyramid import (
    Level,
    Pyramid,
    level_through,
    transform_points,
    upper_median,
)
from reference.registration.target import INNER, INNER_FIRST, Target

MOST = 6
"""Candidates of a sample at most: the strongest."""
DISPLACED = 0.55
"""Of `half`, by noise as strong as the step: standard deviation of an edge's place, as edges drawn at any angle show."""
BEYOND = 16
"""Work px of a profile beyond the reach, for the filter and for what lies inside an edge."""
LEAST = 2.5
"""A step below so many standard deviations of what noise alone gives is none."""
CLUTTER = 0.02
"""Least density of candidates that belong to nothing, for each work px."""
FEW = 30
"""Samples of the surface below which the light is taken to be that of the reference."""
FLAT, SOFT = 5.0, 25.0
"""Grey levels: spread of the surface below which no gain is told; residual at which a sample counts a quarter."""
JUMP = 0.3
"""Odds that the light is another than before."""


class Light(NamedTuple):
    """Grey levels now are ``gain * before + bias``."""

    gain: float
    bias: float


@dataclass
class Candidates:
    """Edges on the normals of the samples.

    Attributes:
        reach: work px within which they were looked for.
        density: candidates for each work px of a normal, on the average.
        half: (n,) px on each side of an edge that were averaged.
        inside: (n,) False where a sample lies outside the image.
        count: (n,) candidates of each.
        offset: (n, MOST) work px along the outward normal; the first `count` of each row count.
        step: (n, MOST) signed, grey levels.
        difference: (n, MOST) mean square of the inner side's grey levels from the object's own.
    """

    reach: int
    density: float
    half: Ints
    inside: Bools
    count: Ints
    offset: Floats
    step: Floats
    difference: Floats

    def there(self) -> Bools:
        """(n, MOST) which entries are candidates."""
        return np.asarray(np.arange(MOST) < self.count[:, None])


def sample_profiles(level: Level, H: Floats, points: Floats, normals: Floats, span: int) -> tuple[Floats, Bools]:
    """Grey levels along p + k n, k = -span..span, and whether the points themselves lie well inside.

    Args:
        level, H: an image and the homography (3, 3) that leads to its px.
        points, normals: (n, 2).
        span: on either side.

    Returns:
        (n, 2 span + 1), NaN outside the image; (n,).
    """
    (px, py), (nx, ny) = points.T, normals.T
    x0, x1 = H[0, 0] * px + H[0, 1] * py + H[0, 2], H[0, 0] * nx + H[0, 1] * ny
    y0, y1 = H[1, 0] * px + H[1, 1] * py + H[1, 2], H[1, 0] * nx + H[1, 1] * ny
    w0, w1 = H[2, 0] * px + H[2, 1] * py + H[2, 2], H[2, 0] * nx + H[2, 1] * ny
    k = np.arange(-span, span + 1)
    s = 1.0 / (w0[:, None] + k * w1[:, None])
    values = level.at((x0[:, None] + k * x1[:, None]) * s, (y0[:, None] + k * y1[:, None]) * s)
    return values, level.holds(x0 / w0, y0 / w0, 3.0)


def find_candidates(values: Floats, span: int, reach: int, noise: float, half: Ints) -> tuple[Ints, Floats, Floats]:
    """Extrema of (mean of `half` px outside - mean of `half` px inside) within the reach.

    A wide filter does not displace a sharp edge, and finds the middle of a blurred one.

    Args:
        values: (n, 2 span + 1) profiles.
        span, reach: px on either side, that are given and that are searched.
        noise: grey levels.
        half: (n,) px, at least 1.

    Returns:
        (n,) counts, (n, MOST) offsets, px, and (n, MOST) steps, grey levels.
    """
    n, length = values.shape
    counts, offsets, steps = np.zeros(n, dtype=np.int64), np.zeros((n, MOST)), np.zeros((n, MOST))
    unknown = np.isnan(values)
    sums = np.zeros((n, length + 1))
    sums[:, 1:] = np.cumsum(np.where(unknown, 0.0, values), axis=1)
    gaps = np.zeros((n, length + 1), dtype=np.int64)
    gaps[:, 1:] = np.cumsum(unknown, axis=1)
    raw, g = np.zeros((n, length)), np.zeros((n, length))
    for h in np.unique(half):
        rows = half == h
        k = np.arange(h, length - h)
        s = sums[rows]
        value = (s[:, k + h + 1] - s[:, k + 1] - s[:, k] + s[:, k - h]) / h
        known = gaps[rows][:, k + h + 1] == gaps[rows][:, k - h]
        raw[rows, h : length - h] = np.where(known, value, 0.0)
    g[:, 1:-1] = 0.5 * raw[:, 1:-1] + 0.25 * (raw[:, :-2] + raw[:, 2:])
    least = LEAST * noise * np.sqrt(2.0 / half)
    k = np.arange(max(2, span - reach), min(length - 3, span + reach) + 1)
    before, here, after = g[:, k - 1], g[:, k], g[:, k + 1]
    a, a_before, a_after = np.abs(here), np.abs(before), np.abs(after)
    peak = (a > least[:, None]) & (a >= a_before) & (a > a_after) & (before * here >= 0) & (after * here >= 0)
    bend = a_before - 2 * a + a_after
    offset = (k - span) + np.where(bend != 0, 0.5 * (a_before - a_after) / bend, 0.0)
    for i in np.flatnonzero(peak.any(axis=1)):
        for q in np.flatnonzero(peak[i]):
            at = counts[i]
            if at < MOST:
                counts[i] += 1
            else:
                at = np.abs(steps[i]).argmin()
                if abs(steps[i, at]) >= a[i, q]:
                    continue
            offsets[i, at], steps[i, at] = offset[i, q], here[i, q]
    return counts, offsets, steps


def edge_width(values: Floats, half: Ints) -> Floats:
    """Standard deviation of the edges in the middle of profiles, by the area between their profiles and a step.

    That of a blurred edge is sqrt(2 / pi) times its standard deviation and its step.

    Args:
        values: (n, 2 span + 1) profiles, the span `half` + 2 at least.
        half: (n,) px, twice the deviation that is expected, so that the step is whole beyond.

    Returns:
        (n,) px; NaN where it cannot be told.
    """
    n, length = values.shape
    at = length // 2
    out = np.full(n, np.nan)
    for h in np.unique(half):
        rows = half == h
        v = values[rows]
        outer = 0.5 * (v[:, at + h + 1] + v[:, at + h + 2])
        inner = 0.5 * (v[:, at - h - 1] + v[:, at - h - 2])
        beyond = (outer[:, None] - v[:, at + 1 : at + h + 1]).sum(axis=1) + (v[:, at - h : at] - inner[:, None]).sum(
            axis=1
        )
        width = np.sqrt(0.5 * np.pi) * (0.5 * (outer - inner) + beyond) / (outer - inner)
        out[rows] = np.where((width > 0) & (width < np.inf), width, np.nan)
    return out


def edge_widths(target: Target, pyramid: Pyramid, G: Floats, places: Floats, half: Ints) -> Floats:
    """(n,) work px, standard deviation of each sample's edge at its place (n, 2), seen through G (3, 3), see `edge_width`."""
    level, H = level_through(pyramid, G, target.centre, 1.0)
    values, _ = sample_profiles(level, H, places, target.normals, MOST_HALF_WIDTH + 2)
    return edge_width(values, half)


def measure_edges(
    target: Target, pyramid: Pyramid, G: Floats, places: Floats, reach: int, half: Ints, light: Light, most_span: int
) -> Candidates:
    """All candidates of all samples of an image seen through the pose G (3, 3).

    Args:
        target: whose outline.
        pyramid: the image.
        G: the pose.
        places: (n, 2) work px, of the samples' edges.
        reach: work px within which edges are looked for.
        half: (n,) px on each side of an edge that are averaged.
        light: of the surface now.
        most_span: work px of a profile at most, on either side.
    """
    span = min(most_span, reach + BEYOND)
    level, H = level_through(pyramid, G, target.centre, 1.0)
    values, inside = sample_profiles(level, H, places, target.normals, span)
    counts, offsets, steps = find_candidates(values, span, reach, target.noise, half)
    counts[~inside] = 0
    # the inner side of each candidate, farther in where the edge is wide
    at = _round_half_away(offsets)[:, :, None] + (INNER_FIRST + np.arange(INNER) + span) - (half - 2)[:, None, None]
    at = np.clip(at, 0, 2 * span)
    seen = np.take_along_axis(values, at.reshape(len(at), -1), axis=1).reshape(at.shape)
    off = seen - (light.gain * target.inner + light.bias)[:, None]
    difference = np.where(np.isnan(off), 0.0, off * off).sum(axis=2) / INNER
    density = max(CLUTTER, float(counts.sum()) / max(1, int(inside.sum())) / (2 * reach + 1))
    return Candidates(reach, density, half, inside, counts, offsets, steps, difference)


def _round_half_away(x: Floats) -> Ints:
    """To the nearest whole number, halves away from 0."""
    down = np.trunc(x)
    return np.asarray((down + np.sign(x) * (np.abs(x - down) >= 0.5)).astype(np.int64))


def surface_light(target: Target, pyramid: Pyramid, G: Floats, before: Light) -> Light:
    """Robust gain and bias of the object's surface, from the reference to an image seen through G (3, 3).

    Where much is covered, the cover is what fits most: the light of before, as far as it still explains some of the surface,
    is believed rather than a jump of the light.
    """
    y = pyramid[0].at(*transform_points(G, target.surface[:, 0], target.surface[:, 1]), margin=1.0)
    held = ~np.isnan(y)
    x, y = target.surface_value[held], y[held]
    if len(x) < FEW:
        return before
    spread = x.std()
    gain = float(np.clip(y.std() / spread, 0.4, 2.5)) if spread > FLAT else 1.0
    fresh = _refine_light(Light(gain, float(upper_median(y - gain * x))), x, y, spread > FLAT)
    same = _refine_light(before, x, y, spread > FLAT)
    explained = [(np.abs(y - light.gain * x - light.bias) < 0.5 * SOFT).sum() for light in (fresh, same)]
    return fresh if JUMP * explained[0] > explained[1] else same


def _refine_light(light: Light, x: Floats, y: Floats, varied: bool) -> Light:
    """The light that explains grey levels y by x, each counting the less the worse it fits."""
    for _ in range(3):
        weight = 1.0 / (1.0 + (y - light.gain * x - light.bias) ** 2 / SOFT**2) ** 2
        total = weight.sum()
        mx, my = (weight * x).sum() / total, (weight * y).sum() / total
        cross, own = (weight * (x - mx) * (y - my)).sum(), 1e-6 + (weight * (x - mx) * (x - mx)).sum()
        gain = float(np.clip(cross / own, 0.3, 3.0)) if varied else light.gain
        light = Light(gain, float(my - gain * mx))
    return light


class EdgeNumbers(NamedTuple):
    """What is believed of edges.

    Attributes:
        miss: probability that an edge that is there is not found.
        same_sign: probability that its contrast keeps its sign.
        floor: work px, error that the model does not explain.
        inner_spread: grey levels, by which the object's own inner side differs from what it was.
        other_spread: the same of anything else.
        sides: probability that a thick part's sides are seen as the object, so that its outline is the lower face's.
    """

    miss: np.float64
    same_sign: np.float64
    floor: np.float64
    inner_spread: np.float64
    other_spread: np.float64
    sides: np.float64


class EdgeLikelihoods(NamedTuple):
    """What the candidates say, for each sample (n,).

    Attributes:
        object, other: likelihood ratios against clutter, of its edge here and of an edge of the object elsewhere.
        upper, lower: probability that the upper, or the lower face's edge was seen, if the object is here.
        upper_offset, lower_offset: work px, where.
    """

    object: Floats
    other: Floats
    upper: Floats
    lower: Floats
    upper_offset: Floats
    lower_offset: Floats


def edge_likelihoods(
    target: Target,
    view: Candidates,
    shift: Floats,
    low: Floats,
    low_variance: Floats,
    P: Floats,
    numbers: EdgeNumbers,
) -> EdgeLikelihoods:
    """What the candidates of all samples say.

    Args:
        target, view: the outline and its candidates.
        shift: (n,) work px, where each sample's edge is expected.
        low, low_variance: (n,) work px, work px^2: how far outside it the lower face's edge lies.
        P: (8, 8) covariance of the pose's error.
        numbers: see there.
    """
    found = 1.0 - numbers.miss
    # noise displaces a wide edge by more, in the reference as here
    shake = DISPLACED * target.noise / np.maximum(np.abs(target.contrast), 1e-9)
    own = shake**2 * (target.half**2 + view.half**2)
    variance = numbers.floor**2 + own + ((target.rows @ P) * target.rows).sum(axis=1)
    two = np.abs(low) + np.sqrt(low_variance) > 0.05
    A, there = _object_edge_likelihood(target, view, numbers), view.there()
    off = view.offset - shift[:, None]
    upper = np.where(
        there, _gaussian_density(off, variance[:, None]) * np.where(two, 1.0 - numbers.sides, 1.0)[:, None] * A, 0.0
    )
    lower = np.where(
        there, numbers.sides * _gaussian_density(off - low[:, None], (variance + low_variance)[:, None]) * A, 0.0
    )
    lower = np.where(two[:, None], lower, 0.0)
    up, down = upper.sum(axis=1), lower.sum(axis=1)
    anywhere = (A / (2 * view.reach + 1)).sum(axis=1)
    object_ = numbers.miss + found * (up + down)
    inside = view.inside
    return EdgeLikelihoods(
        np.where(inside, object_, 1.0),
        np.where(inside, numbers.miss + found * anywhere, 1.0),
        np.where(inside, found * up / object_, 0.0),
        np.where(inside, found * down / object_, 0.0),
        np.where(up > 0, (upper * view.offset).sum(axis=1) / up, 0.0),
        np.where(down > 0, (lower * view.offset).sum(axis=1) / down, 0.0),
    )


def misplaced_edge_log_ratio(target: Target, view: Candidates, numbers: EdgeNumbers, sigma: float) -> Floats:
    """(n,) log-likelihood ratio of something else, whose edge lies anywhere, against the object in a pose that is a little off.

    Of that the edge is there or hidden by light, neither more probable; 0 outside the image.

    Args:
        target, view, numbers: the outline, its candidates, what is believed of them.
        sigma: work px, by which the pose is off.
    """
    own = _object_edge_likelihood(target, view, numbers)
    other = numbers.miss + (1.0 - numbers.miss) * own.sum(axis=1) / (2 * view.reach + 1)
    here = np.where(view.there(), own * _gaussian_density(view.offset, sigma * sigma), 0.0).sum(axis=1)
    return np.where(view.inside, np.log(other / (0.5 + 0.5 * here)), 0.0)


def _object_edge_likelihood(target: Target, view: Candidates, numbers: EdgeNumbers) -> Floats:
    """(n, candidates) likelihood ratio of each being an edge of the object, against clutter; 0 of those that are none."""
    s, sc = numbers.inner_spread, numbers.other_spread
    looks = 1.5 * np.log(sc / s) - 0.75 * view.difference * (1.0 / (s * s) - 1.0 / (sc * sc))
    same = (view.step > 0) == (target.contrast > 0)[:, None]
    sign = np.where(same, numbers.same_sign, 1.0 - numbers.same_sign)
    return np.where(view.there(), 2.0 * np.exp(np.clip(looks, -8.0, 8.0)) * sign / view.density, 0.0)


def _gaussian_density(x: Floats, variance: Floats | float) -> Floats:
    return np.asarray(np.exp(-0.5 * x * x / variance) / np.sqrt(2.0 * np.pi * variance))
