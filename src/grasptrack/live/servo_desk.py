# SPDX-License-Identifier: Apache-2.0
"""A servo beside a session, and the dead-man's switch without which its arm stands.

One thread owns servo and arm. Another one watches the switch: a step of the servo may take longer than the arm may go on.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from grasptrack.errors import GraspTrackError, InputError
from grasptrack.io.arms import Arm, Order
from grasptrack.live.state import ServoMoment, Shown
from grasptrack.servo.command import Command
from grasptrack.servo.goal import Goal
from grasptrack.servo.setup import ServoSetup
from grasptrack.servo.steering import Steering
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Status

PERIOD = 0.02
"""s of control."""
HELD = 0.15
"""s for which a button that was held is taken to be held: with a period of control the arm stands within 0.2 s."""
TOLD_EVERY = 0.1
"""s between two moments that have the same word."""
TAKEN = "another page holds the button"
LATE = f"the page did not say within {HELD:g} s that the button is held: it hangs, or its network is slow"
IDLE = "stands until the button is held"
WORDS: dict[str, tuple[str, Status]] = {
    "approaching": ("Closing in", "tracked"),
    "converged": ("Closing in", "tracked"),
    "closing": ("Closing", "tracked"),
    "retreating": ("Going back", "unstable"),
}
"""Of the servo's states while the button is held; the others wait."""


class HoldSwitch:
    """Held by one `holder` at most, and only for as long as that one goes on saying so. Threads may share it.

    It tells `why` it was let go of last; empty where nothing is to be told.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.holder: object | None = None
        self.why = ""
        self._until, self._said = 0.0, False

    def press_switch(self, holder: object, now: float) -> None:
        """Begin, at s of some clock; nothing moves before the first `keep_held`.

        Raises:
            InputError: another one holds it.
        """
        with self._lock:
            if self.holder not in (None, holder):
                raise InputError(TAKEN)
            self.holder, self.why, self._until, self._said = holder, "", now + HELD, False

    def keep_held(self, holder: object, held_at: float) -> None:
        """Its holder says that it held it at some time, s; from anybody else, or once it was let go of, that says nothing."""
        with self._lock:
            if self.holder is holder:
                self._until, self._said = max(self._until, held_at + HELD), True

    def let_go(self, why: str, holder: object | None = None) -> None:
        """End it; where a holder is named, only if it is that one's."""
        with self._lock:
            if self.holder is not None and holder in (None, self.holder):
                self.holder, self.why = None, why

    def is_held(self, now: float) -> bool:
        """Whether the arm may move; one whose holder said nothing for too long is let go of."""
        with self._lock:
            if self.holder is not None and now > self._until:
                self.holder, self.why = None, LATE
            return self.holder is not None and self._said


@dataclass
class _Seen:
    """The newest image: its result, and when it came, s of `time.perf_counter`, and Unix time."""

    result: TrackResult | None = None
    image: float | None = None


class ServoDesk:
    """Moves an arm by a session's results while somebody holds its switch. One `LiveSession` takes it, starts and ends it.

    Args:
        setup: of the servo.
        arm: that is moved; it is let go of at the end.
        clock: s, that of `Arrival.at` and `Arm.hand_pose`.

    Attributes:
        switch: the dead-man's switch; `press_switch` presses it.
    """

    def __init__(self, setup: ServoSetup, arm: Arm, clock: Callable[[], float] = time.perf_counter) -> None:
        self._setup, self._arm, self._clock = replace(setup, goal=setup.goal or arm.goal), arm, clock
        self.switch = HoldSwitch()
        self._lock = threading.RLock()
        self._wake, self._stopping = threading.Event(), False
        self._steering: Steering | None = None
        self._size: tuple[int, int] | None = None
        self._follows, self._seen = False, _Seen()
        self._tell: Callable[[ServoMoment], None] = lambda _: None
        self._told, self._told_at = ServoMoment(), 0.0
        self._sending, self._moves = threading.Lock(), False
        run = (("grasptrack-servo", self._run), ("grasptrack-watch", self._watch))
        self._threads = [threading.Thread(target=target, name=name, daemon=True) for name, target in run]

    # --- for other threads -----------------------------------------------------------------------

    def start(self, tell: Callable[[ServoMoment], None]) -> None:
        """Begin; `tell` is called with each moment that differs, and must not wait."""
        self._tell = tell
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Have the arm stand, let go of it, and end; may be called again."""
        self._stopping = True
        self._wake.set()
        for thread in self._threads:
            if thread.ident is not None:
                thread.join()

    def press_switch(self, holder: object) -> None:
        """Press the switch, which the holder has to `keep_held` from then on.

        Raises:
            InputError: the arm cannot be moved now, and why.
        """
        with self._lock:
            steering = self._steering
            why = self._why_not()
            if not self._follows:
                why = "follow an object first"
            elif self._setup.goal is None:
                why = "mark the goal first"
            elif steering is not None and steering.servo.over:
                why = "this approach is over: begin a new one"
            if why:
                raise InputError(why)
            self.switch.press_switch(holder, self._clock())

    def keep_held(self, holder: object, held_at: float | None = None) -> None:
        """Say that the switch is held, now or at some s of the clock."""
        self.switch.keep_held(holder, self._clock() if held_at is None else held_at)

    def set_goal(self, goal: Goal) -> None:
        """Stand, and go for another goal in a new approach."""
        with self._lock:
            self._setup = replace(self._setup, goal=goal)
            self.begin_anew("there is a new goal")

    def begin_anew(self, why: str = "a new approach was begun") -> None:
        """Stand; a new approach begins when the switch is pressed again. What was learnt of the camera is learnt anew."""
        with self._lock:
            self.switch.let_go(why)
            self.switch.why = ""  # what came of the last time is told no more
            if self._steering is not None:
                self._steering.stand_still()
            self._steering = None

    def take_moment(self, shown: Shown) -> None:
        """A session's moment: a listener."""
        with self._lock:
            self._follows = shown.phase == "tracking" and not shown.paused
            arrival = shown.arrival
            if not self._follows or arrival is None or shown.result is None or shown.result is self._seen.result:
                return
            self._size = arrival.frame.image.shape[1], arrival.frame.image.shape[0]
            self._seen = _Seen(shown.result, time.time() - self._clock() + arrival.at)
            if self._steering is not None:
                self._steering.take_result(shown.result, arrival.at - self._setup.options.get("latency", 0.0))
        self._wake.set()

    # --- its thread ------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            while not self._stopping:
                self._wake.wait(PERIOD)
                self._wake.clear()
                self.step_control()
        finally:
            with self._lock:
                self.switch.let_go("the session has ended")
                self._send_now(Order(np.zeros(6)))
                self._arm.close()

    def _watch(self) -> None:
        while not self._stopping:
            time.sleep(PERIOD)
            self.watch_switch()

    def watch_switch(self) -> None:
        """Have an arm that moves stand where the switch is not held, whatever the servo is at; waits for nobody."""
        if self._moves and (self._why_not() or not self.switch.is_held(self._clock())):
            self._send_now(Order(np.zeros(6)))

    def _why_not(self) -> str:
        """Why the arm cannot be moved now; an error of a plug-in's is no end of the watch."""
        try:
            return self._arm.why_not()
        except Exception as error:
            return f"the arm does not answer: {type(error).__name__}: {error}"

    def _send_now(self, order: Order) -> None:
        """Send it, or that the arm shall stand where the switch is not held any more."""
        with self._sending:  # what was decided may have taken long
            if order.enabled and not self.switch.is_held(self._clock()):
                order = Order(np.zeros(6))
            self._moves = True  # until it has taken the order to stand
            try:
                self._arm.send_order(order._replace(image=self._seen.image))
                self._moves = order.enabled
            except Exception as error:
                self.switch.let_go(f"the arm took no order: {type(error).__name__}: {error}")

    def step_control(self) -> None:
        """One period of control; whatever goes wrong in it ends the approach, and the arm is told to stand."""
        with self._lock:
            order = Order(np.zeros(6))
            try:
                order = self._decide_order()
            except Exception as error:  # a pose that is none, or a defect of ours
                line = str(error) if isinstance(error, GraspTrackError) else f"{type(error).__name__}: {error}"
                if self._steering is not None:
                    self._steering.servo.stop(line)
                    self._steering.stand_still()
                self.switch.let_go(line)
            self._send_now(order)
            self._tell_moment()

    def _decide_order(self) -> Order:
        now, standing = self._clock(), Order(np.zeros(6))
        for why in (self._why_not(), "" if self._follows else "no object is followed any more"):
            if why:
                self.switch.let_go(why)
        held = self.switch.is_held(now)
        if held and self._steering is None and self._size is not None:
            size = self._size
            self._steering = Steering(lambda: self._setup.make_servo(size), 1)
        steering = self._steering
        if steering is None:
            return standing
        self._take_reports(steering)
        if held and not steering.enabled:
            steering.enable(now)
        elif steering.enabled and not held:
            steering.stand_still()
        before = steering.command
        twist = steering.next_twist(now, *self._arm.hand_pose())
        if steering.servo.over and not steering.enabled:
            self.switch.let_go("")
        command = steering.command
        if twist is None or not held or command is None:
            return standing
        fresh = command is not before
        return Order(twist, steering.enabled, fresh and command.close, fresh and command.open)

    def _take_reports(self, steering: Steering) -> None:
        servo = steering.servo
        for report in self._arm.take_reports():
            if report.stopped:
                servo.stop(f"the arm has stopped itself: {report.stopped}")
            if report.touched:
                servo.touched()
            if report.held is not None or report.opening is not None:
                servo.closed(report.held, opening=report.opening)

    # --- what is shown ---------------------------------------------------------------------------

    def _tell_moment(self) -> None:
        moment, now = self._describe_moment(), self._clock()
        same = (moment.word, moment.held, moment.goal) == (self._told.word, self._told.held, self._told.goal)
        soon = same and now < self._told_at + TOLD_EVERY
        if moment == self._told or soon:
            return
        self._told, self._told_at = moment, now
        self._tell(moment)

    def _describe_moment(self) -> ServoMoment:
        steering, held = self._steering, self.switch.holder is not None
        about = ServoMoment(
            held=held, goal=self._setup.goal is not None, over=steering is not None and steering.servo.over
        )
        if steering is not None and steering.servo.over:
            servo = steering.servo
            if servo.state == "done":
                return replace(about, word="Closed", tone="tracked", why=servo.reason)
            return replace(about, word="Stopped", tone="lost", why=servo.reason)
        if not held:
            why = self.switch.why or self._why_not()
            return replace(about, word="Stopped", tone="unstable", why=why) if why else replace(about, why=IDLE)
        command: Command | None = None if steering is None else steering.command
        if steering is None or command is None or steering.why:
            return replace(
                about, word="Waiting", tone="unstable", why=steering.why if steering else "for the first image"
            )
        word, tone = WORDS.get(command.state, ("Waiting", "unstable"))
        if command.state == "approaching" and steering.servo.is_exploring:
            word = "Exploring"
        error, height = np.nan_to_num([command.error_px, command.height], posinf=0.0, neginf=0.0).tolist()
        return replace(
            about, word=word, tone=tone, why=command.reason, error_px=round(error, 1), height_m=round(height, 3)
        )
