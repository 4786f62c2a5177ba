# SPDX-License-Identifier: Apache-2.0
"""Removes an object's shadow: of its silhouette darker background beside it, in the object's own shape; of its outline the
ramp on one side, where a contact shadow is as dark as the object and fades outward.

A ramp is no edge: its steepest place, and that of a threshold, lie in the shadow, and the object ends at the ramp's foot, where
its own colour does. A rounded rim that is lit is a ramp, too, but ends in an edge. How far a foot is inward follows from where
the light comes from: one shift and one softness explain it all round. The rest of the outline tells how wide a true edge is in
this image.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from grasptrack.geometry.contours import Contour, View
from grasptrack.images import Grey
from grasptrack.segmentation.candidate import SAME_EDGE, outward_normals
from grasptrack.segmentation.closed_edges import Planes
from grasptrack.segmentation.silhouettes import Silhouette, otsu_threshold, to_binary, trace_silhouettes
from grasptrack.segmentation.snapping import read_bilinear
from grasptrack.typing import Bools, Floats, Floats32, Pixels

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
RAMP_SAMPLES, RAMP_MEAN, RAMP_CHORD = 256, 5, 3
"""Points of an outline at which its edge is looked at; of how many of them a mean is taken, and how many its tangent spans."""
RAMP_INSIDE, RAMP_OUTSIDE, OWN_COLOUR = 10, 8, 5
"""px of the working image to either side of an outline; and px from the innermost on that show the object's own colour."""
FOOT_NOISE, LEAST_RISE = 4.0, 0.04
"""Medians of how the object's own colour varies that a ramp rises from its foot before that is seen, and what rounding hides of
the contrast."""
SHARP_SHARE = 0.25
"""Of an outline, at least, that no shadow lies beside."""
SHIFTS, SOFTNESSES = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0), (-4.0, -2.0, -1.0, 0.0, 1.0, 2.0)
"""px of the working image by which a shadow is shifted, and by which the place of its ramp lies farther out or in."""
RAMP_TERMS = 3
"""What a shadow's ramp is told by: two of its shift, and its softness."""


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


def out_of_ramp(view: View, planes: Planes, px: int) -> View:
    """An outline whose part on a shadow's ramp is moved to the ramp's foot; the same where there is no such ramp.

    The planes (h, w, C) are of the image reduced by `px`. A ramp is one if a shift and a softness explain more than as many
    numbers do by chance, and lead farther than outlines of one edge differ.
    """
    points = view.outer.points[np.linspace(0, len(view.outer), RAMP_SAMPLES, endpoint=False).astype(np.intp)]
    normals = outward_normals(points, RAMP_CHORD)
    inward = _foot_distances((points - 0.5 * (px - 1)) / px, normals, planes)
    if float(inward.max()) <= SAME_EDGE:
        return view
    shift, softness = _explain_ramp(inward, normals)
    if float(np.max(softness + normals @ shift)) <= SAME_EDGE:
        return view
    moved = []
    for c in view.contours:
        along = outward_normals(c.points, RAMP_CHORD)
        points = c.points - px * np.maximum(softness + along @ shift, 0.0)[:, None] * along
        moved.append(Contour.trusted(points, hole=c.hole, strength=c.strength, clipped=c.clipped))
    return View(moved)


def _foot_distances(points: Floats, normals: Floats, planes: Planes) -> Floats:
    """(n,) px by which an edge at points (n, 2) begins farther inward than true edges of the same outline do."""
    steps = np.arange(-RAMP_INSIDE, RAMP_OUTSIDE + 1)
    seen = read_bilinear(planes, points[:, None] + steps[None, :, None] * normals[:, None])
    around = np.concatenate([seen[-(RAMP_MEAN // 2) :], seen, seen[: RAMP_MEAN // 2]])
    seen = np.mean([around[k : k + len(points)] for k in range(RAMP_MEAN)], axis=0)
    own, ground, middle = np.median(seen[:, :OWN_COLOUR], axis=1), seen[:, -1], RAMP_INSIDE
    contrast = np.maximum(np.linalg.norm(ground - own, axis=1), 1.0)
    risen = np.linalg.norm(seen - own[:, None], axis=2) / contrast[:, None]
    least = max(LEAST_RISE, FOOT_NOISE * float(np.median(risen[:, :OWN_COLOUR])))
    over = risen > least
    first = np.where(over.any(axis=1), over.argmax(axis=1), len(steps) - 1).clip(1)
    row = np.arange(len(points))
    before, after = risen[row, first - 1], risen[row, first]
    foot = steps[first] - np.clip((after - least) / np.maximum(after - before, 1e-6), 0.0, 1.0)
    slope = np.linalg.norm(seen[:, 2:] - seen[:, :-2], axis=2).max(axis=1) / 2.0
    half = 0.5 * contrast / np.maximum(slope, 1e-6)
    # print varies, too, and a rounded rim that is lit rises inward; but where an edge is steep no ramp reaches far
    wider = 2.0 * np.maximum(half - np.quantile(half, SHARP_SHARE), 0.0)
    inward = np.minimum(np.maximum(np.quantile(foot, 1.0 - SHARP_SHARE) - foot, 0.0), wider)
    return np.asarray(np.where(ground[:, 0] > seen[:, middle, 0], inward, 0.0))  # a shadow is darker than the ground


def _explain_ramp(inward: Floats, normals: Floats) -> tuple[Floats, float]:
    """(2,) shift and softness, px, that explain best how far inward (n,) the foot of a ramp lies; zero where chance does."""
    angles = np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS)
    ways = np.column_stack([np.cos(angles), np.sin(angles)])
    facing = normals @ ways.T
    shifts, softnesses = (each.ravel() for each in np.meshgrid(SHIFTS, SOFTNESSES))
    told = np.maximum(softnesses[:, None, None] + shifts[:, None, None] * facing.T[None], 0.0)
    off = np.abs(told - inward).mean(axis=2)
    best, way = np.unravel_index(int(np.argmin(off)), off.shape)
    count = len(inward) / RAMP_MEAN  # neighbours share what they show
    chance = math.exp(-RAMP_TERMS * math.log(count) / (2.0 * count))  # Schwarz's criterion, for Laplace's distribution
    if float(off[best, way]) >= chance * float(inward.mean()):
        return np.zeros(2), 0.0
    return shifts[best] * ways[way], float(softnesses[best])
