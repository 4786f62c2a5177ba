# SPDX-License-Identifier: Apache-2.0
"""The probability that an answer is off, or another object: the only place where "located" is decided."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.equality import compared_by_value
from grasptrack.tracking.numbers import NUMBERS, Numbers
from grasptrack.typing import Floats

if TYPE_CHECKING:
    from grasptrack.tracking.estimator import PoseEstimate
    from grasptrack.tracking.state import TrackState


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
        accepted: whether the contacts may be given out. Nothing but the probability decides it.
        code: why they may not, one of `CODES`; empty when they may.
        confidence: the complement of the probability, 0 to 1; 0 where nothing was found.
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
    rival: PoseEstimate | None
    rival_share: float = 0.0
    risk: float = NUMBERS.risk

    accepted: bool = field(init=False)
    code: str = field(init=False)
    confidence: float = field(init=False)

    def __post_init__(self) -> None:
        """What follows."""
        accepted = self.probability_off < self.risk
        object.__setattr__(self, "accepted", accepted)
        object.__setattr__(self, "code", "" if accepted else self.doubt)
        object.__setattr__(self, "confidence", 1.0 - self.probability_off)

    def at(self, risk: float) -> Decision:
        """The same by another risk."""
        return replace(self, risk=risk)

    def among(self, share: float) -> Decision:
        """The same where it is one of several answers between which nothing decides, with its share of the probability."""
        off = any_of(self.probability_off, 1.0 - share)
        return replace(
            self, probability_off=off, doubt=self.doubt if self.probability_off > 1.0 - share else "ambiguous"
        )


NOTHING = Decision(None, 1.0, 0.0, math.inf, 0.0, 0.0, 0.0, "not-found", {}, None)
"""Of an image in which no pose was found."""

CODES = (
    "not-found",
    "not-there",
    "other-place",
    "uncertain",
    "other-shape",
    "other-surface",
    "ambiguous",
    "strategy-off",
    "lookalike",
)
"""Reasons for which an answer is not given. `messages` makes sentences of them."""


def contact_tolerance(area: float, numbers: Numbers) -> float:
    """px by which a contact may be off, for an object of `area` px^2."""
    return max(numbers.tolerance_px, numbers.tolerance * math.sqrt(area))


def largest_sigma(area: float, numbers: Numbers) -> float:
    """px, the standard deviation from which on a contact of an object of `area` px^2 is not believed."""
    return contact_tolerance(area, numbers) / math.sqrt(-2.0 * math.log(numbers.risk))


def is_certain(covariance: Floats, area: float, numbers: Numbers) -> bool:
    """Whether contacts of covariance (k, 2, 2) px^2, on an object of `area` px^2, are as surely known as is asked for."""
    return math.sqrt(worst_variance(covariance)) < largest_sigma(area, numbers)


def pose_evidence(estimate: PoseEstimate, usual: list[Floats], numbers: Numbers) -> float:
    """Log-likelihood ratio of an estimate: this object there, partly covered, against nothing of its kind."""
    surface = max(0.0, texture_evidence(estimate, usual, numbers))
    return numbers.temper * surface + outline_evidence(estimate, numbers)


def outline_evidence(estimate: PoseEstimate, numbers: Numbers) -> float:
    """The part of it that the outline has."""
    return numbers.temper * estimate.log_odds + numbers.cover_power * math.log(max(1.0 - estimate.covered, 0.01))


def texture_evidence(estimate: PoseEstimate, usual: list[Floats], numbers: Numbers) -> float:
    """Log-likelihood ratio of the patches' correlations, given those that are usual: this surface against another one."""
    return surface_evidence(estimate.correlation, usual, numbers)[0]


def surface_expected(estimate: PoseEstimate, usual: list[Floats], numbers: Numbers) -> tuple[float, float]:
    """`texture_evidence`, and what it would be if the patches looked as they usually do."""
    as_usual = [u + 0.0 * r for u, r in zip(usual, estimate.correlation, strict=True)]
    return texture_evidence(estimate, usual, numbers), surface_evidence(as_usual, usual, numbers)[0]


def surface_seen(estimate: PoseEstimate, usual: list[Floats], numbers: Numbers) -> float:
    """As `texture_evidence`, where the outline shows that little of it is covered."""
    return surface_evidence(estimate.correlation, usual, numbers, COVERED_PRIOR)[0]


def surface_missing(by_share: Floats) -> float:
    """Log-likelihood ratio of the same surface on another outline, so that any share of it may be missing, against a cover.

    Args:
        by_share: of the surface, by the share of it that is not seen.
    """
    return _log_marginal(by_share, ANY_PRIOR) - _log_marginal(by_share, COVERED_PRIOR)


TURNED = "turned"
"""Origin of a hypothesis that lays the outline on itself otherwise."""
OCCLUDED = np.linspace(0.02, 0.98, 25)
"""Shares of a surface that may be covered, changed or glaring, ..."""
OCCLUDED_PRIOR = np.log((1.0 - OCCLUDED) ** 2 / ((1.0 - OCCLUDED) ** 2).sum())
"""... the less probable the more: logarithms."""
COVERED_PRIOR = np.log((1.0 - OCCLUDED) ** 12 / ((1.0 - OCCLUDED) ** 12).sum())
"""The same of what covers the outline as well."""
ANY_PRIOR = np.full(len(OCCLUDED), -math.log(len(OCCLUDED)))
"""Any share is as probable as any other."""


def surface_evidence(
    correlation: list[Floats], usual: list[Floats], numbers: Numbers, log_prior: Floats = OCCLUDED_PRIOR
) -> tuple[float, Floats]:
    """Log-likelihood ratio of correlations, a share of each level not being seen; and by the share, where all have the same."""
    spreads = numbers.match_spread, numbers.chance_spread, numbers.patch_share
    return kernels.surface_evidence(correlation, usual, OCCLUDED, log_prior, *spreads)


def _log_marginal(by_share: Floats, log_prior: Floats) -> float:
    return float(np.logaddexp.reduce(by_share + log_prior))


def outline_surprisal(estimate: PoseEstimate, numbers: Numbers) -> float:
    """How improbable it is of an outline that so much of it lies elsewhere or is covered: minus the log of the probability."""
    if not len(estimate.other):
        return 0.0
    hidden = numbers.cover_power * math.log1p(-min(estimate.covered, 0.999))
    return -numbers.elsewhere_power * math.log1p(-min(estimate.elsewhere, 0.999)) - hidden


EXCHANGED = 0.1
"""Prior probability that something else lies in its place, after an image that showed it."""


SUDDEN = math.log(100.0)
"""Odds against light that hides edges from one image to the next."""


def _edge_loss_log_odds(state: TrackState, estimate: PoseEstimate) -> float:
    """Log of the odds against edges that hide from one image to the next: less where they are blurred all at once."""
    more = max(0.0, estimate.blur - state.blur) if math.isfinite(estimate.blur) else 0.0
    return SUDDEN / (1.0 + (0.5 * more / state.edge_width) ** 2) if more else SUDDEN


def wrong_object_probability(
    state: TrackState,
    estimate: PoseEstimate,
    steps: float,
    numbers: Numbers,
    told: tuple[float, Floats] | None = None,
) -> float:
    """Probability that something else was taken for the object: its outline differs somewhere, or its surface everywhere.

    Args:
        state: of the object.
        estimate: of what was seen.
        steps: how long the object may have gone unseen, in frames of free motion.
        numbers: the core's.
        told: the `surface_evidence` of the estimate, where it is known already.
    """
    surface, by_share = told or surface_evidence(estimate.correlation, state.usual, numbers)
    shape = max(-max(0.0, surface), math.log(numbers.same_surface))
    if len(estimate.other):
        strange = outline_surprisal(estimate, numbers)
        jump = max(0.0, strange - state.strange)
        # of the edges that are seen elsewhere, as many as are not usually
        astray = numbers.temper * max(0.0, estimate.astray) * jump / max(strange, jump, 1e-9)
        # the surface shows that an outline is the object's though no light shows its edges; it seldom happens at once
        shape += max(jump - max(0.0, surface), min(jump, _edge_loss_log_odds(state, estimate) + astray))
        shape += surface_missing(by_share) if state.accepted else 0.0
        # where the outline is seen nothing differs; one that is seldom seen as it was first tells little
        shape += (
            estimate.other_shape * math.exp(-state.strange)
            if estimate.other_shape > 0.0
            else math.log(numbers.same_shape) * (1.0 - estimate.covered)
        )
    prior = EXCHANGED if state.exchanged else numbers.exchanged
    # the longer it was not seen the more probably something else was brought
    prior = min(EXCHANGED, prior + numbers.hazard * state.lost * departure_probability(steps, numbers))
    odds = prior * math.exp(min(50.0, shape))
    if state.accepted:  # until then an image may show another of its kind, or the same in other light
        odds += numbers.exchanged * math.exp(min(50.0, -surface))
    return odds / (1.0 + odds)


class Expected(NamedTuple):
    """Where continuity has the object.

    Attributes:
        contacts: (k, 2) px.
        steps: how long it may have gone unseen, in frames of free motion.
        size: how large it would be anywhere in the image; None where that is not known.
        taken: as `steps`, if what hid it took it along.
    """

    contacts: Floats
    steps: float
    size: ExpectedSize | None = None
    taken: float = 0.0


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

    def share(self, estimate: PoseEstimate, here: tuple[float, float], there: tuple[float, float]) -> float:
        """The square of an estimate's deviation from the expected size in sd; it lies there, and is expected here, px."""
        (u, v), (x, y), (a, b, c) = here, there, self.depth
        away = math.hypot(x - u, y - v) / math.sqrt(self.area) * 2.0
        depth = max((a * x + b * y + c) / (a * u + b * v + c), LEAST_DEPTH)
        size = 0.5 * math.log(estimate.area / self.area) - 1.5 * math.log(depth)
        return (size / math.hypot(self.spread, 1.5 * self.slope * away)) ** 2


LEAST_DEPTH = 0.1
"""Of a plane that is extended far beyond what was seen of it."""


def place_prior(estimate: PoseEstimate, expected: Expected, numbers: Numbers) -> float:
    """Log of the prior of a pose's place, turn and size: how far it is from what is expected."""
    # number by number: of so few NumPy's calls would cost more
    (x, y), (u, v) = estimate.middle, mean_point(expected.contacts)
    across = along = 0.0
    for (ax, ay), (bx, by) in zip(estimate.contacts.tolist(), expected.contacts.tolist(), strict=True):
        across += (bx - u) * (ay - y) - (by - v) * (ax - x)
        along += (ax - x) * (bx - u) + (ay - y) * (by - v)
    turn, away = math.atan2(across, along), (x - u) ** 2 + (y - v) ** 2
    share = away / (numbers.travel**2 * estimate.area) + (turn / numbers.turn) ** 2
    nu, size = numbers.prior_freedom, 0.0
    if expected.size is not None:
        size = expected.size.share(estimate, (u, v), (x, y))

    def within(steps: float) -> float:
        return -0.5 * (nu + 4.0) * math.log1p((share / steps**2 + size) / nu)

    if expected.taken <= expected.steps:
        return within(expected.steps)
    return float(np.logaddexp(within(expected.steps), math.log(numbers.taken) + within(expected.taken)))


def departure_probability(steps: float, numbers: Numbers) -> float:
    """Probability that an object that moved freely for so many frames left its place, so that another may lie there."""
    nu = numbers.prior_freedom
    return float((1.0 + (SAME_PLACE / (numbers.travel * steps)) ** 2 / nu) ** (-0.5 * nu))


def lookalike_probability(state: TrackState, estimate: PoseEstimate, expected: Expected, numbers: Numbers) -> float:
    """Probability that something just like the object lies where an estimate has it, and not the object."""
    if not (state.lookalike or state.beside):
        return numbers.lookalike
    if is_near(estimate, expected.contacts) and not (state.lost and state.lookalike):
        return numbers.lookalike
    if not state.lookalike:
        return max(numbers.lookalike, SEEN_LIKE)
    return max(numbers.lookalike, SEEN_LIKE * departure_probability(expected.steps, numbers))


SAME_ODDS = math.log(20.0)
"""Odds within which estimates of one answer are as good."""


def variance_of(estimate: PoseEstimate) -> float:
    """px^2 of the worst contact in its worst direction, by the model alone."""
    return worst_variance(estimate.covariance)


def worst_variance(covariance: Floats) -> float:
    """px^2 of the worst of some places in its worst direction, of their covariances (k, 2, 2)."""
    axes = [0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy) for (xx, xy), (_, yy) in covariance.tolist()]
    return float(max(axes))


LONG = 1e6
"""Frames of free motion after which an object may be anywhere, turned in any way."""
SEEN_LIKE = 0.5
"""Probability that what looks just like the object is its equal, once one was seen and the object was not for a while."""
SAME_PLACE = 0.5
"""Share of sqrt(area) within which two poses lie in one place."""


def decide_pose(
    state: TrackState, estimates: list[PoseEstimate], expected: Expected, presence: float, numbers: Numbers
) -> Decision:
    """The most probable estimate, against the others and against none of them.

    What looks just like the object may be something like it: evidence counts up to the odds of that, so that of two good
    places the expected one is chosen.

    Args:
        state: of the object.
        estimates: of one image.
        expected: where continuity has it.
        presence: prior probability that it is there.
        numbers: the core's.
    """
    if not estimates:
        return NOTHING
    told = [surface_evidence(e.correlation, state.usual, numbers) for e in estimates]
    surface = [numbers.temper * max(0.0, odds) for odds, _ in told]
    raw = [s + outline_evidence(e, numbers) for s, e in zip(surface, estimates, strict=True)]
    alike = [k for k, e in enumerate(estimates) if e.origin == TURNED]
    if alike:  # by its outline a turn fits as well as what it is a turn of, whatever noise says
        alike.append(max((k for k in range(len(estimates)) if k not in alike), key=lambda k: raw[k], default=alike[0]))
        best_odds = max(estimates[k].log_odds for k in alike)
        by_levels = [max(0.0, told[k][0]) for k in alike]
        # it lies there in one of these ways: what is not seen of its surface is covered, in all of them
        seen = [surface_seen(estimates[k], state.usual, numbers) for k in alike]
        for k, by_all, by_surface in zip(alike, by_levels, seen, strict=True):
            against = by_surface - max(seen) - (by_all - max(by_levels))
            raw[k] += numbers.temper * (best_odds - estimates[k].log_odds + against)
    outline = [r - s for r, s in zip(raw, surface, strict=True)]
    near = [_nearby_indices(e, estimates, SAME_PLACE) for e in estimates]
    # an outline may be deceived, as by blur; a surface that shows at another place only what chance makes of it is not
    strength = [
        _log_add_exp(
            r, math.log(numbers.deceived) + s + max(outline[k] for k in _nearby_indices(e, estimates, numbers.wide))
        )
        for r, s, e in zip(raw, surface, estimates, strict=True)
    ]
    scores = []
    for e, (_, by_share), own, around in zip(estimates, told, strength, near, strict=True):
        # poses in one place explain the same pixels: between them all that is seen counts
        shared = max(strength[k] for k in around) + math.log(lookalike_probability(state, e, expected, numbers))
        # what shows its outline and not its surface is another one
        missing = max(0.0, surface_missing(by_share)) if state.accepted else 0.0
        prior = math.log(presence) + place_prior(e, expected, numbers)
        scores.append(own - _log_add_exp(0.0, shared) + prior - numbers.temper * missing)
    best = max(range(len(estimates)), key=scores.__getitem__)
    allowed = contact_tolerance(estimates[best].area, numbers)
    # of the same answer the one that knows most: a hypothesis from nowhere has no past
    alike = [
        k for k, e in enumerate(estimates) if max_contact_distance(e.contacts, estimates[best].contacts) < 0.5 * allowed
    ]
    top = max(scores[k] for k in alike)
    best = min((k for k in alike if scores[k] > top - SAME_ODDS), key=lambda k: variance_of(estimates[k]))
    chosen = estimates[best]
    others = [math.log(1.0 - presence)]
    rivals = [k for k, e in enumerate(estimates) if max_contact_distance(e.contacts, chosen.contacts) > allowed]
    others += [scores[k] for k in rivals]
    top = max([*others, scores[best]])
    own = math.exp(scores[best] - top)
    elsewhere = sum(math.exp(o - top) for o in others)
    p, absent = own / (own + elsewhere), elsewhere / (own + elsewhere)
    variance = variance_of(chosen) * numbers.inflate**2
    outside = math.exp(-0.5 * allowed**2 / max(variance, 1e-6))
    other = wrong_object_probability(state, chosen, expected.steps, numbers, told[best])
    off = any_of(absent, outside, other)
    figures = {"probability_off": off}
    causes = {"presence": absent, "uncertain": outside, "exchanged": other}
    cause = max(causes, key=lambda name: causes[name]) if p > 0.5 else "presence"
    if cause == "uncertain":
        doubt, figures = "uncertain", {**figures, "sigma": math.sqrt(variance), "tolerance": allowed}
    elif cause == "exchanged":
        doubt = "other-shape" if chosen.other_shape > 0.0 else "other-surface"
        figures["probability"] = other
    else:
        nowhere = max(others[1:], default=-math.inf) <= others[0]
        doubt = "not-there" if nowhere else "other-place"
        if nowhere and lookalike_probability(state, chosen, expected, numbers) > numbers.lookalike:
            doubt = "lookalike"
        figures |= {"presence": p, "edges": chosen.edge_share}
    rival, share = None, 0.0
    if rivals:
        rival = estimates[max(rivals, key=scores.__getitem__)]
        there = [k for k in rivals if max_contact_distance(estimates[k].contacts, rival.contacts) <= allowed]
        share = sum(math.exp(scores[k] - top) for k in there) / (own + elsewhere)
    return Decision(
        chosen, off, p, math.sqrt(variance), allowed, other, raw[best], doubt, figures, rival, share, numbers.risk
    )


def any_of(*probabilities: float) -> float:
    """Probability that any of some independent things holds: exact also where all are small, and never beyond 0 to 1."""
    found = 0.0
    for probability in probabilities:
        found += (1.0 - found) * probability
    return min(1.0, found)


def _nearby_indices(estimate: PoseEstimate, estimates: list[PoseEstimate], share: float) -> list[int]:
    """Which estimates lie where one lies, within a share of sqrt(area)."""
    reach = share * math.sqrt(estimate.area)
    return [k for k, other in enumerate(estimates) if math.dist(estimate.middle, other.middle) < reach]


def _log_add_exp(one: float, other: float) -> float:
    """The log of the sum of two numbers of which these are the logs."""
    return max(one, other) + math.log1p(math.exp(-abs(one - other)))


def mean_point(points: Floats) -> tuple[float, float]:
    """(x, y) of points (k, 2), number by number: of so few NumPy's calls would cost more."""
    x = y = 0.0
    for u, v in points.tolist():
        x, y = x + u, y + v
    return x / len(points), y / len(points)


def is_near(estimate: PoseEstimate, contacts: Floats) -> bool:
    """Whether an estimate lies in the place of contacts (k, 2) px."""
    return math.dist(estimate.middle, mean_point(contacts)) < SAME_PLACE * math.sqrt(estimate.area)


def max_contact_distance(contacts: Floats, others: Floats) -> float:
    """px between contacts (k, 2) where they are farthest apart."""
    return max(math.hypot(x, y) for x, y in (contacts - others).tolist())


def check_strategy_contacts(decision: Decision, contacts: Floats) -> Decision:
    """The decision of a strategy's own contacts (k, 2) px, which are off by as much more as they differ from the estimate's."""
    if decision.estimate is None:
        return decision
    distance = max_contact_distance(contacts, decision.estimate.contacts)
    spread = max(decision.sigma, 1e-3)
    near, left = decision.tolerance / spread, max(0.0, decision.tolerance - distance) / spread
    # of the chance that the estimate's contacts are right, what is left for the strategy's
    least = max(-math.expm1(-0.5 * near * near), 1e-300)
    missed = (math.exp(-0.5 * left * left) - math.exp(-0.5 * near * near)) / least
    off = any_of(decision.probability_off, min(1.0, max(0.0, missed)))
    if off <= 2.0 * decision.probability_off and not decision.accepted:
        return replace(decision, probability_off=off)
    figures = {"probability_off": off, "distance": distance, "tolerance": decision.tolerance}
    return replace(decision, probability_off=off, doubt="strategy-off", figures=figures)
