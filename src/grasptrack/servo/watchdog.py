# SPDX-License-Identifier: Apache-2.0
"""The limits, and the last word on every twist. It knows nothing of vision: only twists, poses, and when an image came.

An arm in velocity mode does what the last twist said until it is told another. So whatever goes wrong further in, what leaves
the servo stays within the limits, comes to rest where nothing new is seen, and stays at rest once all is over.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grasptrack import arguments
from grasptrack.errors import InputError
from grasptrack.servo.clock import PATIENCE_IMAGES, Tick
from grasptrack.typing import Floats


@arguments.checked(arguments.number, blind=arguments.finite)
@dataclass(frozen=True)
class Bounds:
    """What the hand does at most, whatever the images say.

    Args:
        path: m that it is told to go in one approach, along with a moving object included.
        rise: m above its start. Up is against the approach direction of a hand of 4 DoF; of one of 6 it is the axis z of the
            robot's base, as long as the hand comes along it.
        blind: s after the last new image at which it stands; three intervals between images, where these are longer.

    Raises:
        InputError: one of them is not positive.
    """

    path: float = 5.0
    rise: float = 0.05
    blind: float = 0.3

    def __post_init__(self) -> None:
        if not (self.path > 0.0 and self.rise > 0.0 and self.blind > 0.0):
            raise InputError("bounds are positive", bounds=repr(self))


RISE_SHARE = 0.8
"""Share of the rise at which it is told to go no higher: the rest is for the lag of the arm."""
REACTION_TIME = 0.2
"""s within which an arm does what it is told."""
MIN_COSINE_Z = 0.5
"""Cosine from which on a hand of 6 DoF comes along the axis z of the base."""


class Watchdog:
    """Lets a twist pass, less of it, or none.

    Args:
        limits: of velocity and acceleration.
        bounds: of everything else.
        upright: whether the approach direction is that of the hand at the start, as with 4 DoF.

    Attributes:
        twist: (6,), the last that was let pass.
        path: m that the hand was told to go so far, in this try.
        over: it brakes, and then stands for ever.
        floor: m below its start at which the hand is told to go no lower; infinite where nobody said so.
        patience: s without a new image after which the hand stands.
    """

    def __init__(self, limits: Limits, bounds: Bounds, upright: bool) -> None:
        self._limits, self._bounds, self._upright = limits, bounds, upright
        self.twist: Floats = np.zeros(6)
        self.path, self.over, self.floor = 0.0, False, math.inf
        self._start: Floats | None = None
        self._up: Floats = np.zeros(3)
        self._image, self.patience = math.nan, bounds.blind

    def note_image(self, now: float, interval: float) -> None:
        """A new image at a time of the servo's, s; images usually come every so many s."""
        self._image = now
        self.patience = max(self._bounds.blind, PATIENCE_IMAGES * interval)

    def forget_image(self) -> None:
        """The clock has jumped: nobody knows how old the last image is."""
        self._image = math.nan

    def seconds_blind(self, now: float) -> float:
        """s since the last new image; NaN where there was none, or none since the clock jumped."""
        return now - self._image

    def is_blind(self, now: float) -> bool:
        """Whether there was no image, or none for too long."""
        return not now - self._image < self.patience

    def rise_of(self, hand: Floats) -> float:
        """m of the hand (4, 4) above where it started; below it is negative."""
        return 0.0 if self._start is None else float(self._up @ (hand[:3, 3] - self._start))

    def limit_twist(self, wanted: Floats, hand: Floats, tick: Tick, pace: float) -> tuple[Floats, str]:
        """What becomes of a wanted twist (6,), m/s and rad/s in the hand's frame, of which what is not finite stands for 0.

        The hand (4, 4) is where it is now in the base; `pace` is s until the next call, as a rule. What is given back is the
        twist (6,) that is allowed, and why the approach is over; empty where it goes on.
        """
        if self._start is None:
            self._start, self._up = hand[:3, 3].copy(), self._find_up(hand)
        self.path += math.hypot(*self.twist[:3].tolist()) * tick.step
        failure = "" if self.over else self._find_failure(hand)
        if failure:
            self.over = True
        goal = np.zeros(6)
        if not self.over and np.isfinite(wanted).all():
            goal = self._slow_down(wanted, tick.now + pace)
            goal = self._stop_short(goal, hand, self._up, RISE_SHARE * self._bounds.rise - self.rise_of(hand))
            goal = self._stop_short(goal, hand, -self._up, self.floor + self.rise_of(hand))
        self.twist = self._limits.reachable(goal, self.twist, tick.step)
        return self.twist.copy(), failure

    def _find_up(self, hand: Floats) -> Floats:
        approach = hand[:3, 2]
        if self._upright or abs(approach[2]) < MIN_COSINE_Z:
            return np.asarray(-approach)
        return np.array([0.0, 0.0, -math.copysign(1.0, approach[2])])

    def _find_failure(self, hand: Floats) -> str:
        rise = self.rise_of(hand)
        if rise > self._bounds.rise:
            return (
                f"the hand is {100.0 * rise:.1f} cm above its start and may rise by {100.0 * self._bounds.rise:g}: "
                "do its z axis and the frame of the twist lie as docs/servo.md says?"
            )
        if self.path > self._bounds.path:
            return f"told to go {self.path:.1f} m in all, more than bounds.path = {self._bounds.path:g} m"
        return ""

    def _slow_down(self, wanted: Floats, at: float) -> Floats:
        """As much of it as can be braked before the hand has to stand for want of an image."""
        left = self._image + self.patience - at
        left = left if left > 0.0 else 0.0  # also where there was no image yet
        out = wanted.copy()
        for part, rate in (
            (slice(0, 3), self._limits.linear_acceleration),
            (slice(3, 6), self._limits.angular_acceleration),
        ):
            size, most = math.hypot(*wanted[part].tolist()), rate * left
            if size > most:
                out[part] *= most / size
        return out

    def _stop_short(self, wanted: Floats, hand: Floats, toward: Floats, left: float) -> Floats:
        """Less of what would take it farther in a direction of the base than the way in m that is left."""
        way = hand[:3, :3].T @ toward
        speed, left = float(way @ wanted[:3]), max(left, 0.0)
        most = min(left / REACTION_TIME, math.sqrt(2.0 * self._limits.linear_acceleration * left))
        if speed <= most:
            return wanted
        out = wanted.copy()
        out[:3] -= (speed - most) * way
        return out


@arguments.checked(arguments.number)
@dataclass(frozen=True)
class Limits:
    """What the hand may do.

    Args:
        linear: m/s. A belt that is faster cannot be followed.
        angular: rad/s.
        linear_acceleration: m/s^2.
        angular_acceleration: rad/s^2.

    Raises:
        InputError: one of them is not positive.
    """

    linear: float = 0.5
    angular: float = 1.2
    linear_acceleration: float = 2.5
    angular_acceleration: float = 8.0

    def __post_init__(self) -> None:
        if not all(v > 0.0 for v in (self.linear, self.angular, self.linear_acceleration, self.angular_acceleration)):
            raise InputError("limits are positive", limits=repr(self))

    def joined(self, wanted: Floats, carried: Floats) -> Floats:
        """The sum of both twists (6,), the first as much shortened as the velocity limits ask for.

        What carries the hand along with the object is kept, so that a limit slows the approach and not the following.
        """
        more, kept = wanted.tolist(), carried.tolist()
        kept = [*_limit_norm(kept[:3], self.linear), *_limit_norm(kept[3:], self.angular)]
        share = min(_largest_share(kept[:3], more[:3], self.linear), _largest_share(kept[3:], more[3:], self.angular))
        return np.array([k + share * m for k, m in zip(kept, more, strict=True)])

    def reachable(self, wanted: Floats, last: Floats, seconds: float) -> Floats:
        """The twist nearest to the wanted one that velocity and acceleration allow after the last one."""
        goal, before, out = wanted.tolist(), last.tolist(), []
        for part, most, change in (
            (slice(0, 3), self.linear, self.linear_acceleration),
            (slice(3, 6), self.angular, self.angular_acceleration),
        ):
            way = [g - b for g, b in zip(_limit_norm(goal[part], most), before[part], strict=True)]
            way = _limit_norm(way, change * max(seconds, 0.0))
            out += _limit_norm([b + w for b, w in zip(before[part], way, strict=True)], most)
        return np.array(out)


def _limit_norm(v: list[float], most: float) -> list[float]:
    size = math.hypot(*v)
    return v if size <= most else [x * (most / size) for x in v]


def _largest_share(kept: list[float], more: list[float], most: float) -> float:
    """The largest s of 0 to 1 with |kept + s more| <= most."""
    a, b, c = _dot_product(more, more), _dot_product(kept, more), _dot_product(kept, kept) - most**2
    if a < 1e-18 or a + 2.0 * b + c <= 0.0:
        return 1.0
    return min(max((-b + math.sqrt(max(b * b - a * c, 0.0))) / a, 0.0), 1.0)


def _dot_product(v: list[float], w: list[float]) -> float:
    return sum(x * y for x, y in zip(v, w, strict=True))
