# SPDX-License-Identifier: Apache-2.0
"""What the hand does while the grasp is not seen, by a policy with time-outs, and its way back where it closed on nothing."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from grasptrack import arguments
from grasptrack.errors import InputError
from grasptrack.servo.camera import rotation_vector
from grasptrack.servo.command import Intent
from grasptrack.servo.law import Aim
from grasptrack.servo.watchdog import Limits
from grasptrack.typing import Floats

Step = Literal["coast", "hold", "back off", "give up"]


@arguments.checked(arguments.number, speed=arguments.finite)
@dataclass(frozen=True)
class LossPolicy:
    """Steps after a loss, each for its time, in this order.

    Args:
        coast: s for which it goes on as predicted, without going down. 0 where it does not know how to.
        hold: s for which it then stands.
        back_off: s for which it then moves back to see more, and looks.
        speed: m/s of moving back.
        away: m that it moves back at most.
        follow: s for which it stays with an object that moved, through all these steps.
        start: s for which it waits for a first grasp.

    Raises:
        InputError: a time below 0, or a speed that is not positive.
    """

    coast: float = 1.0
    hold: float = 0.5
    back_off: float = 6.0
    speed: float = 0.06
    away: float = 0.15
    follow: float = 3.0
    start: float = 5.0

    def __post_init__(self) -> None:
        if min(self.coast, self.hold, self.back_off, self.away, self.follow, self.start) < 0.0 or not self.speed > 0.0:
            raise InputError("times of a loss policy are 0 or more, its speed positive", policy=repr(self))

    def step(self, lost: float, can_coast: bool) -> Step:
        """What to do after `lost` s without the grasp."""
        coast = self.coast if can_coast else 0.0
        if lost < coast:
            return "coast"
        if lost < coast + self.hold:
            return "hold"
        if lost < coast + self.hold + self.back_off:
            return "back off"
        return "give up"

    @property
    def patience(self) -> float:
        """s of all steps."""
        return self.coast + self.hold + self.back_off


class LossHandler:
    """Knows when the grasp was seen last, and how far the hand has moved back since."""

    def __init__(self, policy: LossPolicy, limits: Limits) -> None:
        self.policy, self._limits = policy, limits
        self._last, self._retreated = math.nan, 0.0

    def note_seen(self, time: float) -> None:
        """The grasp is seen at a time, s."""
        self._last, self._retreated = time, 0.0

    def seen_recently(self, time: float, moment: float) -> bool:
        """Whether it was seen less than a moment ago, s."""
        return time - self._last < moment

    def wait_for_first(self, why: str, waited: float) -> Intent:
        """What to do before there was a grasp: wait, for a while."""
        if waited > self.policy.start:
            return Intent("failed", f"no grasp within {self.policy.start:g} s: {why}")
        return Intent("searching", f"waits for a grasp: {why}")

    def stand_blind(self, why: str, waited: float) -> Intent:
        """What to do where no new image comes: stand, for as long as all steps of a loss take."""
        if waited > self.policy.patience:
            return Intent("failed", f"no new image within {self.policy.patience:g} s: {why}")
        since = "after the clock has jumped" if math.isnan(waited) else f"for {waited:.2f} s"
        return Intent("holding", f"no new image {since}, stands: {why}")

    def choose_intent(
        self,
        why: str,
        time: float,
        waited: float,
        step: float,
        carried: Floats,
        coasting: Callable[[], Aim | None] | None,
    ) -> Intent:
        """What to do.

        Args:
            why: nothing is seen.
            time: s, now.
            waited: s since the servo began.
            step: s since the last call.
            carried: (6,) the twist that keeps the hand with the object.
            coasting: the step toward the goal as predicted; None where nothing is known that could predict it.
        """
        if math.isnan(self._last):
            return self.wait_for_first(why, waited)
        lost = time - self._last
        along = carried if lost < self.policy.follow else np.zeros(6)
        stays = "goes along" if along.any() else "stands"
        match self.policy.step(lost, coasting is not None):
            case "coast":
                found = coasting() if coasting is not None else None
                twist = np.zeros(6) if found is None else found.twist.copy()
                twist[2] = min(twist[2], 0.0)
                doing = f"not seen for {lost:.2f} s, goes on as predicted: {why}"
                return Intent("holding", doing, self._limits.joined(twist, along), found)
            case "hold":
                return Intent("holding", f"not seen for {lost:.2f} s, {stays}: {why}", along)
            case "back off":
                twist = np.zeros(6)
                if self._retreated < self.policy.away:
                    twist[2] = -self.policy.speed
                    self._retreated += self.policy.speed * step
                doing = f"not seen for {lost:.2f} s, {stays}, moves back and looks: {why}"
                return Intent("searching", doing, self._limits.joined(twist, along))
            case _:
                return Intent("failed", f"not found again within {lost:.1f} s: {why}")


PLACE_DISTANCE = 0.004
"""m between the places that are remembered."""
MAX_PLACES = 400
"""Places."""
RETREAT_GAIN = 4.0
"""1/s at which the hand turns and goes to the next place, up to its speed."""


class _Place(NamedTuple):
    time: float
    pose: Floats


class Trail:
    """The places where the hand has been, as seen from the object: one on a belt has gone on since.

    It goes back at m/s `speed`, far enough when it is `far` m from where it closed.
    """

    def __init__(self, speed: float, far: float) -> None:
        self._speed, self._far = speed, far
        self._places: deque[_Place] = deque(maxlen=MAX_PLACES)
        self._from: _Place | None = None

    def add(self, now: float, hand: Floats) -> None:
        """The hand (4, 4) is at a place, s."""
        if not self._places or math.dist(self._places[-1].pose[:3, 3], hand[:3, 3]) > PLACE_DISTANCE:
            self._places.append(_Place(now, hand))

    def start_retreat(self, now: float, hand: Floats) -> None:
        """From here it goes back."""
        self._from = _Place(now, hand)

    def twist_back(self, now: float, hand: Floats, velocity: Floats) -> Floats | None:
        """The twist (6,) toward the place before; None once it is there.

        Less what carries the hand along with the object, whose velocity (3,) is m/s in the base.
        """
        start = self._from
        if start is None or math.dist(_carried_place(start, now, velocity), hand[:3, 3]) >= self._far:
            return None
        while self._places:
            way = _carried_place(self._places[-1], now, velocity) - hand[:3, 3]
            if float(np.sqrt(way @ way)) > PLACE_DISTANCE:
                turn = rotation_vector(hand[:3, :3].T @ self._places[-1].pose[:3, :3])
                size = float(np.sqrt(way @ way))
                back = hand[:3, :3].T @ way * min(RETREAT_GAIN, self._speed / size)
                return np.concatenate([back, RETREAT_GAIN * turn])
            self._places.pop()
        return None


def _carried_place(place: _Place, now: float, velocity: Floats) -> Floats:
    """(3,) m, where a place of the object's surroundings is by now."""
    return np.asarray(place.pose[:3, 3] + (now - place.time) * velocity)
