# SPDX-License-Identifier: Apache-2.0
"""Whether the arm does what it is told: twists against the poses that came of them. Nothing here knows of images.

What the hand was told, added up, is a path in the base; the poses are another. Where all is well they agree up to a factor and
a lag. Where the twist is executed in the base's frame, the pose is handed in the wrong way round or in mm, or the arm stands,
the path of another hypothesis fits, and this one does not.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from grasptrack.servo.camera import rotation_vector
from grasptrack.servo.limits import Limits
from grasptrack.typing import Floats

LAGS = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3)
"""s by which an arm may be late."""
LAGS_S: Floats = np.array(LAGS)
PROMPT = 0.15
"""s by which an arm may be late that is not to be taken for one that stands."""
WINDOWS = (0.3, 0.8)
"""s over which both paths are compared: what stands is found in the first, a frame in the second."""
FEWEST = 5
"""Poses that a window holds at least."""
VISIBLE = 0.0012
"""m rms about its mean from which on a path that was told says something: encoders are ten times as good."""
LEVER = 0.1
"""m by which turns compare with shifts."""
STANDS = 0.05
"""Share of the path that was told which an arm that stands makes at most."""
FASTER, JOLT = 3.0, 0.01
"""Times as fast as it may a hand goes at most, and m besides (over `LEVER` in rad) for the clock and the encoders."""
FITS, FITS_NOT = 0.9, 0.5
"""Share of the poses' path that a hypothesis explains (squared correlation): from which on it holds, below which it fails."""
THOUSAND = 100.0
"""Factor between both paths from which on they are in different units."""


class _Moment(NamedTuple):
    """A pose.

    Attributes:
        time: s.
        went: (9,) m, where the hand is in the base, what it has turned in its own frame, times `LEVER`, and where it is if
            the pose is inverse.
        told: (12,) m, how it was told to go so far, in the same order; then its shift as if twists were in the base's frame.
    """

    time: float
    went: Floats
    told: Floats


class ArmCheck:
    """Remembers the last second of what was told and what came of it.

    Args:
        limits: of velocity: a hand that goes much faster than it may was somewhere else all the time.
    """

    def __init__(self, limits: Limits) -> None:
        self._limits, self._jumped = limits, ""
        self._kept: deque[_Moment] = deque()
        self._hand: Floats | None = None
        self._twist: Floats = np.zeros(6)
        self._turned: Floats = np.zeros(3)
        self._told: Floats = np.zeros(12)

    def forget(self) -> None:
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
            self._turned = self._turned + LEVER * rotation_vector(self._hand[:3, :3].T @ hand[:3, :3])
            v, w = seconds * self._twist[:3], seconds * self._twist[3:]
            R = self._hand[:3, :3]
            self._told = self._told + np.concatenate([R @ v, LEVER * w, R.T @ v, v])
        inverse = -hand[:3, :3].T @ hand[:3, 3]
        self._kept.append(_Moment(now, np.concatenate([hand[:3, 3], self._turned, inverse]), self._told))
        self._hand = hand
        while len(self._kept) > FEWEST and self._kept[1].time <= now - WINDOWS[-1] - LAGS[-1]:
            self._kept.popleft()

    def _note_jump(self, hand: Floats, before: Floats, seconds: float) -> None:
        """The pose changes by more than any motion of this hand can be."""
        turn = rotation_vector(before[:3, :3].T @ hand[:3, :3])
        way, angle = math.dist(hand[:3, 3], before[:3, 3]), math.hypot(*turn.tolist())
        far, wide = FASTER * self._limits.linear * seconds, FASTER * self._limits.angular * seconds
        if way > far + JOLT or angle > wide + JOLT / LEVER:
            told = math.hypot(*self._twist[:3].tolist()) * seconds
            self._jumped = (
                _not_in_m(way / told)
                if THOUSAND * told < way < 30.0 * THOUSAND * told
                else (
                    f"the pose that is handed in jumps, by {100.0 * way:.1f} cm and {math.degrees(angle):.0f} degrees in "
                    f"{seconds:.2g} s: is it always the hand's, in m and in the same frame?"
                )
            )

    def tell(self, twist: Floats) -> None:
        """The twist (6,) in the hand's frame that it is told from now on."""
        self._twist = twist

    def why_not(self) -> str:
        """What is wrong; empty where nothing is, or too little was told to know."""
        if self._jumped or len(self._kept) < FEWEST + 1:
            return self._jumped
        times = np.array([m.time for m in self._kept])
        went, late = np.array([m.went for m in self._kept]), self._told_late(times)
        for window in WINDOWS:
            first = min(int(np.searchsorted(times, times[-1] - window)), len(times) - FEWEST)
            why = _judge(_about_mean(went[first:]), [_about_mean(path) for path in late[:, first:]])
            if why:
                return why
        return ""

    def _told_late(self, times: Floats) -> Floats:
        """(lags, M, 12), the path as it was told, for an arm that is late by each lag."""
        told, at = np.array([m.told for m in self._kept]), times - LAGS_S[:, None]
        after = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
        share = np.clip((at - times[after - 1]) / (times[after] - times[after - 1]), 0.0, 1.0)[..., None]
        return np.asarray(told[after - 1] * (1.0 - share) + told[after] * share)


def _judge(went: Floats, late: list[Floats]) -> str:
    """What is wrong of a path (N, 9), as it was told for each lag (N, 12), all about their means."""
    prompt = [path for path, lag in zip(late, LAGS, strict=True) if lag <= PROMPT]
    least = min(_rms(path[:, :6]) for path in prompt)
    if least > VISIBLE and _rms(went[:, :6]) < STANDS * least:
        return "the arm does not move as it is told: the pose that is handed in does not follow"
    moved = went[:, :3]
    if min(_rms(path[:, :3]) for path in prompt) < VISIBLE or _rms(moved) < VISIBLE:
        return ""
    right = max((_explained(path[:, :3], moved) for path in late), key=_share)
    if right.share > FITS and right.factor > THOUSAND:
        return _not_in_m(right.factor)
    if right.share >= FITS_NOT:
        return ""
    based = max((_explained(path[:, 9:], moved) for path in late), key=_share)
    back = max((_explained(path[:, 6:9], went[:, 6:9]) for path in late), key=_share)
    if based.share > FITS:
        return "the twist is executed in the base's frame: it is told in the hand's"
    if back.share > FITS:
        return "the pose that is handed in is inverse, the base's in the hand: the hand's in the base is asked for"
    return ""


def _not_in_m(factor: float) -> str:
    return f"the pose that is handed in is not in m (in mm?): the hand went {factor:.0f} times as far as it was told"


class _Explained(NamedTuple):
    share: float
    factor: float


def _share(found: _Explained) -> float:
    return found.share


def _about_mean(path: Floats) -> Floats:
    return np.asarray(path - path.mean(axis=0))


def _rms(path: Floats) -> float:
    return float(np.sqrt((path * path).sum() / len(path)))


def _explained(by: Floats, path: Floats) -> _Explained:
    """The share of a path (N, 3) that another, times a positive factor, explains, and the factor."""
    both, own, all_ = float((by * path).sum()), float((by * by).sum()), float((path * path).sum())
    if both <= 0.0 or own <= 0.0:
        return _Explained(0.0, 0.0)
    return _Explained(both * both / (own * all_), both / own)
