# SPDX-License-Identifier: Apache-2.0
"""Segmentation as one would otherwise write it with OpenCV: Otsu's threshold, an adaptive one, GrabCut."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Hint = tuple[float, float] | None
Baseline = Callable[[NDArray[np.uint8], Hint], Mask]

MARGIN = 0.1
"""Of each side of the image, which GrabCut takes for background."""
ITERATIONS = 5
SEED = 4
"""px, radius of what GrabCut takes for the object around the hint."""
BLOCK, OFFSET, CLOSING = 51, 5, 7
"""Adaptive threshold: px of the neighbourhood, grey levels off its mean, px of the closing that joins what is left."""


def otsu(image: NDArray[np.uint8], object_at: Hint = None) -> Mask:
    """(H, W) the region on either side of Otsu's threshold that `outlined` picks.

    Args:
        image: (H, W, 3) BGR.
        object_at: (x, y) px that the object covers.
    """
    grey = _soft_grey(image)
    _, light = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    return outlined([light, cv2.bitwise_not(light)], object_at)


def adaptive(image: NDArray[np.uint8], object_at: Hint = None) -> Mask:
    """(H, W) the closed region lighter or darker than its neighbourhood that `outlined` picks; arguments as of `otsu`."""
    grey = _soft_grey(image)
    kernel = np.ones((CLOSING, CLOSING), np.uint8)
    regions = []
    for side in (grey, cv2.bitwise_not(grey)):
        dark = cv2.adaptiveThreshold(
            side, 255, cv2.ADAPTIVE_THRESH_GAUSSIAN_C, cv2.THRESH_BINARY_INV, BLOCK, OFFSET
        )
        regions.append(cv2.morphologyEx(dark, cv2.MORPH_CLOSE, kernel))
    return outlined(regions, object_at)


def grabcut(image: NDArray[np.uint8], object_at: Hint = None) -> Mask:
    """(H, W) the region that GrabCut finds within the image's margin and `outlined` picks; arguments as of `otsu`.

    With a hint, a small disc around it is given as the object. Sets OpenCV's random seed, to give the same every time.
    """
    cv2.setRNGSeed(0)
    height, width = image.shape[:2]
    top, left = round(MARGIN * height), round(MARGIN * width)
    labels = np.full((height, width), cv2.GC_BGD, dtype=np.uint8)
    labels[top : height - top, left : width - left] = cv2.GC_PR_FGD
    if object_at is not None:
        cv2.circle(labels, (round(object_at[0]), round(object_at[1])), SEED, cv2.GC_FGD, -1)
    background, foreground = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(image, labels, None, background, foreground, ITERATIONS, cv2.GC_INIT_WITH_MASK)
    found = (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)
    return outlined([found.astype(np.uint8)], object_at)


BASELINES: dict[str, Baseline] = {"Otsu": otsu, "adaptive": adaptive, "GrabCut": grabcut}


def outlined(regions: list[Any], object_at: Hint = None) -> Mask:
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


def _soft_grey(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), (5, 5), 0), dtype=np.uint8)
