# SPDX-License-Identifier: Apache-2.0
"""What is tried, and what became of it."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

from grasptrack.errors import InputError
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack_bench.physics.gripper import make_gripper
from grasptrack_bench.physics.model import import_mujoco
from grasptrack_bench.physics.setting import ARMS, SCENARIOS, Arm, Scenario
from grasptrack_bench.simulation.outlines import Shape

Law = Literal["online", "nominal", "textbook"]
LAWS: tuple[Law, ...] = ("online", "nominal", "textbook")
IMAGES = ("auto", "mujoco", "planar")


def check_options(*, scenario: str, arm: str, law: str, images: str, fingers: int = 2) -> None:
    """See that names are known and MuJoCo is there."""
    for option, value, known in (
        ("--scenario", scenario, SCENARIOS),
        ("--arm", arm, ARMS),
        ("--law", law, LAWS),
        ("--images", images, IMAGES),
    ):
        if value not in known:
            raise InputError(f'{option} is one of {", ".join(known)}, not "{value}"', option=option, value=value)
    make_gripper(fingers)
    import_mujoco()


@dataclass(frozen=True)
class ApproachCase:
    """What is to be tried.

    Attributes:
        shape: the part's outline.
        seed: of everything that chance decides.
        scenario, arm: as in `World`.
        law: of the servo.
        images: who draws them.
        pictures: return a picture of the end of a trial that fails.
        fingers: of the hand, 2 or 3.
        risk: probability below which an answer of the tracker may be wrong.
        sure: probability from which the choice of the object is sure; the hand does not move below it. 0 takes the likeliest:
            the bench of these trials holds one part.
    """

    shape: Shape
    seed: int
    scenario: Scenario = "static"
    arm: Arm = "gantry"
    law: Law = "online"
    images: Literal["auto", "mujoco", "planar"] = "planar"
    pictures: bool = True
    fingers: Literal[2, 3] = 2
    risk: float = DEFAULT_RISK
    sure: float = 0.0

    @property
    def name(self) -> str:
        """Of the trial, and of its files."""
        hand = "" if self.fingers == 2 else f"-{self.fingers}-fingers"
        return f"{self.shape.name}-{self.scenario}-{self.arm}{hand}-{self.law}-{self.seed}"


@dataclass
class Row:
    """What became of a trial; one line of trials.csv.

    Attributes:
        seed, shape, scenario, arm, law: of the case.
        outcome: "lifted", "refused" (no grasp was found on the shape), or "failed".
        reason: empty when lifted.
        confirmed: of a refusal: all pairs, or triples, of the true outline's points were tried, and none closes.
        time_s: until the hand closed, or the trial ended, in the world's time.
        images: that were looked at.
        error_px: farthest contact from its goal as the servo saw it in the last image before closing.
        contact_error_px: farthest tracked contact from its true place in that image.
        aside_mm: true distance of the grasp's middle from the hand's axis when it began to close.
        turned_deg: true angle between the grasp and the hand then.
        again: how often the grasp was chosen anew on the way.
        believed: at closing, the tracker's status was "tracked"; empty where the hand never closed.
        right: at closing, every tracked contact was in truth within max(3 px, 4 % of sqrt(area)) of the one that was chosen,
            which was on the part's outline; empty where the hand never closed.
        start_turn_deg, start_off, start_away: how the view was off at the start: the turn that the chosen grasp asks for,
            share of the view, multiple of the goal's distance.
        servo_ms, loop_ms: medians of a step of the servo, and of tracker and servo together.
        loop_p99_ms: 99th percentile of the latter.
        look_ms: median of the looks at the whole image in which a grasp was chosen; the loop's times are without them.
        fingers: of the case.
        tries: how often the hand closed. What is told above of closing is of the last time.
        noticed: the fingers had nothing between them when they closed for the first time, and the servo knew; empty where they
            held something, or never closed.
        wrong: how often the hand closed and was not `right`.
    """

    seed: int
    shape: str
    scenario: str
    arm: str
    law: str
    outcome: str = "failed"
    reason: str = ""
    confirmed: bool | None = None
    time_s: float = math.nan
    images: int = 0
    error_px: float = math.nan
    contact_error_px: float = math.nan
    aside_mm: float = math.nan
    turned_deg: float = math.nan
    again: int = 0
    believed: bool | None = None
    right: bool | None = None
    start_turn_deg: float = math.nan
    start_off: float = math.nan
    start_away: float = math.nan
    servo_ms: float = math.nan
    loop_ms: float = math.nan
    loop_p99_ms: float = math.nan
    look_ms: float = math.nan
    fingers: int = 2
    tries: int = 0
    noticed: bool | None = None
    wrong: int = 0

    def values(self) -> dict[str, Any]:
        """By the names of the columns."""
        return asdict(self)
