# SPDX-License-Identifier: Apache-2.0
"""Small patches of one look laid on another image, each saying by how much the pose is off, and how surely."""

import math
from typing import NamedTuple

import numpy as np

from grasptrack.kernels import PATCH_SIDE
from grasptrack.typing import Bools, Floats
from reference.registration.pyramid import (
    Pyramid,
    homography_derivatives,
    levels_through,
    transform_points,
    upper_median,
)
from reference.registration.target import Patches, Target

PIXELS = PATCH_SIDE * PATCH_SIDE
MEDIAN = 1.386
"""Of chi-squared with two degrees of freedom."""
LEAST_PATCHES, CHANCE = 4, 0.12
"""Patches that texture must rest on, and the share of all that may agree by chance."""
SCHARR_NOISE = (2.0 * 10.0**2 + 4.0 * 3.0**2) / 32.0**2
"""Variance of Scharr's gradients of noise of variance 1."""
AGREEING = 0.5
"""Correlation from which on a patch shows the same."""


class Matches(NamedTuple):
    """What patches say of a pose."""

    rows: Floats  # (m, 2, 8) derivatives of `shift` by the pose's error
    inside: Bools  # (m,) whether each is whole in view; else the rest is 0
    correlation: Floats  # (m,) with the camera's noise in the denominator
    shift: Floats  # (m, 2) work px, by which the pose is off there
    weight: Floats  # (m, 3) information xx, xy, yy about that, per work px^2


def patch_noise(camera: float, stride: float) -> float:
    return max(camera / (2.0 * stride), math.sqrt(1.0 / 12.0)) if stride > 1.0 else camera


def cut_patches(target: Target, pyramid: Pyramid, G: Floats, places: Floats, stride: float) -> Patches:
    """Patches of an image seen through G (3, 3) round places (m, 2), `stride` work px a pixel; those whole in view."""
    inside, values = _sample_lattice(pyramid, G, places, stride, PATCH_SIDE // 2 + 1)
    values, m = values[inside], int(inside.sum())
    value = values[:, 1:-1, 1:-1].reshape(m, PIXELS)
    value = value - value.mean(axis=1, keepdims=True)
    gradients = _scharr_gradients(values, stride)
    # Bias and gain are free: only what a shift changes otherwise tells of it. (The tail of a blurred edge, shifted, is
    # the same tail with another gain.)
    free = np.stack([np.ones_like(value), value], axis=1)
    free = free / np.maximum(np.linalg.norm(free, axis=2, keepdims=True), 1e-300)
    gradients = gradients - gradients @ free.transpose(0, 2, 1) @ free
    products = np.einsum("mip,mjp->mij", gradients, gradients)
    power, axes = np.linalg.eigh(products)
    patches = Patches(stride, places[inside], value, gradients, axes.transpose(2, 0, 1), power.T, np.zeros((m, 2, 8)))
    patches.rows[:] = _shift_derivatives(target, patches, values)
    return patches


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
        inside[here] = level.holds(u[here][:, ::half, ::half], v[here][:, ::half, ::half], 1.0).all(axis=(1, 2))
        whole = here & inside
        values[whole] = level.at(u[whole], v[whole])
    return inside, values


def _shift_derivatives(target: Target, patches: Patches, values: Floats) -> Floats:
    """(m, 2, 8) derivatives by the pose's error of the shifts that patches tell.

    A turn of the pose turns a patch as well, which its gradients take for a shift: the arc of a disc, that comes to lie on
    itself, tells nothing of how far it turned.

    Args:
        target, patches: whose pose it is, and all but these rows of them.
        values: (m, 9, 9) grey levels.
    """
    m, half = len(patches.places), PATCH_SIDE // 2
    j, i = np.mgrid[-half : half + 1, -half : half + 1]
    pixels = patches.places[:, None] + patches.stride * np.column_stack([i.ravel(), j.ravel()])
    J = target.jacobian(pixels.reshape(-1, 2)).reshape(m, PIXELS, 2, 8)
    scharr = _scharr_gradients(values, patches.stride)
    changes = patches.gradients @ np.einsum("npk,nkpa->nka", scharr, J)
    alone = _noise_gradient_energy(patch_noise(target.noise, patches.stride), patches.stride)
    moved = np.einsum("snp,npa->sna", patches.axes, changes - 0.5 * alone * target.jacobian(patches.places))
    shift = (patches.axes * moved[..., :2]).sum(axis=2)  # a shift along the axis
    tells = ((patches.power > alone) & (shift > 0))[..., None]
    rows = np.where(tells, moved / np.where(tells, shift[..., None], 1.0), 0.0)
    return np.asarray(np.einsum("snp,sna->npa", patches.axes, rows))


def _scharr_gradients(values: Floats, stride: float) -> Floats:
    """(m, 2, n n) of (m, n + 2, n + 2) grey levels: plain differences turn those of a sharp edge by some degrees."""
    x, y = values[:, :, 2:] - values[:, :, :-2], values[:, 2:] - values[:, :-2]
    gx = 10.0 * x[:, 1:-1] + 3.0 * (x[:, :-2] + x[:, 2:])
    gy = 10.0 * y[:, :, 1:-1] + 3.0 * (y[:, :, :-2] + y[:, :, 2:])
    return np.asarray(np.stack([gx, gy], axis=1).reshape(len(values), 2, -1) / (32.0 * stride))


def _noise_gradient_energy(noise: float, stride: float) -> float:
    """Of the sum of squares of Scharr's gradients `stride` apart along an axis, what noise alone gives twice."""
    return 2.0 * SCHARR_NOISE * PIXELS * noise * noise / stride**2


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
    m, stride = len(places), patches.stride
    inside, values = _sample_lattice(pyramid, G, places, stride, PATCH_SIDE // 2)
    value = values.reshape(m, PIXELS)
    value = value - value.mean(axis=1, keepdims=True)
    noise = patch_noise(camera, stride)
    grain = PIXELS * noise * noise
    own, cross = (value * value).sum(axis=1), (value * patches.value).sum(axis=1)
    variance = (patches.value**2).sum(axis=1)
    gain = np.sqrt(np.maximum(own - grain, 0.0) / np.maximum(variance, 1e-9))
    gain = np.clip(gain, 0.2, 5.0)
    # along each of the two axes of the patch's gradients; what noise alone gives of them tells nothing
    signal = patches.power - _noise_gradient_energy(noise, stride)
    tells = signal > 0
    e = np.einsum("snk,nkp,np->sn", patches.axes, patches.gradients, value)
    # noise in the gradients shortens a shift measured with them
    some = np.where(tells, signal, 1.0)
    offset = np.where(tells, np.clip(-e / (some * gain), -2.5 * stride, 2.5 * stride), 0.0)
    explained = np.where(tells, e * e / np.where(tells, patches.power, 1.0), 0.0).sum(axis=0)
    rest = own - 2.0 * gain * cross + gain * gain * variance - explained
    s2 = np.maximum(rest, 0.0) / (PIXELS - 4) + noise * noise
    told = gain * gain * some * some / np.where(tells, patches.power, 1.0)
    # what has no such gradients any more does not tell
    noisy = SCHARR_NOISE * (PATCH_SIDE - 2) ** 2 * noise * noise / stride**2
    here, there = (_power_within(v, patches) - noisy for v in (patches.value, values))
    before = gain * gain * here
    fewer = (before > 0.0) & (there < before)
    told *= np.where(fewer, np.maximum(there, 0.0) / np.where(fewer, before, 1.0), 1.0)
    information = np.where(tells & (told > 0.0), 1.0 / (s2 / np.where(told > 0.0, told, 1.0) + floor * floor), 0.0)
    shift = np.einsum("snk,sn->nk", patches.axes, offset)
    weight = np.einsum("snk,sn,snl->nkl", patches.axes, information, patches.axes)[:, (0, 0, 1), (0, 1, 1)]
    out = inside[:, None]
    return Matches(
        patches.rows,
        inside,
        np.where(inside, cross / np.sqrt((own + grain) * (variance + grain)), 0.0),
        np.where(out, shift, 0.0),
        np.where(out, weight, 0.0),
    )


def _power_within(values: Floats, patches: Patches) -> Floats:
    """(2, m) sums of squares of the gradients of patches' (m, ...) inner pixels along each of their axes."""
    gradients = _scharr_gradients(values.reshape(-1, PATCH_SIDE, PATCH_SIDE), patches.stride)
    return np.asarray((np.einsum("snk,nkp->snp", patches.axes, gradients) ** 2).sum(axis=2))


def join_matches(parts: list[Matches]) -> Matches:
    """Those of several levels."""
    if not parts:
        return Matches(np.zeros((0, 2, 8)), np.zeros(0, dtype=bool), np.zeros(0), np.zeros((0, 2)), np.zeros((0, 3)))
    return Matches(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def texture_weights(matches: Matches, prior: Floats, gradient: Floats, numbers: dict[str, float]) -> Floats:
    """(m,) by which the information of patches counts: robust, about their own best fit together with a prior.

    0 where so few agree that noise alone may.

    Args:
        matches: of patches.
        prior, gradient: (8, 8) information about the pose's error, and (8,) that times what it is thought to be.
        numbers: by name; the error of a patch has a t distribution, and several carry one independent measurement.
    """
    weight, inside, J = matches.inside.astype(np.float64), matches.inside, matches.rows
    W = matches.weight[:, (0, 1, 1, 2)].reshape(-1, 2, 2)
    scale, agreeing = 1.0, 0
    for _ in range(3 if inside.sum() >= LEAST_PATCHES else 0):
        K = np.einsum("n,npa,npq->naq", weight / (scale * numbers["texture_independent"]), J, W)
        A, b = np.einsum("naq,nqc->ac", K, J) + prior, np.einsum("naq,nq->a", K, matches.shift) + gradient
        off = matches.shift - J @ np.linalg.solve(A, b)
        distance = np.einsum("np,npq,nq->n", off, W, off)
        scale = max(1.0, float(upper_median(distance[inside])) / MEDIAN)
        freedom = numbers["texture_freedom"]
        weight = np.where(inside, (freedom + 2.0) / (freedom + distance / scale), 0.0)
        agreeing = int((inside & (distance / scale < 9.0) & (matches.correlation > AGREEING)).sum())
    enough = agreeing >= LEAST_PATCHES + CHANCE * len(inside)
    return weight / (scale * numbers["texture_independent"]) if enough else np.zeros(len(inside))
