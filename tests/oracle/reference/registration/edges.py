# SPDX-License-Identifier: Apache-2.0
"""Edges along the outline's normals: several candidates a sample, each with how much it looks like the object's own."""

from typing import NamedTuple

import numpy as np

from grasptrack.typing import Bools, Floats, Ints
from reference.registration.pyramid import Level, Pyramid, level_through, transform_points, upper_median
from reference.registration.target import INNER, INNER_FIRST, Target

MOST = 6
"""Candidates of a sample at most: the strongest."""
DISPLACED = 0.55
"""Of `half`, by noise as strong as the step: standard deviation of an edge's place, as edges drawn at any angle show."""
BEYOND = 16
"""Work px of a profile beyond the reach, for the filter and for what lies inside an edge."""
LEAST_STEP = 2.5
"""A step below so many standard deviations of what noise alone gives is none."""
LEAST_CLUTTER = 0.02
"""Least density of candidates that belong to nothing, for each work px."""
FEW_SAMPLES = 30
"""Samples of the surface below which the light is taken to be that of the reference."""
FLAT, SOFT = 5.0, 25.0
"""Grey levels: spread of the surface below which no gain is told; residual at which a sample counts a quarter."""
JUMP = 0.3
"""Odds that the light is another than before."""


class Light(NamedTuple):
    """Grey levels now are ``gain * before + bias``."""

    gain: float
    bias: float


class Candidates(NamedTuple):
    """Edges on the normals of the samples."""

    reach: int  # work px within which they were looked for
    density: float  # candidates for each work px of a normal, on the average
    half: Ints  # (n,) px on each side of an edge that were averaged
    inside: Bools  # (n,) False where a sample lies outside the image
    offset: Floats  # (n, MOST) work px along the outward normal; NaN of none
    step: Floats  # (n, MOST) signed, grey levels
    difference: Floats  # (n, MOST) mean square of the inner side's grey levels from the object's own


def sample_profiles(level: Level, H: Floats, points: Floats, normals: Floats, span: int) -> tuple[Floats, Bools]:
    """Grey levels along p + k n, k = -span..span, and whether the points themselves lie well inside.

    Args:
        level, H: an image and the homography (3, 3) that leads to its px.
        points, normals: (n, 2).
        span: on either side.

    Returns:
        (n, 2 span + 1), NaN outside the image; (n,).
    """
    at = points[:, None] + np.arange(-span, span + 1)[:, None] * normals[:, None]
    return level.at(*transform_points(H, *at.transpose(2, 0, 1))), level.holds(*transform_points(H, *points.T), 3.0)


def find_candidates(values: Floats, reach: int, noise: float, half: int) -> list[tuple[float, float]]:
    """Extrema of (mean of `half` px outside - mean of `half` px inside) within the reach of a profile's middle.

    A wide filter does not displace a sharp edge, and finds the middle of a blurred one.

    Args:
        values: (2 span + 1,) profile.
        reach: px on either side.
        noise: grey levels.
        half: px, at least 1.

    Returns:
        Offset, px, and step, grey levels, of the MOST strongest, in the order in which they were found.
    """
    length, span = len(values), len(values) // 2
    raw, known = np.zeros(length), np.where(np.isnan(values), 0.0, values)
    sums = np.append(0.0, np.cumsum(known))
    for k in range(half, length - half):
        if not np.isnan(values[k - half : k + half + 1]).any():
            raw[k] = (sums[k + half + 1] - sums[k + 1] - sums[k] + sums[k - half]) / half
    g = np.zeros(length)
    g[1:-1] = 0.5 * raw[1:-1] + 0.25 * (raw[:-2] + raw[2:])
    found: list[tuple[float, float]] = []
    for k in range(max(2, span - reach), min(length - 3, span + reach) + 1):
        before, a, after = np.abs(g[k - 1 : k + 2])
        peak = a >= before and a > after and g[k - 1] * g[k] >= 0 and g[k + 1] * g[k] >= 0
        if not (peak and a > LEAST_STEP * noise * np.sqrt(2.0 / half)):
            continue
        bend = before - 2.0 * a + after
        one = k - span + (0.5 * (before - after) / bend if bend else 0.0), g[k]
        if len(found) < MOST:
            found.append(one)
        else:
            weakest = min(range(MOST), key=lambda i: abs(found[i][1]))
            if abs(found[weakest][1]) < a:
                found[weakest] = one
    return found


def edge_width(values: Floats, half: int) -> float:
    """Standard deviation of the edge in the middle of a profile, by the area between it and a step; NaN where that fails.

    That of a blurred edge is sqrt(2 / pi) times its standard deviation and its step.

    Args:
        values: (2 span + 1,) profile, the span `half` + 2 at least.
        half: px, twice the deviation that is expected, so that the step is whole beyond.
    """
    outward, inward = values[len(values) // 2 :], values[len(values) // 2 :: -1]
    outer, inner = outward[half + 1 : half + 3].mean(), inward[half + 1 : half + 3].mean()
    beyond = (outer - outward[1 : half + 1]).sum() + (inward[1 : half + 1] - inner).sum()
    width = np.sqrt(0.5 * np.pi) * (0.5 * (outer - inner) + beyond) / (outer - inner)
    return float(width) if 0.0 < width < np.inf else float("nan")


def measure_edges(
    target: Target, pyramid: Pyramid, G: Floats, places: Floats, reach: int, half: Ints, light: Light, most_span: int
) -> Candidates:
    """All candidates of all samples of an image seen through the pose G (3, 3).

    Args:
        target, pyramid, G: whose outline, in which image, seen through which pose.
        places: (n, 2) work px, of the samples' edges.
        reach: work px within which edges are looked for.
        half: (n,) px on each side of an edge that are averaged.
        light: of the surface now.
        most_span: work px of a profile at most, on either side.
    """
    span, n = min(most_span, reach + BEYOND), len(places)
    level, H = level_through(pyramid, G, target.centre, 1.0)
    values, inside = sample_profiles(level, H, places, target.normals, span)
    offset, step, difference = (np.full((n, MOST), np.nan) for _ in range(3))
    for i in np.flatnonzero(inside):
        for q, (at, g) in enumerate(find_candidates(values[i], reach, target.noise, half[i])):
            offset[i, q], step[i, q] = at, g
            # the inner side, farther in where the edge is wide
            first = int(np.trunc(at + np.copysign(0.5, at))) + INNER_FIRST + span - (half[i] - 2)
            seen = values[i, np.clip(np.arange(first, first + INNER), 0, 2 * span)]
            difference[i, q] = np.nansum((seen - (light.gain * target.inner[i] + light.bias)) ** 2) / INNER
    density = max(LEAST_CLUTTER, np.isfinite(offset).sum() / max(1, int(inside.sum())) / (2 * reach + 1))
    return Candidates(reach, density, half, inside, offset, step, difference)


def surface_light(target: Target, pyramid: Pyramid, G: Floats, before: Light) -> Light:
    """Robust gain and bias of the object's surface, from the reference to an image seen through G (3, 3).

    Where much is covered, the cover is what fits most: the light of before, as far as it still explains some of the surface,
    is believed rather than a jump of the light.
    """
    y = pyramid[0].at(*transform_points(G, *target.surface.T), margin=1.0)
    held = ~np.isnan(y)
    x, y = target.surface_value[held], y[held]
    if len(x) < FEW_SAMPLES:
        return before
    varied = x.std() > FLAT
    gain = float(np.clip(y.std() / x.std(), 0.4, 2.5)) if varied else 1.0
    fresh = _refine_light(Light(gain, float(upper_median(y - gain * x))), x, y, varied)
    same = _refine_light(before, x, y, varied)
    explained = [(np.abs(y - light.gain * x - light.bias) < 0.5 * SOFT).sum() for light in (fresh, same)]
    return fresh if JUMP * explained[0] > explained[1] else same


def is_other_light(target: Target, light: Light, before: Light) -> bool:
    """Whether a light makes other grey levels of the surface than that of before. What covers all of it looks like that."""
    change = (light.gain - before.gain) * target.surface_value + light.bias - before.bias
    return bool(abs(change.sum()) > 0.5 * SOFT * len(change))


def _refine_light(light: Light, x: Floats, y: Floats, varied: bool) -> Light:
    """The light that explains grey levels y by x, each counting the less the worse it fits."""
    for _ in range(3):
        weight = 1.0 / (1.0 + (y - light.gain * x - light.bias) ** 2 / SOFT**2) ** 2
        mx, my = np.average(x, weights=weight), np.average(y, weights=weight)
        cross, own = (weight * (x - mx) * (y - my)).sum(), 1e-6 + (weight * (x - mx) ** 2).sum()
        gain = float(np.clip(cross / own, 0.3, 3.0)) if varied else light.gain
        light = Light(gain, float(my - gain * mx))
    return light


class EdgeNumbers(NamedTuple):
    """What is believed of edges."""

    miss: float  # probability that an edge that is there is not found
    same_sign: float  # probability that its contrast keeps its sign
    floor: float  # work px, error that the model does not explain
    inner_spread: float  # grey levels, by which the object's own inner side differs from what it was
    other_spread: float  # the same of anything else
    sides: (
        float  # probability that a thick part's sides are seen as the object, so that its outline is the lower face's
    )


class EdgeLikelihoods(NamedTuple):
    """What the candidates say, for each sample (n,)."""

    object: Floats  # object, other: likelihood ratios against clutter, of its edge here and of an edge of the object elsewhere
    other: Floats
    upper: Floats  # upper, lower: probability that the upper, or the lower face's edge was seen, if the object is here
    lower: Floats
    upper_offset: Floats  # upper_offset, lower_offset: work px, where
    lower_offset: Floats
    share: Floats  # (n, MOST, 2) of each candidate in them


def edge_likelihoods(
    target: Target, view: Candidates, shift: Floats, low: Floats, low_variance: Floats, P: Floats, numbers: EdgeNumbers
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
    variance = numbers.floor**2 + shake**2 * (target.half**2 + view.half**2)
    variance = variance + ((target.rows @ P) * target.rows).sum(axis=1)
    two = np.abs(low) + np.sqrt(low_variance) > 0.05
    own = _own_edge_ratio(target, view, numbers)
    sides = np.where(two, numbers.sides, 0.0)[:, None]
    off = view.offset - shift[:, None]
    seen = np.nan_to_num(
        np.stack(
            [
                (1.0 - sides) * own * _gaussian_density(off, variance[:, None]),
                sides * own * _gaussian_density(off - low[:, None], (variance + low_variance)[:, None]),
            ],
            axis=2,
        )
    )
    faces = seen.sum(axis=1)
    share = np.divide(seen, faces[:, None], out=np.zeros_like(seen), where=faces[:, None] > 0)
    upper_offset, lower_offset = (share * np.nan_to_num(view.offset)[:, :, None]).sum(axis=1).T
    object_ = np.where(view.inside, numbers.miss + found * faces.sum(axis=1), 1.0)
    other = np.where(view.inside, numbers.miss + found * np.nansum(own, axis=1) / (2 * view.reach + 1), 1.0)
    upper, lower = found * faces.T / object_
    return EdgeLikelihoods(object_, other, upper, lower, upper_offset, lower_offset, share)


def misplaced_edge_log_ratio(target: Target, view: Candidates, numbers: EdgeNumbers, sigma: float) -> Floats:
    """(n,) log-likelihood ratio of something else, whose edge lies anywhere, against the object in a pose that is a little off.

    Of that the edge is there or hidden by light, neither more probable; 0 outside the image.

    Args:
        target, view, numbers: the outline, its candidates, what is believed of them.
        sigma: work px, by which the pose is off.
    """
    own = _own_edge_ratio(target, view, numbers)
    other = numbers.miss + (1.0 - numbers.miss) * np.nansum(own, axis=1) / (2 * view.reach + 1)
    here = np.nansum(own * _gaussian_density(view.offset, sigma * sigma), axis=1)
    return np.where(view.inside, np.log(other / (0.5 + 0.5 * here)), 0.0)


def _own_edge_ratio(target: Target, view: Candidates, numbers: EdgeNumbers) -> Floats:
    """(n, MOST) likelihood ratio of each candidate being an edge of the object, against clutter; NaN of none."""
    s, sc = numbers.inner_spread, numbers.other_spread
    looks = 1.5 * np.log(sc / s) - 0.75 * view.difference * (1.0 / (s * s) - 1.0 / (sc * sc))
    same = (view.step > 0) == (target.contrast > 0)[:, None]
    sign = np.where(same, numbers.same_sign, 1.0 - numbers.same_sign)
    return np.asarray(2.0 * np.exp(np.clip(looks, -8.0, 8.0)) * sign / view.density)


def _gaussian_density(x: Floats, variance: Floats | float) -> Floats:
    return np.asarray(np.exp(-0.5 * x * x / variance) / np.sqrt(2.0 * np.pi * variance))


def explain_outline(object_: Floats, other: Floats, power: float, share: Floats, stay: float) -> tuple[Floats, float]:
    """Explanations of the outline's samples come in stretches: a Markov chain along it, forward and backward.

    Args:
        object_, other: (n,) likelihood ratios of the object's edge and of another shape against an occluder.
        power: how much of an independent measurement a sample is.
        share: (3,) prior shares of the states: the object's edge, an occluder, another shape.
        stay: probability that a sample's state is simply the one before's; else it is drawn from the shares.

    Returns:
        (n, 3) probabilities of the states, and the log-likelihood of all samples.
    """
    n = len(object_)
    likelihood = np.column_stack([object_**power, np.ones(n), other**power])
    step = stay * np.eye(3) + (1.0 - stay) * share
    forward, backward, log_likelihood, before = np.zeros((n, 3)), np.ones((n, 3)), 0.0, share
    for i in range(n):
        a = (before @ step if i else share) * likelihood[i]
        log_likelihood += float(np.log(a.sum()))
        forward[i] = before = a / a.sum()
    for i in reversed(range(n - 1)):
        b = step @ (likelihood[i + 1] * backward[i + 1])
        backward[i] = b / b.sum()
    states = forward * backward
    return states / states.sum(axis=1, keepdims=True), log_likelihood
