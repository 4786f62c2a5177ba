# SPDX-License-Identifier: Apache-2.0
"""Removes an object's shadow from its silhouette: darker background beside it, in the object's own shape."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.images import Grey
from grasptrack.segmentation.silhouettes import Silhouette, trace_silhouettes
from grasptrack.segmentation.thresholds import otsu_threshold

DARK, BRIGHT = 0.25, 0.93
"""A shadow leaves a share of the light between these."""
SAME_COLOUR = 0.08
"""It darkens all colours alike, within this share."""
MOST = 0.45
"""A larger share of a silhouette cannot be the shadow of the rest."""
LEAST = 0.03
"""A smaller share is ignored."""
LENGTH = 0.3
"""A flat object's shadow is shifted by at most this fraction of sqrt(area)."""
EXPLAINED = 0.6
"""The shifted object must cover this share of the shadow; what it covers beyond is subtracted."""
DIRECTIONS = 16
LENGTHS = 6
MARGIN = 12
"""px of background around the silhouette from which its colour is taken."""
GLANCE = 3
"""Step of a first look in px: most objects cast no shadow."""


def without_shadow(image: NDArray[np.uint8], shape: Silhouette) -> Silhouette | None:
    """The silhouette of the object alone, or None if no shadow can be distinguished from it.

    Args:
        image: (H, W) or BGR (H, W, 3).
        shape: the object, perhaps with its shadow.
    """
    window, (left, top), filled = _crop_window(image, shape, GLANCE)
    if _shadow_mask(window, filled) is None:
        return None
    window, (left, top), filled = _crop_window(image, shape)
    shade = _shadow_mask(window, filled)
    if shade is None:
        return None
    alone = _largest_region(np.where(shade, np.uint8(0), filled))
    if alone is None or not _is_cast(alone, filled):
        return None
    found = trace_silhouettes(alone, 30.0, (left, top), holes=False)
    return found[0] if found else None


def shadow_removed(image: NDArray[np.uint8], shape: Silhouette) -> Silhouette:
    """As `without_shadow` for an object known to cast a shadow: by colour alone."""
    window, (left, top), filled = _crop_window(image, shape)
    shade = _shadow_mask(window, filled)
    alone = None if shade is None else _largest_region(np.where(shade, np.uint8(0), filled))
    found = [] if alone is None else trace_silhouettes(alone, 30.0, (left, top), holes=False)
    return found[0] if found else shape


def _crop_window(
    image: NDArray[np.uint8], shape: Silhouette, step: int = 1
) -> tuple[NDArray[np.float32], tuple[int, int], Grey]:
    """(h, w, C) the blurred image around a silhouette, its origin, and the filled silhouette; every step-th pixel."""
    x, y, w, h = shape.box
    left, top = max(x - MARGIN, 0), max(y - MARGIN, 0)
    right, bottom = min(x + w + MARGIN, image.shape[1]), min(y + h + MARGIN, image.shape[0])
    seen = image[top:bottom, left:right]
    part = cv2.GaussianBlur(seen, (5, 5), 1.2) if step == 1 else seen[::step, ::step]
    filled = np.zeros((bottom - top, right - left), np.uint8)
    cv2.drawContours(filled, [shape.outer.reshape(-1, 1, 2)], -1, (255,), cv2.FILLED, offset=(-left, -top))
    filled = np.ascontiguousarray(filled[::step, ::step])
    return np.asarray(part, dtype=np.float32).reshape(*filled.shape, -1), (left, top), filled


def _shadow_mask(window: NDArray[np.float32], filled: Grey) -> NDArray[np.bool_] | None:
    """(h, w) where a silhouette shows shaded background, or None."""
    outside = cv2.dilate(filled, np.ones((7, 7), np.uint8)) == 0
    if np.count_nonzero(outside) < 20:
        return None
    ground = np.median(window[outside], axis=0)
    inside = filled > 0
    light = window / np.maximum(ground, 1.0)
    left_over = light.mean(axis=2)
    shaded = inside & (left_over > DARK) & (left_over < BRIGHT)
    shaded &= light.max(axis=2) - light.min(axis=2) < SAME_COLOUR
    total = np.count_nonzero(inside)
    if np.count_nonzero(shaded) > MOST * total:
        # the object has the background's hue too, so it must be darker than its shadow
        level = otsu_threshold(
            np.bincount((left_over[shaded] * 255.0).astype(np.intp), minlength=256)[:256].astype(np.float64)
        )
        if level is None:
            return None
        shaded &= left_over > level / 255.0
    if not LEAST * total <= np.count_nonzero(shaded) <= MOST * total:
        return None
    opened = cv2.morphologyEx(shaded.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return np.asarray(cv2.dilate(opened, np.ones((3, 3), np.uint8)) > 0)


def _largest_region(mask: Grey) -> Grey | None:
    """The largest region of a smoothed mask."""
    opened = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(opened)
    if count < 2:
        return None
    best = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    return np.where(labels == best, np.uint8(255), np.uint8(0))


def _is_cast(alone: Grey, both: Grey) -> bool:
    """Whether the removed part is the object's own shape, shifted."""
    area = float(np.count_nonzero(alone))
    rest = (both > 0) & (alone == 0)
    wanted = float(np.count_nonzero(rest))
    if not 0.0 < wanted <= MOST * (area + wanted):
        return False
    beyond = both == 0
    height, width = alone.shape
    for angle in np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS):
        for length in np.linspace(0.03, LENGTH, LENGTHS) * np.sqrt(area):
            dx, dy = int(np.rint(length * np.cos(angle))), int(np.rint(length * np.sin(angle)))
            shift = np.array([[1, 0, dx], [0, 1, dy]], np.float32)
            moved = cv2.warpAffine(alone, shift, (width, height), flags=cv2.INTER_NEAREST)
            covered = float(np.count_nonzero(rest & (moved > 0)))
            over = float(np.count_nonzero(beyond & (moved > 0)))
            if covered - over >= EXPLAINED * wanted:
                return True
    return False
