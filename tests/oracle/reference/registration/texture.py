# SPDX-License-Identifier: Apache-2.0
"""Small patches of one look laid on another image, each saying by how much the pose is off, and how surely."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from grasptrack.kernels import PATCH_SIDE
from grasptrack.typing import Bools, Floats
from reference.registration.pyramid import (
    Pyramid,
    homography_derivatives,
    inverse_definite,
    levels_through,
    transform_points,
    upper_median,
)
from reference.registration.target import Patches, Target

PIXELS = PATCH_SIDE * PATCH_SIDE
MEDIAN = 1.386
"""Of chi-squared with two degrees of freedom."""


class TextureNumbers(NamedTuple):
    """What is believed of patches.

    Attributes:
        floor: pixels of a patch's own level, error that the model does not explain.
        independent: patches that carry one independent measurement.
        freedom: degrees of freedom of the t distribution of their errors.
    """

    floor: np.float64
    independent: np.float64
    freedom: np.float64


class Matches(NamedTuple):
    """What patches say of a pose.

    Attributes:
        rows: (m, 2, 8) derivatives of `shift` by the pose's error.
        inside: (m,) whether each is whole in view; else the rest is 0.
        correlation: (m,) with the camera's noise in the denominator.
        shift: (m, 2) work px, by which the pose is off there.
        weight: (m, 3) information xx, xy, yy about that, per work px^2.
    """

    rows: Floats
    inside: Bools
    correlation: Floats
    shift: Floats
    weight: Floats


@dataclass
class TextureFit:
    """What the patches say together.

    Attributes:
        information: (8, 8) of the pose's error d; gradient: (8,) that times d.
        used: patches in view.
        agreeing: share of all patches that agree with the fit.
        spread: median error, in predicted standard deviations.
        weight: (m,) by which each patch's information counts.
    """

    information: Floats
    gradient: Floats
    used: int = 0
    agreeing: float = 0.0
    spread: float = 0.0
    weight: Floats = field(default_factory=lambda: np.zeros(0))


def empty_fit() -> TextureFit:
    """A fit that tells nothing."""
    return TextureFit(np.zeros((8, 8)), np.zeros(8))


def _sample_lattice(pyramid: Pyramid, G: Floats, places: Floats, stride: float, half: int) -> tuple[Bools, Floats]:
    """Grey levels round places (m, 2), `stride` work px apart, on the level on which that is nearest to a pixel.

    Returns:
        (m,) whether the lattice is whole in view, by its corners and the middles between them; and
        (m, 2 half + 1, 2 half + 1), row by row, NaN where it is not.
    """
    x, y = places.T
    which = levels_through(pyramid, G, x, y, stride)
    reduced = 0.5**which
    cx, cy = (c * reduced for c in transform_points(G, x, y))
    ux, vx, uy, vy = (d * reduced * stride for d in homography_derivatives(G, x, y))
    j, i = np.mgrid[-half : half + 1, -half : half + 1]
    u, v = (c[:, None, None] + i * a[:, None, None] + j * b[:, None, None] for c, a, b in ((cx, ux, vx), (cy, uy, vy)))
    inside, values = np.zeros(len(places), dtype=bool), np.full(u.shape, np.nan)
    for k, level in enumerate(pyramid):
        here = which == k
        ends = level.holds(u[here][:, ::half, ::half], v[here][:, ::half, ::half], 1.0)
        inside[here] = ends.all(axis=(1, 2))
        whole = here & inside
        values[whole] = level.between(u[whole], v[whole])
    return inside, values


def cut_patches(target: Target, pyramid: Pyramid, G: Floats, places: Floats, stride: float) -> Patches:
    """Patches of an image seen through G (3, 3) round places (m, 2), `stride` work px a pixel; those whole in view."""
    inside, values = _sample_lattice(pyramid, G, places, stride, PATCH_SIDE // 2 + 1)
    values = values[inside]
    m = len(values)
    raw = values[:, 1:-1, 1:-1].reshape(m, PIXELS)
    gx = ((values[:, 1:-1, 2:] - values[:, 1:-1, :-2]) / (2.0 * stride)).reshape(m, PIXELS)
    gy = ((values[:, 2:, 1:-1] - values[:, :-2, 1:-1]) / (2.0 * stride)).reshape(m, PIXELS)
    value = raw.astype(np.float32) - raw.mean(axis=1, keepdims=True).astype(np.float32)
    v = value.astype(np.float64)
    variance = (v * v).sum(axis=1)
    s = np.where(variance > 0, 1.0 / variance, 0.0)[:, None]
    # Bias and gain are free: only what a shift changes otherwise tells of it. (The tail of a blurred edge, shifted, is
    # the same tail with another gain.)
    gx, gy = (
        single - g.mean(axis=1, keepdims=True) - s * (v * single).sum(axis=1, keepdims=True) * v
        for g, single in ((gx, _round_to_float32(gx)), (gy, _round_to_float32(gy)))
    )
    patches = Patches(
        stride,
        places[inside],
        value,
        gx.astype(np.float32),
        gy.astype(np.float32),
        (gx * gx).sum(axis=1),
        (gx * gy).sum(axis=1),
        (gy * gy).sum(axis=1),
        variance,
        np.zeros((m, 2, 8)),
    )
    return replace(patches, rows=_shift_derivatives(target, patches, np.stack([gx, gy], axis=1), values))


SHARED = 0.5 * 10.0 / 16.0
"""Of what noise alone gives of gradients, twice its mean, that which Scharr's have in common with plain differences."""


def _shift_derivatives(target: Target, patches: Patches, own: Floats, values: Floats) -> Floats:
    """(m, 2, 8) derivatives by the pose's error of the shifts that patches tell.

    A turn of the pose turns a patch as well, which its gradients take for a shift: the arc of a disc, that comes to lie on
    itself, tells nothing of how far it turned.

    Args:
        target: whose pose it is.
        patches: all but these rows.
        own: (m, 2, 49) gradients of which a gain or a bias of the light changes nothing.
        values: (m, 9, 9) grey levels.
    """
    m, half = len(patches), PATCH_SIDE // 2
    j, i = np.mgrid[-half : half + 1, -half : half + 1]
    pixels = patches.places[:, None] + patches.stride * np.column_stack([i.ravel(), j.ravel()])
    J = target.jacobian(pixels.reshape(-1, 2)).reshape(m, PIXELS, 2, 8)
    changes = own @ np.einsum("npk,nkpa->nka", _scharr_gradients(values) / patches.stride, J)
    axes, power = _gradient_axes(patches)
    alone = _noise_gradient_energy(patch_noise(target.noise, patches.stride), patches.stride)
    moved = np.einsum("snp,npa->sna", axes, changes - SHARED * alone * target.jacobian(patches.places))
    shift = (axes * moved[..., :2]).sum(axis=2)  # a shift along the axis
    tells = ((power > alone) & (shift > 0))[..., None]
    rows = np.where(tells, moved / np.where(tells, shift[..., None], 1.0), 0.0)
    return np.asarray(np.einsum("snp,sna->npa", axes, rows))


def _scharr_gradients(values: Floats) -> Floats:
    """(m, 2, 49) gradients a pixel of grey levels (m, 9, 9), by Scharr, for their directions.

    Plain differences turn those of a sharp edge by some degrees.
    """
    x, y = values[:, :, 2:] - values[:, :, :-2], values[:, 2:] - values[:, :-2]
    gx = 10.0 * x[:, 1:-1] + 3.0 * (x[:, :-2] + x[:, 2:])
    gy = 10.0 * y[:, :, 1:-1] + 3.0 * (y[:, :, :-2] + y[:, :, 2:])
    return np.stack([gx, gy], axis=1).reshape(len(values), 2, PIXELS) / 32.0


def _gradient_axes(patches: Patches) -> tuple[Floats, Floats]:
    """(2, m, 2) unit axes of the patches' gradients, along and across the largest; (2, m) sums of their squares on each."""
    mean = 0.5 * (patches.axx + patches.ayy)
    root = np.hypot(0.5 * (patches.axx - patches.ayy), patches.axy)
    angle = 0.5 * np.arctan2(2.0 * patches.axy, patches.axx - patches.ayy)
    cosine, sine = np.cos(angle), np.sin(angle)
    axes = np.stack([np.column_stack([cosine, sine]), np.column_stack([-sine, cosine])])
    return axes, np.stack([mean + root, mean - root])


def _noise_gradient_energy(noise: float, stride: float) -> float:
    """Of the sum of squares of gradients `stride` apart along an axis, what noise alone gives twice."""
    return PIXELS * noise * noise / stride**2


def _round_to_float32(values: Floats) -> Floats:
    return values.astype(np.float32).astype(np.float64)


def patch_noise(camera: float, stride: float) -> float:
    """Grey levels, of the camera's noise in pixels `stride` apart: at least that of 8 bits.

    Halving an image leaves little more than a quarter of it, halving it again the half of that.
    """
    return max(camera / (2.0 * stride), math.sqrt(1.0 / 12.0)) if stride > 1.0 else camera


def match_patches(
    pyramid: Pyramid, G: Floats, patches: Patches, places: Floats, camera: float, floor: float
) -> Matches:
    """What patches say of the pose G (3, 3) of an image.

    Args:
        pyramid, G, patches: the image, the pose, and what is laid on it.
        places: (m, 2) work px, where the patches' middles are expected.
        camera: grey levels, of its noise.
        floor: work px, error that the model does not explain.
    """
    m, stride = len(patches), patches.stride
    inside, values = _sample_lattice(pyramid, G, places, stride, PATCH_SIDE // 2)
    value = values.reshape(m, PIXELS)
    value = value - value.mean(axis=1, keepdims=True)
    noise = patch_noise(camera, patches.stride)
    grain = PIXELS * noise * noise
    own, cross = (value * value).sum(axis=1), (value * patches.value).sum(axis=1)
    ex, ey = (value * patches.gx).sum(axis=1), (value * patches.gy).sum(axis=1)
    correlation = cross / np.sqrt((own + grain) * (patches.variance + grain))
    gain = np.sqrt(np.maximum(own - grain, 0.0) / np.maximum(patches.variance, 1e-9))
    gain = np.clip(gain, 0.2, 5.0)
    # along each of the two axes of the patch's gradients; what noise alone gives of them tells nothing
    axes, power = _gradient_axes(patches)
    cosine, sine = axes[0].T
    signal = power - _noise_gradient_energy(noise, stride)
    tells = signal > 0
    e = axes[..., 0] * ex + axes[..., 1] * ey
    # noise in the gradients shortens a shift measured with them
    some = np.where(tells, signal, 1.0)
    offset = np.where(tells, np.clip(-e / (some * gain), -2.5 * stride, 2.5 * stride), 0.0)
    rest = own - 2.0 * gain * cross + gain * gain * patches.variance - np.where(tells, e * e / power, 0.0).sum(axis=0)
    s2 = np.maximum(rest, 0.0) / (PIXELS - 4) + noise * noise
    information = np.where(tells, gain * gain * signal * signal / power, 0.0)
    information = np.where(information > 0, 1.0 / (s2 / information + floor * floor), 0.0)
    shift = np.column_stack([cosine * offset[0] - sine * offset[1], sine * offset[0] + cosine * offset[1]])
    weight = np.column_stack(
        [
            cosine**2 * information[0] + sine**2 * information[1],
            cosine * sine * (information[0] - information[1]),
            sine**2 * information[0] + cosine**2 * information[1],
        ]
    )
    out = inside[:, None]
    return Matches(
        patches.rows,
        inside,
        np.where(inside, correlation, 0.0),
        np.where(out, shift, 0.0),
        np.where(out, weight, 0.0),
    )


def join_matches(parts: list[Matches]) -> Matches:
    """Those of several levels."""
    if not parts:
        return Matches(np.zeros((0, 2, 8)), np.zeros(0, dtype=bool), np.zeros(0), np.zeros((0, 2)), np.zeros((0, 3)))
    return Matches(*(np.concatenate(column) for column in zip(*parts, strict=True)))


LEAST, CHANCE = 4, 0.12
"""Patches that texture must rest on, and the share of all that may agree by chance."""


def is_informative(fit: TextureFit, count: int) -> bool:
    """Whether so many patches tell more than noise alone, which agrees here and there."""
    return fit.used >= LEAST and fit.agreeing * count >= LEAST + CHANCE * count


def fit_patches(matches: Matches, prior: Floats, gradient: Floats, numbers: TextureNumbers) -> TextureFit:
    """Robust normal equations of patches about their own best fit together with a prior.

    Args:
        matches: of patches.
        prior, gradient: (8, 8) information about the pose's error, and (8,) that times what it is thought to be.
        numbers: see there.
    """
    fit = empty_fit()
    inside = matches.inside
    fit.used = int(inside.sum())
    if fit.used < 4:
        return fit
    J = matches.rows[inside]
    shift = matches.shift[inside]
    xx, xy, yy = matches.weight[inside].T
    W = np.stack([np.column_stack([xx, xy]), np.column_stack([xy, yy])], axis=1)
    weight, scale = np.ones(fit.used), 1.0
    for round_ in range(4):
        w = weight / (scale * numbers.independent)
        w = np.where(w > 0, w, 0.0)
        K = np.einsum("n,npa,npq->naq", w, J, W)
        fit.information = np.einsum("naq,nqc->ac", K, J)
        fit.gradient = np.einsum("naq,nq->a", K, shift)
        if round_ == 3:
            fit.weight = np.zeros(len(inside))
            fit.weight[inside] = w
            break
        P = inverse_definite(fit.information + prior)
        if P is None:
            return empty_fit()
        off = shift - J @ (P @ (fit.gradient + gradient))
        distance = xx * off[:, 0] ** 2 + 2.0 * xy * off[:, 0] * off[:, 1] + yy * off[:, 1] ** 2
        scale = max(1.0, float(upper_median(distance)) / MEDIAN)
        weight = (numbers.freedom + 2.0) / (numbers.freedom + distance / scale)
        agree = (distance / scale < 9.0) & (matches.correlation[inside] > 0.5)
        fit.agreeing = float(agree.sum()) / len(inside)
        fit.spread = float(np.sqrt(scale))
    return fit


class FlowFit(NamedTuple):
    """A look laid on another image.

    Attributes:
        valid: whether a pose was found.
        G, covariance: (3, 3) it, and (8, 8) of its error; 0 where there is none.
        agreeing: share of the patches that agree.
        correlation: mean of all.
        used: patches in view.
    """

    valid: bool
    G: Floats
    covariance: Floats
    agreeing: float
    correlation: float
    used: int


def follow_look(
    target: Target,
    looks: list[Patches],
    pyramid: Pyramid,
    start: Floats,
    prior_covariance: Floats,
    numbers: TextureNumbers,
) -> FlowFit:
    """Patches of one look laid on another image, coarse to fine, from a given start.

    Args:
        target: whose pose is asked for.
        looks: fine to coarse.
        pyramid: of the image.
        start, prior_covariance: (3, 3) and (8, 8), a pose and how far off it may be.
        numbers: see there.
    """
    none = np.zeros((3, 3))
    covariance, agreeing, correlation, used = np.zeros((8, 8)), 0.0, 0.0, 0
    prior = inverse_definite(prior_covariance)
    if prior is None:
        return FlowFit(False, none, covariance, agreeing, correlation, used)
    G = start
    for level, patches in reversed(list(enumerate(looks))):
        if len(patches) < 6:
            continue
        for _ in range(5 if level + 1 == len(looks) else 3):
            d = target.difference(start, G)
            if d is None:
                return FlowFit(False, none, covariance, agreeing, correlation, used)
            b = -prior @ d
            matches = match_patches(pyramid, G, patches, patches.places, target.noise, numbers.floor * patches.stride)
            fit = fit_patches(matches, prior, b, numbers)
            P = inverse_definite(prior + fit.information) if fit.used >= 6 else None
            if P is None:
                return FlowFit(False, none, covariance, agreeing, correlation, used)
            step = P @ (b + fit.gradient)
            G = target.moved(G, step)
            if not np.isfinite(G).all():
                return FlowFit(False, none, covariance, agreeing, correlation, used)
            covariance, used, agreeing = P, fit.used, fit.agreeing
            correlation = float(matches.correlation.sum()) / len(patches)
            if np.abs(step).max() < 0.05 * patches.stride:
                break
    return FlowFit(used > 0, G, covariance, agreeing, correlation, used)
