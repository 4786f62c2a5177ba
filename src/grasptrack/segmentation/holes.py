# SPDX-License-Identifier: Apache-2.0
"""Holes of an object: places within its outline where the background is seen, as opposed to print."""

from __future__ import annotations

import cv2
import numpy as np

from grasptrack.errors import ContourError
from grasptrack.geometry.contours import Contour
from grasptrack.images import Grey
from grasptrack.segmentation.localization import Localised, localize_contour
from grasptrack.segmentation.normalized_gradient import Planes
from grasptrack.segmentation.silhouettes import Chain, Silhouette, trace_silhouettes
from grasptrack.typing import Floats

SHARPNESS = 0.5
"""Least strength of a hole's edge relative to the outer one; print is seldom as sharp."""
LEVEL = 0.25
"""A hole shows the same background as around the object, within this fraction of the contrast."""
MOST = 12
"""Holes that are examined, the largest first."""
LEAST = 0.004
"""Smallest hole found by colour alone, as a share of its object."""
ALIKE = 3.0
"""The background in a hole differs from that around the object by at most this many times its noise."""
RIM = 3
"""px, least width of material between a hole and the outline; what reaches the outline is a notch, or enclosed
background."""
MARGIN = 12
"""px of background around the object that are examined."""


def true_hole(grey: Grey, chain: Chain, outer: Localised, polarity: int, hidden: Grey | None) -> Contour | None:
    """The hole's contour if its edge is sharp and shows the background, else None; print seldom does both."""
    try:
        hole = localize_contour(grey, chain, hole=True, polarity=polarity, hidden=hidden)
    except ContourError:
        return None
    strength, reference = hole.contour.strength, outer.contour.strength
    if strength is None or reference is None:
        return None
    if lower_quintile(strength) < SHARPNESS * float(np.median(reference)):
        return None
    if polarity and not abs(hole.outside - outer.outside) <= LEVEL * abs(outer.outside - outer.inside):
        return None
    return hole.contour


def lower_quintile(values: Floats) -> float:
    """The value below which a fifth of the values lie."""
    k = len(values) // 5
    return float(np.partition(values, k)[k])


def ground_within(image: Planes, shape: Silhouette) -> list[Chain]:
    """Pixel chains around the places within a silhouette that look like the background, the largest first.

    The background around the silhouette is extrapolated to its inside by a wide average.

    Args:
        image: planes.
        shape: the silhouette.
    """
    x, y, w, h = shape.box
    left, top = max(x - MARGIN, 0), max(y - MARGIN, 0)
    right, bottom = min(x + w + MARGIN, image.shape[1]), min(y + h + MARGIN, image.shape[0])
    window = np.ascontiguousarray(image[top:bottom, left:right])
    filled = np.zeros(window.shape[:2], np.uint8)
    cv2.drawContours(filled, [shape.outer.reshape(-1, 1, 2)], -1, (255,), cv2.FILLED, offset=(-left, -top))
    outside = (cv2.dilate(filled, np.ones((7, 7), np.uint8)) == 0).astype(np.float32)
    if not outside.any():
        return []
    wide = (2 * (max(w, h) // 2) + 1,) * 2  # a box filter: a Gaussian this wide is slow
    weight = cv2.blur(outside, wide) + 1e-6
    ground = cv2.blur(window * outside[:, :, None], wide).reshape(window.shape) / weight[:, :, None]
    soft = cv2.GaussianBlur(window, (0, 0), 1.0).reshape(window.shape)
    away = np.sqrt(((soft - ground) ** 2).sum(axis=2))
    grain = float(np.median(away[outside > 0]))
    deep = cv2.erode(filled, np.ones((2 * RIM + 1, 2 * RIM + 1), np.uint8))
    if not deep.any():
        return []
    limit = min(ALIKE * max(grain, 1.0), LEVEL * float(np.median(away[deep > 0])))
    alike = np.where((filled > 0) & (away <= limit), np.uint8(255), np.uint8(0))
    alike = np.asarray(cv2.morphologyEx(alike, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)), dtype=np.uint8)
    # the chain of a hole runs through the adjacent material
    grown = np.asarray(cv2.dilate(alike, np.ones((3, 3), np.uint8)), dtype=np.uint8)
    found = trace_silhouettes(grown, max(LEAST * shape.area, 30.0), holes=False)
    whole = [s for s in found if (deep[s.outer[:, 1], s.outer[:, 0]] > 0).all()]
    return [s.outer + np.array([left, top], np.int32) for s in whole[:MOST]]
