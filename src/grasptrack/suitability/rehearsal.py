# SPDX-License-Identifier: Apache-2.0
"""The tracker on the image itself, moved a little and with fresh noise: where the truth is known, its error can be seen."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grasptrack.projective import apply_homography
from grasptrack.suitability.first import FirstView
from grasptrack.suitability.restaged import Stage, course

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


def rehearse(first: FirstView, stage: Stage, steps: int = STEPS) -> Rehearsal:
    """Follow the grasp through small motions of its first image.

    Args:
        first: the view, with a grasp that can be carried.
        stage: the same, to be moved.
        steps: motions.
    """
    assert first.carrier is not None
    view, contacts = first.candidate.view, first.held.contacts
    errors, reason = [], ""
    for H in course(steps, view.outer.points.mean(axis=0), math.sqrt(view.outer.area), stage.middle):
        moved = first.carrier.move(first.observer.look(stage.moved(H)), None)
        if moved.contacts is None:
            reason = reason or moved.reason.sentence
            continue
        off = moved.contacts - apply_homography(H, contacts)
        errors.append(float(np.hypot(*off.T).max()))
    error = float(np.sqrt(np.mean(np.square(errors)))) if errors else math.nan
    return Rehearsal(steps, len(errors), error, reason)
