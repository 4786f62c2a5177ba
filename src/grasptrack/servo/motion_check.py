# SPDX-License-Identifier: Apache-2.0
"""Whether the arm does what it is told, and whether the image follows the hand.

The arm: twists that were told, added up, are a path in the base; the poses are another. Where all is well they agree up to a
factor and a lag. Where the twist is executed in the base's frame, the pose is inverse or in mm, or the arm stands,
the path of another hypothesis fits, and this one does not.

The image: each move foretells what it does, and one that stands still is another camera's. A filter believes an object that
moves along with the hand if it is only told so long enough. So what was believed a moment ago, before any of it, is what
foretells; and what is compared with it is that the image shows no motion at all.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from grasptrack.servo.camera import rotation_vector
from grasptrack.servo.estimate import OUTLIER_SIZE, PLACE_DRIFT, Estimate, rms_deviations
from grasptrack.servo.model import AXES, PLACE, expected_sightings
from grasptrack.servo.observation import Observation, block_diagonal
from grasptrack.servo.watchdog import Limits
from grasptrack.typing import Floats

ARM_LAGS: Floats = np.array([0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3])
"""s by which an arm may be late."""
PROMPT_LAG = 0.15
"""s by which an arm may be late that is not to be taken for one that stands."""
PATH_WINDOWS = (0.3, 0.8)
"""s over which both paths are compared: what stands is found in the first, a frame in the second."""
MIN_POSES = 5
"""Poses that a window holds at least."""
MIN_PATH = 0.0012
"""m rms about its mean from which on a path that was told says something: encoders are ten times as good."""
TURN_LEVER = 0.1
"""m by which turns compare with shifts."""
MAX_STANDING_SHARE = 0.05
"""Share of the path that was told which an arm that stands makes at most."""
MAX_SPEED_FACTOR, POSE_JOLT = 3.0, 0.01
"""Times as fast as it may a hand goes at most, and m besides (over `TURN_LEVER` in rad) for the clock and the encoders."""
MIN_FIT_SHARE, MAX_UNFIT_SHARE = 0.9, 0.5
"""Share of the poses' path that a hypothesis explains (squared correlation): from which on it holds, below which it fails."""
UNIT_FACTOR = 100.0
"""Factor between both paths from which on they are in different units."""


class _ArmSample(NamedTuple):
    """A pose.

    Attributes:
        time: s.
        went: (9,) m, where the hand is in the base, what it has turned in its own frame, times `TURN_LEVER`, and where it is if
            the pose is inverse.
        told: (12,) m, how it was told to go so far, in the same order; then its shift as if twists were in the base's frame.
    """

    time: float
    went: Floats
    told: Floats


class ArmCheck:
    """Remembers the last second of what was told and what came of it.

    A hand that goes much faster than the limits of velocity was somewhere else all the time.

    Attributes:
        twist: (6,) in the hand's frame, that it is told from now on.
    """

    def __init__(self, limits: Limits) -> None:
        self._limits, self._jumped = limits, ""
        self._kept: deque[_ArmSample] = deque()
        self._hand: Floats | None = None
        self.twist: Floats = np.zeros(6)
        self._turned: Floats = np.zeros(3)
        self._told: Floats = np.zeros(12)

    def forget_moves(self) -> None:
        """The clock has jumped: what happened meanwhile is not known."""
        self._kept.clear()
        self._hand, self._jumped = None, ""

    def add_pose(self, now: float, hand: Floats) -> None:
        """The hand (4, 4) in the base at a time, s."""
        if self._hand is not None and self._kept:
            seconds = now - self._kept[-1].time
            if seconds <= 0.0:
                return
            self._note_jump(hand, self._hand, seconds)
            self._turned = self._turned + TURN_LEVER * rotation_vector(self._hand[:3, :3].T @ hand[:3, :3])
            v, w = seconds * self.twist[:3], seconds * self.twist[3:]
            R = self._hand[:3, :3]
            self._told = self._told + np.concatenate([R @ v, TURN_LEVER * w, R.T @ v, v])
        inverse = -hand[:3, :3].T @ hand[:3, 3]
        self._kept.append(_ArmSample(now, np.concatenate([hand[:3, 3], self._turned, inverse]), self._told))
        self._hand = hand
        while len(self._kept) > MIN_POSES and self._kept[1].time <= now - PATH_WINDOWS[-1] - ARM_LAGS[-1]:
            self._kept.popleft()

    def _note_jump(self, hand: Floats, before: Floats, seconds: float) -> None:
        """The pose changes by more than any motion of this hand can be."""
        turn = rotation_vector(before[:3, :3].T @ hand[:3, :3])
        way, angle = math.dist(hand[:3, 3], before[:3, 3]), math.hypot(*turn.tolist())
        far, wide = MAX_SPEED_FACTOR * self._limits.linear * seconds, MAX_SPEED_FACTOR * self._limits.angular * seconds
        if way > far + POSE_JOLT or angle > wide + POSE_JOLT / TURN_LEVER:
            told = math.hypot(*self.twist[:3].tolist()) * seconds
            self._jumped = (
                _not_in_m(way / told)
                if UNIT_FACTOR * told < way < 30.0 * UNIT_FACTOR * told
                else (
                    f"the pose that is handed in jumps, by {100.0 * way:.1f} cm and {math.degrees(angle):.0f} degrees in "
                    f"{seconds:.2g} s: is it always the hand's, in m and in the same frame?"
                )
            )

    def why_not(self) -> str:
        """What is wrong; empty where nothing is, or too little was told to know."""
        if self._jumped or len(self._kept) < MIN_POSES + 1:
            return self._jumped
        times = np.array([m.time for m in self._kept])
        went, late = np.array([m.went for m in self._kept]), self._told_late(times)
        for window in PATH_WINDOWS:
            first = min(int(np.searchsorted(times, times[-1] - window)), len(times) - MIN_POSES)
            why = _fault_of(_about_mean(went[first:]), [_about_mean(path) for path in late[:, first:]])
            if why:
                return why
        return ""

    def _told_late(self, times: Floats) -> Floats:
        """(lags, M, 12), the path as it was told, for an arm that is late by each lag."""
        told, at = np.array([m.told for m in self._kept]), times - ARM_LAGS[:, None]
        after = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
        share = np.clip((at - times[after - 1]) / (times[after] - times[after - 1]), 0.0, 1.0)[..., None]
        return np.asarray(told[after - 1] * (1.0 - share) + told[after] * share)


def _fault_of(went: Floats, late: list[Floats]) -> str:
    """What is wrong of a path (N, 9), as it was told for each lag (N, 12), all about their means."""
    prompt = [path for path, lag in zip(late, ARM_LAGS, strict=True) if lag <= PROMPT_LAG]
    least = min(_rms_length(path[:, :6]) for path in prompt)
    if least > MIN_PATH and _rms_length(went[:, :6]) < MAX_STANDING_SHARE * least:
        return "the arm does not move as it is told: the pose that is handed in does not follow"
    moved = went[:, :3]
    if min(_rms_length(path[:, :3]) for path in prompt) < MIN_PATH or _rms_length(moved) < MIN_PATH:
        return ""
    right = max(_explained_by(path[:, :3], moved) for path in late)
    if right.share > MIN_FIT_SHARE and right.factor > UNIT_FACTOR:
        return _not_in_m(right.factor)
    if right.share >= MAX_UNFIT_SHARE:
        return ""
    based = max(_explained_by(path[:, 9:], moved) for path in late)
    back = max(_explained_by(path[:, 6:9], went[:, 6:9]) for path in late)
    if based.share > MIN_FIT_SHARE:
        return "the twist is executed in the base's frame: it is told in the hand's"
    if back.share > MIN_FIT_SHARE:
        return "the pose that is handed in is inverse, the base's in the hand: the hand's in the base is asked for"
    return ""


def _not_in_m(factor: float) -> str:
    return f"the pose that is handed in is not in m (in mm?): the hand went {factor:.0f} times as far as it was told"


class _Explained(NamedTuple):
    share: float
    factor: float


def _about_mean(path: Floats) -> Floats:
    return np.asarray(path - path.mean(axis=0))


def _rms_length(path: Floats) -> float:
    return float(np.sqrt((path * path).sum() / len(path)))


def _explained_by(by: Floats, path: Floats) -> _Explained:
    """The share of a path (N, 3) that another, times a positive factor, explains, and the factor."""
    both, own, all_ = float((by * path).sum()), float((by * by).sum()), float((path * path).sum())
    if both <= 0.0 or own <= 0.0:
        return _Explained(0.0, 0.0)
    return _Explained(both * both / (own * all_), both / own)


STILL_IMAGES = 3
"""Images in which it has to stand still."""
IMAGE_WINDOW = 1.0
"""s back to which images are compared."""
MAX_STILL_SIZE = 2.0
"""Standard deviations rms within which two sightings are of the same place."""


class _Sighting(NamedTuple):
    """A sighting, and what was believed before it: see `Estimate`."""

    seen: Observation
    state: Floats
    covariance: Floats
    time: float
    wander: float


class ImageCheck:
    """Remembers sightings, and what was believed before each."""

    def __init__(self) -> None:
        self._kept: deque[_Sighting] = deque()

    def forget_sightings(self) -> None:
        """What was seen before is no longer compared: another grasp, or another estimate."""
        self._kept.clear()

    def why_not(self, seen: Observation, known: Estimate) -> str:
        """Why a sighting cannot be believed: the object stands still in the image while the hand moves. Empty otherwise."""
        if self._kept and len(self._kept[-1].seen.points) != len(seen.points):
            self._kept.clear()
        while self._kept and self._kept[0].seen.time < seen.time - IMAGE_WINDOW:
            self._kept.popleft()
        still = []
        for one in reversed(self._kept):  # the longest row of sightings of the same place
            if not _rms_size(seen.points - one.seen.points, seen.noise + one.seen.noise) <= MAX_STILL_SIZE:
                break
            still.append(one)
        self._kept.append(_Sighting(seen, known.packed_state, known.covariance, known.time, known.wander_at(seen.time)))
        if any(_is_contradicted(first, seen) for first in still[STILL_IMAGES - 2 :]):
            return (
                "the image does not follow the hand: the object stands still in it while the hand moves, as in that of another "
                "camera, of one that hangs, or where the object moves along with the hand"
            )
        return ""


def _is_contradicted(before: _Sighting, seen: Observation) -> bool:
    """Whether it is all but impossible, by what was believed before, that the image shows no motion now."""
    n, first = len(seen.points), before.seen
    hands = np.stack([first.hand, seen.hand])
    pixels, slopes = expected_sightings(before.state, hands, np.array([first.time, seen.time]) - before.time)
    shift = (pixels[n:] - pixels[:n]).ravel()
    if not np.isfinite(shift).all():
        return False
    slope = slopes[2 * n :] - slopes[: 2 * n]
    apart, axes = max(seen.time - before.time, 0.0), slopes[2 * n :, PLACE] @ before.state[AXES].reshape(3, 3)
    strays = PLACE_DRIFT**2 * apart + before.wander**2 * apart**3 / 3.0
    spread = slope @ before.covariance @ slope.T + strays * axes @ axes.T + block_diagonal(first.noise + seen.noise)
    return rms_deviations(shift, spread) > OUTLIER_SIZE


def _rms_size(off: Floats, noise: Floats) -> float:
    """In standard deviations, (n, 2) px of covariances (n, 2, 2)."""
    squares = np.einsum("ni,nij,nj->n", off, np.linalg.inv(noise), off)
    return float(np.sqrt(squares.mean() / 2.0))
