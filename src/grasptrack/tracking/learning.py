# SPDX-License-Identifier: Apache-2.0
"""What an image teaches: of an object that was located its motion, looks, light and camera; of another where it may be."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.tracking.decision import Decision, middle, strangeness
from grasptrack.tracking.estimator import CONTINUOUS, PoseEstimate
from grasptrack.tracking.hypotheses import Predictions
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.state import Look, TrackState
from grasptrack.tracking.target import Grey, Target

Floats = NDArray[np.float64]

MOST_SEEN = 0.7
"""Share of the outline that shows from which on what shows another shape lies in the place of the object."""
BLUR_KEPT = 0.2
"""Share of a new measurement of the blur: shutters keep their time, hands do not keep their speed."""
MEMORY = 10
"""Images over which it is remembered what is usual, ..."""
FIRST = 2
"""... and images for which the likeness that noise allows counts before the first."""
UNSURE = 0.5
"""Most that an image in which nothing was accepted tells of the object's presence."""
STILL = 0.05
"""Least wandering: what rests may be pushed."""
CALM = 0.01
"""Share of the process noise that always remains."""
MOST = 1.2
"""Of the log of the focal length, and of the normal's slopes: beyond it a view is not believable."""


def learn(
    target: Target,
    state: TrackState,
    levels: list[Grey],
    decision: Decision,
    estimate: PoseEstimate,
    predictions: Predictions,
    steps: float,
) -> None:
    """What an image teaches in which the object was located; all of it only if it was accepted.

    Args:
        target, state: of the object.
        levels: the image's pyramid.
        decision, estimate: what was found in it.
        predictions: where it was expected.
        steps: time since the last image in usual intervals.
    """
    numbers, e = target.numbers, estimate
    _learn_motion(target, state, e, predictions, steps)
    state.last = Look(levels, e.G)
    state.P = e.P
    state.presence = _between(decision.presence, numbers.redetected, 1.0 - numbers.hazard)
    state.expected, state.anchored, state.unseen, state.adrift, state.lost = e.G, True, 0.0, 0.0, 0
    if not decision.accepted:  # where it is, is known only roughly
        return
    state.exchanged, state.sighted, state.gone = False, None, False
    state.slope = math.sqrt(e.P[6, 6] + e.P[7, 7]) / (0.5 * target.size)
    state.located, state.light = state.last, e.light
    learn_camera(target, state, e, numbers)
    learn_thickness(state, e, numbers)
    _remember_looks(target, state, e)
    if math.isfinite(e.edge_width):
        state.edge_width = e.edge_width
    if math.isfinite(e.blur):
        state.blur = e.blur
    if math.isfinite(e.blur_share):
        state.blur_share += BLUR_KEPT * (e.blur_share - state.blur_share)
    if e.look > 0.0:
        state.inner_spread = _between(0.9 * state.inner_spread + 0.1 * 1.3 * e.look, 6.0, 30.0)


def lose(
    target: Target,
    state: TrackState,
    levels: list[Grey],
    decision: Decision,
    predictions: Predictions,
    steps: float,
) -> None:
    """What remains known of an object that was not located; arguments as for `learn`."""
    numbers, e, ground = target.numbers, decision.estimate, predictions.ground
    state.lost += 1
    seen = e is not None and bool(len(e.visible)) and float(np.mean(e.visible)) > MOST_SEEN
    state.exchanged = state.exchanged or (seen and decision.exchanged > 0.5 < decision.presence)
    state.velocity, state.elsewhere, state.confirmed = None, 0.0, 0.0
    # while something is followed that is more probably the object than another shape or surface, its place is known
    followed = decision.presence > 1.0 - numbers.risk and decision.probability_off < 0.5
    if e is not None and e.origin in CONTINUOUS and followed and decision.code in ("other-shape", "other-surface"):
        state.expected, state.anchored, state.unseen, state.adrift = e.G, True, 0.0, 0.0
        state.last, state.P, state.presence = Look(levels, e.G), e.P, UNSURE
        return
    state.anchored = state.anchored and ground is not None
    if ground is not None and state.anchored:
        state.expected = ground
        state.last = Look(levels, ground)
        state.unseen += state.wander
        state.adrift = 0.0
    else:
        state.adrift += max(1.0, steps)
        state.unseen += max(1.0, steps)
        state.last = Look(levels, state.last.G if e is None else e.G)
    # what looks like it elsewhere looks like it again and again: that makes it no surer
    state.presence = _between(decision.presence, numbers.redetected, UNSURE)
    if e is not None:
        state.P = e.P


def _learn_motion(
    target: Target, state: TrackState, estimate: PoseEstimate, predictions: Predictions, steps: float
) -> None:
    """How it moves; how far even motion and rest on the ground are off."""
    numbers, ground = target.numbers, predictions.ground
    if predictions.even is not None:
        off = target.handle.difference(predictions.even, estimate.G)
        share = float(off**2 @ target.precision_of_motion) / len(off)
        if math.isfinite(share):
            state.moves += 1
            rate = 1.0 / min(state.moves, MEMORY)
            state.agility = _between(state.agility + (share - state.agility) * rate, CALM, 1.0)
    if ground is not None and not state.lost:
        away = math.dist(estimate.middle, middle(target.carried(ground)))
        share = away / math.sqrt(estimate.area) / numbers.travel
        state.wanders += 1
        rate = 1.0 / min(state.wanders, MEMORY)
        state.wander = _between(state.wander + (share - state.wander) * rate, STILL, 1.0)
    velocity = target.handle.difference(state.last.G, estimate.G) / max(steps, 1e-3)
    state.velocity_P = state.P + estimate.P
    state.velocity = velocity if not state.lost and math.isfinite(float(velocity @ velocity)) else None


def learn_camera(target: Target, state: TrackState, estimate: PoseEstimate, numbers: Numbers) -> None:
    """A Kalman step on focal length and normal: an accepted pose must be a pinhole's view of a rigid plane."""
    height, width = state.last.levels[0].shape
    state.theta, state.theta_covariance = target.handle.learned_camera(
        estimate.G,
        estimate.P,
        state.theta,
        state.theta_covariance,
        float(width),
        float(height),
        numbers.pinhole_sd,
        numbers.camera_keep,
        MOST,
    )


def learn_thickness(state: TrackState, estimate: PoseEstimate, numbers: Numbers) -> None:
    """The part's height, from the share of this image's information that is new."""
    gained = max(0.0, 1.0 / estimate.thickness_variance - 1.0 / state.thickness_variance) * numbers.camera_keep
    total = 1.0 / state.thickness_variance + gained
    state.thickness += (estimate.thickness - state.thickness) * gained / total
    state.thickness_variance = 1.0 / total


def _remember_looks(target: Target, state: TrackState, estimate: PoseEstimate) -> None:
    """How much of outline and patches usually looks as it did first: noise, reflections and blur make it less."""
    state.accepted += 1
    share = 1.0 / (min(state.accepted, MEMORY) + FIRST)
    state.elsewhere = estimate.elsewhere if estimate.confirmed else min(state.elsewhere, estimate.elsewhere)
    strange = strangeness(estimate, target.numbers)
    state.strange += (strange - state.strange) * share
    state.confirmed = min(state.confirmed, strange)
    for usual, r in zip(state.usual, estimate.correlation, strict=True):
        if state.accepted == 1:
            # what passed for texture in the first image, as JPEG's noise, shows itself in the second
            np.minimum(usual, r, out=usual, where=np.isfinite(r))
        np.add(usual, (r - usual) * share, out=usual, where=np.isfinite(r))


def _between(value: float, low: float, high: float) -> float:
    """A value within bounds; of one number NumPy's takes longer than all that it is the bound of."""
    return min(max(value, low), high)
