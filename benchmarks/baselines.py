# SPDX-License-Identifier: Apache-2.0
"""Segmentation as one would otherwise write it with OpenCV: Otsu's threshold, an adaptive one, GrabCut."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

Array = np.ndarray
Hint = tuple[float, float] | None
Baseline = Callable[[Array, Hint], Array]

MARGIN = 0.1
"""Of each side of the image, which GrabCut takes for background."""
ITERATIONS = 5
SHRINK = 2
SEED = 2
"""px in the smaller image, radius of what GrabCut takes for the object around the hint."""
BLOCK, OFFSET, CLOSING = 51, 5, 7
"""Adaptive threshold: px of the neighbourhood, grey levels off its mean, px of the closing that joins what is left."""


def otsu(image: Array, object_at: Hint = None) -> Array:
    """(H, W) the region on either side of Otsu's threshold that `outlined` picks.

    Args:
        image: (H, W, 3) BGR.
        object_at: (x, y) px that the object covers.
    """
    grey = soft_grey(image)
    _, light = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    return outlined([light, cv2.bitwise_not(light)], object_at)


def adaptive(image: Array, object_at: Hint = None) -> Array:
    """(H, W) the region darker than its neighbourhood, on a dark ground lighter, closed; arguments as of `otsu`.

    One side only: on the other a halo round the object would win, being larger.
    """
    grey = soft_grey(image)
    if np.median(grey) < 128:
        grey = cv2.bitwise_not(grey)
    dark = cv2.adaptiveThreshold(grey, 255, cv2.ADAPTIVE_THRESH_GAUSSIAN_C, cv2.THRESH_BINARY_INV, BLOCK, OFFSET)
    return outlined([cv2.morphologyEx(dark, cv2.MORPH_CLOSE, np.ones((CLOSING, CLOSING), np.uint8))], object_at)


def grabcut(image: Array, object_at: Hint = None) -> Array:
    """(H, W) the region that GrabCut finds within the image's margin and `outlined` picks; arguments as of `otsu`.

    In an image of half the size: in the whole one it takes 10 s. With a hint, a small disc around it is given as the
    object. Sets OpenCV's random seed, to give the same every time.
    """
    cv2.setRNGSeed(0)
    small = cv2.resize(image, None, fx=1.0 / SHRINK, fy=1.0 / SHRINK, interpolation=cv2.INTER_AREA)
    height, width = small.shape[:2]
    top, left = round(MARGIN * height), round(MARGIN * width)
    labels = np.full((height, width), cv2.GC_BGD, dtype=np.uint8)
    labels[top : height - top, left : width - left] = cv2.GC_PR_FGD
    if object_at is not None:
        x, y = ((value + 0.5) / SHRINK - 0.5 for value in object_at)
        cv2.circle(labels, (round(x), round(y)), SEED, cv2.GC_FGD, -1)
    cv2.grabCut(small, labels, None, np.zeros((1, 65)), np.zeros((1, 65)), ITERATIONS, cv2.GC_INIT_WITH_MASK)
    found = np.where((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD), np.float32(1), np.float32(0))
    whole = cv2.resize(found, (image.shape[1], image.shape[0]), interpolation=cv2.INTER_LINEAR)
    return outlined([(whole > 0.5).astype(np.uint8)], object_at)


BASELINES: dict[str, Baseline] = {"Otsu": otsu, "adaptive": adaptive, "GrabCut": grabcut}


def outlined(regions: list[Array], object_at: Hint = None) -> Array:
    """(H, W) the largest outline in some binary images, filled: clear of the border, and round the hint if there is one.

    At a hint an outline that touches the border serves where no other does. Empty where there is none.

    Args:
        regions: (H, W) each, nonzero inside.
        object_at: (x, y) px.
    """
    height, width = regions[0].shape
    best: tuple[bool, float] = (False, 0.0)
    mask = np.zeros((height, width), dtype=np.uint8)
    for region in regions:
        outlines, _ = cv2.findContours(region, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        for outline in outlines:
            x, y, w, h = cv2.boundingRect(outline)
            clear = bool(x > 0 and y > 0 and x + w < width and y + h < height)
            rank = (clear, float(cv2.contourArea(outline)))
            if rank <= best or (object_at is None and not clear):
                continue
            if object_at is not None and cv2.pointPolygonTest(outline, object_at, False) < 0:
                continue
            best = rank
            mask[:] = 0
            cv2.drawContours(mask, [outline], -1, 1, -1)
    return mask > 0


def soft_grey(image: Array) -> Array:
    return cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), (5, 5), 0)
