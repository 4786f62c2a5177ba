# SPDX-License-Identifier: Apache-2.0
"""Where the object is expected: carried by its own texture, by the background, at rest, or moving on evenly."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.projective import apply_homography
from grasptrack.tracking.estimator import Hypothesis
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.state import TrackState, process_noise
from grasptrack.tracking.target import Grey, Target

Floats = NDArray[np.float64]

FEW = 8
"""Patches that a motion must rest on."""


class Predictions(NamedTuple):
    """Hypotheses to try at once, and those to try where none of them is accepted."""

    first: list[Hypothesis]
    second: list[Hypothesis]


def predict(target: Target, state: TrackState, levels: list[Grey], steps: float, numbers: Numbers) -> Predictions:
    """Hypotheses of continuity.

    Args:
        target, state: of the object.
        levels: the image's pyramid.
        steps: time since the last image in usual intervals.
        numbers: the core's.
    """
    Q = process_noise(target.size, numbers) * max(1.0, steps)
    rest = [Hypothesis("at rest", state.G, state.P + Q)]
    even = moving_on(state)
    if even is not None:
        rest.insert(0, Hypothesis("moving on", even, state.P + Q))
    flow = _flow(target, state, levels, rest, Q, numbers)
    if flow is not None:
        calm = None if even is None else Hypothesis("moving on", even, state.P + Q * state.agility)
        return Predictions([flow if calm is None else _joined(target, flow, calm)], rest)
    background = _background(target, state, levels)
    first = (
        [] if background is None else [Hypothesis("background", background, state.P + Q * (2 * numbers.predicted) ** 2)]
    )
    return Predictions(first + rest, [])


def moving_on(state: TrackState) -> Floats | None:
    """(3, 3) the pose that even motion leads to; None where the motion is not known."""
    if state.G_before is None or state.lost:
        return None
    G = state.G @ np.linalg.inv(state.G_before) @ state.G
    return np.asarray(G / G[2, 2], dtype=np.float64)


def _joined(target: Target, flow: Hypothesis, even: Hypothesis) -> Hypothesis:
    """What texture and even motion say together, where they agree."""
    d = target.difference(flow.G, even.G)
    S = flow.P + even.P
    if not np.isfinite(d).all() or d @ np.linalg.solve(S, d) > AGREE:
        return flow
    K = flow.P @ np.linalg.inv(S)
    P = flow.P - K @ flow.P
    return Hypothesis(flow.origin, target.handle.moved(flow.G, K @ d), 0.5 * (P + P.T))


AGREE = 20.1
"""Squared Mahalanobis distance of predictions that agree: 99 % of chi-squared with 8 degrees of freedom."""


def _flow(
    target: Target, state: TrackState, levels: list[Grey], starts: list[Hypothesis], Q: Floats, numbers: Numbers
) -> Hypothesis | None:
    """The last look's texture and corners laid on this image."""
    if len(target.corners) < FEW or state.lost:
        return None
    best = None
    wide = Q * 4.0
    for start in starts:
        found = target.handle.follow(
            state.last.levels, state.G, levels, start.G, wide, target.corners, target.corner_strides
        )
        if not found["valid"] or found["agreeing"] * len(target.corners) < FEW:
            continue
        if best is None or found["agreeing"] > best["agreeing"]:
            best = found
        if best["agreeing"] > 0.6:
            break
    if best is None or best["agreeing"] < 0.25:
        return None
    return Hypothesis("texture", best["G"], state.P + best["P"] + Q * numbers.predicted**2)


def _background(target: Target, state: TrackState, levels: list[Grey]) -> Floats | None:
    """(3, 3) where the object is if it lies still on its surroundings; None where they tell nothing."""
    scale = 1 if len(levels) == 1 else 2
    before, now = (look[scale - 1] for look in (state.last.levels, levels))
    try:
        outline = apply_homography(state.G, target.outline) / scale
    except ValueError:
        return None
    if np.abs(outline).max() > 1e4:
        return None
    size = float(np.sqrt(abs(cv2.contourArea(outline.astype(np.float32)))) + 1.0)
    inner = np.zeros(before.shape, np.uint8)
    cv2.fillPoly(inner, [np.round(outline).astype(np.int32)], 255)
    wide = int(min(151, 0.7 * size)) | 1
    ring = cv2.subtract(
        cv2.dilate(inner, np.ones((wide, wide), np.uint8)), cv2.dilate(inner, np.ones((7, 7), np.uint8))
    )
    points = cv2.goodFeaturesToTrack(before, 80, 0.02, 6, mask=ring)
    if points is None or len(points) < 12:
        return None
    window = {"winSize": (15, 15), "maxLevel": 3}
    there, found, _ = cv2.calcOpticalFlowPyrLK(before, now, points, None, **window)
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(now, before, there, None, **window)
    keep = (found[:, 0] == 1) & (found_back[:, 0] == 1) & (np.hypot(*(back - points)[:, 0].T) < 0.75)
    if keep.sum() < 12:
        return None
    H, inliers = cv2.findHomography(points[keep], there[keep], cv2.RANSAC, 1.0)
    if H is None or inliers.sum() < max(10, 0.4 * keep.sum()):
        return None
    D = np.diag([scale, scale, 1.0])
    G = D @ H @ np.linalg.inv(D) @ state.G
    return np.asarray(G / G[2, 2], dtype=np.float64)
