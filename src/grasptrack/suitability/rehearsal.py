# SPDX-License-Identifier: Apache-2.0
"""The tracker on the image itself, moved a little and with fresh noise: where the truth is known, its error can be seen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.belief import Belief
from grasptrack.errors import ConditioningError, GraspError
from grasptrack.observation.restaged import course, denoised, restaged
from grasptrack.projective import apply_homography
from grasptrack.search import Search
from grasptrack.suitability.first import FirstView

Floats = NDArray[np.float64]

STEPS = 6
"""Motions that are rehearsed."""


class Rehearsal(NamedTuple):
    """How the tracker did.

    Attributes:
        steps: motions.
        located: how many it answered.
        error: px, rms distance of the worst contact where it answered; NaN where it never did.
        reason: why it first did not; else empty.
    """

    steps: int
    located: int
    error: float
    reason: str


def rehearse(first: FirstView, noise: float, steps: int = STEPS) -> Rehearsal:
    """Track the grasp through small motions of its first image.

    The image is freed of its noise first: it would come along, and pass for a surface of the object and of the ground.

    Args:
        first: the view, with a reference.
        noise: grey levels, standard deviation of a pixel.
        steps: motions.
    """
    reference, observer = first.reference, first.observer
    assert reference is not None
    search = Search(observer, reference, first.others)
    belief = Belief(reference, search)
    rng = np.random.default_rng(0)
    source = denoised(first.colours, noise)
    middle = 0.5 * np.array([first.grey.shape[1] - 1.0, first.grey.shape[0] - 1.0])
    errors, reason = [], ""
    for H in course(steps, np.array(reference.centre), reference.size, middle):
        grey = observer.look(restaged(source, H, noise, rng))
        found = belief.find(grey, None)
        try:
            if found is not None:
                reference.carried_back(found.carried.transfer.grasp.contacts, found.homography)
        except (GraspError, ConditioningError) as problem:
            belief.reasons.insert(0, str(problem))
            found = None
        if found is None:
            reason = reason or next(iter(belief.reasons), "the object was not found")
            search.lost(grey)
            continue
        belief.accept(found)
        off = found.carried.transfer.grasp.contacts - apply_homography(H, reference.grasp.contacts)
        errors.append(float(np.hypot(*off.T).max()))
    error = float(np.sqrt(np.mean(np.square(errors)))) if errors else float("nan")
    return Rehearsal(steps, len(errors), error, reason)
