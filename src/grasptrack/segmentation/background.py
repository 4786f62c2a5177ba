# SPDX-License-Identifier: Apache-2.0
"""What an image has that a picture of the empty bench has not: the difference of both, whatever the light.

The picture of the bench is registered to the image and given the image's light, a smooth gain and an offset for each colour,
fitted to what both share. How large a difference is shows beside the noise of the rest, which is larger at edges of the
bench than between them; no level of grey is set beforehand.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from grasptrack.images import PLAIN, Grey
from grasptrack.segmentation.registration import register_affine, warp_affine
from grasptrack.segmentation.silhouettes import to_binary
from grasptrack.statistics import MAD_TO_SD, robust_sd
from grasptrack.typing import Bools, Floats32, Pixels

FIT_SIDE = 160
"""px; light changes so smoothly that it is fitted to images of this longer side."""
FIT_ROUNDS = 12
"""Of the robust fits, each with the weights of the one before."""
BIWEIGHT = 4.685
"""Standard deviations from which a pixel has no weight in the fit of the light (Tukey's constant)."""
SLOPE_BINS = 8
"""Classes of pixels, by the slope of the bench there, in each of which the noise is measured."""
QUANTIZED = math.sqrt(1.0 / 12.0)
"""Grey levels, standard deviation of a pixel whose noise is its rounding alone."""
BRIGHTEST = 255.0
GAIN_RIDGE, MEAN_GAIN_RIDGE, OFFSET_RIDGE = 1e-6, 1e-9, 1e-2
"""For each pixel, what keeps the fit of the light determined: of the gain's changes over the image, of the gain, and of the
offset."""
MIN_PIXELS = 16
"""Pixels from which a noise is known."""
FIRST_SHARE, MIN_CHANGED, MAX_CHANGED = 0.1, 1e-4, 0.9
"""Share of the image that differs: where the fit begins, and its bounds."""
MAX_LOG_ODDS = 50.0
TINY = 1e-3
DEGREES = 5.0
"""Degrees of freedom of the t distribution of what differs by noise: reflections and dust make more than a Gaussian."""
MIN_LIGHT = 0.25
"""A shadow leaves at least this share of the light."""
SOFTENING = 1.5
"""px, Gaussian blur of differences, which shows faint ones: objects are larger than a pixel, noise is not; and of what differs
pixel by pixel, which shows where it ends."""


def background_maps(image: Pixels, background: Pixels, hidden: Grey | None = None) -> list[Floats32]:
    """How likely each pixel is something that the empty bench has not.

    Args:
        image: (H, W) or BGR (H, W, 3).
        background: the same scene without the object, of the same height and width; its light may differ, and the camera
            may have moved by a few px.
        hidden: (H, W) nonzero where pixels are ignored.

    Returns:
        (H, W) 0 to 1: of all that differs; and in colours of what differs by more than a shadow would.
    """
    seen, empty = _same_planes(image, background)
    bench, usable = _relight_background(seen, empty, hidden)
    difference = seen - bench
    noise = _measure_noise(difference, bench, usable)
    maps = [_soft_and_sharp(difference / noise, usable)]
    if seen.shape[2] == 3:
        lit = (seen * bench).sum(axis=2, keepdims=True)
        shade = np.clip(lit / np.maximum((bench**2).sum(axis=2, keepdims=True), 1.0), MIN_LIGHT, 1.0)
        maps.append(_soft_and_sharp((seen - shade * bench) / noise, usable))
    return maps


def _relight_background(seen: Floats32, empty: Floats32, hidden: Grey | None) -> tuple[Floats32, Bools]:
    """The picture of an empty bench (H, W, C) moved and lit as an image (H, W, C) shows the same bench.

    And (H, W) where it shows the place, and the place counts.
    """
    height, width = seen.shape[:2]
    kept = None if hidden is None else to_binary(hidden == 0)
    motion = register_affine(seen.mean(axis=2), empty.mean(axis=2), kept)
    moved = warp_affine(empty, motion, (height, width))
    whole = np.full((height, width), BRIGHTEST, np.float32)
    inside = warp_affine(whole, motion, (height, width), border=0.0) > BRIGHTEST - 1.0
    usable = inside if hidden is None else inside & (hidden == 0)
    shrink = max(1, max(height, width) // FIT_SIDE)
    rows, columns = slice(shrink // 2, None, shrink), slice(shrink // 2, None, shrink)
    blur = 0.5 * shrink
    soft_seen, soft_empty = (_blur_planes(p, blur) for p in (seen, moved))
    chosen = usable[rows, columns].ravel()
    terms = _light_terms(height, width)
    coarse = terms[rows, columns].reshape(-1, terms.shape[2])[chosen]
    bench = np.empty_like(seen)
    for c in range(seen.shape[2]):
        x = soft_empty[rows, columns, c].ravel()[chosen]
        y = soft_seen[rows, columns, c].ravel()[chosen]
        gain, offset = _fit_light(coarse, x, y)
        bench[..., c] = np.clip((terms @ gain) * moved[..., c] + offset, 0.0, BRIGHTEST)
    return bench, usable


def _same_planes(image: Pixels, background: Pixels) -> tuple[Floats32, Floats32]:
    """Both as (H, W, C), grey where one of them is."""
    if image.ndim != background.ndim:
        image, background = PLAIN.to_grey(image), PLAIN.to_grey(background)
    return np.atleast_3d(image).astype(np.float32), np.atleast_3d(background).astype(np.float32)


def _blur_planes(planes: Floats32, blur: float) -> Floats32:
    """(H, W, C) blurred by so many px."""
    return np.asarray(np.atleast_3d(cv2.GaussianBlur(planes, (0, 0), blur)), dtype=np.float32)


def _light_terms(height: int, width: int) -> Floats32:
    """(H, W, 6) polynomials of the second degree, over the image's sides from -1 to 1."""
    y, x = np.meshgrid(
        np.linspace(-1.0, 1.0, height, dtype=np.float32), np.linspace(-1.0, 1.0, width, dtype=np.float32), indexing="ij"
    )
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=2)


def _fit_light(terms: Floats32, x: Floats32, y: Floats32) -> tuple[Floats32, float]:
    """Gain, as weights of terms (n, 6), and offset for y = gain x + offset, of what most pixels (n,) agree in.

    An evenly bright bench does not tell gain from offset: then the offset is none.
    """
    design = np.column_stack([terms * x[:, None], np.ones_like(x)]).astype(np.float64)
    ridge = np.full(design.shape[1], GAIN_RIDGE * len(x) * max(float(np.mean(x)) ** 2, 1.0))
    ridge[0], ridge[-1] = MEAN_GAIN_RIDGE * len(x), OFFSET_RIDGE * len(x)
    ratio = float(np.median(y / np.maximum(x, 1.0)))
    weights = np.zeros(design.shape[1])
    weights[0] = ratio
    for _ in range(FIT_ROUNDS):
        rest = y - design @ weights
        scale = max(robust_sd(rest), QUANTIZED)
        weight = np.clip(1.0 - (rest / (BIWEIGHT * scale)) ** 2, 0.0, None) ** 2
        weighted = design * weight[:, None]
        weights = np.linalg.solve(weighted.T @ design + np.diag(ridge), weighted.T @ y.astype(np.float64))
    return weights[:-1].astype(np.float32), float(weights[-1])


def _measure_noise(difference: Floats32, bench: Floats32, usable: Bools) -> Floats32:
    """(H, W, C) standard deviation of a difference by noise, in grey levels: robustly among pixels of like slope."""
    noise = np.empty_like(difference)
    for c in range(difference.shape[2]):
        slope = np.hypot(cv2.Sobel(bench[..., c], cv2.CV_32F, 1, 0), cv2.Sobel(bench[..., c], cv2.CV_32F, 0, 1))
        counted, off = slope[usable], np.abs(difference[..., c][usable])
        limits = np.quantile(counted, np.linspace(0.0, 1.0, SLOPE_BINS + 1)[1:-1]) if len(counted) else np.zeros(0)
        of = np.searchsorted(limits, counted, side="right")
        levels = np.full(len(limits) + 1, QUANTIZED)
        for k in range(len(levels)):
            mine = off[of == k]
            if len(mine):
                levels[k] = max(robust_sd(mine), QUANTIZED)
        noise[..., c] = levels[np.searchsorted(limits, slope, side="right")]
    return noise


def _soft_and_sharp(relative: Floats32, usable: Bools) -> Floats32:
    """(H, W) probability that a place differs (H, W, C), in its noise: with its neighbours, and by itself."""
    soft = _blur_planes(relative, SOFTENING)
    sharp = cv2.GaussianBlur(_change_probability(relative, usable), (0, 0), SOFTENING)
    return np.asarray(_change_probability(soft, usable) * sharp, dtype=np.float32)


def _change_probability(relative: Floats32, usable: Bools) -> Floats32:
    """(H, W) probability that a pixel's difference (H, W, C), in its noise, is none of the noise.

    A mixture of two: noise, a t distribution with the covariance that is measured, and anything at all, evenly spread over
    what was seen. The share of either follows from the image.
    """
    seen = relative[usable].astype(np.float64)
    if len(seen) < MIN_PIXELS:
        return np.zeros(relative.shape[:2], np.float32)
    unit = seen / np.maximum(MAD_TO_SD * np.median(np.abs(seen), axis=0), TINY)
    d = unit.shape[1]
    own = unit[(np.abs(unit) < BIWEIGHT).all(axis=1)]
    covariance = (own.T @ own) / max(len(own), 1) + TINY * np.eye(d)
    form = np.linalg.inv(covariance)
    squared = np.einsum("ni,ij,nj->n", unit, form, unit)
    height = math.lgamma(0.5 * (DEGREES + d)) - math.lgamma(0.5 * DEGREES) - 0.5 * d * math.log(DEGREES * math.pi)
    noise = (
        height - 0.5 * math.log(float(np.linalg.det(covariance))) - 0.5 * (DEGREES + d) * np.log1p(squared / DEGREES)
    )
    anything = -float(np.log(np.maximum(np.ptp(unit, axis=0), 1.0)).sum())
    share = FIRST_SHARE
    for _ in range(FIT_ROUNDS):
        odds = math.log(share / (1.0 - share)) + anything - noise
        likely = 1.0 / (1.0 + np.exp(-np.clip(odds, -MAX_LOG_ODDS, MAX_LOG_ODDS)))
        share = float(np.clip(likely.mean(), MIN_CHANGED, MAX_CHANGED))
    found = np.zeros(relative.shape[:2], np.float32)
    found[usable] = likely
    return found
