# SPDX-License-Identifier: Apache-2.0
"""An image that follows no other: hypotheses made exact and judged without continuity, and nothing learned from them."""

import math
from dataclasses import replace

import numpy as np

from grasptrack.tracking.decision import ANYWHERE_STEPS, Decision, Expected, any_of, decide_pose
from grasptrack.tracking.estimator import WHOLE_WAY, estimate_pose
from grasptrack.tracking.evidence import other_surface_odds, pose_evidence, surface_evidence, texture_evidence
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.pose import (
    TURNED,
    Hypothesis,
    PoseEstimate,
    contact_tolerance,
    known_by_image,
    max_contact_distance,
    mixed_estimate,
)
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Grey, Target
from grasptrack.typing import Floats

DOUBTED_TEXTURE = 4.0
"""Grey levels of texture that compression, light and dust make in one image, and another of the same surface need not show."""
THICK = 1.5
"""Standard deviations of a part's thickness by which it is thick, where its side may be what is seen."""
THICK_ODDS = -0.5 * THICK**2
"""Log of how much less probable that is than that it is thin."""
SLID = 3.0
"""Times the tolerance by which another answer is looked for along the way in which an outline slides along itself."""
UNKNOWN_PRESENCE = 0.5
"""Prior probability that an image of which nothing is known shows the object."""


def pose_hypothesis(target: Target, origin: str, H: Floats) -> Hypothesis:
    """The object may be where a homography H_current_reference (3, 3) puts it, give or take what a frame may change."""
    return Hypothesis(origin, target.pose(H), target.noise_of_guess)


def turned_hypotheses(target: Target, estimate: PoseEstimate) -> list[Hypothesis]:
    """The object as estimated, but for each of the turns in which its outline fits itself."""
    return [Hypothesis(TURNED, estimate.G @ T, target.noise_of_guess) for T in target.turns]


def single_estimate(
    state: TrackState, levels: list[Grey], hypothesis: Hypothesis, *, one_camera: bool = False
) -> PoseEstimate | None:
    """One hypothesis made exact in an image of which no image before tells anything.

    Texture that the two images share by chance pulls a loose pose away, a tight one may stay beside its edges: both are
    tried, and the one for which there is more evidence is taken.

    Args:
        state: of the object.
        levels: the image's pyramid.
        hypothesis: where it may be.
        one_camera: the first image is of the same camera, and what that can show counts as knowledge.
    """
    target, numbers = state.target, state.numbers

    def solve_from(G: Floats, P: Floats, reach: float = 0.0) -> list[PoseEstimate]:
        # between two images without a time nothing moved while it was exposed
        trial = Hypothesis(hypothesis.origin, G, P, reach)
        found = estimate_pose(state, levels, trial, blur_share=WHOLE_WAY if reach > 0.0 else None, still=True)
        # a prior is where to begin, not knowledge: an outline that slides along itself is exact by nothing else
        return [] if found is None else [_without_guess(target, found, P, one_camera=one_camera)]

    tight = hypothesis.P * numbers.predicted**2
    found = solve_from(hypothesis.G, tight) + solve_from(hypothesis.G, hypothesis.P)
    for e in list(found):
        if e.elsewhere > numbers.elsewhere:
            found += solve_from(e.G, hypothesis.P + target.noise_of_guess, numbers.wide * target.size)
    best = max(found, key=lambda e: pose_evidence(state, e), default=None)
    if best is None:
        return None
    if surely_shown(state, best):
        return best
    own = numbers.temper * texture_evidence(state, best)
    # what shows another surface is no more exact by what that has in common with this one by chance
    begun = Hypothesis(hypothesis.origin, best.G, tight)
    if one_camera:
        found_alone = estimate_pose(state, levels, begun, still=True, surface=False)
        alone = found_alone and _without_guess(target, found_alone, tight, one_camera=True)
    else:
        alone = _by_edges(state, levels, begun)
    if alone is None or own > 0.0:
        return best if alone is None else mixed_estimate(target, [best, alone], [own, 0.0])
    return alone


def _without_guess(target: Target, estimate: PoseEstimate, P: Floats, *, one_camera: bool) -> PoseEstimate:
    """As exact as an estimate is without the guess (8, 8) that it began with, and without what another camera can show."""
    known: PoseEstimate = target.handle.known_by(estimate, estimate.P, np.linalg.inv(P)) if one_camera else estimate
    return known_by_image(target, known, target.noise_of_view)


def surely_shown(state: TrackState, estimate: PoseEstimate) -> bool:
    """Whether it shows the object's own surface beyond doubt: what two surfaces have in common by chance is much less."""
    return state.numbers.temper * texture_evidence(state, estimate) > -2.0 * math.log(state.numbers.risk)


def _by_edges(state: TrackState, levels: list[Grey], begun: Hypothesis) -> PoseEstimate | None:
    """The pose by the outline alone, as exact as it is where the part may be thin or thick and its outline slides along itself.

    An edge that is a little off is explained as well by a part that leans as by one whose side is seen, and near an answer
    each of these looks sure: so each is made exact, and all of them weighed.
    """
    target, thick = state.target, thick_part(state)
    slid = [s * SLID * target.numbers.tolerance_px * target.slide for s in (-1.0, 1.0)] if target.slides else []
    found, evidence = list[PoseEstimate](), list[float]()
    starts = [begun, *(replace(begun, G=target.handle.moved(begun.G, d), P=begun.P + np.outer(d, d)) for d in slid)]
    for start in starts:
        for explained, prior in ((state, 0.0), (thick, THICK_ODDS)):
            e = estimate_pose(explained, levels, start, still=True, surface=False)
            if e is not None:
                found.append(known_by_image(target, e, target.noise_of_view))
                evidence.append(prior + pose_evidence(state, found[-1]))
    return mixed_estimate(target, found, evidence) if found else None


def thick_part(state: TrackState) -> TrackState:
    """The same, were the part thick and its sides seen."""
    sd = state.numbers.thickness_sd * state.target.size
    nuisance, covariance = state.nuisance.copy(), state.nuisance_covariance.copy()
    nuisance[0], covariance[0, 0] = THICK * sd, (0.5 * THICK * sd) ** 2
    return replace(state, nuisance=nuisance, nuisance_covariance=covariance, sides=1.0)


def decide_single(state: TrackState, estimates: list[PoseEstimate]) -> Decision:
    """The most probable of some estimates of one image, wherever it lies.

    No continuity says that it is this object and not another of its outline: what its surface does not show counts at once.
    """
    decision = decide_pose(state, estimates, Expected(state.target.contacts, UNKNOWN_PRESENCE, ANYWHERE_STEPS))
    own = decision.estimate
    if own is None:
        return decision
    surface = surface_evidence(own.correlation, _certain_correlations(state), state.numbers)
    odds = other_surface_odds(surface.log_odds, state.numbers)
    other = odds / (1.0 + odds)
    doubt = "other-surface" if other > decision.probability_off else decision.doubt
    off, exchanged = any_of(decision.probability_off, other), any_of(decision.exchanged, other)
    return replace(decision, probability_off=off, exchanged=exchanged, doubt=doubt)


def _certain_correlations(state: TrackState) -> list[Floats]:
    """What is usual of each patch, had the first image so much noise that only texture that is surely its own is more."""
    noise = state.target.noise
    ratio = (noise / max(noise, DOUBTED_TEXTURE)) ** 2
    found = []
    for usual in state.usual:
        signal = (1.0 + usual) / np.maximum(1.0 - usual, 1e-9) * ratio  # variance over that of the noise
        found.append(np.clip((signal - 1.0) / (signal + 1.0), 0.0, 1.0))
    return found


def told_apart(state: TrackState, one: PoseEstimate, other: PoseEstimate, risk: float) -> bool:
    """Whether the image has so much more evidence for one estimate than for another as a risk asks for."""
    return pose_evidence(state, one) - pose_evidence(state, other) >= -math.log(risk)


def same_place(one: PoseEstimate, other: PoseEstimate, numbers: Numbers) -> bool:
    """Whether two estimates put each contact at the same place, as exactly as is asked for."""
    return max_contact_distance(one.contacts, other.contacts) <= contact_tolerance(one.area, numbers)
