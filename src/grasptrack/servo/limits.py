# SPDX-License-Identifier: Apache-2.0
"""The limits of velocity and acceleration that no command exceeds."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grasptrack import arguments
from grasptrack.errors import InputError
from grasptrack.typing import Floats


@arguments.checked(
    linear=arguments.number,
    angular=arguments.number,
    linear_acceleration=arguments.number,
    angular_acceleration=arguments.number,
)
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
