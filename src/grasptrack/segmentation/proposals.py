# SPDX-License-Identifier: Apache-2.0
"""Silhouettes that may be objects, from thresholds and closed edges, all rated alike."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack import kernels
from grasptrack.segmentation.closed_edges import ClosedEdgeSegmenter
from grasptrack.segmentation.images import Grey
from grasptrack.segmentation.rating import NONE, Rating, SilhouetteScorer
from grasptrack.segmentation.silhouettes import Silhouette, trace_silhouettes
from grasptrack.segmentation.thresholds import candidate_thresholds

Box = tuple[float, float, float, float]
"""Left, top, width and height, px."""

PER_THRESHOLD = 8
"""Silhouettes of each threshold that are examined closely, the largest first."""
LEAST_AREA = 150.0
"""px^2, least area enclosed by closed edges."""
ONE_LEVEL = 0.9
"""Factor on the rating of thresholds, which leave out parts of another grey: closed edges are preferred if both rate
alike; ..."""
ALIKE = 0.06
"""... but where box and area differ by less than this share of the size, both are the same region, and a threshold is
simpler."""


class Proposal(NamedTuple):
    """A silhouette that may be an object.

    Attributes:
        silhouette: the region.
        rating: of its outline.
        polarity: +1 darker than its surroundings, -1 lighter, 0 unknown.
        level: grey level of the threshold that found it; NaN for closed edges.
        bridge: px, the widest gap that was bridged.
        recipe: the closing recipe that found it; -1 for a threshold.
        grain: Lab units per px, the gradient noise of the image for that recipe.
    """

    silhouette: Silhouette
    rating: Rating
    polarity: int
    level: float
    bridge: float
    recipe: int
    grain: float = math.nan

    @property
    def worth(self) -> float:
        """The value by which proposals are ordered."""
        return self.rating.score * (ONE_LEVEL if self.recipe < 0 else 1.0)

    def is_meant(self, object_at: tuple[float, float] | None, box: Box | None) -> bool:
        """Whether it covers a given pixel, and overlaps a given box."""
        if object_at is not None and not self.silhouette.contains(*object_at):
            return False
        return box is None or box_iou(self.silhouette.box, box) > 0.3


def propose_silhouettes(
    grey: Grey, scenery: ClosedEdgeSegmenter, hidden: Grey | None, masked: bool, extent: float
) -> list[Proposal]:
    """All silhouettes of an image, the best rated first, each once.

    Args:
        grey: (H, W).
        scenery: the image's edges.
        hidden: (H, W) nonzero where pixels are ignored.
        masked: the image is a softened mask with light objects; thresholds find all of them.
        extent: px across; smaller silhouettes are not rated.
    """
    rater = SilhouetteScorer(scenery.fields[0], scenery.shrink, grey.shape)
    found: list[Proposal] = []
    soft: Grey = np.asarray(cv2.GaussianBlur(grey, (3, 3), 0), dtype=np.uint8)
    for level in candidate_thresholds(soft if hidden is None else soft[hidden == 0]):
        for polarity in (-1,) if masked else (1, -1):
            for shape in threshold_silhouettes(grey, level, polarity, hidden)[:PER_THRESHOLD]:
                rating = rater.rate(shape) if max(shape.box[2:]) >= extent else NONE
                found.append(Proposal(shape, rating, polarity, level, 0.0, -1))
    if not masked:
        for closure in scenery.closures(LEAST_AREA, extent):
            rating = rater.rate(closure.silhouette, closure.bridge)
            found.append(
                Proposal(closure.silhouette, rating, 0, math.nan, closure.bridge, closure.recipe, closure.grain)
            )
    found.sort(key=lambda p: -p.worth)
    return _remove_duplicates(found)


def threshold_silhouettes(
    grey: Grey, level: float, polarity: int, hidden: Grey | None, least: float = 30.0
) -> list[Silhouette]:
    """Regions darker (polarity +1) or lighter (-1) than a level, of at least `least` px^2, the largest first."""
    binary = kernels.blur_threshold(grey, 0, 0, grey.shape[1], grey.shape[0], level, polarity)
    if hidden is not None:
        binary[hidden != 0] = 0
    return trace_silhouettes(binary, least)


def box_iou(one: tuple[int, int, int, int], other: Box) -> float:
    """Intersection over union of two boxes."""
    wide = min(one[0] + one[2], other[0] + other[2]) - max(one[0], other[0])
    tall = min(one[1] + one[3], other[1] + other[3]) - max(one[1], other[1])
    both = max(wide, 0.0) * max(tall, 0.0)
    return both / (one[2] * one[3] + other[2] * other[3] - both)


def is_alike(one: Silhouette, other: Silhouette) -> bool:
    """Whether two silhouettes are nearly the same region."""
    (x, y, w, h), (u, v, p, q) = one.box, other.box
    size = math.sqrt(other.area)
    corners = max(abs(x - u), abs(y - v), abs(x + w - u - p), abs(y + h - v - q))
    return corners < 0.5 * ALIKE * size and abs(math.sqrt(one.area) - size) < 0.25 * ALIKE * size


def _remove_duplicates(found: list[Proposal]) -> list[Proposal]:
    """One proposal for each region: the first, or the first found by a threshold."""
    kept: list[Proposal] = []
    places = np.zeros((len(found), 5))
    for p in found:
        x, y, w, h = p.silhouette.box
        place = np.array([x, y, x + w, y + h, 2.0 * math.sqrt(p.silhouette.area)])
        limit = ALIKE * max(math.sqrt(p.silhouette.area), 20.0)
        same = np.flatnonzero(np.abs(places[: len(kept)] - place).max(axis=1, initial=0.0) < limit)
        if not len(same):
            places[len(kept)] = place
            kept.append(p)
        elif p.recipe < 0 <= kept[same[0]].recipe:
            kept[same[0]] = p
    return sorted(kept, key=lambda p: -p.worth)
