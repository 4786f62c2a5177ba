# SPDX-License-Identifier: Apache-2.0
"""Whether what lies about a contact goes with the object: where an object bends, or comes apart, it leaves the whole."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from grasptrack.kernels.results import SurfaceEvidence
from grasptrack.tracking.decision import Decision
from grasptrack.tracking.estimator import FIRST_POSE_SD, estimate_pose
from grasptrack.tracking.evidence import MAX_EXPONENT, pose_evidence, surface_evidence
from grasptrack.tracking.pose import TRIED, Hypothesis, PoseEstimate, worst_variance
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Grey, TargetPiece
from grasptrack.typing import Floats

REACH = 0.4
"""Share of sqrt(area) about a contact within which all is taken for one body with it: 0.3 and 0.5 tell nearly the same."""
LEAST_LOSS = math.log(2.0)
"""Log odds that a surface has to lose about a contact for it to be asked where else it is."""
STAYED = 0.25
"""Share of the tolerance by which a body may be off its place in the whole and is not asked whether it has left it."""


class Apart(NamedTuple):
    """Where a body was seen by itself: its pose (3, 3), and (3, 3) from where the whole had it to there, work px."""

    G: Floats
    way: Floats


class ContactBodies:
    """What lies about each contact, as a body of its own.

    Args:
        state: of the object.
    """

    def __init__(self, state: TrackState) -> None:
        self._state, self._whole, self._turn = state, state.target, 0
        self._pieces: dict[int, TargetPiece] = {}
        self._apart: dict[int, Apart] = {}

    def against_moved_contacts(self, decision: Decision, levels: list[Grey]) -> Decision:
        """A decision against contacts that have moved with a body of their own.

        What lies about a contact, and contradicts the whole, is solved by itself: free to go on from where the whole has it as
        far as motion that is predicted errs, so that another edge beside it is not taken for it. By how much more that explains
        than the pose of the whole tells whether it has left that; how far, whether the contact is off by more than the
        tolerance. The contacts are asked in turn, one that was found apart in each image, from where it was as well.

        Args:
            decision: of an image.
            levels: the image's pyramid.
        """
        state, e, numbers = self._state, decision.estimate, self._state.numbers
        if e is None or not state.accepted or not len(e.other) or not state.target.knows_patches:
            return decision
        if self._whole is not state.target:  # patches were dropped that are fixed in the image
            self._whole = state.target
            self._pieces.clear()
        self._turn += 1
        for k, contact in enumerate(e.contacts):
            if k not in self._apart and not (decision.is_accepted and k == self._turn % len(e.contacts)):
                continue
            part = self._piece_about(k, e)
            alone = None if part is None else self._solve_alone(k, part, e, levels)
            away = 0.0 if alone is None else math.dist(alone.contacts[0], contact)
            self._apart.pop(k, None)
            if part is None or alone is None or away < STAYED * decision.tolerance:
                continue
            whole = estimate_pose(part, levels, Hypothesis(TRIED, e.G, FIRST_POSE_SD**2 * np.eye(8)), still=True)
            gain = 0.0 if whole is None else pose_evidence(part, alone) - pose_evidence(part, whole)
            if gain <= LEAST_LOSS:
                continue
            self._apart[k] = Apart(alone.G, np.linalg.inv(e.G) @ alone.G)
            variance = numbers.inflate**2 * (worst_variance(e.covariance) + worst_variance(alone.covariance))
            off = math.exp(-0.5 * max(0.0, decision.tolerance - away) ** 2 / variance)
            apart = numbers.apart * math.exp(min(gain, MAX_EXPONENT))
            decision = decision.with_contact_apart(off * apart / (1.0 + apart), decision.bare)
        return decision

    def _piece_about(self, k: int, e: PoseEstimate) -> TrackState | None:
        """The state of what lies about a contact; None where nothing of that contradicts an estimate of the whole."""
        state, target, numbers = self._state, self._state.target, self._state.numbers
        if k not in self._pieces:
            self._pieces[k] = target.about_contact(k, REACH * target.size)
        piece = self._pieces[k]
        usual = [u[own] for u, own in zip(state.usual, piece.patches, strict=True)]
        if k not in self._apart and e.other[piece.samples].sum() <= numbers.elsewhere * np.count_nonzero(piece.samples):
            shown = [r[own] for r, own in zip(e.correlation, piece.patches, strict=True)]
            most = [np.where(np.isfinite(r), u, r) for r, u in zip(shown, usual, strict=True)]
            now, before = (self._surface_log_odds(each, usual) for each in (shown, most))
            if numbers.temper * (before - max(0.0, now)) < LEAST_LOSS:
                return None
        return replace(state, target=piece.target, usual=usual)

    def _surface_log_odds(self, correlation: list[Floats], usual: list[Floats]) -> float:
        found: SurfaceEvidence = surface_evidence(correlation, usual, self._state.numbers)
        return found.log_odds

    def _solve_alone(self, k: int, part: TrackState, e: PoseEstimate, levels: list[Grey]) -> PoseEstimate | None:
        """The pose of what lies about a contact by itself."""
        seen, target = self._apart.get(k), self._state.target
        places = [e.G] if seen is None else [e.G, e.G @ seen.way, seen.G]
        P = e.P + target.numbers.predicted**2 * target.noise_of_motion
        found = [estimate_pose(part, levels, Hypothesis(TRIED, G, P), still=True) for G in places]
        return max(filter(None, found), key=lambda each: pose_evidence(part, each), default=None)
