# SPDX-License-Identifier: Apache-2.0
"""Follows one target through images: hypotheses, estimates, decision, and what is learned from them (Fig. 3)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.contour import View
from grasptrack.tracking.camera import learn_camera, learn_thickness
from grasptrack.tracking.decision import Decision, checked, decide
from grasptrack.tracking.estimator import Hypothesis, PoseEstimate, estimate_pose
from grasptrack.tracking.hypotheses import predict
from grasptrack.tracking.numbers import NUMBERS, Numbers
from grasptrack.tracking.redetection import Keypoints, search
from grasptrack.tracking.state import Look, TrackState, initial_state, process_noise
from grasptrack.tracking.target import Grey, make_target, pyramid

Floats = NDArray[np.float64]


class Proposal(NamedTuple):
    """What a strategy by itself makes of an image: the pose that it suggests, and (k, 2) px where it puts the contacts."""

    hypothesis: Hypothesis
    contacts: Floats


class Follower:
    """One target, from its first image on.

    Args:
        grey: (H, W) the first image.
        view: the object's outline in it.
        contacts: (k, 2) px in it.
        time: s, or None.
        hidden: (H, W) nonzero where no image shows anything of the scene.
        numbers: the core's.
    """

    def __init__(
        self,
        grey: Grey,
        view: View,
        contacts: Floats,
        time: float | None = None,
        hidden: Grey | None = None,
        numbers: Numbers = NUMBERS,
    ) -> None:
        levels = pyramid(grey)
        self.numbers = numbers
        self.target = make_target(levels, view, contacts, numbers, hidden)
        self.state: TrackState = initial_state(self.target, levels, numbers)
        self.state.time = time
        self.keypoints = Keypoints(self.target, grey)

    def update(self, grey: Grey, time: float | None = None) -> Decision:
        """The best pose in the next image (H, W), taken at a time in s, and whether it is believed."""
        state, target, numbers = self.state, self.target, self.numbers
        levels = pyramid(grey)
        presence = self._presence()
        predictions = predict(target, state, levels, self._steps(time), numbers)
        estimates = self._estimates(levels, predictions.first)
        expected = target.carried(predictions.first[0].G)
        decision = decide(target, state, estimates, expected, presence, numbers)
        if not decision.accepted:
            more = predictions.second + search(target, state.located, self.keypoints, levels)
            for hypothesis in more:
                estimates += self._estimates(levels, [hypothesis])
            decision = decide(target, state, estimates, expected, presence, numbers)
        self._learn(levels, decision)
        return decision

    @property
    def expected(self) -> Floats:
        """(3, 3) the next image's pose if it moves on evenly; that of the last image in which it was located, after a loss."""
        state = self.state
        if state.lost:
            return state.located.G
        if state.G_before is None:
            return state.G
        G = state.G @ np.linalg.inv(state.G_before) @ state.G
        return np.asarray(G / G[2, 2], dtype=np.float64)

    def judge(
        self, grey: Grey, time: float | None, batches: Iterable[Sequence[Proposal]]
    ) -> tuple[Decision, Proposal | None]:
        """As `update`, of what somebody else proposes: what is decided, and of which proposal.

        Args:
            grey, time: as for `update`.
            batches: proposals, those of a batch being rivals; none is taken after the first batch of which one is accepted.
        """
        state, target, numbers = self.state, self.target, self.numbers
        levels = pyramid(grey)
        presence = self._presence()
        self._steps(time)
        expected = target.carried(self.expected)
        estimates: list[PoseEstimate] = []
        proposed: list[Proposal] = []
        decision, chosen = Decision(None), None
        for batch in batches:
            for proposal in batch:
                found = self._estimates(levels, [proposal.hypothesis])
                estimates += found
                proposed += [proposal] * len(found)
            decision = decide(target, state, estimates, expected, presence, numbers)
            for estimate, proposal in zip(estimates, proposed, strict=True):
                if estimate is decision.estimate:
                    chosen = proposal
                    decision = checked(decision, proposal.contacts, numbers)
                    break
            if decision.accepted:
                break
        self._learn(levels, decision)
        return decision, chosen

    def _presence(self) -> float:
        """Prior probability that the object is there."""
        numbers = self.numbers
        return float(np.clip(self.state.presence * (1.0 - numbers.hazard), numbers.redetected, 1.0 - numbers.hazard))

    def _estimates(self, levels: list[Grey], hypotheses: list[Hypothesis]) -> list[PoseEstimate]:
        """Each hypothesis made exact; a second time from farther away where much of the outline lies elsewhere."""
        found = []
        for hypothesis in hypotheses:
            estimate = estimate_pose(self.target, self.state, levels, hypothesis)
            if estimate is None:
                continue
            if estimate.elsewhere > self.numbers.elsewhere:
                farther = Hypothesis(
                    hypothesis.origin,
                    estimate.G,
                    estimate.P + process_noise(self.target.size, self.numbers),
                    self.numbers.wide * self.target.size,
                )
                other = estimate_pose(self.target, self.state, levels, farther, again=True)
                if other is not None and _better(other, estimate, self.state.usual, self.numbers):
                    estimate = other
            found.append(estimate)
        return found

    def _steps(self, time: float | None) -> float:
        """Time since the last image in usual intervals, 1 where times are not told."""
        state = self.state
        if time is None or state.time is None or time <= state.time:
            return 1.0
        passed = time - state.time
        state.interval = passed if state.interval is None else min(state.interval, passed)
        state.time = time
        return passed / state.interval

    def _learn(self, levels: list[Grey], decision: Decision) -> None:
        state, numbers = self.state, self.numbers
        if decision.estimate is None:
            state.lost += 1
            state.presence = min(state.presence, 0.5)
            state.last = Look(levels, state.G)
            return
        e = decision.estimate
        state.G_before = state.G
        state.last = Look(levels, e.G)
        state.P = e.P
        state.presence = float(np.clip(decision.presence, numbers.redetected, 1.0 - numbers.hazard))
        if not decision.accepted:
            state.lost += 1
            return
        state.lost = 0
        state.located = state.last
        learn_camera(self.target, state, e, numbers)
        learn_thickness(state, e, numbers)
        self._remember_patches(e)
        if e.look > 0.0:
            state.inner_spread = float(np.clip(0.9 * state.inner_spread + 0.1 * 1.3 * e.look, 6.0, 30.0))

    def _remember_patches(self, estimate: PoseEstimate) -> None:
        """How much each patch usually looks as it did first: noise, reflections and blur make it less."""
        state = self.state
        state.accepted += 1
        share = 1.0 / (min(state.accepted, MEMORY) + FIRST)
        for usual, r in zip(state.usual, estimate.correlation, strict=True):
            seen = np.isfinite(r)
            usual[seen] += (r[seen] - usual[seen]) * share


MEMORY = 10
"""Images over which it is remembered what is usual, ..."""
FIRST = 2
"""... and images without any likeness that count before the first."""


def _better(one: PoseEstimate, other: PoseEstimate, usual: list[Floats], numbers: Numbers) -> bool:
    from grasptrack.tracking.decision import texture_evidence

    return one.log_odds + texture_evidence(one, usual, numbers) > other.log_odds + texture_evidence(other, usual, numbers)
