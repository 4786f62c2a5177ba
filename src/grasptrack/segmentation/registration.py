# SPDX-License-Identifier: Apache-2.0
"""How far the camera moved between two images of one bench: an affine map, by what most of both show alike."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.segmentation.silhouettes import to_binary
from grasptrack.statistics import robust_sd
from grasptrack.typing import Floats, Floats32, Pixels

SIDES = (160, 640)
"""px, longer side of the images that are compared: coarse first, which bears larger motions."""
CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-5)
SMOOTHING = 5
"""px, of the filter that OpenCV compares through."""
FLATTENED, CLIPPED = 8.0, 2.0
"""px of the blur that takes light and large objects out of what is compared, and standard deviations at which the rest is
cut: the edge of an object that only one image shows tells no more than the bench's own grain."""
MAX_MOTION = 0.1
"""Of the longer side, the most that a corner may move: the camera stood nearly still."""
MIN_GRAIN = 0.1
"""Grey levels, standard deviation of what is compared."""
MIN_SHARED = 0.25
"""Share of the image that both must show."""
OUTSIDE = 10.0 * CLIPPED
"""What lies outside a moved image."""
OPAQUE = 254
"""What a reduced mask has at most where it is not whole."""
STILL = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def register_affine(image: NDArray[np.floating], other: NDArray[np.floating], kept: Pixels | None = None) -> Floats:
    """(2, 3) px of an image to px of another one of the same bench; no motion where none explains more than that.

    Grey levels (H, W), whose light may differ; (H, W) nonzero where the image may be compared: not on the object, if known.
    """
    one, two = np.asarray(image, dtype=np.float32), np.asarray(other, dtype=np.float32)
    motion = STILL.copy()
    for side in SIDES:
        shrink = max(1.0, max(one.shape) / side)
        small = [_flatten_light(_shrink_image(p, shrink)) for p in (one, two)]
        mask = np.full(one.shape, 255, np.uint8) if kept is None else kept
        mask = to_binary(cv2.resize(mask, small[0].shape[::-1], interpolation=cv2.INTER_AREA) > OPAQUE)
        began = _scale_motion(motion, 1.0 / shrink)
        try:
            _, found = cv2.findTransformECC(
                small[0], small[1], began.astype(np.float32), cv2.MOTION_AFFINE, CRITERIA, mask, SMOOTHING
            )
        except cv2.error:  # an even bench shows no motion
            continue
        moved = np.asarray(found, dtype=np.float64)
        if _largest_motion(moved, small[0].shape) > MAX_MOTION * max(small[0].shape):
            continue
        if _mean_difference(small, moved, mask) < _mean_difference(small, began, mask):
            motion = _scale_motion(moved, shrink)
    return motion


def warp_affine(image: Floats32, motion: Floats, size: tuple[int, int], border: float | None = None) -> Floats32:
    """An image (H, W) or (H, W, C) where `motion` (2, 3) finds each pixel of one of (height, width) `size`.

    Outside lies `border`, or, if None, the nearest pixel repeated.
    """
    if np.array_equal(motion, STILL) and image.shape[:2] == size:
        return image
    mode, how = cv2.BORDER_REPLICATE if border is None else cv2.BORDER_CONSTANT, cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    moved = cv2.warpAffine(image, motion, size[::-1], flags=how, borderMode=mode, borderValue=border or 0.0)
    return np.asarray(moved, dtype=np.float32).reshape(*size, *image.shape[2:])


def _shrink_image(image: Floats32, shrink: float) -> Floats32:
    if shrink <= 1.0:
        return image
    size = round(image.shape[1] / shrink), round(image.shape[0] / shrink)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _flatten_light(image: Floats32) -> Floats32:
    """The grain of an image, without its light, in its standard deviations."""
    grain = image - cv2.GaussianBlur(image, (0, 0), FLATTENED)
    scale = max(robust_sd(grain), MIN_GRAIN)
    return np.asarray(np.clip(grain / scale, -CLIPPED, CLIPPED), dtype=np.float32)


def _largest_motion(motion: Floats, size: tuple[int, ...]) -> float:
    """px that the corner moves that moves most."""
    height, width = size
    corners = np.array([[0.0, 0.0, 1.0], [width, 0.0, 1.0], [0.0, height, 1.0], [width, height, 1.0]])
    return float(np.hypot(*(corners @ motion.T - corners[:, :2]).T).max())


def _scale_motion(motion: Floats, by: float) -> Floats:
    """The same motion of images `by` times as large, whose pixels' middles stay at whole numbers."""
    there = np.array([[by, 0.0, 0.5 * by - 0.5], [0.0, by, 0.5 * by - 0.5], [0.0, 0.0, 1.0]])
    whole = there @ np.vstack([motion, [0.0, 0.0, 1.0]]) @ np.linalg.inv(there)
    return np.asarray(whole[:2], dtype=np.float64)


def _mean_difference(pair: list[Floats32], motion: Floats, mask: Pixels) -> float:
    """Mean difference of two flattened images, where both show the bench."""
    height, width = pair[0].shape
    moved = warp_affine(pair[1], motion, (height, width), border=OUTSIDE)
    usable = moved <= CLIPPED
    usable &= mask != 0
    if usable.mean() < MIN_SHARED:
        return float("inf")
    return float(np.abs(pair[0][usable] - moved[usable]).mean())
