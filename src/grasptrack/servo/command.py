# SPDX-License-Identifier: Apache-2.0
"""What the servo is told in a call, and what it tells the hand: a twist, a state and a reason."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np

from grasptrack.equality import compared_by_value
from grasptrack.presentation import to_dict
from grasptrack.servo.grasp_pose import GraspPose
from grasptrack.servo.law import Aim
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats

State = Literal[
    "unsure", "approaching", "converged", "holding", "searching", "closing", "retreating", "done", "empty", "failed"
]
OVER: tuple[State, ...] = ("done", "empty", "failed")


@compared_by_value
@dataclass(frozen=True)
class Command:
    """One answer.

    Attributes:
        twist: (6,) m/s and rad/s in the hand's frame.
        state: unsure (stands still: the choice of the object is not sure, and no person said which), approaching (moves
            toward the grasp, the first exploratory moves included), converged (at the grasp, making sure), holding (sees
            nothing it believes: stands, or goes on as predicted), searching (looks for the object), closing, retreating (backs
            off along its own path, to try again), done, empty (closed, and nothing is held), failed.
        reason: what it does and why, a short sentence.
        close: whether the hand shall close now; true in one command of a try only.
        error: features less those of the goal (x/l, y/l, l*/l, angle in rad; with 6 DoF the normal's two components
            across the approach besides); NaN where not known.
        error_px: the farthest contact from its goal in the image, px; NaN where not known.
        height: m to go along the approach direction; NaN where not known.
        goal: (k, 2) px, where the contacts are wanted in the end; None where not known.
        open: whether the hand shall open now, to try again; true in one command of a try only.
        grasp_pose: where the grasp is in the robot's base, in m, with covariance, as the moves so far have told; None before.
    """

    twist: Floats
    state: State
    reason: str
    close: bool = False
    error: Floats = field(default_factory=lambda: np.full(4, math.nan))
    error_px: float = math.nan
    height: float = math.nan
    goal: Floats | None = None
    open: bool = False
    grasp_pose: GraspPose | None = None

    def to_dict(self) -> dict[str, Any]:
        """Its attributes by name as plain values, for JSON and data frames; what is not finite is None."""
        return to_dict(self)

    def __repr__(self) -> str:
        twist = " ".join(f"{v:.4g}" for v in self.twist.tolist())
        also = ", close" if self.close else ", open" if self.open else ""
        return f'Command({self.state}, twist {twist}{also}, "{self.reason}")'


@compared_by_value
@dataclass(frozen=True)
class Intent:
    """What is wanted.

    Attributes:
        state, reason, close, open: as of the command.
        twist: (6,) m/s and rad/s in the hand's frame, before the limits of acceleration.
        found: the step toward the goal; None where there is none.
    """

    state: State
    reason: str
    twist: Floats = field(default_factory=lambda: np.zeros(6))
    found: Aim | None = None
    close: bool = False
    open: bool = False

    def command_with(self, twist: Floats, pose: GraspPose | None) -> Command:
        """The command with the twist (6,) that limits allow."""
        f = self.found
        if f is None:
            return Command(twist, self.state, self.reason, self.close, open=self.open, grasp_pose=pose)
        return Command(
            twist, self.state, self.reason, self.close, f.error, f.error_px, f.height, f.final, self.open, pose
        )


class ServoCall(NamedTuple):
    """A call, and what comes with it.

    Attributes:
        time, step: s, the servo's own time, and the step that counts.
        hand: (4, 4).
        result: the answer for a new image; None where there is none.
        why: why there is none.
    """

    time: float
    step: float
    hand: Floats
    result: TrackResult | None
    why: str
