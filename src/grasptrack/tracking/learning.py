# SPDX-License-Identifier: Apache-2.0
"""What an image teaches of an object, and what remains known of it without: the only changes of a `TrackState`."""

import math

import numpy as np

from grasptrack import kernels
from grasptrack.errors import ConditioningError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.decision import Decision, squared_way
from grasptrack.tracking.evidence import (
    STILL_FROM,
    agreeing_share,
    astray_share,
    contact_testimony,
    outline_evidence,
    outline_surprisal,
    stands_at,
    texture_evidence,
)
from grasptrack.tracking.hypotheses import Predictions
from grasptrack.tracking.pose import (
    CONTINUOUS,
    Look,
    PoseEstimate,
    is_at,
    max_contact_distance,
    mean_point,
)
from grasptrack.tracking.state import SHORTEST_STEP, Coasting, TrackState, nothing_visible
from grasptrack.tracking.target import Grey
from grasptrack.typing import Floats

BLUR_RATE = 0.2
"""Share of a new measurement of the blur: shutters keep their time, hands do not keep their speed."""
SPREAD_RATE = 0.1
"""Share of a new measurement of the inner spread."""
LOOK_TO_SPREAD = 1.3
"""A standard deviation over the median of the inner side's differences, with some room."""
LEAST_INNER_SPREAD, MOST_INNER_SPREAD = 6.0, 30.0
"""Grey levels between which the inner spread stays."""
FAST_FROM = 3.0
"""Times as far as it takes to have moved, from which on a surface that still lies where the outline does is fast to it."""
MEMORY = 10
"""Images over which it is remembered what is usual, ..."""
FIRST_IMAGES = 2
"""... and images for which the likeness that noise allows counts before the first."""
UNSURE_PRESENCE = 0.5
"""Most that an image in which nothing was accepted tells of the object's presence."""
FOLLOWED_PRESENCE = 0.999
"""Presence from which on what shows another shape or surface is followed all the same, whatever risk is taken."""
MOSTLY_SEEN = 0.5
"""Share of the outline whose edge is seen, from which on a pose that is not exact in every way tells where the object is."""
STEADY = 0.5
"""Share of the larger of two motions in a row that the other one has at least, of what goes on its way."""
LEAST_WANDER = 0.05
"""What rests may be pushed: `TrackState.wander` is never less."""
LEAST_AGILITY = 0.01
"""Share of the process noise that always remains."""


def learn(state: TrackState, levels: list[Grey], decision: Decision, e: PoseEstimate, predictions: Predictions) -> None:
    """What an image teaches in which the object was located; all of it only if it was accepted.

    Args:
        state: of the object.
        levels: the image's pyramid.
        decision, e: what was found in it, and the decision's estimate.
        predictions: where it was expected.
    """
    target, numbers, steps = state.target, state.numbers, state.steps
    way = float(np.linalg.norm(target.pose_difference(state.last.G, e.G)))
    new = min(1.0, way / (numbers.new_view * target.size)) if math.isfinite(way) else 1.0
    state.alias, state.marks = decision.alias, decision.marks
    state.sightings.bare = max(state.sightings.bare, decision.bare)
    if decision.is_accepted and state.marks is not None and not stands_at(target, e.G, state.marks.G):
        state.marks = None
    _learn_motion(state, e, predictions)
    if not state.lost and (decision.is_accepted or e.edge_share > MOSTLY_SEEN):
        _learn_wander(state, e, predictions)
    rigid = state.shutter.follow_pose(target, e.G, e.bend, steps)
    px = math.sqrt(2.0 * float(((e.contacts - target.carried_contacts(state.last.G)) ** 2).mean()))
    moved = 0.0 if state.lost else px * target.size / math.sqrt(e.area) / max(steps, SHORTEST_STEP)
    state.moved = moved, state.moved[0]
    if not state.lost:
        repeated = target.handle.repeats(state.last.levels, state.last.G, levels, e.G)
        state.stale.add(repeated.way, repeated.change)
    state.last, state.visible, state.P = Look(levels, e.G), e.visible, e.P
    state.presence, state.coasting = _clamp(decision.presence, numbers.redetected, 1.0 - numbers.hazard), None
    state.expected, state.anchored, state.unseen, state.adrift, state.lost = e.G, True, 0.0, 0.0, 0
    state.leaving, state.left = False, 0
    if decision.is_accepted or decision.code == "outline-open":
        state.sightings.add(e.contacts, contact_testimony(state, e), state.last, e.visible, state.passed_s, numbers)
    else:
        state.sightings.pass_image(state.passed_s)
    if not decision.is_accepted:  # where it is, is known only roughly
        return
    _learn_shown(state, e)
    state.exchanged, state.sighted, state.gone = 0.0, None, False
    state.slope = math.sqrt(e.P[6, 6] + e.P[7, 7]) / (0.5 * target.size)
    state.located, state.light = state.last, e.light
    if state.plane.learn_view(rigid, e.P):
        state.nuisance[1:], state.nuisance_covariance[1:, 1:] = state.plane.theta_and_covariance()
    _learn_thickness(state, e, new)
    state.shutter.learn_readout(e.readout, e.readout_variance, new)
    _learn_looks(state, e)
    _learn_slip(state, e)
    if math.isfinite(e.edge_width):
        state.edge_width = e.edge_width
    if math.isfinite(e.blur):
        state.blur = e.blur
    if math.isfinite(e.blur_share):
        state.blur_share += BLUR_RATE * (e.blur_share - state.blur_share)
    if e.look > 0.0:
        spread = (1.0 - SPREAD_RATE) * state.inner_spread + SPREAD_RATE * LOOK_TO_SPREAD * e.look
        state.inner_spread = _clamp(spread, LEAST_INNER_SPREAD, MOST_INNER_SPREAD)


def lose(
    state: TrackState, levels: list[Grey], decision: Decision, predictions: Predictions, *, lookalike: bool
) -> None:
    """What remains known of an object that was not located.

    Args:
        state, levels, decision, predictions: as for `learn`.
        lookalike: the last look at it shows something just like it elsewhere.
    """
    state.lookalike = state.lookalike or lookalike
    state.marks = state.marks if decision.marks is None else decision.marks
    state.sightings.pass_image(state.passed_s)
    e, background = decision.estimate, predictions.background
    if not state.lost and state.velocity is not None:
        state.coasting = Coasting(state.last.G, state.velocity)
        if _away_from_rest(state, predictions.background) <= decision.tolerance:  # it rests, or may have
            state.coasting = None
    most = 1.0 - state.numbers.hazard if _moves_on(state, decision, predictions.background) else UNSURE_PRESENCE
    moved_on = state.moved_on()
    _note_leaving(state, background if state.coasting is None and state.anchored else moved_on, levels[0].shape)
    if state.coasting is not None and moved_on is not None:
        state.coasting = state.coasting._replace(steps=state.coasting.steps + state.steps)
    state.lost += 1
    if state.accepted:  # until a second image shows it, what contradicts the first outline may be that outline
        state.exchanged += decision.presence * (decision.exchanged - state.exchanged)
    state.velocity, state.elsewhere, state.confirmed = None, 0.0, 0.0
    state.shutter.forget_motion()
    # while something is followed that is more probably the object than another shape or surface, its place is known
    followed = decision.presence > FOLLOWED_PRESENCE and decision.probability_off < 0.5
    if e is not None and e.origin in CONTINUOUS and followed and decision.code in ("other-shape", "other-surface"):
        state.expected, state.anchored, state.unseen, state.adrift = e.G, True, 0.0, 0.0
        state.last, state.P, state.presence = Look(levels, e.G), e.P, UNSURE_PRESENCE
        state.visible = e.visible
        return
    state.visible = nothing_visible()
    # what shows its outline in its place has not left it, whatever else is wrong, but may have turned if that fits itself
    at_place = False
    if e is not None and decision.presence > FOLLOWED_PRESENCE and not state.target.turns:
        at_place = is_at(e, mean_point(state.target.carried_contacts(state.expected)))
    state.anchored = background is not None and (state.anchored or predictions.anew)
    if background is not None and state.anchored:
        state.expected = background
        state.last = Look(levels, background)
        if predictions.anew:
            state.unseen = state.wander * state.adrift
        state.unseen += 0.0 if at_place else state.wander * state.delay
        state.adrift = 0.0
    else:
        passed = 0.0 if at_place else max(1.0, state.steps)
        state.adrift += passed
        state.unseen += passed * state.pace
        state.last = Look(levels, state.last.G if e is None else e.G)
    state.presence = _clamp(decision.presence, state.numbers.redetected, most)
    if e is not None:
        state.P = e.P


def _note_leaving(state: TrackState, there: Floats | None, shape: tuple[int, ...]) -> None:
    """Whether what was lost in this image, or before, goes out of it: by its place (3, 3), None where that is not known."""
    if there is None:
        state.left += state.left > 0
        return
    (x, y), (height, width) = mean_point(state.target.carried_contacts(there)), shape
    if not state.lost:
        steady = min(state.moved) > STEADY * max(state.moved)  # a jump leads nowhere
        try:
            u, v = apply_homography(there if steady else state.last.G, state.target.outline).T
        except ConditioningError:
            return
        state.leaving = not (u.min() >= 0.0 and u.max() < width and v.min() >= 0.0 and v.max() < height)
    state.left = 0 if 0.0 <= x < width and 0.0 <= y < height else state.left + 1


def _moves_on(state: TrackState, decision: Decision, background: Floats | None) -> bool:
    """Whether what an image shows of a lost object lies where even motion has it, and moves against the ground.

    What looks like it in one place looks like it again and again, as the ground does that a camera passes: that makes it no
    surer. What leaves the ground under it, in an image by more than a contact may be off, shows itself anew.
    """
    e, coasted = decision.estimate, state.coasted()
    if e is None or coasted is None:
        return False
    near = math.dist(e.middle, mean_point(state.target.carried_contacts(coasted))) < decision.tolerance
    return near and _away_from_rest(state, background) > decision.tolerance


def _away_from_rest(state: TrackState, background: Floats | None) -> float:
    """px in a usual interval by which even motion leaves where the ground has a lost object, or where the last image has it."""
    coasted, coasting = state.coasted(), state.coasting
    if coasted is None or coasting is None:
        return 0.0
    rests = state.last.G if background is None else background
    steps = state.steps if background is None or not state.anchored else coasting.steps + state.steps
    there, resting = (mean_point(state.target.carried_contacts(G)) for G in (coasted, rests))
    return math.dist(there, resting) / max(steps, SHORTEST_STEP)


def _learn_motion(state: TrackState, estimate: PoseEstimate, predictions: Predictions) -> None:
    """How it moves; how far even motion and rest on the background are off."""
    target = state.target
    if predictions.even is not None:
        off = target.pose_difference(predictions.even, estimate.G)
        share = float(off**2 @ target.precision_of_motion) / len(off)
        if math.isfinite(share):
            state.moves += 1
            state.strays.add(squared_way(estimate, target.carried_contacts(predictions.even), state.numbers), 1.0)
            state.agility = _clamp(_updated_mean(state.agility, share, state.moves), LEAST_AGILITY, 1.0)
    if not state.lost:
        before = target.carried_contacts(state.last.G)
        state.ways.add(squared_way(estimate, before, state.numbers) / max(state.steps, SHORTEST_STEP) ** 2, 1.0)
    usual, passed = math.log(state.usual_s or state.passed_s), math.log(state.passed_s)
    state.usual_s = math.exp(_updated_mean(usual, passed, state.accepted + 1))
    expected = predictions.first[0]
    if expected.origin == "texture":
        precision, off = np.linalg.inv(expected.P), target.pose_difference(expected.G, estimate.G)
        # of its eight freedoms those that the image itself has told
        state.flow_misfit.add(float(off @ precision @ off), len(off) - float((precision * estimate.P).sum()))
    velocity = target.pose_difference(state.last.G, estimate.G) / max(state.steps, SHORTEST_STEP)
    state.velocity_P = state.P + estimate.P
    state.velocity = velocity if not state.lost and math.isfinite(float(velocity @ velocity)) else None


def _learn_wander(state: TrackState, estimate: PoseEstimate, predictions: Predictions) -> None:
    """How far it left its place on the background; what is not known of both is no motion."""
    if predictions.background is None:
        return
    known = estimate.P if predictions.ground is None else estimate.P + predictions.ground.P
    away = math.dist(estimate.middle, mean_point(state.target.carried_contacts(predictions.background)))
    moved = away**2 / estimate.area - (known[2, 2] + known[5, 5]) / state.target.size**2
    state.wanders += 1
    share = math.sqrt(max(0.0, moved)) / state.numbers.travel
    state.wander = _clamp(_updated_mean(state.wander, share, state.wanders), LEAST_WANDER, 1.0)


def _updated_mean(mean: float, value: float, count: int) -> float:
    """A mean over the latest images, with the value of another one, the `count`-th."""
    return mean + (value - mean) * (1.0 / min(count, MEMORY))


def _learn_shown(state: TrackState, estimate: PoseEstimate) -> None:
    """How much of each sample of the outline is seen where it has left its first place: what stands there has not."""
    first, now = (apply_homography(G, state.target.points) for G in (state.target.A, estimate.G))
    moved = np.hypot(*(now - first).T) >= STILL_FROM
    if not len(state.shown_in):
        state.shown, state.shown_in = np.zeros(len(moved)), np.zeros(len(moved))
    state.shown_in = state.shown_in + moved
    state.shown = state.shown + moved * (estimate.visible - state.shown) / np.maximum(state.shown_in, 1.0)


def _learn_thickness(state: TrackState, estimate: PoseEstimate, new: float) -> None:
    """How thick the part is, by an accepted image of which the share `new` (0 to 1) is new.

    Information is averaged rather than added up: much the same view errs as the last one did.
    """
    before, after = float(state.nuisance_covariance[0, 0]), float(estimate.nuisance_covariance[0, 0])
    both = (1.0 - new) * after + new * before
    thickness = ((1.0 - new) * after * state.nuisance[0] + new * before * estimate.nuisance[0]) / both
    if not both > 0.0 or not math.isfinite(both) or not math.isfinite(thickness):
        return
    state.nuisance[0], state.nuisance_covariance[0, 0] = thickness, after * before / both
    if math.isfinite(estimate.sides) and thickness**2 > state.nuisance_covariance[0, 0]:  # there are sides
        state.sides += new * (estimate.sides - state.sides)


def _learn_slip(state: TrackState, estimate: PoseEstimate) -> None:
    """Whether the surface is fast to the outline: what moves by itself would seldom be found where the outline is."""
    numbers = state.numbers
    if estimate.slipped > 0.0:
        state.slip += math.log(estimate.slipped / (1.0 - estimate.slipped))
        return
    shown = min(outline_evidence(estimate, numbers), texture_evidence(state, estimate))
    agrees = 1.0 - astray_share(state, estimate) / numbers.contradicted
    if agrees <= 0.0 or shown < -math.log(numbers.risk):
        return
    moved = max_contact_distance(estimate.contacts, state.fast)
    if moved > FAST_FROM * STILL_FROM:
        state.slip, state.fast = state.slip + 2.0 * agrees * math.log(STILL_FROM / moved), estimate.contacts


def _learn_looks(state: TrackState, estimate: PoseEstimate) -> None:
    """How much of outline and patches usually looks as it did first: noise, reflections and blur make it less."""
    state.accepted += 1
    state.surfaces = texture_evidence(state, estimate), state.surfaces[0]
    share = 1.0 / (min(state.accepted, MEMORY) + FIRST_IMAGES)
    state.elsewhere = estimate.elsewhere if estimate.confirmed else min(state.elsewhere, estimate.elsewhere)
    strange = outline_surprisal(estimate, state.numbers)
    # the first images may show that the first outline is wrong; later, edges of something else are not what is usual
    if state.accepted <= FIRST_IMAGES or not estimate.astray > 0.0 or strange < state.strange:
        state.strange += (strange - state.strange) * share
    state.confirmed = min(state.confirmed, strange)
    agreeing = agreeing_share(estimate)
    if math.isfinite(agreeing):
        state.agreeing += (agreeing - state.agreeing) / state.accepted
    spreads = state.numbers.match_spread, state.numbers.chance_spread
    # noise that agrees by chance is not learned
    own = kernels.surface_probability(estimate.correlation, state.usual, *spreads)
    for usual, r, probability in zip(state.usual, estimate.correlation, own, strict=True):
        told = r * probability
        if state.accepted == 1:
            # what passed for texture in the first image, as JPEG's noise, shows itself in the second
            np.minimum(usual, told, out=usual, where=np.isfinite(r))
        np.add(usual, (told - usual) * share, out=usual, where=np.isfinite(r))


def _clamp(value: float, low: float, high: float) -> float:
    """A value within bounds; of one number NumPy's takes longer than all that it is the bound of."""
    return min(max(value, low), high)
