# SPDX-License-Identifier: Apache-2.0
"""Which of many regions is the object that a person would name: one worth for each, and a probability from all of them.

The worth is the rating of the region's outline, times its overlap with the one of a segmenter's maps that it agrees with most,
times that of its box with the box that was given, each to a power. How likely the first is to be right follows from `Signs`.
The numbers are fitted by `research.studies.first_look`. In the worth itself neither these signs nor how smooth an outline is,
nor the colours under a finger, chose better on photos: open tools are ragged, and a finger lies on print.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from functools import lru_cache
from importlib.resources import files
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack.segmentation.proposals import OutlineProposal
from grasptrack.segmentation.silhouettes import box_iou
from grasptrack.typing import Box, Floats, Floats32

MIN_RATING, MIN_OVERLAP = 1e-6, 0.02
"""What logarithms' arguments are raised to, at least: of a rating, and of an overlap."""
RATING_OFFSET = 1e-3
"""Added to a rating, so that its logarithm is finite."""
TIE = 8.0
"""For each unit of the lead: of two regions that are worth the same either may be meant, two fifths more settle it. A choice,
for parts on sheets and equals: at 15 more sure ones were wrong on scenes of other parts, at 6 fewer were sure and none less
wrong."""
ALL_BUT = 0.02
"""Share of an outline that says nothing by not returning, by being thin, or by being cut."""
OVERLAP_PIXELS = 48
"""px across of a region in which its overlap with a map is measured."""
MAX_LOG_ODDS = 50.0
TINY_SHARE, TINY_AREA = 1e-9, 1e-6


class ChoiceNumbers(NamedTuple):
    """How a choice is made.

    Attributes:
        map_power: of the overlap with a segmenter's map.
        box_power: of the overlap of boxes.
        offset, rating, returned, thin, cut, around, neck: of a logistic function: constant, and weights of `Signs.terms`.
            Times `Signs.factor` it is the probability.
        among: share of cases with a wrong first one in which another one is right.
    """

    map_power: float
    box_power: float
    offset: float
    rating: float
    returned: float
    thin: float
    cut: float
    around: float
    neck: float
    among: float


class Signs(NamedTuple):
    """What shows whether the first region is right.

    Attributes:
        rating: of its outline, 0 to 1.
        lead: logarithm of its worth over that of the best that is plainly another region; where contacts are given, one on
            whose outline they lie as well.
        returned: share of its outline that comes back when it is displaced, as of `snapping.OutlineSnapper`.
        thin: share of its outline on thin parts, as of `silhouettes.thin_share`.
        neck: width of its narrowest neck, as of `silhouettes.neck_width`.
        cut: what the image's border takes from its rating, 0 to 1.
        toned: how plainly it may be two things, as of `candidate.two_toned` and `seams.joined_parts`, the larger.
        around: how plainly two things lie round it, as of the same.
    """

    rating: float
    lead: float
    returned: float
    thin: float
    neck: float
    cut: float
    toned: float
    around: float

    @property
    def terms(self) -> tuple[float, ...]:
        """What a logistic function weighs: all but the lead, and that it may be two things."""
        bad = 1.0 - self.returned, self.thin, self.cut, self.around
        return math.log(self.rating + RATING_OFFSET), *map(soundness_term, bad), math.log(self.neck)

    @property
    def factor(self) -> float:
        """What the logistic function is multiplied by: of what is worth the same, and of two things, either may be meant."""
        return logistic(TIE * self.lead) * (1.0 - self.toned)


def soundness_term(bad: float) -> float:
    """What a logistic function weighs of the share of an outline that is bad: each factor of that counts alike."""
    return -math.log(bad + ALL_BUT)


def drawn_probability(returned: float) -> float:
    """Probability that an outline is right that a person drew roughly and edges drew nearer, by the share that comes back."""
    numbers = _fitted_numbers()["drawn"]
    return logistic(numbers["offset"] + numbers["returned"] * soundness_term(1.0 - returned))


def load_numbers(mapped: bool, at_contacts: bool = False) -> ChoiceNumbers:
    """The fitted numbers, for choices with or without a segmenter's map; without it others where contacts are given."""
    return ChoiceNumbers(**_fitted_numbers()["with map" if mapped else "at contacts" if at_contacts else "without map"])


@lru_cache(maxsize=1)
def _fitted_numbers() -> dict[str, dict[str, float]]:
    text = files("grasptrack.segmentation").joinpath("choice.json").read_text(encoding="utf-8")
    numbers: dict[str, dict[str, float]] = json.loads(text)
    return numbers


def measure_worth(
    proposals: Sequence[OutlineProposal], maps: Sequence[Floats32], box: Box | None, numbers: ChoiceNumbers
) -> Floats:
    """(n,) logarithm of the worth of each proposal of one image.

    By maps (H, W), 0 to 1, alternatives of a segmenter's, and the object's box in px; none of either will do.
    """
    worth = np.array([math.log(max(p.comparison_order, MIN_RATING)) for p in proposals])
    if len(maps):
        totals = [(each, float(each.sum())) for each in maps]
        overlaps = [max(MIN_OVERLAP, *(map_overlap(p, each, total) for each, total in totals)) for p in proposals]
        worth = worth + numbers.map_power * np.log(np.array(overlaps))
    if box is not None:
        boxes = [max(box_iou(p.silhouette.box, box), MIN_OVERLAP) for p in proposals]
        worth = worth + numbers.box_power * np.log(np.array(boxes))
    return np.asarray(worth, dtype=np.float64)


def choice_probabilities(worth: Floats, signs: Signs, numbers: ChoiceNumbers) -> Floats:
    """(n,) probability of each proposal to be the object, the likeliest first; what is missing to 1 is that of none."""
    if not len(worth):
        return np.zeros(0)
    weights = numbers.rating, numbers.returned, numbers.thin, numbers.cut, numbers.around, numbers.neck
    log_odds = numbers.offset + sum(w * t for w, t in zip(weights, signs.terms, strict=True))
    first = logistic(log_odds) * signs.factor
    rest = np.exp(worth[1:] - worth[0])
    shares = (1.0 - first) * numbers.among * rest / max(float(rest.sum()), TINY_SHARE)
    return np.concatenate([[first], np.minimum(shares, first)])


def logistic(log_odds: float) -> float:
    """Probability of log odds."""
    return 1.0 / (1.0 + math.exp(-min(max(log_odds, -MAX_LOG_ODDS), MAX_LOG_ODDS)))


def map_overlap(p: OutlineProposal, map_: Floats32, total: float) -> float:
    """Intersection over union of a region and a map (H, W) of so much in total."""
    x, y, w, h = p.silhouette.box
    step = max(1, min(w, h) // OVERLAP_PIXELS)
    part = map_[max(y, 0) : y + h : step, max(x, 0) : x + w : step]
    mask = np.zeros(part.shape, np.uint8)
    outer = ((p.silhouette.outer - (max(x, 0), max(y, 0))) // step).astype(np.int32)
    cv2.drawContours(mask, [outer.reshape(-1, 1, 2)], -1, (1,), cv2.FILLED)
    both = float(part[mask > 0].sum()) * step**2
    return both / max(float(np.count_nonzero(mask)) * step**2 + total - both, TINY_AREA)
