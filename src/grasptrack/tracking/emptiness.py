# SPDX-License-Identifier: Apache-2.0
"""Whether the place of an object is seen without it: the ground beside its outline is still there, and goes on within."""

import math
from typing import NamedTuple

import numpy as np

from grasptrack.statistics import median_of_few, robust_sd
from grasptrack.tracking.decision import Decision
from grasptrack.tracking.evidence import MAX_EXPONENT, OUTLINE_PRIOR, SHARES_MISSING, USUAL_PRIOR, contact_testimony
from grasptrack.tracking.hypotheses import MIN_PLACES, align_look
from grasptrack.tracking.pose import Hypothesis, Look, max_contact_distance
from grasptrack.tracking.state import SEEN, TrackState
from grasptrack.tracking.target import Grey, Target
from grasptrack.typing import Bools, Floats

FARTHER = (1, 2, 4, 8)
"""How far apart samples along the outline are compared, as multiples of how far apart they lie across it."""
ROUNDING = 1.0
"""Grey levels by which every spread is larger: images are rounded, and no two are alike."""
STRAY = 0.1
"""Share of grey levels that follow no model."""
ANY_LEVEL = 1.0 / 256.0
"""Density of a grey level of which nothing is known."""


def has_gone_from(
    state: TrackState, place: Floats, levels: list[Grey], even: Floats | None, *, on_ground: bool = True
) -> bool:
    """Whether a place (3, 3) is seen without the object, and that to which it moves on: beyond the border none is.

    Args:
        state: of the object.
        place: where it would rest.
        levels: the image's pyramid.
        even: (3, 3) where even motion has it, if it was in the last image; None where its motion is not known.
        on_ground: whether the ground was followed, so that the place is that on which it was seen.
    """
    if not place_is_empty(state.target, state.located, levels, place, on_ground=on_ground):
        return False
    moved_on = state.moved_on() if state.lost else even
    return moved_on is None or place_is_empty(state.target, state.located, levels, moved_on, on_ground=False)


def place_is_empty(target: Target, look: Look, levels: list[Grey], G: Floats, *, on_ground: bool = True) -> bool:
    """Whether an image shows, where G (3, 3) has the object, more probably its empty place than the object or a cover."""
    return emptiness_log_odds(target, look, levels, G, on_ground=on_ground) > 0.0


def against_bare_contacts(decision: Decision, state: TrackState, levels: list[Grey]) -> Decision:
    """A decision against bare ground where a contact's part of the object was: what hides a contact covers it.

    If the ground on which it rests goes on there, what is followed is another body, with which the contact's part was taken
    for one. What was seen bare once stays told until the contact is seen again.

    Args:
        decision: of an image.
        state: of the object.
        levels: the image's pyramid.
    """
    e, sightings = decision.estimate, state.sightings
    if e is None or (state.lost and decision.evidence <= 0.0):  # nothing shows the object
        return decision
    if len(e.visible) != len(sightings.shown) or (contact_testimony(state, e) >= SEEN).all():
        return decision
    told, target, Q = sightings.bare, state.target, state.target.noise_of_motion
    rests = align_look(
        state, sightings.look, levels, [Hypothesis("background", e.G, Q)], Q, target.clear_ring(e.visible)
    )
    if rests and max_contact_distance(e.contacts, target.carried_contacts(rests.G)) < decision.tolerance:
        vanished = np.asarray((e.visible < SEEN) & (sightings.shown >= SEEN))
        told = max(told, emptiness_log_odds(target, sightings.look, levels, e.G, among=vanished))
    odds = state.numbers.apart * math.exp(min(MAX_EXPONENT, told))
    return decision.with_contact_apart(odds / (1.0 + odds), told)


class Sides(NamedTuple):
    """(n,) grey levels within the object's outline, beside it on the ground, and farther away, in one image."""

    inside: Floats
    ground: Floats
    farther: Floats


def emptiness_log_odds(
    target: Target, look: Look, levels: list[Grey], G: Floats, *, on_ground: bool = True, among: Bools | None = None
) -> float:
    """Log-odds of an empty place against the object, partly hidden or not, and against a cover; -inf where nothing is told.

    Where the place is empty, or shows the object, the ground beside it is what it was, but for light and for as much as it
    changes over the distance of two samples at most; within it is as the ground beside it now, or as the object was, or
    anything, if something else lies there. A cover has its own texture beside the outline and any grey level, and goes on
    within; so does other ground, in about the grey level that it had. What changes slowly, as light does, tells nothing of
    texture: compared are samples that lie as far apart along the outline as they do across it.

    Args:
        target: the object.
        look: the last one at it.
        levels: the image's pyramid.
        G: (3, 3) where it would be.
        on_ground: whether it lay on that very ground.
        among: (n,) the samples of the outline that are asked; None for all.
    """
    depth, rows = target.sides
    if among is not None:
        rows = [row[among] for row in rows]
    before = Sides(*(_sample_grey_levels(look.levels[0], look.G, row) for row in rows))
    now = Sides(*(_sample_grey_levels(levels[0], G, row) for row in rows))
    shown = np.isfinite(now.inside + now.ground)
    seen = shown & np.isfinite(before.inside + before.ground)
    if seen.sum() < MIN_PLACES or shown.sum() < 0.5 * np.isfinite(rows[0] + rows[1]).all(axis=1).sum():
        return -math.inf
    before, now = (Sides(*(values[seen] for values in image)) for image in (before, now))
    noise, middle = target.noise + ROUNDING, median_of_few(before.ground)
    texture = robust_sd(before.ground - middle, median_of_few) + noise
    light = float(np.median(levels[-1]) - np.median(look.levels[-1]))
    change = median_of_few(now.ground - before.ground)
    off = now.ground - before.ground - change
    carried = robust_sd(off, median_of_few) + noise
    most = math.sqrt(2.0) * _change_across(before, texture, noise)
    step = max(1, round(2.0 * depth / target.spacing))

    as_ground, as_cover = np.ones(len(off)), np.ones(len(off))
    for times in FARTHER:  # the farther apart, the fewer of them are independent
        lag = min(times * step, len(off) // 2)
        changed, varies = (values - np.roll(values, lag) for values in (off, now.ground))
        as_cover *= _density(varies, robust_sd(varies, median_of_few) + noise) ** (1.0 / times)
        as_ground *= _density(changed, min(robust_sd(changed, median_of_few) + noise, most)) ** (1.0 / times)
    if not on_ground:
        as_ground = as_cover
    goes_on = _density(now.inside - now.ground, _change_across(now, texture, noise))
    darker = min(1.0, median_of_few(now.ground) / max(middle, 1.0))
    beside = before.inside * now.ground / np.maximum(before.ground, ROUNDING)  # where a lamp wanders
    lit = [_density(now.inside - each, carried) for each in (before.inside + change, darker * before.inside, beside)]
    as_object = max(lit, key=lambda density: float(np.log(density).sum()))
    covered, shares = as_cover * goes_on, SHARES_MISSING[:, None]

    def log_mixture(own: Floats, log_prior: Floats) -> float:
        told = target.numbers.temper * np.log((1.0 - shares) * own + shares * covered).sum(axis=1)
        return float(np.logaddexp.reduce(told + log_prior))

    # of samples that were seen and are no more a cover hides all or few
    hidden = USUAL_PRIOR if among is None else OUTLINE_PRIOR
    empty = log_mixture(as_ground * goes_on, OUTLINE_PRIOR)
    present = float(
        np.logaddexp(log_mixture(as_ground * as_object, hidden), log_mixture(as_ground * ANY_LEVEL, hidden))
    )
    same_level = _log_normal_density(min(abs(change), abs(change - light)), texture)
    cover = log_mixture(as_ground * goes_on, USUAL_PRIOR[::-1]) + math.log(ANY_LEVEL) - same_level
    return empty - float(np.logaddexp(present, cover))


def _change_across(image: Sides, texture: float, noise: float) -> float:
    """Spread of how much the ground changes between samples away from the object: its `texture`, if too few are seen."""
    across = (image.ground - image.farther)[np.isfinite(image.farther)]
    return (
        robust_sd(across - median_of_few(across), median_of_few) + noise
        if len(across) > MIN_PLACES
        else texture + noise
    )


def _log_normal_density(deviation: float, spread: float) -> float:
    return -0.5 * (deviation / spread) ** 2 - math.log(spread * math.sqrt(2.0 * math.pi))


def _density(deviation: Floats, spread: float) -> Floats:
    """(n,) of deviations (n,) that are normal, but for a share of them."""
    normal = np.exp(-0.5 * (deviation / spread) ** 2) / (spread * math.sqrt(2.0 * math.pi))
    return np.asarray((1.0 - STRAY) * normal + STRAY * ANY_LEVEL)


def _sample_grey_levels(grey: Grey, G: Floats, points: Floats) -> Floats:
    """(n,) grey levels of an image (H, W) at work points (n, 2) seen through G (3, 3); NaN outside."""
    lam = points @ G[2, :2] + G[2, 2]
    x, y = ((points @ G[:2, :2].T + G[:2, 2]) / lam[:, None]).T
    height, width = grey.shape
    held = (lam > 0) & (x > -0.5) & (y > -0.5) & (x < width - 0.5) & (y < height - 0.5)
    out = np.full(len(points), np.nan)
    out[held] = grey[np.round(y[held]).astype(int), np.round(x[held]).astype(int)]
    return out
