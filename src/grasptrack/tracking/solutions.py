# SPDX-License-Identifier: Apache-2.0
"""Hypotheses of one image made exact, and solved again from farther away where much of the outline lies elsewhere."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from grasptrack.tracking.decision import evidence, surface_evidence, texture_evidence
from grasptrack.tracking.estimator import Hypothesis, PoseEstimate, estimate_pose, lead_alike, renamed
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.redetection import CONTINUOUS
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Grey, Target

LEAST_OF_USUAL = 0.5
"""Share of the usual evidence of the surface below which a second solution is looked for."""


class Solutions:
    """What is found of the target in one image.

    Args:
        target: the object.
        state: what is known of it so far.
        levels: the image's pyramid.
        numbers: the core's.

    Attributes:
        found: one estimate of each hypothesis that has one.
    """

    def __init__(self, target: Target, state: TrackState, levels: list[Grey], numbers: Numbers) -> None:
        self.found: list[PoseEstimate] = []
        self._target, self._state, self._levels, self._numbers = target, state, levels, numbers
        self._second: list[
            tuple[PoseEstimate, PoseEstimate | None]
        ] = []  # an answer, and what it led to from farther away

    def add(self, hypotheses: list[Hypothesis]) -> None:
        """Make hypotheses exact; of a lost object those that do not lead to what was found already."""
        for hypothesis in hypotheses:
            state = self._state
            if state.lost and self._answered(hypothesis):
                continue
            # where it was a moment ago does not tell how it moves
            still = bool(state.lost) or hypothesis.origin not in CONTINUOUS
            estimate = estimate_pose(self._target, state, self._levels, hypothesis, still=still)
            if estimate is None:
                continue
            # of a lost object only what shows it can be nearly right
            lost = self._state.lost and evidence(estimate, self._state.usual, self._numbers) < 0.0
            # what lay elsewhere a moment ago, whatever was tried, lies there still
            more = estimate.elsewhere - (0.0 if self._state.lost else self._state.elsewhere)
            if (more > self._numbers.elsewhere or self.falls_short(estimate)) and not lost:
                other = self._from_farther(estimate, still=still)
                if other is not None and self._score(other, hypothesis) > self._score(estimate, hypothesis):
                    estimate = other
                else:
                    estimate = replace(estimate, confirmed=True)
            self.found.append(estimate)

    def _answered(self, hypothesis: Hypothesis) -> bool:
        """Whether an answer that shows the object lies where a hypothesis would lead."""
        return any(
            lead_alike(self._target, hypothesis, e) and evidence(e, self._state.usual, self._numbers) > 0.0
            for e in self.found
        )

    def _from_farther(self, estimate: PoseEstimate, *, still: bool) -> PoseEstimate | None:
        """A second solution; answers that lead to the same one share it."""
        for first, second in self._second:
            if lead_alike(self._target, first, estimate):
                return None if second is None else renamed(second, estimate.origin)
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
        return self._usual_surface(estimate) - texture_evidence(estimate, self._state.usual, self._numbers)

    def falls_short(self, estimate: PoseEstimate) -> bool:
        """Whether much less of the surface is seen than usual, as where only its coarse patches found their place."""
        if not sum(self._target.counts):
            return False
        seen = texture_evidence(estimate, self._state.usual, self._numbers)
        return seen < LEAST_OF_USUAL * self._usual_surface(estimate)

    def _usual_surface(self, estimate: PoseEstimate) -> float:
        """Log-likelihood ratio of the patches of an estimate if they looked as they usually do."""
        state = self._state
        seen = [u + 0.0 * r for u, r in zip(state.usual, estimate.correlation, strict=True)]
        return surface_evidence(seen, state.usual, self._numbers)[0]

    def _score(self, estimate: PoseEstimate, hypothesis: Hypothesis) -> float:
        """Evidence for an estimate, and how far it went from the hypothesis that it was made from."""
        away = self._target.difference(hypothesis.G, estimate.G)
        distance = float(away @ np.linalg.solve(hypothesis.P, away))
        freedom = self._numbers.prior_freedom
        prior = -0.5 * (freedom + len(away)) * math.log1p(distance / freedom)
        return evidence(estimate, self._state.usual, self._numbers) + prior
