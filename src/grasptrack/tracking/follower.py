# SPDX-License-Identifier: Apache-2.0
"""Follows one target through images: hypotheses, estimates, decision, and what is learned from them (Fig. 3)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.contour import View
from grasptrack.tracking.camera import learn_camera, learn_thickness
from grasptrack.tracking.decision import Decision, checked, decide, farthest
from grasptrack.tracking.estimator import Hypothesis, PoseEstimate, estimate_pose
from grasptrack.tracking.hypotheses import moving_on, predict
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
        """(3, 3) the next image's pose if it moves on evenly; where it was located last, after a loss."""
        state = self.state
        even = moving_on(state)
        if even is not None:
            return even
        return state.located.G if state.lost else state.G

    def judge(
        self, grey: Grey, time: float | None, batches: Iterable[Sequence[Proposal]]
    ) -> tuple[Decision, Proposal | None]:
        """As `update`, of what a strategy proposes, against even motion and rest: the decision, and the proposal it is of.

        Args:
            grey, time: as for `update`.
            batches: proposals, those of a batch being rivals; none is taken after the first batch of which one is accepted.
        """
        state, target, numbers = self.state, self.target, self.numbers
        levels = pyramid(grey)
        presence = self._presence()
        P = state.P + process_noise(target.size, numbers) * max(1.0, self._steps(time))
        expected = target.carried(self.expected)
        estimates = self._estimates(levels, [Hypothesis("at rest", state.located.G if state.lost else state.G, P)])
        if moving_on(state) is not None:
            estimates += self._estimates(levels, [Hypothesis("moving on", self.expected, P)])
        found = answer = decide(target, state, estimates, expected, presence, numbers)
        nearest, proposed = None, list[Proposal]()
        for batch in batches:
            proposed += batch
            estimates += self._estimates(levels, [proposal.hypothesis for proposal in batch])
            found = answer = decide(target, state, estimates, expected, presence, numbers)
            if found.estimate is None or not proposed:
                continue
            contacts = found.estimate.contacts
            nearest = min(proposed, key=lambda proposal: farthest(proposal.contacts, contacts))
            answer = checked(found, nearest.contacts, numbers)
            if answer.accepted:
                break
        self._learn(levels, found)  # where the object is does not depend on what the strategy makes of it
        return answer, nearest

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
        if decision.accepted or decision.code == "uncertain":
            self._learn_agility(e)
        state.G_before = state.G
        state.last = Look(levels, e.G)
        state.P = e.P
        state.presence = float(np.clip(decision.presence, numbers.redetected, 1.0 - numbers.hazard))
        if decision.code == "uncertain":  # its motion is known nevertheless
            state.lost = 0
        elif not decision.accepted:
            state.lost += 1
        if not decision.accepted:
            return
        state.lost = 0
        state.located = state.last
        learn_camera(self.target, state, e, numbers)
        learn_thickness(state, e, numbers)
        self._remember_patches(e)
        if e.look > 0.0:
            state.inner_spread = float(np.clip(0.9 * state.inner_spread + 0.1 * 1.3 * e.look, 6.0, 30.0))

    def _learn_agility(self, estimate: PoseEstimate) -> None:
        """How far even motion is off: the prior of the next pose."""
        state, even = self.state, moving_on(self.state)
        if even is None:
            return
        off = self.target.difference(even, estimate.G)
        share = float(np.mean(off**2 / np.diag(process_noise(self.target.size, self.numbers))))
        if np.isfinite(share):
            state.moves += 1
            state.agility = float(
                np.clip(state.agility + (share - state.agility) / min(state.moves, MEMORY), CALM, 1.0)
            )

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
CALM = 0.01
"""Share of the process noise that always remains."""
FIRST = 2
"""... and images without any likeness that count before the first."""


def _better(one: PoseEstimate, other: PoseEstimate, usual: list[Floats], numbers: Numbers) -> bool:
    from grasptrack.tracking.decision import texture_evidence

    return one.log_odds + texture_evidence(one, usual, numbers) > other.log_odds + texture_evidence(
        other, usual, numbers
    )
