# SPDX-License-Identifier: Apache-2.0
"""Where the object is expected: by its own texture, the background, rest or even motion."""

import math
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack.kernels import PoseFlow, seen_area
from grasptrack.tracking.evidence import (
    Agreement,
)
from grasptrack.tracking.patches import LEAST_NOISE
from grasptrack.tracking.pose import (
    Hypothesis,
    Look,
    PoseEstimate,
    contact_tolerance,
    distinct_hypotheses,
    largest_sigma,
    max_contact_distance,
    sane_area,
    share_in_view,
    worst_variance,
)
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Grey
from grasptrack.typing import Floats

MIN_PLACES = 8
"""Patches that a motion must rest on."""
ALL_AGREE, PLENTY_AGREE, ENOUGH_AGREE = 0.9, 0.6, 0.25
"""Shares of the places that agree on a motion for no other start to be tried, none to be likelier, and it to be believed."""
AGREE_BY_CHANCE = 0.1
"""Share of a surface's patches that agrees with another surface in its place; of exchanged parts 0 to 0.11 do."""
MOST_BY_CHANCE = 0.999
"""Share of the places that agrees by chance, at most, where the logarithm of the rest is taken."""
WIDER_START = 4.0
"""By which the variance of a frame's motion is taken larger where a look is laid on the next image."""
BACKGROUND_EVERY = 4
"""Usual intervals after which it is asked anew whether the object rests on the ground, where its texture tells its motion."""
AGREE_DISTANCE = 20.1
"""Squared Mahalanobis distance of predictions that agree: 99 % of chi-squared with 8 degrees of freedom."""
LEAST_SHARE = 1e-12
"""Of the largest variance, that along an axis at least, where a covariance is inverted."""


class Predictions(NamedTuple):
    """Hypotheses to try at once, and those to try where none of them is accepted; and where the background has the object.

    Attributes:
        first, second: the likeliest first.
        background: (3, 3), None where the background tells nothing, or was not asked.
        ground: of the background, as far as this image tells.
        anew: the background has been found again after it was lost with the object.
        even: (3, 3) where even motion has it; None where the motion is not known.
    """

    first: list[Hypothesis]
    second: list[Hypothesis]
    background: Floats | None
    even: Floats | None
    ground: PoseFlow | None = None
    anew: bool = False


def predict_hypotheses(state: TrackState, levels: list[Grey]) -> Predictions:
    """Hypotheses of continuity.

    Args:
        state: of the object, `steps` before the image.
        levels: the image's pyramid.
    """
    target, numbers = state.target, state.numbers
    Q = target.noise_of_motion * max(1.0, state.steps)
    free = state.P + Q
    rest = [Hypothesis("at rest", state.last.G, free)]
    if state.lost:
        # what was found since was not believed, and what moves before the background may have carried it along
        rest.append(Hypothesis("at rest", state.located.G, free))
        if (coasted := state.coasted()) is not None:
            rest.append(Hypothesis("moving on", coasted, free))
    even = None
    if state.velocity is not None and not state.lost:
        even = np.asarray(target.handle.moved(state.last.G, state.velocity * state.steps), dtype=np.float64)
        even = even if sane_area(target, even) else None  # over a long gap it may have turned to the plane's back
    if even is not None:
        rest.insert(0, Hypothesis("moving on", even, free))
    shifted, apart = shifted_with_image(state.last, levels)
    jerked = max_contact_distance(target.carried_contacts(shifted), target.carried_contacts(rest[0].G)) > apart
    background, starts = None, rest
    if jerked:
        background = ground_gone_far(state, levels, [Hypothesis("at rest", shifted, free), *rest], Q)
    if background is not None:
        starts = [rest[0], Hypothesis("background", background.G, free), *rest[1:]]
    flows = list[PoseFlow]()
    if not state.lost:
        flows = align_looks(state, state.last, levels, starts, Q, target.clear_corners(state.visible))
    first = []
    for flow in flows:
        # without noise of a camera's own an encoder has changed the images
        step = flow.P * max(1.0, state.flow_misfit.value)
        far = state.P + step if target.noise > LEAST_NOISE else add_alike(state.P, step)
        first.append(Hypothesis("texture", flow.G, far + Q * numbers.predicted**2 + np.diag(state.surface_lag)))
    if first and even is not None:
        calm = Hypothesis("moving on", even, state.P + state.velocity_P + Q * state.agility)
        joined = _fuse_predictions(state, first[0], calm)
        # what moves over the object may have carried its texture along
        first[:1] = [first[0], calm] if joined is None else [joined]
    first = distinct_hypotheses(target, first)
    settled = bool(flows) and _fixes_contacts(state, flows[0])
    among_equals = len(state.equals) > 0  # of which one may look as the object would where it was looked for
    seldom = state.accepted % BACKGROUND_EVERY and state.delay < BACKGROUND_EVERY
    if settled and seldom and not jerked and not among_equals and not target.slides:
        return Predictions(first, rest, None, even)
    if not jerked:
        background = align_look(state, state.last, levels, rest, Q, target.clear_ring(state.visible))
    if background is None:
        return Predictions(first or rest, rest if first else [], None, even)
    # what rested on the background rests on it still
    carried = Hypothesis("background", background.G, state.P + background.P + Q * state.wander**2)
    if first and not settled:
        joined = _fuse_predictions(state, carried, first[0])
        first = first if joined is None else [joined, *first[1:]]
    rests = state.wander < numbers.predicted
    if jerked and rests and first:  # its texture may have been found on what looks like it
        return Predictions(distinct_hypotheses(target, [carried, *first]), rest, carried.G, even, background)
    if first:
        return Predictions(first, [*rest, carried], carried.G, even, background)
    return Predictions([carried, *rest], [], carried.G, even, background)


def add_alike(P: Floats, step: Floats) -> Floats:
    """(8, 8) covariance of an error and of a step's that goes the same way: standard deviations add up, not variances.

    What the motion of a surface errs by, where an encoder carries blocks along, is alike from image
    to image. The sum is P + step + 2 (P # step), with the geometric mean of both.
    """
    variances, axes = np.linalg.eigh(P)
    sd = np.sqrt(np.maximum(variances, LEAST_SHARE * variances[-1]))
    L, inverse = axes * sd, (axes / sd).T
    shares, V = np.linalg.eigh(inverse @ step @ inverse.T)
    spread = (L @ V) * (1.0 + np.sqrt(np.maximum(shares, 0.0)))
    return np.asarray(spread @ spread.T, dtype=np.float64)


def _fixes_contacts(state: TrackState, flow: PoseFlow) -> bool:
    """Whether its own texture tells where every contact is, as surely as an answer is asked for."""
    covariance = state.target.handle.placed(flow.G, flow.P)[1]
    area = abs(seen_area(flow.G, state.target.outline))
    return math.sqrt(worst_variance(covariance)) < largest_sigma(area, state.numbers)


def _fuse_predictions(state: TrackState, flow: Hypothesis, even: Hypothesis) -> Hypothesis | None:
    """What texture and even motion say together; None where they contradict each other."""
    distance, G, P = state.target.handle.joined(flow.G, flow.P, even.G, even.P)
    return Hypothesis(flow.origin, G, P) if distance <= AGREE_DISTANCE else None


def located_ground(state: TrackState, levels: list[Grey]) -> PoseFlow | None:
    """Where the ground has what was located last, whatever lies there since; None where it is not seen in both images."""
    Q = state.target.noise_of_motion * max(1.0, state.steps)
    look = state.located
    starts = [Hypothesis("background", G, Q) for G in (state.expected, look.G, shifted_with_image(look, levels)[0])]
    return align_look(state, look, levels, starts, Q, state.target.ring)


def ground_gone_far(state: TrackState, levels: list[Grey], starts: list[Hypothesis], Q: Floats) -> PoseFlow | None:
    """The ground where the image went as a whole, the first start; None where it may lie elsewhere, too.

    A pattern that repeats goes by its pitch unseen, and so does a row of equals: where the ground shows nearly as much of the
    last look at other starts, or by the way to an equal farther, nothing tells which it is.
    """
    numbers, ring = state.numbers, state.target.clear_ring(state.visible)
    steps = [np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]]) for e in state.equals for x, y in (e, -e)]
    beside = [Hypothesis(starts[0].origin, starts[0].G @ step, starts[0].P) for step in steps]
    starts = [*starts, *beside]
    found = [flow for start in starts for flow in align_looks(state, state.last, levels, [start], Q, ring)]
    if not found:
        return None
    best = max(found, key=lambda flow: flow.agreeing)
    contacts, n = state.target.carried_contacts(best.G), len(ring) * share_in_view(state.last.G, ring, levels[0])
    tolerance = contact_tolerance(abs(seen_area(best.G, state.target.outline)), numbers)
    others = [f for f in found if max_contact_distance(contacts, state.target.carried_contacts(f.G)) >= tolerance]
    # ground that went out of view may be the one, though nothing of it can be laid on the image
    unseen = any(len(ring) * share_in_view(start.G, ring, levels[0]) < MIN_PLACES for start in starts)
    for rival in [*(flow.agreeing for flow in others), *([ENOUGH_AGREE] if unseen else [])]:
        told = numbers.temper * Agreement(best.agreeing * n, n).log_odds(min(rival, MOST_BY_CHANCE))
        if told < -math.log(numbers.risk):
            return None
    return best


def surface_goes_on(state: TrackState, levels: list[Grey], estimate: PoseEstimate) -> float:
    """Log odds that the surface at an estimate is what the last image showed of the object: more of its patches agree, and
    there, than do by chance."""
    target, last = state.target, state.last
    agreeing = places = 0.0
    for _, centres, stride in target.recipe.textures[: len(estimate.correlation)]:
        strides = np.array([stride], dtype=np.float64)
        flow = target.handle.follow(last.levels, last.G, levels, estimate.G, estimate.P, centres, strides)
        limit = contact_tolerance(estimate.area, state.numbers)
        there = flow.valid and max_contact_distance(target.carried_contacts(flow.G), estimate.contacts) < limit
        agreeing, places = agreeing + there * flow.agreeing * len(centres), places + len(centres)
    return state.numbers.temper * Agreement(agreeing, places).log_odds(AGREE_BY_CHANCE) if places else 0.0


@cache
def hanning_window(width: int, height: int) -> Floats:
    """(H, W) by which an image fades towards its borders, so that they are no edges to a phase correlation."""
    return np.asarray(cv2.createHanningWindow((width, height), cv2.CV_32F))


def shifted_with_image(look: Look, levels: list[Grey]) -> tuple[Floats, float]:
    """The pose (3, 3) of a look at the object, had it gone as the image did as a whole, and how many px that may be off.

    A phase correlation of small images: a hand that jerks carries everything along, farther than patches find their own motion.
    Beyond some 10 px they find what looks like them. Where the ground shows nothing, an equal may have shifted the image.
    """
    before, now = (pyramid[-2:][0].astype(np.float32) for pyramid in (look.levels, levels))
    (x, y), _ = cv2.phaseCorrelate(before, now, hanning_window(*before.shape[::-1]))
    right, down = levels[0].shape[1] / before.shape[1], levels[0].shape[0] / before.shape[0]
    T = np.array([[1.0, 0.0, x * right], [0.0, 1.0, y * down], [0.0, 0.0, 1.0]])
    return np.asarray(T @ look.G, dtype=np.float64), max(right, down)


def align_look(
    state: TrackState, look: Look, levels: list[Grey], starts: list[Hypothesis], Q: Floats, places: Floats
) -> PoseFlow | None:
    """A look at some places (n, 2), work px, laid on this image; None where too few agree, or it would not be in front."""
    return next(iter(align_looks(state, look, levels, starts, Q, places)), None)


def align_looks(
    state: TrackState, look: Look, levels: list[Grey], starts: list[Hypothesis], Q: Floats, places: Floats
) -> list[PoseFlow]:
    """All that `align_look` may mean, the likeliest first: near what looks alike many places agree, too."""
    if len(places) < MIN_PLACES:
        return []
    found: list[PoseFlow] = []
    wide, target = Q * WIDER_START, state.target
    for start in starts:
        flow = target.handle.follow(look.levels, look.G, levels, start.G, wide, places, target.corner_strides)
        agree = flow.valid and flow.agreeing * len(places) >= MIN_PLACES and flow.agreeing >= ENOUGH_AGREE
        if agree and seen_area(flow.G, target.outline) > 0.0:
            found.append(flow)
            if flow.agreeing > ALL_AGREE:
                break
    plenty = [flow for flow in found if flow.agreeing > PLENTY_AGREE]
    return sorted(found, key=lambda flow: (flow not in plenty[:1], -flow.agreeing))
