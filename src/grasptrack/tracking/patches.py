# SPDX-License-Identifier: Apache-2.0
"""The surface of the first view: camera noise, patches that tell how they moved, shifts under which it looks alike."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels import PATCH_SIDE
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.target import Grey, as_grey
from grasptrack.typing import Floats

Spectrum = NDArray[np.complex128]
SECOND_DIFFERENCE = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])
"""Of which noise has a standard deviation that is larger by its norm."""
SECOND_NORM = 6.0
LEAST_NOISE = 1.0
"""Grey levels, of the noise of 8 bits."""
MEDIAN_OF_NORMAL = 0.6745
"""Median of the absolute value of a normal variable, in standard deviations."""
SURFACE_SAMPLES = 400
"""Samples of the surface, for its gain and bias."""
EDGE_SHARE, EDGE_CONTRAST = 0.1, 4.0
"""A patch with gradients in one direction alone: how much it counts beside one with both, and how much more it needs."""
COARSE_FROM = 1.6
"""Pixels of an image to a work px from which on its next level is looked at."""
SLIDE_SIZE = 100.0
"""Pixels of sqrt(area) at which a surface is laid on itself: what slides by less than a few does not matter."""
MAX_SLIDES = 8
"""Nearest shifts that are kept: what slides farther slides by one of them first."""
MIN_OVERLAP = 0.5
"""Share of a surface on which it must look like itself."""


def camera_noise(grey: Grey) -> float:
    """Grey levels, standard deviation of the camera's noise, by the median second difference; at least that of 8 bits.

    J. Immerkaer, "Fast noise variance estimation", Computer Vision and Image Understanding 64 (1996), with a median.
    """
    second = np.abs(cv2.filter2D(grey, cv2.CV_32F, SECOND_DIFFERENCE))
    return max(LEAST_NOISE, float(np.median(second)) / (SECOND_NORM * MEDIAN_OF_NORMAL))


def select_textured_patches(image: Grey, mask: Grey, stride: int, noise: float, contrast: float, most: int) -> Floats:
    """(n, 2) work px: middles of patches that tell how they moved; `image` is reduced by `stride`, `mask` is not."""
    gradients = [cv2.Sobel(image, cv2.CV_32F, i, 1 - i, ksize=1) * 0.5 for i in (1, 0)]
    box = (PATCH_SIDE, PATCH_SIDE)
    xx, xy, yy = (
        cv2.boxFilter(a * b, -1, box, normalize=False)
        for a, b in ((gradients[0], gradients[0]), (gradients[0], gradients[1]), (gradients[1], gradients[1]))
    )
    root = np.sqrt((0.5 * (xx - yy)) ** 2 + xy**2)
    least, largest = 0.5 * (xx + yy) - root, 0.5 * (xx + yy) + root
    own = 0.5 * PATCH_SIDE * PATCH_SIDE * noise * noise  # of noise alone
    height, width = image.shape
    allowed = mask[::stride, ::stride][:height, :width] > 0
    score = np.where(allowed[:height, :width], least + EDGE_SHARE * largest, 0.0)
    tells = (least > contrast * own) | (largest > EDGE_CONTRAST * contrast * own)
    score = np.where(tells, score, 0.0)
    rows, columns = -(-height // PATCH_SIDE), -(-width // PATCH_SIDE)
    padded = np.zeros((rows * PATCH_SIDE, columns * PATCH_SIDE), np.float32)
    padded[:height, :width] = score
    cells = padded.reshape(rows, PATCH_SIDE, columns, PATCH_SIDE).transpose(0, 2, 1, 3).reshape(rows * columns, -1)
    best = cells.argmax(axis=1)
    value = cells[np.arange(len(cells)), best]
    found = np.flatnonzero(value > 0)
    y = (found // columns) * PATCH_SIDE + best[found] // PATCH_SIDE
    x = (found % columns) * PATCH_SIDE + best[found] % PATCH_SIDE
    # the best of every region first, then the second best: what lies close together tells the same
    side = max(PATCH_SIDE, math.sqrt(float(allowed.sum()) / most))
    region = (y // side).astype(int) * (width + 1) + (x // side).astype(int)
    order = np.lexsort((-value[found], region))
    first = np.r_[True, np.diff(region[order]) != 0] if len(order) else np.zeros(0, bool)
    start = np.maximum.accumulate(np.where(first, np.arange(len(order)), 0)) if len(order) else np.zeros(0, int)
    rank = np.empty(len(order), int)
    rank[order] = np.arange(len(order)) - start
    chosen = np.lexsort((-value[found], rank))[:most]
    x, y = x[chosen], y[chosen]
    return np.ascontiguousarray(np.column_stack([x, y]).astype(np.float64) * stride)


def self_similar_shifts(image: Grey, mask: Grey, noise: float, size: float, numbers: Numbers) -> Floats:
    """(n, 2) work px: shifts of a surface onto itself, as of a chessboard by two squares, the nearest first.

    By the correlation of its local contrast where it overlaps itself (D. Padfield, "Masked object registration in the Fourier
    domain", IEEE Transactions on Image Processing 21, 2012, with local means).
    """
    scale = min(1.0, SLIDE_SIZE / size)
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA).astype(np.float32)
    inside = cv2.resize(mask, small.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    mean = cv2.boxFilter(small, -1, (PATCH_SIDE, PATCH_SIDE))
    variance = np.maximum(cv2.boxFilter(small**2, -1, (PATCH_SIDE, PATCH_SIDE)) - mean**2, 0.0)
    textured = inside & (variance > numbers.texture_contrast * (noise * scale) ** 2)
    if float(textured.sum()) < MIN_OVERLAP * float(inside.sum()) or not inside.any():
        return np.zeros((0, 2))
    contrast = np.where(inside, (small - mean) / np.sqrt(variance + noise**2), 0.0)
    height, width = (2 * side for side in small.shape)

    there, own, alike = (
        np.fft.rfft2(values, (height, width)) for values in (inside.astype(np.float64), contrast**2, contrast)
    )

    def shifted_sum(a: Spectrum, b: Spectrum) -> Floats:
        """At (dy, dx), with the origin in the middle: the sum of a where b is, shifted by so much."""
        return np.asarray(np.fft.fftshift(np.fft.irfft2(a.conj() * b, (height, width))), dtype=np.float64)

    correlation = shifted_sum(alike, alike) / np.sqrt(
        np.maximum(shifted_sum(own, there) * shifted_sum(there, own), 1e-6)
    )
    overlap = shifted_sum(there, there) / float(inside.sum())
    middle = np.array([height // 2, width // 2])
    highest = cv2.dilate(correlation, np.ones((5, 5)))
    peak = (correlation > _as_likely(numbers)) & (overlap > MIN_OVERLAP) & (correlation >= highest)
    found = np.argwhere(peak) - middle
    away = np.hypot(*found.T)
    order = np.argsort(away, kind="stable")
    halfway = correlation[tuple((found // 2 + middle).T)]
    kept = [k for k in order if away[k] > numbers.tolerance * size * scale and halfway[k] < _as_likely(numbers)]
    return np.asarray(found[kept[:MAX_SLIDES], ::-1] / scale, dtype=np.float64).reshape(-1, 2)


def _as_likely(numbers: Numbers) -> float:
    """Correlation of a patch that is as probable of the same surface as of another one."""
    a, b = numbers.match_spread**-2, numbers.chance_spread**-2
    more = 2.0 * math.log(numbers.match_spread / numbers.chance_spread)
    return (a - math.sqrt(a * a - (a - b) * (a + more))) / (a - b)


def surface_samples(inside_mask: Grey) -> Floats:
    """(n, 2) pixels of the surface, spread all over it, whose mask (H, W) is nonzero: for its gain and bias."""
    inside = np.argwhere(inside_mask > 0)[:, ::-1]
    step = max(1, len(inside) // SURFACE_SAMPLES)
    order = np.arange(len(inside))
    if step > 1:  # a stride that does not run down the columns
        order = np.random.default_rng(0).permutation(len(inside))[: len(inside) // step]
    return np.ascontiguousarray(inside[order][:SURFACE_SAMPLES].astype(np.float64)).reshape(-1, 2)


def rectify_image(levels: list[Grey], A: Floats, size: tuple[int, int]) -> Grey:
    """(H, W) a view of the levels of an image through A (3, 3), work px -> px."""
    level, G = 0, A
    while G[0, 0] > COARSE_FROM and level + 1 < len(levels):
        level, G = level + 1, np.diag([0.5, 0.5, 1.0]) @ G
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return as_grey(cv2.warpPerspective(levels[level], G, size, flags=flags, borderMode=cv2.BORDER_REPLICATE))
