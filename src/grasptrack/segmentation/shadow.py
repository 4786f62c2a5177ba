# SPDX-License-Identifier: Apache-2.0
"""Removes an object's shadow from its silhouette: darker background beside it, in the object's own shape."""

from __future__ import annotations

import cv2
import numpy as np

from grasptrack.images import Grey
from grasptrack.segmentation.silhouettes import Silhouette, otsu_threshold, to_binary, trace_silhouettes
from grasptrack.typing import Bools, Floats32, Pixels

DARK, BRIGHT = 0.25, 0.93
"""A shadow leaves a share of the light between these."""
SAME_COLOUR = 0.08
"""It darkens all colours alike, within this share."""
MIN_SHARE, MAX_SHARE = 0.03, 0.45
"""Of a silhouette: less is ignored, and more cannot be the shadow of the rest."""
MIN_SHIFT, MAX_SHIFT = 0.03, 0.3
"""A flat object's shadow is shifted by such a fraction of sqrt(area)."""
EXPLAINED = 0.6
"""The shifted object must cover this share of the shadow; what it covers beyond is subtracted."""
DIRECTIONS = 16
LENGTHS = 6
WINDOW_MARGIN = 12
"""px of background around the silhouette from which its colour is taken."""
MIN_BACKGROUND = 20
"""px of it that are needed."""
GLANCE_STEP = 3
"""px, step of a first look: most objects cast no shadow."""
SOFTENING = 1.2
"""px, Gaussian blur of the image."""
GREY_LEVELS = 255.0
"""Levels that the share of the light is divided into."""
THREE = np.ones((3, 3), np.uint8)


def without_shadow(image: Pixels, shape: Silhouette) -> Silhouette | None:
    """The silhouette of the object alone, or None if no shadow can be distinguished from it."""
    window, _, filled = _crop_window(image, shape, GLANCE_STEP)
    if _shadow_mask(window, filled) is None:
        return None
    return _cut_out(image, shape, only_cast=True)


def shadow_removed(image: Pixels, shape: Silhouette) -> Silhouette:
    """As `without_shadow` for an object known to cast a shadow: by colour alone."""
    return _cut_out(image, shape, only_cast=False) or shape


def _cut_out(image: Pixels, shape: Silhouette, only_cast: bool) -> Silhouette | None:
    """The largest region of a silhouette without shaded background, if any is; only where that is the rest's own shape."""
    window, origin, filled = _crop_window(image, shape)
    shade = _shadow_mask(window, filled)
    alone = None if shade is None else _largest_region(np.where(shade, np.uint8(0), filled))
    if alone is None or (only_cast and not _is_cast(alone, filled)):
        return None
    found = trace_silhouettes(alone, origin=origin, holes=False)
    return found[0] if found else None


def _crop_window(image: Pixels, shape: Silhouette, step: int = 1) -> tuple[Floats32, tuple[int, int], Grey]:
    """(h, w, C) the blurred image around a silhouette, its origin, and the filled silhouette; every step-th pixel."""
    left, top, right, bottom = window = shape.box_window(WINDOW_MARGIN, image.shape)
    seen = image[top:bottom, left:right]
    part = cv2.GaussianBlur(seen, (5, 5), SOFTENING) if step == 1 else seen[::step, ::step]
    filled = np.ascontiguousarray(shape.filled_window(window)[::step, ::step])
    return np.asarray(part, dtype=np.float32).reshape(*filled.shape, -1), (left, top), filled


def _shadow_mask(window: Floats32, filled: Grey) -> Bools | None:
    """(h, w) where a silhouette shows shaded background, or None."""
    outside = cv2.dilate(filled, np.ones((7, 7), np.uint8)) == 0
    if np.count_nonzero(outside) < MIN_BACKGROUND:
        return None
    background = np.median(window[outside], axis=0)
    inside = filled > 0
    light = window / np.maximum(background, 1.0)
    left_over = light.mean(axis=2)
    shaded = inside & (left_over > DARK) & (left_over < BRIGHT)
    shaded &= light.max(axis=2) - light.min(axis=2) < SAME_COLOUR
    total = np.count_nonzero(inside)
    if np.count_nonzero(shaded) > MAX_SHARE * total:
        # the object has the background's hue too, so it must be darker than its shadow
        counts = np.bincount((left_over[shaded] * GREY_LEVELS).astype(np.intp), minlength=256)[:256]
        level = otsu_threshold(counts.astype(np.float64))
        if level is None:
            return None
        shaded &= left_over > level / GREY_LEVELS
    if not MIN_SHARE * total <= np.count_nonzero(shaded) <= MAX_SHARE * total:
        return None
    opened = cv2.morphologyEx(shaded.astype(np.uint8), cv2.MORPH_OPEN, THREE)
    return np.asarray(cv2.dilate(opened, THREE) > 0)


def _largest_region(mask: Grey) -> Grey | None:
    """The largest region of a smoothed mask."""
    opened = cv2.morphologyEx(mask, cv2.MORPH_OPEN, THREE)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(opened)
    if count < 2:
        return None
    best = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    return to_binary(labels == best)


def _is_cast(alone: Grey, both: Grey) -> bool:
    """Whether the removed part is the object's own shape, shifted."""
    area = float(np.count_nonzero(alone))
    rest = (both > 0) & (alone == 0)
    wanted = float(np.count_nonzero(rest))
    if not 0.0 < wanted <= MAX_SHARE * (area + wanted):
        return False
    beyond = both == 0
    height, width = alone.shape
    for angle in np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS):
        for length in np.linspace(MIN_SHIFT, MAX_SHIFT, LENGTHS) * np.sqrt(area):
            dx, dy = int(np.rint(length * np.cos(angle))), int(np.rint(length * np.sin(angle)))
            shift = np.array([[1, 0, dx], [0, 1, dy]], np.float32)
            moved = cv2.warpAffine(alone, shift, (width, height), flags=cv2.INTER_NEAREST)
            covered = float(np.count_nonzero(rest & (moved > 0)))
            over = float(np.count_nonzero(beyond & (moved > 0)))
            if covered - over >= EXPLAINED * wanted:
                return True
    return False
