# SPDX-License-Identifier: Apache-2.0
"""The probability that an answer is off, or another object: the only place where "located" is decided."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from grasptrack.equality import compared_by_value
from grasptrack.kernels import PoseFlow, seen_area
from grasptrack.kernels.results import SurfaceEvidence
from grasptrack.tracking.evidence import (
    apart_probability,
    departure_probability,
    fixed_probability,
    missing_evidence,
    other_surface_odds,
    outline_evidence,
    outline_open_probability,
    slip_probability,
    surface_evidence,
    texture_evidence,
    unoccluded_evidence,
    wrong_object_probability,
)
from grasptrack.tracking.numbers import NUMBERS, Numbers
from grasptrack.tracking.pose import (
    PLACE_FREEDOMS,
    SAME_PLACE,
    TRIED,
    TURNED,
    FixedMarks,
    PoseEstimate,
    contact_tolerance,
    is_at,
    max_contact_distance,
    mean_point,
    worst_variance,
)
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Target
from grasptrack.typing import Bools, Floats

CODES = (
    "not-found",
    "not-there",
    "other-place",
    "uncertain",
    "other-shape",
    "other-surface",
    "apart",
    "outline-open",
    "image-fixed",
    "ambiguous",
    "strategy-off",
    "lookalike",
)
"""Reasons for which an answer is not given. `messages` makes sentences of them."""
ANYWHERE_STEPS = 1e6
"""Frames of free motion after which an object may be anywhere, turned in any way."""
SEEN_LIKE = 0.5
"""Probability that what looks just like the object is its equal, once one was seen and the object was not for a while."""
SAME_ODDS = math.log(20.0)
"""Odds within which estimates of one answer are as good."""
LEAST_DEPTH = 0.1
"""Of a plane that is extended far beyond what was seen of it, relative to its depth where the object is expected."""
DEPTH_POWER = 1.5
"""sqrt(area) of a piece of a plane goes with its depth to minus this power."""
LEAST_SD = 1e-3
"""px, below which no contact's standard deviation is taken."""


@compared_by_value
@dataclass(frozen=True)
class Decision:
    """What is decided of one image.

    Attributes:
        estimate: the best pose; None where there is none.
        probability_off: that a contact is off by more than the tolerance, or that it is another object.
        presence: that the object is there and the pose is its own, in the coarse.
        sigma: px, of the worst contact.
        tolerance: px.
        exchanged: probability that something else lies in its place.
        evidence: log-likelihood ratio of the estimate, against nothing of its kind.
        doubt: what most of that probability stands for, one of `CODES`.
        figures: the numbers that go with it, by name.
        rival: the most probable of the estimates that put a contact elsewhere.
        rival_share: probability of the contacts where the rival has them.
        risk: probability from which on the estimate is not accepted.
        alias: probability that an equal of the object is followed.
        marks: what is fixed in the image and was taken for the object's surface; None where nothing was.
        bare: log-odds that where a contact's part was there is bare ground, and no cover.
    """

    estimate: PoseEstimate | None
    probability_off: float
    presence: float
    sigma: float
    tolerance: float
    exchanged: float
    evidence: float
    doubt: str
    figures: dict[str, float]
    rival: PoseEstimate | None = None
    rival_share: float = 0.0
    risk: float = NUMBERS.risk
    alias: float = 0.0
    marks: FixedMarks | None = None
    bare: float = -math.inf

    @property
    def is_accepted(self) -> bool:
        """Whether the contacts may be given out. Nothing but the probability decides it."""
        return self.probability_off < self.risk

    @property
    def code(self) -> str:
        """Why they may not, one of `CODES`; empty when they may."""
        return "" if self.is_accepted else self.doubt

    @property
    def confidence(self) -> float:
        """The complement of the probability, 0 to 1, but never more than scenes have shown; 0 where nothing was found."""
        return 1.0 - max(self.probability_off, NUMBERS.untested)

    def with_risk(self, risk: float) -> Decision:
        """The same by another risk."""
        return self if risk == self.risk else replace(self, risk=risk)

    def with_alias(self, probability: float, doubt: str = "lookalike") -> Decision:
        """The same where what was found may be an equal of the object with a probability, or one like it by that doubt."""
        more = probability > max(self.probability_off, self.alias)
        off, alias = any_of(self.probability_off, probability), any_of(self.alias, probability)
        return replace(self, probability_off=off, alias=alias, doubt=doubt if more else self.doubt)

    def with_contact_apart(self, probability: float, bare: float) -> Decision:
        """The same where a contact's part has left the object with a probability, bare ground showing by log-odds."""
        off = any_of(self.probability_off, probability)
        found = replace(self, probability_off=off, bare=bare)
        if probability <= self.probability_off:
            return found
        return replace(found, doubt="apart", figures={"probability_off": off, "probability": probability})

    def among_several(self, share: float) -> Decision:
        """The same where it is one of several answers between which nothing decides, with its share of the probability."""
        doubt = self.doubt if self.probability_off > 1.0 - share else "ambiguous"
        return replace(self, probability_off=any_of(self.probability_off, 1.0 - share), doubt=doubt)


NOTHING = Decision(None, 1.0, 0.0, math.inf, 0.0, 0.0, 0.0, "not-found", {})
"""Of an image in which no pose was found."""


# --- what is expected -----------------------------------------------------------------------------


class Expected(NamedTuple):
    """What continuity says of an image before it is looked at.

    Attributes:
        contacts: (k, 2) px where it has the object.
        presence: prior probability that the object is there.
        steps: how long it may have gone unseen, in frames of free motion.
        size: how large it would be anywhere in the image; None where that is not known.
        taken: as `steps`, if what hid it took it along.
        coasting: (k, 2) px where it had the contacts if it moved on evenly after it was lost; None where that is not known.
        strayed: how far it may have left that, in what an unseen object goes in a frame.
        turned: log of the prior of what may have turned so, instead of place, turn and size.
        on_ground: whether the ground has them there, and that place was not seen without it.
        unseen: as `steps`, had its place not been seen without it; 0 where no image before showed it.
        goes_on: log odds that what lies at an estimate shows what lay there in the last image; None where it was lost then.
    """

    contacts: Floats
    presence: float
    steps: float
    size: ExpectedSize | None = None
    taken: float = 0.0
    coasting: Floats | None = None
    strayed: float = 0.0
    turned: Callable[[PoseEstimate], float] | None = None
    on_ground: bool = False
    unseen: float = 0.0
    goes_on: Callable[[PoseEstimate], float] | None = None


class ExpectedSize(NamedTuple):
    """How large an object would be that lies where it lay, or elsewhere in that plane.

    An object may go and turn, but what changes its size is above all the camera.

    Attributes:
        area: px^2 of the outline at the pose that is expected.
        depth: that of the plane at px (x, y, 1), up to a factor: the last row of the inverse pose.
        slope: sd of the change of depth, as a share, over half its size.
        spread: sd of the log of its size at the expected place.
    """

    area: float
    depth: tuple[float, float, float]
    slope: float
    spread: float

    @classmethod
    def of(cls, target: Target, G: Floats, slope: float, spread: float) -> ExpectedSize | None:
        """That of an object at a pose (3, 3); None where it is not to be seen."""
        area, ((a, b, _), (c, d, _), (e, f, _)) = abs(seen_area(G, target.outline)), G.tolist()
        return cls(area, (c * f - d * e, b * e - a * f, a * d - b * c), slope, spread) if area > 0.0 else None

    def squared_deviation(self, estimate: PoseEstimate, here: tuple[float, float], there: tuple[float, float]) -> float:
        """The square of an estimate's deviation from the expected size in sd; it lies there, and is expected here, px."""
        (u, v), (x, y), (a, b, c) = here, there, self.depth
        away = math.hypot(x - u, y - v) / math.sqrt(self.area) * 2.0
        depth = max((a * x + b * y + c) / (a * u + b * v + c), LEAST_DEPTH)
        size = 0.5 * math.log(estimate.area / self.area) - DEPTH_POWER * math.log(depth)
        return (size / math.hypot(self.spread, DEPTH_POWER * self.slope * away)) ** 2


def squared_way(estimate: PoseEstimate, contacts: Floats, numbers: Numbers) -> float:
    """How far an estimate is from contacts (k, 2) px in place and turn: squares of what an object goes in a frame unseen."""
    # number by number: of so few NumPy's calls would cost more
    (x, y), (u, v) = estimate.middle, mean_point(contacts)
    across = along = 0.0
    for (ax, ay), (bx, by) in zip(estimate.contacts.tolist(), contacts.tolist(), strict=True):
        across += (bx - u) * (ay - y) - (by - v) * (ax - x)
        along += (ax - x) * (bx - u) + (ay - y) * (by - v)
    turn, away = math.atan2(across, along), (x - u) ** 2 + (y - v) ** 2
    return float(away / (numbers.travel**2 * estimate.area) + (turn / numbers.turn) ** 2)


def place_prior(estimate: PoseEstimate, expected: Expected, numbers: Numbers) -> float:
    """Log of the prior of a pose's place, turn and size: how far it is from what is expected."""
    if expected.turned is not None and estimate.origin in (TURNED, TRIED):
        return expected.turned(estimate)
    (x, y), (u, v) = estimate.middle, mean_point(expected.contacts)
    way = squared_way(estimate, expected.contacts, numbers)
    nu, size = numbers.prior_freedom, 0.0
    if expected.size is not None:
        size = expected.size.squared_deviation(estimate, (u, v), (x, y))

    def log_density(way: float, steps: float) -> float:
        return -0.5 * (nu + PLACE_FREEDOMS) * math.log1p((way / steps**2 + size) / nu)

    density = log_density(way, expected.steps)
    if expected.taken > expected.steps:
        density = _log_add_exp(density, math.log(numbers.taken) + log_density(way, expected.taken))
    if expected.coasting is not None:
        strayed = log_density(squared_way(estimate, expected.coasting, numbers), expected.strayed)
        density = _log_add_exp(math.log(numbers.taken) + density, strayed)
    return density


def lookalike_probability(state: TrackState, estimate: PoseEstimate, expected: Expected) -> float:
    """Probability that something just like the object lies where an estimate has it, and not the object.

    What took the place of an object that rested on the ground seldom lies there as exactly.
    """
    unseen = state.numbers.lookalike
    if not (state.lookalike or state.beside or state.is_outside):
        return unseen
    which_is_open = state.lost and state.lookalike and state.carried_by_belt() is None
    went_on = state.has_left and state.coasting is not None  # beyond where the ground has it
    if is_at(estimate, mean_point(expected.contacts)) and not (which_is_open or went_on):
        return unseen
    left = departure_probability(expected.steps, state.numbers) if state.lookalike else 1.0
    if expected.on_ground:
        way = squared_way(estimate, expected.contacts, state.numbers) + state.wander**2
        left *= min(1.0, way * (state.numbers.travel / SAME_PLACE) ** 2)
    return max(unseen, SEEN_LIKE * left)


def other_size_probability(state: TrackState, estimate: PoseEstimate, ground: PoseFlow) -> float:
    """Probability that a larger or smaller part of the same shape lies on the ground, where that tells the object's size.

    Of another one any size is as probable. The object has that which it had, where `ground` has it now, if it lies on it still,
    and nearly so if it is thick and the camera comes nearer; if what hid it took it along, it may be nearer itself.
    """
    target, numbers = state.target, state.numbers
    before, size = seen_area(state.located.G, target.outline), ExpectedSize.of(target, ground.G, state.slope, 1.0)
    if size is None or not before > 0.0:
        return 0.0
    swollen = 0.5 * math.log(size.area / before) * math.sqrt(size.area) / state.last.levels[0].shape[1]
    known = numbers.inflate * math.sqrt(float((estimate.P + ground.P)[np.ix_((2, 5), (2, 5))].sum())) / target.size
    spread = math.hypot(known, numbers.pinhole_sd, numbers.thickness_sd * swollen)
    here, nu = mean_point(target.carried_contacts(ground.G)), numbers.prior_freedom
    share = size._replace(spread=spread).squared_deviation(estimate, here, estimate.middle) / nu
    same: float = math.exp(math.lgamma(0.5 * nu + 0.5) - math.lgamma(0.5 * nu)) / math.sqrt(math.pi * nu) / spread
    same *= (1.0 + share) ** (-0.5 * (nu + 1.0))
    odds = other_surface_odds(max(0.0, texture_evidence(state, estimate)), numbers)
    odds /= numbers.taken + (1.0 - numbers.taken) * same
    return odds / (1.0 + odds)


# --- the decision ---------------------------------------------------------------------------------


def decide_pose(
    state: TrackState, estimates: list[PoseEstimate], expected: Expected, marks: FixedMarks | None = None
) -> Decision:
    """The most probable estimate, against the others and against none of them.

    A softmax over the places where the object may be, of which one is nowhere:

        log posterior(e) = prior(e) + evidence(e) - missing(e),    log posterior(nowhere) = log(1 - presence)

        prior(e) = log presence + place_prior(e)
        evidence(e) = strength(e) - log(1 + lookalike(e) exp(max of strength in the place of e))
        strength(e) = log(exp(seen(e)) + deceived exp(surface(e) + max of outline near e))
        seen(e) = surface(e) + outline(e), of turns of one outline levelled
        missing(e) = temper max(0, log-likelihood ratio of this surface on another outline)

    Evidence counts up to the odds of a lookalike, for what looks just like the object may be something like it: of two good
    places the expected one is chosen. An outline may be deceived, as by blur; a surface that shows at another place only what
    chance makes of it is not. The answer is the most exact of the estimates that are as good as the best one. It is wrong if
    the object is elsewhere, if a contact is off by more than the tolerance, or if it is another object.

    Args:
        state: of the object.
        estimates: of one image.
        expected: what continuity says of it.
        marks: see `Decision`.
    """
    if not estimates:
        return NOTHING
    numbers = state.numbers
    surfaces = [surface_evidence(e.correlation, state.usual, numbers) for e in estimates]
    by_surface = [numbers.temper * max(0.0, surface.log_odds) for surface in surfaces]
    seen = [s + outline_evidence(e, numbers) for s, e in zip(by_surface, estimates, strict=True)]
    _level_turns(state, estimates, surfaces, seen)
    scores = _log_posteriors(state, estimates, expected, surfaces, _evidence_of(estimates, by_surface, seen, numbers))
    leading = max(range(len(estimates)), key=scores.__getitem__)
    allowed = contact_tolerance(estimates[leading].area, numbers)
    best = _most_exact(estimates, scores, leading, allowed)
    chosen = estimates[best]
    rivals = [k for k, e in enumerate(estimates) if max_contact_distance(e.contacts, chosen.contacts) > allowed]
    nowhere = math.log(1.0 - expected.presence)
    others = [nowhere, *(scores[k] for k in rivals)]
    top = max([*others, scores[best]])
    own, elsewhere = math.exp(scores[best] - top), sum(math.exp(other - top) for other in others)
    variance = worst_variance(chosen.covariance) * numbers.inflate**2
    absent = elsewhere / (own + elsewhere)
    outside = math.exp(-0.5 * allowed**2 / max(variance, 1e-6))
    other = wrong_object_probability(state, chosen, expected.steps, surfaces[best], expected.goes_on)
    apart = apart_probability(state, chosen)
    false_edge = outline_open_probability(state, chosen)
    fixed = fixed_probability(state, chosen, marks, allowed)
    slip = slip_probability(state, chosen, allowed)
    off, here = any_of(absent, outside, other, apart, state.alias, false_edge, fixed, slip), own / (own + elsewhere)
    sigma, place = math.sqrt(variance), {"presence": here, "edges": chosen.edge_share}
    unlike = "other-shape" if chosen.other_shape > 0.0 else "other-surface"
    worst, doubt, told = max(
        (false_edge, "outline-open", {"probability": false_edge}),
        (state.alias, "lookalike", place),
        (apart, "apart", {"probability": apart}),
        (fixed, "image-fixed", {"probability": fixed}),
        (slip, "other-shape", {"probability": slip}),
        (outside, "uncertain", {"sigma": sigma, "tolerance": allowed}),
        (other, unlike, {"probability": other}),
        key=lambda each: each[0],
    )
    if here <= 0.5 or absent >= worst:
        doubt, told = "not-there" if max(others[1:], default=-math.inf) <= nowhere else "other-place", place
        if doubt == "not-there" and lookalike_probability(state, chosen, expected) > numbers.lookalike:
            doubt = "lookalike"
    rival, share = None, 0.0
    if rivals:
        rival = estimates[max(rivals, key=scores.__getitem__)]
        there = [k for k in rivals if max_contact_distance(estimates[k].contacts, rival.contacts) <= allowed]
        share = sum(math.exp(scores[k] - top) for k in there) / (own + elsewhere)
    figures = {"probability_off": off} | told
    evidence, risk = seen[best], numbers.risk
    return Decision(
        chosen, off, here, sigma, allowed, other, evidence, doubt, figures, rival, share, risk, state.alias, marks
    )


def _level_turns(
    state: TrackState, estimates: list[PoseEstimate], surfaces: list[SurfaceEvidence], seen: list[float]
) -> None:
    """By its outline a turn fits as well as what it is a turn of, whatever noise says: `seen` is changed so.

    The object lies there in one of these ways, so that what is not seen of its surface is occluded in all of them.
    """
    turned = [k for k, e in enumerate(estimates) if e.origin == TURNED]
    if not turned:
        return
    own = (k for k in range(len(estimates)) if k not in turned)
    alike = [*turned, max(own, key=seen.__getitem__, default=turned[0])]
    best_odds = max(estimates[k].log_odds for k in alike)
    usual = [max(0.0, surfaces[k].log_odds) for k in alike]
    clear = [unoccluded_evidence(state, estimates[k]) for k in alike]
    for k, by_usual, by_clear in zip(alike, usual, clear, strict=True):
        against = by_clear - max(clear) - (by_usual - max(usual))
        seen[k] += state.numbers.temper * (best_odds - estimates[k].log_odds + against)


def _evidence_of(
    estimates: list[PoseEstimate], by_surface: list[float], seen: list[float], numbers: Numbers
) -> list[float]:
    """What is seen of each estimate, or its surface with the best outline nearby, where its own outline is deceived."""
    outline = [both - surface for both, surface in zip(seen, by_surface, strict=True)]
    deceived = math.log(numbers.deceived)
    return [
        _log_add_exp(both, deceived + surface + max(outline[k] for k in _indices_near(e, estimates, numbers.wide)))
        for both, surface, e in zip(seen, by_surface, estimates, strict=True)
    ]


def _log_posteriors(
    state: TrackState,
    estimates: list[PoseEstimate],
    expected: Expected,
    surfaces: list[SurfaceEvidence],
    strengths: list[float],
) -> list[float]:
    """Prior and evidence of each estimate, up to one constant."""
    found = []
    # poses in one place explain the same pixels: between them all that is seen counts
    most = np.where(_overlapping_places(state.target, estimates), np.array(strengths), -np.inf).max(axis=1).tolist()
    priors = _place_priors(estimates, expected, strengths, state.numbers)
    for e, surface, strength, there, place in zip(estimates, surfaces, strengths, most, priors, strict=True):
        alike = _log_add_exp(0.0, there + math.log(lookalike_probability(state, e, expected)))
        # what shows its outline and not its surface is another one
        missing = max(0.0, missing_evidence(surface)) if state.accepted else 0.0
        prior = math.log(expected.presence) + place
        found.append(strength - alike + prior - state.numbers.temper * missing)
    return found


def _place_priors(
    estimates: list[PoseEstimate], expected: Expected, strengths: list[float], numbers: Numbers
) -> list[float]:
    """`place_prior` of each. How far an object went that left its place is told by the most evident; more than that costs."""
    anywhere = [place_prior(e, expected, numbers) for e in estimates]
    if expected.steps < ANYWHERE_STEPS or not expected.unseen:  # or no image has shown where it was
        return anywhere
    free = expected._replace(steps=max(1.0, expected.unseen, expected.taken), taken=0.0)
    moved = [place_prior(e, free, numbers) for e in estimates]
    best = max(range(len(estimates)), key=strengths.__getitem__)
    return [min(a, m + anywhere[best] - moved[best]) for a, m in zip(anywhere, moved, strict=True)]


def _most_exact(estimates: list[PoseEstimate], scores: list[float], leading: int, allowed: float) -> int:
    """Of the answers that are the leading one the index of that which knows most: a hypothesis from nowhere has no past."""
    contacts, least = estimates[leading].contacts, scores[leading] - SAME_ODDS
    alike = (k for k, e in enumerate(estimates) if max_contact_distance(e.contacts, contacts) < 0.5 * allowed)
    return min((k for k in alike if scores[k] > least), key=lambda k: worst_variance(estimates[k].covariance))


def any_of(*probabilities: float) -> float:
    """Probability that any of some independent things holds: exact also where all are small, and never beyond 0 to 1."""
    found = 0.0
    for probability in probabilities:
        found += (1.0 - found) * probability
    return min(1.0, found)


def _indices_near(estimate: PoseEstimate, estimates: Sequence[PoseEstimate], share: float) -> list[int]:
    """Which estimates lie where one lies, within a share of sqrt(area)."""
    return [k for k, other in enumerate(estimates) if is_at(estimate, other.middle, share)]


def _overlapping_places(target: Target, estimates: Sequence[PoseEstimate]) -> Bools:
    """(n, n) which estimates, in a row, lie where one lies, so that not both may be there, itself among them."""
    if len(estimates) == 1:
        return np.ones((1, 1), dtype=bool)
    to_work = np.linalg.inv(np.array([e.G for e in estimates]))
    middles = np.array([(*e.middle, 1.0) for e in estimates])
    x, y, w = np.moveaxis(middles @ to_work.transpose(0, 2, 1), 2, 0)
    w = np.where(w > 0.0, w, np.nan)
    away = np.stack([x / w, y / w], axis=2) - target.work_contacts.mean(axis=0)
    share = np.einsum("nki,ij,nkj->nk", away, target.place_metric, away)
    return np.asarray((share < SAME_PLACE**2) | np.eye(len(estimates), dtype=bool))


def _log_add_exp(one: float, other: float) -> float:
    """The log of the sum of two numbers of which these are the logs."""
    return max(one, other) + math.log1p(math.exp(-abs(one - other)))


def check_strategy_contacts(decision: Decision, contacts: Floats) -> Decision:
    """The decision of a strategy's own contacts (k, 2) px, which are off by as much more as they differ from the estimate's."""
    if decision.estimate is None:
        return decision
    distance = max_contact_distance(contacts, decision.estimate.contacts)
    spread = max(decision.sigma, LEAST_SD)
    near, left = decision.tolerance / spread, max(0.0, decision.tolerance - distance) / spread
    # of the chance that the estimate's contacts are right, what is left for the strategy's
    least = max(-math.expm1(-0.5 * near * near), 1e-300)
    missed = (math.exp(-0.5 * left * left) - math.exp(-0.5 * near * near)) / least
    off = any_of(decision.probability_off, min(1.0, max(0.0, missed)))
    if off <= 2.0 * decision.probability_off and not decision.is_accepted:
        return replace(decision, probability_off=off)
    figures = {"probability_off": off, "distance": distance, "tolerance": decision.tolerance}
    return replace(decision, probability_off=off, doubt="strategy-off", figures=figures)
