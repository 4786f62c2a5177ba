# SPDX-License-Identifier: Apache-2.0
"""Silhouettes that may be objects, from thresholds and closed edges, all rated alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.images import Grey
from grasptrack.segmentation.closed_edges import ClosedEdgeSegmenter
from grasptrack.segmentation.rating import NONE, Rating, SilhouetteScorer
from grasptrack.segmentation.silhouettes import Silhouette, trace_silhouettes
from grasptrack.segmentation.thresholds import candidate_thresholds
from grasptrack.segmentation.work import RATED, Work
from grasptrack.segmentation.work import THRESHOLD as THRESHOLD_COST

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


THRESHOLD, GIVEN = -1, -2
"""In the place of a recipe: a threshold found it; a segmenter or a person did."""
MAP_LEVELS = (0.06, 0.15, 0.3, 0.5, 0.7, 0.85)
"""Levels at which a segmenter's map is cut: thin parts of an object fade in it."""
PER_LEVEL = 4
"""Regions of each level."""


class Proposal(NamedTuple):
    """A silhouette that may be an object.

    Attributes:
        silhouette: the region.
        rating: of its outline.
        polarity: +1 darker than its surroundings, -1 lighter, 0 unknown.
        level: grey level of the threshold that found it; NaN for closed edges.
        bridge: px, the widest gap that was bridged.
        recipe: which closing of edges found it; THRESHOLD or GIVEN.
        grain: Lab units per px of the image's own slopes, as that closing saw them.
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
        """What proposals are ordered by before they are compared closely."""
        return self.rating.score * (ONE_LEVEL if self.recipe == THRESHOLD else 1.0)


def propose_silhouettes(
    grey: Grey,
    scenery: ClosedEdgeSegmenter,
    hidden: Grey | None,
    masked: bool,
    extent: float,
    maps: Sequence[NDArray[np.float32]] = (),
    shapes: Sequence[Silhouette] = (),
    work: Work | None = None,
) -> list[Proposal]:
    """All silhouettes of an image, the best rated first, each once.

    Args:
        grey: (H, W).
        scenery: the image's edges.
        hidden: (H, W) nonzero where nothing belongs to the scene.
        masked: the image is a softened mask: only what is light is meant, and thresholds find all of it.
        extent: px across; what is smaller is not rated, and not looked for by closed edges.
        maps: (H, W) each, 0 to 1: a segmenter's regions.
        shapes: regions that were found otherwise.
        work: bound of the search, in which thresholds come first, being cheap.
    """
    work = Work() if work is None else work
    rater = SilhouetteScorer(scenery.fields[0], scenery.shrink, grey.shape)
    found: list[Proposal] = []
    soft: Grey = np.asarray(cv2.GaussianBlur(grey, (3, 3), 0), dtype=np.uint8)
    for level in candidate_thresholds(soft if hidden is None else soft[hidden == 0]):
        for polarity in (-1,) if masked else (1, -1):
            work.spend(THRESHOLD_COST * grey.size / 1e6 + RATED * PER_THRESHOLD)
            for shape in threshold_silhouettes(grey, level, polarity, hidden)[:PER_THRESHOLD]:
                rating = rater.rate(shape) if max(shape.box[2:]) >= extent else NONE
                found.append(Proposal(shape, rating, polarity, level, 0.0, THRESHOLD))
    if not masked:
        for closure in scenery.closures(LEAST_AREA, extent, work):
            rating = rater.rate(closure.silhouette, closure.bridge)
            found.append(
                Proposal(closure.silhouette, rating, 0, math.nan, closure.bridge, closure.recipe, closure.grain)
            )
    for each in maps:
        for share in MAP_LEVELS:
            binary = np.where(each > share, np.uint8(255), np.uint8(0))
            for shape in trace_silhouettes(binary, LEAST_AREA, holes=False)[:PER_LEVEL]:
                if max(shape.box[2:]) >= extent:
                    found.append(Proposal(shape, rater.rate(shape), 0, math.nan, 0.0, GIVEN))
    found.extend(Proposal(shape, rater.rate(shape), 0, math.nan, 0.0, GIVEN) for shape in shapes)
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


def is_alike(one: Silhouette, other: Silhouette) -> bool:
    """Whether two silhouettes are nearly the same region."""
    (x, y, w, h), (u, v, p, q) = one.box, other.box
    size = math.sqrt(other.area)
    corners = max(abs(x - u), abs(y - v), abs(x + w - u - p), abs(y + h - v - q))
    return corners < 0.5 * ALIKE * size and abs(math.sqrt(one.area) - size) < 0.25 * ALIKE * size


def _remove_duplicates(found: list[Proposal]) -> list[Proposal]:
    """Of those that are the same region the first, or the first that a threshold found."""
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
            continue
        own = kept[same[0]]
        if _simplicity(p) > _simplicity(own):
            kept[same[0]] = p
    return sorted(kept, key=lambda p: -p.worth)


def _simplicity(p: Proposal) -> int:
    """Of the same region what a threshold found is the simplest to find again, then what a closing did."""
    return 2 if p.recipe == THRESHOLD else int(p.recipe != GIVEN)
