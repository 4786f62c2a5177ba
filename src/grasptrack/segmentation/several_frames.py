# SPDX-License-Identifier: Apache-2.0
"""What the next images tell of the candidates of the first: a reflection stays with the lamps, an object with the bench.

Each image is registered to the first by the bench, and looked at for the same candidates. How far one lies from where
the bench took it speaks for the bench or for the lamps by as much as the camera moved: where it stood still, for neither.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import ObservationError
from grasptrack.images import PLAIN, to_bgr
from grasptrack.segmentation.candidate import Candidate
from grasptrack.segmentation.registration import register_affine
from grasptrack.typing import Floats

MAX_FRAMES = 4
"""Images that are asked at most."""
REFLECTION_SHARE = 0.45
"""Of wrong first candidates the share that reflections made, 9 of 20 on photos of benches: the most that an object gains by
lying still on its bench, for stains and print do so too."""
MIN_SD = 0.5
"""px, the least standard deviation of a candidate's place in another image. Of what lay still in the first frames of real
videos whose camera moved by up to 20 px, three in four were found within 0.5 px of where the bench took them."""
DEGREES = 3.0
"""Degrees of freedom of the t distribution of that place: now and then an outline takes in something more."""
MATCH_DEVIATIONS = 3.0
"""Standard deviations, beside the bench's own motion, within which a candidate is looked for."""
NEAREST_SHARE = 0.25
"""Of the candidates, those by which the registration is judged: ..."""
RAYLEIGH_QUANTILE = math.sqrt(2.0 * math.log(1.0 / (1.0 - NEAREST_SHARE)))
"""... the largest of their distances, in standard deviations of a place along each axis."""
SAME_AREA = 0.2
"""Share by which areas may differ that belong to one candidate."""


def ask_more_frames(
    found: list[Candidate],
    image: NDArray[np.uint8],
    more: Iterable[NDArray[np.uint8]],
    look: Callable[[NDArray[np.uint8]], list[Candidate]],
    sure: float,
) -> list[Candidate]:
    """The candidates with what other images tell of them, the likeliest first; images are asked until one is sure.

    Images that follow the first, (H, W) or BGR (H, W, 3), are of its size; MAX_FRAMES are asked at most. `look` finds
    candidates in one, or raises an ObservationError; `sure` is the probability from which no more is asked.
    """
    bench = PLAIN.to_grey(image).astype(np.float32)
    still, lamps = np.zeros(len(found)), np.zeros(len(found))  # logarithms of what was seen, by either
    judged, frames = found, islice(more, MAX_FRAMES)
    while judged[0].probability < sure and (other := next(frames, None)) is not None:
        colours = to_bgr(other)
        if colours.shape[:2] != image.shape[:2]:
            continue  # the tracker says so when it comes to it
        motion = register_affine(bench, PLAIN.to_grey(colours).astype(np.float32))
        try:
            seen = look(colours)
        except ObservationError:
            continue
        on_bench, with_lamps = place_likelihoods(found, seen, motion)
        still, lamps = still + on_bench, lamps + with_lamps
        judged = _with_reflection_evidence(found, still, lamps)
    return judged


def place_likelihoods(found: Sequence[Candidate], seen: Sequence[Candidate], motion: Floats) -> tuple[Floats, Floats]:
    """(n,) logarithms of how likely each candidate is seen where it is, if it lies on the bench, and if it comes from lamps.

    Both are 0 where nothing alike is seen in the other image, to whose px `motion` (2, 3) takes those of the first. Lamps may
    move a reflection by anything between the bench's motion and none.
    """
    places = np.array([c.view.outer.points.mean(axis=0) for c in found])
    taken = places @ motion[:, :2].T + motion[:, 2]
    shifts = np.hypot(*(taken - places).T)
    offsets = np.full(len(found), math.nan)
    for k, c in enumerate(found):
        area = c.view.outer.area * abs(float(np.linalg.det(motion[:, :2])))
        reach = shifts[k] + MATCH_DEVIATIONS * MIN_SD
        near = [
            float(np.hypot(*(other.view.outer.points.mean(axis=0) - taken[k])))
            for other in seen
            if abs(math.log(other.view.outer.area / area)) < SAME_AREA
        ]
        if near and min(near) <= reach:
            offsets[k] = min(near)
    matched = np.isfinite(offsets)
    on_bench, with_lamps = np.zeros(len(found)), np.zeros(len(found))
    if not matched.any():
        return on_bench, with_lamps
    d = offsets[matched]
    # of few, the nearest shows how well the images are registered; one alone does not show whether it or they are off
    nearest = float(np.quantile(d, NEAREST_SHARE, method="lower"))
    sigma = max(nearest / RAYLEIGH_QUANTILE, MIN_SD)
    wide = sigma**2 + (0.5 * shifts[matched]) ** 2
    for log, variance in ((on_bench, np.full(len(d), sigma**2)), (with_lamps, wide)):
        log[matched] = -np.log(variance) - 0.5 * (DEGREES + 2.0) * np.log1p(d**2 / (DEGREES * variance))
    return on_bench, with_lamps


def _with_reflection_evidence(found: list[Candidate], still: Floats, lamps: Floats) -> list[Candidate]:
    """The candidates with probabilities after what was seen: one of them is right, or none, and of the wrong ones a share are
    reflections."""
    wrong = np.logaddexp(math.log(1.0 - REFLECTION_SHARE) + still, math.log(REFLECTION_SHARE) + lamps)
    weights = np.array([c.probability for c in found]) * np.exp(still - wrong)
    none = max(1.0 - sum(c.probability for c in found), 0.0)
    total = float(weights.sum()) + none
    if not total > 0.0:
        return found
    judged = [c._replace(probability=float(w / total)) for c, w in zip(found, weights, strict=True)]
    return sorted(judged, key=lambda c: -c.probability)
