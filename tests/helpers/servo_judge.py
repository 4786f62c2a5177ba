# SPDX-License-Identifier: Apache-2.0
"""Judges a servo by the truth of the simulated arm, camera and clock, and not by what the servo says of them."""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

import grasptrack as gt

LONGEST = 0.2
"""s of a step that count for the acceleration at most."""
BLIND = 0.3
"""s without a new image after which the hand stands; three intervals between images, where these are longer."""
RISE = 0.05
"""m above its start."""
STILL = 1e-6
"""Norm of a twist that is none."""
SLACK = 1e-9
"""Rounding."""
GRACE = 8
"""Calls more, where the caller's own clock does not tell how much time has passed, or it has not called for a while."""
PAUSE = 2.5
"""Usual steps from which on the caller has not called for a while."""
MISLED = 5.0
"""px between what an image shows and what the hand's camera would show, from which on the image does not follow the hand."""
ASTRAY = 0.02
"""m between where the hand is and where it was told to go, from which on the arm does not follow."""
NOTICING = 0.3
"""s more for what has to be inferred: an image that does not follow the hand, an arm that does not follow the twist."""

OVER = ("done", "empty", "failed")
KINDS = (
    "not finite", "beyond the limits", "undocumented exception", "malformed, yet taken",
    "closed on what is not new, seen and right", "closed beside the grasp", "moved without a new image",
    "moved by images that do not follow the hand", "moved though the arm does not follow", "below the table",
    "above the start", "not over for ever, or not at rest", "closed twice, or opened unasked",
    "no reason in one line", "nothing failed, and yet not done",
)  # fmt: skip


@dataclass(frozen=True)
class Finding:
    """What went wrong."""

    kind: str  # of KINDS
    call: int  # its number in the sequence
    said: str  # details


@dataclass(frozen=True)
class Seen:
    """The truth of one call."""

    seconds: float  # since the call before, by the true clock
    told: float  # the same by the caller's
    image: bool  # a new image of the hand's camera, or of another or a frozen scene, with new pixels, was handed in
    right: bool  # it shows the grasp where it is, and the tracker gives it as tracked
    misled: float  # px between what was handed in and what the hand's camera would show; 0 where nothing was located
    astray: float  # m between where the hand is and where it was told to go
    clearance: float  # m of the lowest fingertip above the table
    rise: float  # m of the hand above its start
    off: tuple[float, float, float]  # m across and along the approach, and rad, from the grasp


@dataclass
class Judge:
    """Takes every command with the truth, and remembers what was wrong with it; each kind is told once."""

    limits: gt.Limits  # the servo's
    interval: float  # s between images, as a rule
    pace: float  # s between calls, as a rule
    retries: int = 0  # how often it may try again
    physical: bool = True  # whether the hand's height is the servo's doing
    calls: int = 0
    findings: list[Finding] = field(default_factory=list)
    twist: np.ndarray = field(default_factory=lambda: np.zeros(6))
    credit: float = 0.0
    intervals: deque[float] = field(default_factory=lambda: deque(maxlen=9))
    blind: float = math.inf
    blind_calls: int = 10**6
    sane: bool = True
    sane_since: bool = True
    misled: float = 0.0
    astray: float = 0.0
    reason: str = ""
    state: str = ""
    over: str = ""
    resting: float = 0.0
    resting_calls: int = 0
    closings: int = 0
    openings: int = 0

    @property
    def patience(self) -> float:
        """s without a new image after which the hand stands."""
        usual = float(np.median(self.intervals)) if self.intervals else 0.0
        return max(BLIND, 3.0 * max(self.interval, usual))

    def find(self, kind: str, said: str) -> None:
        """Something is wrong."""
        if all(f.kind != kind for f in self.findings):
            self.findings.append(Finding(kind, self.calls, said))

    def pass_time(self, seen: Seen) -> None:
        """A call begins, whatever comes of it."""
        self.calls += 1
        sane = abs(seen.told - seen.seconds) < 1e-6
        left = 0.0 if self.sane or sane else self.credit  # what a clock that stood has kept back may come later
        passed = seen.told if self.calls == 2 else 0.0  # how often calls come, nobody can know before
        self.credit = min(max(left + seen.seconds, passed), LONGEST)
        regular = sane and seen.seconds < PAUSE * self.pace  # nobody can brake while nobody calls
        self.sane, self.sane_since = sane, regular and self.sane_since
        self.blind, self.blind_calls = self.blind + seen.seconds, self.blind_calls + 1
        if seen.image:
            if math.isfinite(self.blind):
                self.intervals.append(self.blind)
            self.blind, self.blind_calls, self.sane_since = 0.0, 0, regular
        # what an image has to show, it does not know before; and what it does not believe is a loss, with a policy of its own
        excused = "exploratory" in self.reason or self.state in ("holding", "searching")
        self.misled = self.misled + (0.0 if excused else seen.seconds) if seen.misled > MISLED else 0.0
        self.astray = self.astray + seen.seconds if seen.astray > ASTRAY else 0.0
        self.resting, self.resting_calls = self.resting + seen.seconds, self.resting_calls + 1

    def take(self, command: gt.Command, seen: Seen) -> None:
        """The command of the call that has begun."""
        twist = command.twist
        if not np.isfinite(twist).all():
            self.find("not finite", f"{twist}")
            twist = np.nan_to_num(twist, nan=0.0, posinf=0.0, neginf=0.0)
        self._check_limits(twist)
        if not command.reason or len(command.reason.splitlines()) != 1:
            self.find("no reason in one line", repr(command.reason))
        if "internal error" in command.reason:
            self.find("undocumented exception", command.reason)
        moves = float(np.linalg.norm(twist)) > STILL
        if moves:
            self._check_sight(command, seen)
        self._check_grip(command, seen)
        self._check_end(command, moves)
        if self.physical and not self.over:
            self.check_height(seen)
        self.twist, self.reason, self.state = twist, command.reason, command.state

    def check_height(self, seen: Seen) -> None:
        """Where the hand is."""
        if seen.clearance < 0.0:
            self.find("below the table", f"{1000.0 * -seen.clearance:.1f} mm")
        if seen.rise > RISE + SLACK:
            self.find("above the start", f"{1000.0 * seen.rise:.1f} mm")

    def _check_limits(self, twist: np.ndarray) -> None:
        limits, spent = self.limits, 0.0
        for name, part, most, change in (
            ("m/s", slice(0, 3), limits.linear, limits.linear_acceleration),
            ("rad/s", slice(3, 6), limits.angular, limits.angular_acceleration),
        ):
            size = float(np.linalg.norm(twist[part]))
            by = float(np.linalg.norm(twist[part] - self.twist[part]))
            if size > most + SLACK:
                self.find("beyond the limits", f"{size:.4g} {name}, may be {most:g}")
            if by > change * self.credit + SLACK:
                most = change * self.credit
                self.find("beyond the limits", f"changed by {by:.4g} {name} in one step, may by {most:.4g}")
            spent = max(spent, by / change)
        self.credit = max(self.credit - spent, 0.0)

    def _check_sight(self, command: gt.Command, seen: Seen) -> None:
        """Of a hand that is told to move."""
        said = f"{command.state}, {np.linalg.norm(command.twist):.2g}: {command.reason}"
        calls = self.patience / self.pace + GRACE
        if self.blind > self.patience + SLACK and (self.sane_since or self.blind_calls > calls):
            self.find("moved without a new image", f"{self.blind:.2f} s after the last: {said}")
        longest = self.patience + NOTICING
        if self.misled > longest:
            self.find(
                "moved by images that do not follow the hand", f"{seen.misled:.0f} px, {self.misled:.2f} s: {said}"
            )
        if self.astray > longest:
            self.find(
                "moved though the arm does not follow", f"{1e3 * seen.astray:.0f} mm, {self.astray:.2f} s: {said}"
            )

    def _check_grip(self, command: gt.Command, seen: Seen) -> None:
        opens = bool(getattr(command, "open", False))
        self.closings, self.openings = self.closings + command.close, self.openings + opens
        if self.closings > self.openings + 1 or self.openings > min(self.retries, self.closings):
            self.find("closed twice, or opened unasked", f"{self.closings} closings, {self.openings} openings")
        if not command.close:
            return
        if not (seen.image and seen.right):
            how = "not new" if not seen.image else f"{seen.misled:.0f} px off, or not tracked"
            self.find("closed on what is not new, seen and right", how)
        across, along, turn = seen.off
        if across > 0.006 or abs(along) > 0.01 or abs(turn) > 0.15:
            self.find(
                "closed beside the grasp", f"{1e3 * across:.1f} mm across, {1e3 * along:.1f} along, {turn:.2f} rad"
            )

    def _check_end(self, command: gt.Command, moves: bool) -> None:
        if not self.over:
            if command.state in OVER:
                self.over, self.resting, self.resting_calls = command.state, 0.0, 0
            return
        if command.state != self.over or command.close:
            self.find("not over for ever, or not at rest", f"{self.over}, then {command.state}")
        limits = self.limits
        braking = max(limits.linear / limits.linear_acceleration, limits.angular / limits.angular_acceleration)
        calls = braking / self.pace + GRACE
        if moves and self.resting > braking + SLACK and self.resting_calls > calls:
            self.find("not over for ever, or not at rest", f"{self.resting:.2f} s after the end {command.twist}")
