# SPDX-License-Identifier: Apache-2.0
"""Where the object is expected: carried by its own texture, by the background, at rest, or moving on evenly."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from grasptrack.kernels import seen_area
from grasptrack.tracking.decision import largest_sigma, worst_variance
from grasptrack.tracking.estimator import Hypothesis
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.target import Grey, Target
from grasptrack.typing import Floats

if TYPE_CHECKING:
    from grasptrack.tracking.state import Look, TrackState


FEW = 8
"""Patches that a motion must rest on."""


class Predictions(NamedTuple):
    """Hypotheses to try at once, and those to try where none of them is accepted; and where the ground has the object.

    Attributes:
        first, second: the likeliest first.
        ground: (3, 3), None where the ground tells nothing, or was not asked.
        even: (3, 3) where even motion has it; None where the motion is not known.
    """

    first: list[Hypothesis]
    second: list[Hypothesis]
    ground: Floats | None
    even: Floats | None


def predict_hypotheses(
    target: Target, state: TrackState, levels: list[Grey], steps: float, numbers: Numbers
) -> Predictions:
    """Hypotheses of continuity.

    Args:
        target, state: of the object.
        levels: the image's pyramid.
        steps: time since the last image in usual intervals.
        numbers: the core's.
    """
    Q = target.noise_of_motion * max(1.0, steps)
    free = state.P + Q
    rest = [Hypothesis("at rest", state.last.G, free)]
    if state.lost:  # what was found since was not believed, and what moves before the ground may have carried it along
        rest.append(Hypothesis("at rest", state.located.G, free))
    even = _moving_on(target, state, steps)
    if even is not None:
        rest.insert(0, Hypothesis("moving on", even, free))
    flow = None if state.lost else _align_last_look(target, state, levels, rest, Q, target.clear_corners(state.visible))
    first = []
    if flow is not None:
        hypothesis = Hypothesis("texture", flow["G"], state.P + flow["P"] + Q * numbers.predicted**2)
        first = [hypothesis]
        if even is not None:
            calm = Hypothesis("moving on", even, state.P + state.velocity_P + Q * state.agility)
            joined = _fuse_predictions(target, hypothesis, calm)
            # what moves over the object may have carried its texture along
            first = [hypothesis, calm] if joined is None else [joined]
    settled = flow is not None and _fixes_contacts(target, flow, numbers)
    if settled and state.accepted % GROUND:
        return Predictions(first, rest, None, even)
    ground = _align_last_look(target, state, levels, rest, Q, target.clear_ring(state.visible))
    if ground is None:
        return Predictions(first or rest, rest if first else [], None, even)
    # what rested on the ground rests on it still
    carried = Hypothesis("background", ground["G"], state.P + ground["P"] + Q * state.wander**2)
    if first and not settled:
        joined = _fuse_predictions(target, carried, first[0])
        first = first if joined is None else [joined]
    if first:
        return Predictions(first, [*rest, carried], ground["G"], even)
    return Predictions([carried, *rest], [], ground["G"], even)


def _fixes_contacts(target: Target, flow: dict[str, Any], numbers: Numbers) -> bool:
    """Whether its own texture tells where every contact is, as surely as an answer is asked for."""
    area = abs(seen_area(flow["G"], target.outline))
    most = worst_variance(target.handle.placed(flow["G"], flow["P"]).covariance)
    return math.sqrt(most) < largest_sigma(area, numbers)


GROUND = 4
"""Images after which it is asked anew whether the object rests on the ground, where its own texture tells its motion."""


def _moving_on(target: Target, state: TrackState, steps: float) -> Floats | None:
    """(3, 3) the pose that even motion leads to in so many usual intervals; None where the motion is not known."""
    if state.velocity is None or state.lost:
        return None
    return np.asarray(target.handle.moved(state.last.G, state.velocity * steps), dtype=np.float64)


def _fuse_predictions(target: Target, flow: Hypothesis, even: Hypothesis) -> Hypothesis | None:
    """What texture and even motion say together; None where they contradict each other."""
    distance, G, P = target.handle.joined(flow.G, flow.P, even.G, even.P)
    return Hypothesis(flow.origin, G, P) if distance <= AGREE else None


AGREE = 20.1
"""Squared Mahalanobis distance of predictions that agree: 99 % of chi-squared with 8 degrees of freedom."""


def _align_last_look(
    target: Target, state: TrackState, levels: list[Grey], starts: list[Hypothesis], Q: Floats, places: Floats
) -> dict[str, Any] | None:
    """The last look at some places (n, 2), work px, laid on this image; None where too few of them agree."""
    if len(places) < FEW:
        return None
    best = None
    wide = Q * 4.0
    for start in starts:
        found = target.handle.follow(
            state.last.levels, state.last.G, levels, start.G, wide, places, target.corner_strides
        )
        if not found["valid"] or found["agreeing"] * len(places) < FEW:
            continue
        if best is None or found["agreeing"] > best["agreeing"]:
            best = found
        if best["agreeing"] > PLENTY:
            break
    return None if best is None or best["agreeing"] < ENOUGH else best


PLENTY, ENOUGH = 0.6, 0.25
"""Shares of the places that agree on a motion for no other start to be tried, and for it to be believed at all."""


BESIDE = 0.06
"""Share of sqrt(area) from the outline at which object and ground are looked at."""
ALIKE = 3.0
"""Standard deviations within which a grey level is the ground's."""


def place_is_empty(target: Target, look: Look, levels: list[Grey], G: Floats) -> bool:
    """Whether an image shows, where the object is expected, the ground that was round it, and nothing in front of either.

    Args:
        target: the object.
        look: the last one at it.
        levels: the image's pyramid.
        G: (3, 3) where it is expected.
    """
    depth = max(4.0, BESIDE * target.size)
    sides = [target.points + sign * depth * target.normals for sign in (-1.0, 1.0)]
    inside, ground = (_sample_grey_levels(look.levels[0], look.G, points) for points in sides)
    inside_now, ground_now = (_sample_grey_levels(levels[0], G, points) for points in sides)
    if np.isfinite(ground).sum() < FEW or np.isfinite(inside_now + ground_now).mean() < 0.5:
        return False
    level = float(np.nanmedian(ground))
    spread = 1.4826 * float(np.nanmedian(np.abs(ground - level))) + target.noise + 2.0
    change = float(np.nanmedian(ground_now)) - level
    light = float(np.median(levels[-1])) - float(np.median(look.levels[-1]))
    if min(abs(change), abs(change - light)) > ALIKE * spread:  # a cover may be as even as the ground
        return False

    def of_ground(values: Floats, level: float) -> float:
        return float(np.mean(np.abs(values[np.isfinite(values)] - level) < ALIKE * spread))

    told_apart = of_ground(inside, level) < 0.5
    return told_apart and of_ground(ground_now, level + change) > 0.7 and of_ground(inside_now, level + change) > 0.8


def _sample_grey_levels(grey: Grey, G: Floats, points: Floats) -> Floats:
    """(n,) grey levels of an image (H, W) at work points (n, 2) seen through G (3, 3); NaN outside."""
    lam = points @ G[2, :2] + G[2, 2]
    x, y = ((points @ G[:2, :2].T + G[:2, 2]) / lam[:, None]).T
    height, width = grey.shape
    held = (lam > 0) & (x > -0.5) & (y > -0.5) & (x < width - 0.5) & (y < height - 0.5)
    out = np.full(len(points), np.nan)
    out[held] = grey[np.round(y[held]).astype(int), np.round(x[held]).astype(int)]
    return out
