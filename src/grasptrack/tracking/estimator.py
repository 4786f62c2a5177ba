# SPDX-License-Identifier: Apache-2.0
"""Hypotheses of the pose made exact (`kernels.PoseTarget.solve`), again from farther away where much lies elsewhere."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from grasptrack import kernels
from grasptrack.equality import compared_by_value
from grasptrack.tracking.decision import pose_evidence, surface_expected
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.target import Grey, Target
from grasptrack.typing import Floats

if TYPE_CHECKING:
    from grasptrack.tracking.state import TrackState


CONTINUOUS = ("texture", "background", "at rest", "moving on")
"""Origins of hypotheses that continue what was."""


@compared_by_value
@dataclass(frozen=True)
class Hypothesis:
    """Where the object may be.

    Attributes:
        origin: what proposed it, one of `CONTINUOUS` or of redetection.
        G: (3, 3) work px -> px.
        P: (8, 8) covariance of its error, work px^2.
        reach: work px within which edges are looked for; 0: by the covariance.
    """

    origin: str
    G: Floats
    P: Floats
    reach: float = 0.0


@compared_by_value
@dataclass(frozen=True)
class PoseEstimate:
    """A hypothesis made exact.

    Attributes:
        origin: of the hypothesis.
        G, P: pose and covariance.
        contacts: (k, 2) px.
        covariance: (k, 2, 2) px^2 of them, by the model alone.
        area: px^2 of the outline in the image.
        bend: (3, 8) as of `Shutter`.
        readout, readout_variance: share of a usual interval, as the edges of this image tell it.
        nuisance, nuisance_covariance: (4,), (4, 4) as of `TrackState`.
        sides: likewise; NaN where nothing tells.
        edge_width: work px, standard deviation of an edge at rest; NaN where too few are seen.
        blur_share: half of an edge's blur, of what moved across it since the last image; NaN where too few moved.
        blur: work px, half of what blurs all but a quarter of the edges; NaN where too few are seen.
        edge_share: of the outline's samples whose edge was found; edge_sigma: work px, of their residuals.
        look: grey levels by which the inner side differs from the first view's, median.
        light: gain and bias of the surface's grey levels since the first view.
        correlation: of each patch of the three finest levels; NaN outside the image.
        texture_agreeing: share of the patches that agree with the pose; texture_spread: their errors in predicted sd.
        visible, occluded, other: of each sample of the outline, probabilities.
        log_odds: of the outline, this object against none.
        elsewhere: share of the outline whose edge lies elsewhere; astray: log-likelihood ratio of these edges, of something
            else against light that hides them and a pose that is a little off.
        other_shape: log-likelihood ratio of another shape; differs: of each sample, probability that the shape differs there.
        middle: (x, y) px of the contacts.
        hidden: share of the outline that is hidden; covered: that, or has its edge elsewhere.
        confirmed: a second solution, from farther away, was no better.
    """

    origin: str
    G: Floats
    P: Floats
    contacts: Floats
    covariance: Floats
    area: float
    bend: Floats
    readout: float
    readout_variance: float
    nuisance: Floats
    nuisance_covariance: Floats
    sides: float
    edge_width: float
    blur_share: float
    blur: float
    edge_share: float
    edge_sigma: float
    look: float
    light: tuple[float, float]
    correlation: list[Floats]
    texture_agreeing: float
    texture_spread: float
    visible: Floats
    occluded: Floats
    other: Floats
    log_odds: float
    elsewhere: float
    astray: float
    other_shape: float
    differs: Floats
    middle: tuple[float, float]
    hidden: float
    covered: float
    confirmed: bool = False


NO_BEND = np.zeros((3, 8))
"""Of what does not move, or moves nobody knows how."""
UNKNOWN = np.full((3, 3), np.nan)
"""The last pose, where none tells what moved."""
BEGAN = 1.0
"""Half the blur of what began to move since the last image, while the shutter was open all the time: as far as it went."""


def estimate_pose(
    target: Target,
    state: TrackState,
    levels: list[Grey],
    hypothesis: Hypothesis,
    *,
    again: bool = False,
    still: bool = False,
) -> PoseEstimate | None:
    """The pose near a hypothesis that image, prior and camera model agree on; None where there is none.

    Args:
        target, state: of the object.
        levels: the image's pyramid.
        hypothesis: where it may be.
        again: edges may be blurred by all that moved since the last image.
        still: the last pose does not tell what moved since.
    """
    if not sane_area(target, hypothesis.G):
        return None
    readout = state.shutter.readout
    bend = NO_BEND if still else state.bend(target, levels, hypothesis.G)
    found = target.handle.solve(
        levels,
        hypothesis.G,
        hypothesis.P,
        UNKNOWN if still else state.last.G,
        bend,
        readout.share,
        state.nuisance,
        state.nuisance_covariance,
        state.sides,
        state.inner_spread,
        *state.light,
        hypothesis.reach,
        state.edge_width,
        BEGAN if again else state.blur_share,
    )
    G, P = found["G"], found["P"]
    area = sane_area(target, G) if found["valid"] else 0.0
    if not area:
        return None
    by = found["by_readout"]
    P = P + by[:, None] * (by * readout.variance)
    contacts, covariance, middle = target.handle.placed(G, P)
    occluded = found["occluded"]
    hidden = float(occluded.sum()) / len(occluded) if len(occluded) else 0.0
    return PoseEstimate(
        hypothesis.origin,
        G,
        P,
        contacts,
        covariance,
        area,
        bend,
        found["readout"],
        found["readout_variance"],
        found["nuisance"],
        found["nuisance_covariance"],
        found["sides"],
        found["edge_width"],
        found["blur_share"],
        found["blur"],
        found["edge_share"],
        found["edge_sigma"],
        found["look"],
        (found["gain"], found["bias"]),
        found["correlation"],
        found["texture_agreeing"],
        found["texture_spread"],
        found["visible"],
        occluded,
        found["other"],
        found["log_odds"],
        found["elsewhere"],
        found["astray"],
        found["other_shape"],
        found["differs"],
        middle,
        hidden,
        hidden + found["elsewhere"],
    )


def lead_alike(target: Target, one: Hypothesis | PoseEstimate, other: Hypothesis | PoseEstimate) -> bool:
    """Whether one of two poses lies within the uncertainty of the other, so that both lead to the same answer."""
    d = target.difference(other.G, one.G)
    return bool(np.isfinite(d).all()) and min(float(d @ np.linalg.solve(P, d)) for P in (other.P, one.P)) < 1.0


def distinct_hypotheses(target: Target, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
    """Those that lead elsewhere than the ones before them."""
    kept: list[Hypothesis] = []
    for hypothesis in hypotheses:
        if not any(lead_alike(target, hypothesis, other) for other in kept):
            kept.append(hypothesis)
    return kept


def with_origin(estimate: PoseEstimate, origin: str) -> PoseEstimate:
    """The same from elsewhere."""
    return replace(estimate, origin=origin)


SMALLEST, LARGEST = 0.02, 30.0
"""Areas relative to the first view's between which an object is looked for: seven times as far, five times as near."""


def sane_area(target: Target, G: Floats) -> float:
    """px^2 of the outline; 0 unless G is a view of the plane's front, before the camera, at a size to be seen."""
    area = kernels.seen_area(G, target.outline)
    return area if SMALLEST < area / target.area < LARGEST else 0.0


# --- all hypotheses of one image ------------------------------------------------------------

LEAST_OF_USUAL = 0.5
"""Share of the usual evidence of the surface below which a second solution is looked for."""


class Solutions:
    """What is found of the target in one image.

    Args:
        target: the object.
        state: what is known of it so far.
        levels: the image's pyramid.
        numbers: the core's.
        hypotheses: to begin with.

    Attributes:
        found: one estimate of each hypothesis that has one.
    """

    def __init__(
        self, target: Target, state: TrackState, levels: list[Grey], numbers: Numbers, hypotheses: list[Hypothesis]
    ) -> None:
        self.found: list[PoseEstimate] = []
        self._target, self._state, self._levels, self._numbers = target, state, levels, numbers
        # an answer, and what it led to from farther away
        self._second: list[tuple[PoseEstimate, PoseEstimate | None]] = []
        self.add(hypotheses)

    def add(self, hypotheses: list[Hypothesis]) -> None:
        """Make hypotheses exact; of a lost object those that do not lead to what was found already."""
        for hypothesis in hypotheses:
            state, numbers = self._state, self._numbers
            if state.lost and self._is_answered(hypothesis):
                continue
            # where it was a moment ago does not tell how it moves
            still = bool(state.lost) or hypothesis.origin not in CONTINUOUS
            estimate = estimate_pose(self._target, state, self._levels, hypothesis, still=still)
            if estimate is None:
                continue
            # of a lost object only what shows it can be nearly right
            lost = state.lost and pose_evidence(estimate, state.usual, numbers) < 0.0
            # what lay elsewhere a moment ago, whatever was tried, lies there still
            more = estimate.elsewhere - (0.0 if state.lost else state.elsewhere)
            if (more > numbers.elsewhere or self.falls_short(estimate)) and not lost:
                other = self._from_farther(estimate, still=still)
                score = self._score_estimate
                if other is not None and score(other, hypothesis) > score(estimate, hypothesis):
                    estimate = other
                else:
                    estimate = replace(estimate, confirmed=True)
            self.found.append(estimate)

    def _is_answered(self, hypothesis: Hypothesis) -> bool:
        """Whether an answer that shows the object lies where a hypothesis would lead."""
        return any(
            lead_alike(self._target, hypothesis, e) and pose_evidence(e, self._state.usual, self._numbers) > 0.0
            for e in self.found
        )

    def _from_farther(self, estimate: PoseEstimate, *, still: bool) -> PoseEstimate | None:
        """A second solution; answers that lead to the same one share it."""
        for first, second in self._second:
            if lead_alike(self._target, first, estimate):
                return None if second is None else with_origin(second, estimate.origin)
        target = self._target
        P, reach = estimate.P + target.noise_of_motion, self._numbers.wide * target.size
        farther = Hypothesis(estimate.origin, estimate.G, P, reach)
        found = estimate_pose(target, self._state, self._levels, farther, again=True, still=still)
        self._second.append((estimate, found))
        if found is not None:
            self._second.append((found, found))
        return found

    def surface_missing(self, estimate: PoseEstimate) -> float:
        """By how much the evidence of the surface falls short of what it would be if its patches looked as usual."""
        seen, expected = surface_expected(estimate, self._state.usual, self._numbers)
        return expected - seen

    def falls_short(self, estimate: PoseEstimate) -> bool:
        """Whether much less of the surface is seen than usual, as where only its coarse patches found their place."""
        if not sum(self._target.counts):
            return False
        seen, expected = surface_expected(estimate, self._state.usual, self._numbers)
        return seen < LEAST_OF_USUAL * expected

    def _score_estimate(self, estimate: PoseEstimate, hypothesis: Hypothesis) -> float:
        """Evidence for an estimate, and how far it went from the hypothesis that it was made from."""
        away: Floats = self._target.handle.difference(hypothesis.G, estimate.G)
        distance = float(away @ np.linalg.solve(hypothesis.P, away))
        freedom = self._numbers.prior_freedom
        prior = -0.5 * (freedom + len(away)) * math.log1p(distance / freedom)
        return pose_evidence(estimate, self._state.usual, self._numbers) + prior
