# SPDX-License-Identifier: Apache-2.0
"""Log-likelihood ratios: what surface and outline of an estimate say for the object, and against it."""

import math
from collections.abc import Callable
from itertools import combinations
from typing import NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.geometry.homographies import apply_homography
from grasptrack.kernels.results import SurfaceEvidence
from grasptrack.segmentation.choice import logistic
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.pose import SAME_PLACE, FixedMarks, PoseEstimate, max_contact_distance
from grasptrack.tracking.state import SEEN, TrackState
from grasptrack.tracking.target import Target
from grasptrack.typing import Floats

SHARES_MISSING = np.linspace(0.02, 0.98, 25)
"""Shares of a surface that may be occluded, changed or glaring."""


def _log_prior(power: float) -> Floats:
    """Logs of the priors of `SHARES_MISSING`, of which the share that is left is taken to a power."""
    left = (1.0 - SHARES_MISSING) ** power
    return np.asarray(np.log(left / left.sum()), dtype=np.float64)


USUAL_PRIOR = _log_prior(2)
"""The more is missing the less probable."""
OUTLINE_PRIOR = _log_prior(12)
"""The same where the outline shows that little is occluded."""
ANY_PRIOR = np.full(len(SHARES_MISSING), -math.log(len(SHARES_MISSING)))
"""Any share is as probable as any other."""
LEAST_CLEAR = 0.01
"""Share of the outline that counts as clear at least, where its logarithm is taken."""
MOST_HIDDEN = 0.999
"""Share that counts as occluded, or elsewhere, at most, where the logarithm of the rest is taken."""
SUDDEN = math.log(100.0)
"""Odds against light that hides edges from one image to the next, at least, ..."""
EDGE_LOSS = 0.4
"""... and their logarithm as a share of how much more surprising an outline is of which nothing is occluded, less than what
eight real films show: by 5 and more 0.7 % of 3,310 answers, by 10 one, by 20 none (`research.studies.edge_loss`)."""
EXCHANGED = 0.1
"""Prior probability that something else lies in its place, after an image that showed it with more than that."""
LEAST_AGREEING = 0.05
"""Share of patches that usually agree, below which there is no surface to speak of."""
STILL_FROM = 1.0
"""px that something has moved, from which on it stands still no more."""
MAX_EXPONENT = 50.0
"""Of odds: beyond it nothing changes."""
SHARES = 200
"""Shares of agreeing places over which is summed; a numerical accuracy."""


class Agreement(NamedTuple):
    """So many of some places agree."""

    agreeing: float
    places: float

    def log_odds(self, chance: float) -> float:
        """Of the same surroundings, of which any larger share may agree, against others, of which a share does by chance."""
        k, n = self.agreeing, self.places
        shares = chance + (1.0 - chance) * (np.arange(SHARES) + 0.5) / SHARES
        odds = k * np.log(shares / chance) + (n - k) * np.log((1.0 - shares) / (1.0 - chance))
        return float(np.logaddexp.reduce(odds)) - math.log(SHARES)


def surface_evidence(
    correlation: list[Floats], usual: list[Floats], numbers: Numbers, log_prior: Floats = USUAL_PRIOR
) -> SurfaceEvidence:
    """What the patches' correlations say for this surface against another one, given those that are usual.

    A share of each level is missing; `by_share` has the same by the share, where all levels have the same.
    """
    spreads = numbers.match_spread, numbers.chance_spread, numbers.patch_share
    return kernels.surface_evidence(correlation, usual, SHARES_MISSING, log_prior, *spreads)


def missing_evidence(surface: SurfaceEvidence) -> float:
    """Log-likelihood ratio of the same surface on another outline, any share of it missing, against an occluder."""
    return _log_marginal(surface.by_share, ANY_PRIOR) - _log_marginal(surface.by_share, OUTLINE_PRIOR)


def texture_evidence(state: TrackState, estimate: PoseEstimate) -> float:
    """Log-likelihood ratio of an estimate's surface: this one against another one."""
    return surface_evidence(estimate.correlation, state.usual, state.numbers).log_odds


def unoccluded_evidence(state: TrackState, estimate: PoseEstimate) -> float:
    """The same where the outline shows that little of it is occluded."""
    return surface_evidence(estimate.correlation, state.usual, state.numbers, OUTLINE_PRIOR).log_odds


def expected_texture(state: TrackState, estimate: PoseEstimate) -> float:
    """What `texture_evidence` would be if the patches looked as they usually do."""
    as_usual = [u + 0.0 * r for u, r in zip(state.usual, estimate.correlation, strict=True)]
    return surface_evidence(as_usual, state.usual, state.numbers).log_odds


def outline_evidence(estimate: PoseEstimate, numbers: Numbers) -> float:
    """Log-likelihood ratio of an estimate's outline: this object there, partly occluded, against nothing of its kind."""
    clear = max(1.0 - estimate.covered, LEAST_CLEAR)
    return numbers.temper * estimate.log_odds + numbers.cover_power * math.log(clear)


def pose_evidence(state: TrackState, estimate: PoseEstimate) -> float:
    """Log-likelihood ratio of an estimate, by surface and outline."""
    surface = max(0.0, texture_evidence(state, estimate))
    return state.numbers.temper * surface + outline_evidence(estimate, state.numbers)


def outline_surprisal(estimate: PoseEstimate, numbers: Numbers, *, hidden: bool = True) -> float:
    """Minus the log of the probability of an outline of which so much lies elsewhere or, if that counts, is occluded."""
    if not len(estimate.other):
        return 0.0
    elsewhere = power_surprisal(estimate.elsewhere, numbers.elsewhere_power)
    return elsewhere + power_surprisal(estimate.covered if hidden else estimate.elsewhere, numbers.cover_power)


def power_surprisal(share: float, power: float) -> float:
    """Minus the log of the probability of a share, that of the rest being taken to a power."""
    return -power * math.log1p(-min(share, MOST_HIDDEN))


def wrong_object_probability(
    state: TrackState,
    estimate: PoseEstimate,
    steps: float,
    surface: SurfaceEvidence | None = None,
    goes_on: Callable[[PoseEstimate], float] | None = None,
) -> float:
    """Probability that something else was taken for the object: its outline differs somewhere, or its surface everywhere.

    Args:
        state: of the object.
        estimate: of what was seen.
        steps: how long the object may have gone unseen, in frames of free motion.
        surface: that of the estimate, where it is known already.
        goes_on: log odds that an estimate shows what the last image showed of the object: what fades from image to image, as
            the grain that an encoder made of noise, is not exchanged. Asked only where the surface speaks against it.
    """
    numbers = state.numbers
    surface = surface or surface_evidence(estimate.correlation, state.usual, numbers)
    seen = max(0.0, surface.log_odds)
    shape = max(-seen, math.log(numbers.same_surface))
    if len(estimate.other):
        strange = outline_surprisal(estimate, numbers)
        jump = max(0.0, strange - state.strange)
        # of the edges that are seen elsewhere, as many as are not usually
        astray = numbers.temper * max(0.0, estimate.astray) * jump / max(strange, jump, 1e-9)
        # the surface shows that an outline is the object's though no light shows its edges; it seldom happens at once
        shape += max(jump - seen, min(jump, _edge_loss_log_odds(state, estimate) + astray))
        shape += missing_evidence(surface) if state.accepted else 0.0
        # where the outline is seen nothing differs; one that is seldom seen as it was first tells little
        shape += (
            estimate.other_shape * math.exp(-state.strange)
            if estimate.other_shape > 0.0
            else math.log(numbers.same_shape) * (1.0 - estimate.covered)
        )
    prior = EXCHANGED if state.exchanged > EXCHANGED else numbers.exchanged
    # the longer it was not seen the more probably something else was brought
    prior = min(EXCHANGED, prior + numbers.hazard * state.lost * departure_probability(steps, numbers))
    odds = prior * math.exp(min(MAX_EXPONENT, shape))
    if state.accepted:  # until then an image may show another of its kind, or the same in other light
        faded = goes_on(estimate) if goes_on is not None and surface.log_odds < 0.0 else 0.0
        last, before = (0.0, 0.0) if state.lost else state.surfaces  # what an encoder made of noise fades as it did
        expected = min(0.0, last + min(0.0, last - before))
        odds += other_surface_odds(surface.log_odds - expected, numbers) * math.exp(-max(0.0, faded))
    return odds / (1.0 + odds)


def apart_probability(state: TrackState, estimate: PoseEstimate) -> float:
    """Probability that a contact has moved with another body than what is followed, as a handle that opens.

    The edge under the finger is seen elsewhere, or ground cuts the outline on both sides of two contacts, for no edge shows
    that a piece moves along itself; and the surface beside it does not testify against that. Either something covers that
    place, and the more of the surface it covers beyond what is hidden of the outline the less probable that is; or the object
    has come apart.
    What agrees usually is that of all views: doubt must not become habit.
    """
    if not len(estimate.other):
        return 0.0
    target, numbers = state.target, state.numbers
    (height, width), (x, y) = state.last.levels[0].shape, estimate.contacts.T
    inside = (x >= 0.0) & (y >= 0.0) & (x < width) & (y < height)  # beyond the border no edge is seen anywhere
    beside = target.seen_surface(estimate.correlation, state.usual)
    seen_elsewhere = np.maximum(inside * target.contact_visibility(estimate.other), _cut_probability(state, estimate))
    denied = float((seen_elsewhere * (1.0 - beside)).max())
    agreeing = agreeing_share(estimate)
    if state.agreeing > LEAST_AGREEING and math.isfinite(agreeing):
        missing = max(0.0, 1.0 - agreeing / state.agreeing - estimate.hidden)
    else:  # without a surface the outline alone tells how much of the object does not move along
        missing = estimate.elsewhere
    odds = numbers.apart * math.exp(power_surprisal(missing, numbers.apart_power))
    return denied * odds / (1.0 + odds)


def _cut_probability(state: TrackState, estimate: PoseEstimate) -> float:
    """Probability that the outline is cut on both sides of the line through two contacts: ground goes on within it.

    Asked once a view was accepted, and only as far as neither a piece that the first outline took in nor marks fixed in the
    image explain it. What views in which the object moved never showed is none of its outline.
    """
    target, piece = state.target, estimate.open_piece
    ground = np.asarray(piece.samples)
    if not (len(ground) and piece.log_odds > 0.0 and state.accepted and state.marks is None):
        return 0.0
    if len(state.shown):
        ground = ground * np.where(state.shown_in > 0.0, state.shown, 1.0)
    found = 0.0
    for one, other in combinations(target.work_contacts, 2):
        (dx, dy), (x, y) = other - one, (target.points - one).T
        side = dx * y - dy * x
        found = max(found, float(ground[side > 0.0].max(initial=0.0) * ground[side < 0.0].max(initial=0.0)))
    return found * math.exp(min(0.0, estimate.other_shape - max(estimate.closed_piece.log_odds, piece.log_odds)))


def contact_testimony(state: TrackState, estimate: PoseEstimate) -> Floats:
    """(k,) 0 to 1: how much of each contact is seen, by the outline under the finger or the surface beside it."""
    beside = state.target.seen_surface(estimate.correlation, state.usual)
    return np.maximum(state.target.contact_visibility(estimate.visible), beside)


def outline_open_probability(state: TrackState, estimate: PoseEstimate) -> float:
    """Probability that a contact lies beside the object, on an edge that the first view alone showed.

    Of a wrong first outline a contact is not seen where it has moved to; of a right one seldom, where something covers it.
    Once it was seen there it is the object's.
    """
    sightings, numbers = state.sightings, state.numbers
    unseen = sightings.open & sightings.have_moved(estimate.contacts, numbers)
    if not sightings.doubt or not unseen.any() or not len(estimate.visible):
        return 0.0
    false = sightings.doubt / (sightings.doubt + (1.0 - sightings.doubt) * numbers.share_occluded)
    return false * float((unseen * np.maximum(0.0, 1.0 - contact_testimony(state, estimate) / SEEN)).max())


def astray_share(state: TrackState, estimate: PoseEstimate) -> float:
    """Share of the outline whose edge lies elsewhere, of what later views showed of it as far as there are some."""
    seen = float(state.shown.sum())
    if seen > state.numbers.contradicted * len(state.shown):
        return float(state.shown @ estimate.other) / seen
    return estimate.elsewhere


def slip_probability(state: TrackState, estimate: PoseEstimate, allowed: float) -> float:
    """Probability that a surface which is not fast to its outline, as a reflection is not, has led a pose astray.

    Only where the outline says little for that pose, and only as far as more px than are allowed lie between it
    and where the outline last was on it.
    """
    if texture_evidence(state, estimate) <= 0.0 or max_contact_distance(estimate.contacts, state.fast) <= allowed:
        return 0.0
    return logistic(-outline_evidence(estimate, state.numbers)) * logistic(state.slip)


def fixed_probability(state: TrackState, estimate: PoseEstimate, marks: FixedMarks | None, allowed: float) -> float:
    """Probability that what is seen is fixed in the image, as a crosshair, and not the object's.

    Only where marks were taken for it before: they stood still while something else moved on. What lies there now, and
    how much more surprising than usual its outline then is, tells the rest. As long as the object itself would be within the
    px that are allowed, no contact is wrong for it.
    """
    target = state.target
    if marks is None or not marks.still or not stands_at(target, estimate.G, marks.G):
        return 0.0
    if is_surface_proven(state) and texture_evidence(state, estimate) > -math.log(state.numbers.risk):
        return 0.0
    there = marks.object_pose
    if there is not None and max_contact_distance(target.carried_contacts(there), estimate.contacts) <= allowed:
        return 0.0
    odds = state.numbers.fixed * math.exp(max(0.0, outline_surprisal(estimate, state.numbers) - state.strange))
    if not state.shown_in.any():  # of places where it may lie on ground that moves, the first view's is one
        first, now = (apply_homography(G, target.outline) for G in (target.A, estimate.G))
        beside = max(STILL_FROM, max_contact_distance(first, now))
        odds *= max(1.0, math.hypot(*marks.left) / beside) ** 2
    return odds / (1.0 + odds)


def is_surface_proven(state: TrackState) -> bool:
    """Whether most of its patches were seen where the first image had none of them: they are not fixed in the image."""
    return 2 * sum(int(left.sum()) for left in state.unasked) <= sum(state.target.counts)


def stands_at(target: Target, G: Floats, there: Floats) -> bool:
    """Whether two poses (3, 3) have the middle of an object at one place of the image."""
    here, other = (apply_homography(each, target.centre[None])[0] for each in (G, there))
    return math.dist(here, other) < STILL_FROM


def agreeing_share(estimate: PoseEstimate) -> float:
    """Share of the patches in view that agree with an estimate; NaN where none is in view."""
    in_view = sum(int(np.count_nonzero(np.isfinite(r))) for r in estimate.correlation)
    return estimate.texture_agreeing * sum(map(len, estimate.correlation)) / in_view if in_view else math.nan


def departure_probability(steps: float, numbers: Numbers) -> float:
    """Probability that an object that moved freely for so many frames left its place, so that another may lie there."""
    nu = numbers.prior_freedom
    return float((1.0 + (SAME_PLACE / (numbers.travel * steps)) ** 2 / nu) ** (-0.5 * nu))


def other_surface_odds(surface: float, numbers: Numbers) -> float:
    """Odds of another object with this outline, of the surface's log-likelihood ratio."""
    return numbers.exchanged * math.exp(min(MAX_EXPONENT, -surface))


def _edge_loss_log_odds(state: TrackState, estimate: PoseEstimate) -> float:
    """Log of the odds against edges that hide from one image to the next: less where they are blurred all at once."""
    bare = outline_surprisal(estimate, state.numbers, hidden=False)
    against = max(SUDDEN, EDGE_LOSS * (bare - state.strange))
    more = max(0.0, estimate.blur - state.blur) if math.isfinite(estimate.blur) else 0.0
    return against / (1.0 + (0.5 * more / state.edge_width) ** 2) if more else against


def _log_marginal(by_share: Floats, log_prior: Floats) -> float:
    return float(np.logaddexp.reduce(by_share + log_prior))
