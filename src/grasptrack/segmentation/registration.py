# SPDX-License-Identifier: Apache-2.0
"""How far the camera moved between two images of one bench: an affine map, by what most of both show alike."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats

Floats32 = NDArray[np.float32]

SIDES = (160, 640)
"""px, longer side of the images that are compared: coarse first, which bears larger motions."""
CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-5)
SMOOTHING = 5
FLATTENED, CLIPPED = 8.0, 2.0
"""px of the blur that takes light and large objects out of what is compared, and standard deviations at which the rest is
cut: the edge of an object that only one image shows tells no more than the bench's own grain."""
FARTHEST = 0.1
"""Of the longer side, the most that a corner may move: the camera stood nearly still."""
STILL = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def register_affine(
    image: NDArray[np.floating], other: NDArray[np.floating], kept: NDArray[np.uint8] | None = None
) -> Floats:
    """(2, 3) px of an image to px of another one of the same bench; no motion where none explains more than that.

    Args:
        image, other: (H, W) grey levels; the light may differ.
        kept: (H, W) nonzero where the image may be compared: not on the object, if it is known.
    """
    one, two = np.asarray(image, dtype=np.float32), np.asarray(other, dtype=np.float32)
    motion = STILL.copy()
    for side in SIDES:
        shrink = max(1.0, max(one.shape) / side)
        small = [_flattened(_reduced(p, shrink)) for p in (one, two)]
        mask = np.full(small[0].shape, 255, np.uint8) if kept is None else _reduced_mask(kept, small[0].shape)
        began = _scaled(motion, 1.0 / shrink)
        try:
            _, found = cv2.findTransformECC(
                small[0], small[1], began.astype(np.float32), cv2.MOTION_AFFINE, CRITERIA, mask, SMOOTHING
            )
        except cv2.error:  # an even bench shows no motion
            continue
        moved = np.asarray(found, dtype=np.float64)
        if _farthest(moved, small[0].shape) > FARTHEST * max(small[0].shape):
            continue
        if _misfit(small, moved, mask) < _misfit(small, began, mask):
            motion = _scaled(moved, shrink)
    return motion


def warp_affine(image: Floats32, motion: Floats, size: tuple[int, int], border: float | None = None) -> Floats32:
    """An image (H, W) or (H, W, C) where `motion` (2, 3) finds each pixel of one of (height, width) `size`.

    Args:
        border: what lies outside; None repeats the nearest pixel.
    """
    if np.array_equal(motion, STILL) and image.shape[:2] == size:
        return image
    mode = cv2.BORDER_REPLICATE if border is None else cv2.BORDER_CONSTANT
    moved = cv2.warpAffine(
        image,
        motion,
        size[::-1],
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=mode,
        borderValue=border or 0.0,
    )
    return np.asarray(moved, dtype=np.float32).reshape(*size, *image.shape[2:])


def _reduced(image: Floats32, shrink: float) -> Floats32:
    if shrink <= 1.0:
        return image
    size = round(image.shape[1] / shrink), round(image.shape[0] / shrink)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _flattened(image: Floats32) -> Floats32:
    """The grain of an image, without its light, in its standard deviations."""
    grain = image - cv2.GaussianBlur(image, (0, 0), FLATTENED)
    scale = max(1.4826 * float(np.median(np.abs(grain))), 0.1)
    return np.asarray(np.clip(grain / scale, -CLIPPED, CLIPPED), dtype=np.float32)


def _farthest(motion: Floats, size: tuple[int, ...]) -> float:
    """px that the corner moves that moves most."""
    height, width = size
    corners = np.array([[0.0, 0.0, 1.0], [width, 0.0, 1.0], [0.0, height, 1.0], [width, height, 1.0]])
    return float(np.hypot(*(corners @ motion.T - corners[:, :2]).T).max())


def _reduced_mask(mask: NDArray[np.uint8], size: tuple[int, ...]) -> NDArray[np.uint8]:
    small = cv2.resize(mask, (size[1], size[0]), interpolation=cv2.INTER_AREA)
    return np.where(small > 254, np.uint8(255), np.uint8(0))


def _scaled(motion: Floats, by: float) -> Floats:
    """The same motion of images `by` times as large, whose pixels' middles stay at whole numbers."""
    there = np.array([[by, 0.0, 0.5 * by - 0.5], [0.0, by, 0.5 * by - 0.5], [0.0, 0.0, 1.0]])
    whole = there @ np.vstack([motion, [0.0, 0.0, 1.0]]) @ np.linalg.inv(there)
    return np.asarray(whole[:2], dtype=np.float64)


def _misfit(pair: list[Floats32], motion: Floats, mask: NDArray[np.uint8]) -> float:
    """Mean difference of two flattened images, where both show the bench."""
    height, width = pair[0].shape
    outside = 10.0 * CLIPPED
    moved = warp_affine(pair[1], motion, (height, width), border=outside)
    usable = moved <= CLIPPED
    usable &= mask != 0
    if usable.mean() < 0.25:
        return float("inf")
    return float(np.abs(pair[0][usable] - moved[usable]).mean())
