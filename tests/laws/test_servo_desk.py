# SPDX-License-Identifier: Apache-2.0
"""The arm moves while its button is held, and only then; whatever ends that ends with a zero twist, and is told."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import grasptrack as gt
from grasptrack.errors import InputError
from grasptrack.io.arms import Order, Report
from grasptrack.io.base import Frame
from grasptrack.live.inbox import Arrival
from grasptrack.live.servo_desk import HELD, LATE, PERIOD, TAKEN, HoldSwitch, ServoDesk
from grasptrack.live.state import ServoMoment, Shown
from grasptrack.servo.setup import ServoSetup
from servo_bench import Bench

STOPS = 0.2
"""s within which the arm stands, whatever happens to the page."""
IMAGE = np.zeros((480, 640), np.uint8)


class BenchArm:
    """The arm of a kinematic bench."""

    def __init__(self, cell: "Cell") -> None:
        self.goal: gt.Goal | None = cell.bench.goal()
        self._cell, self.orders, self.lost, self.reports, self.closed = cell, list[Order](), "", list[Report](), False

    def why_not(self) -> str:
        return self.lost

    def hand_pose(self) -> tuple[np.ndarray, float]:
        return self._cell.bench.hand, self._cell.now

    def send_order(self, order: Order) -> None:
        self.orders.append(order)

    def take_reports(self) -> list[Report]:
        told, self.reports = self.reports, []
        return told

    def close(self) -> None:
        self.closed = True


@dataclass
class Cell:
    """A desk on a bench in a time that this makes pass: images in every second period of control."""

    bench: Bench = field(default_factory=lambda: Bench(seed=1, period=PERIOD))
    now: float = 100.0
    holds: object | None = None
    sees: bool = True
    told: list[ServoMoment] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.arm = BenchArm(self)
        limits = gt.Limits(linear=0.5, angular=1.2)
        self.desk = ServoDesk(ServoSetup("bench:", None, {"limits": limits}), self.arm, lambda: self.now)
        self.desk._tell = self.told.append
        self.shown = Shown(phase="tracking")
        self.look()

    def look(self) -> None:
        result = self.bench.result()
        arrival = Arrival(Frame(result.frame, result.time, IMAGE, "bench"), self.now - 1e-3, 1)
        self.shown = replace(self.shown, image=result.frame, arrival=arrival, result=result)
        self.desk.take_moment(self.shown)

    def press(self, page: object = "page") -> None:
        self.desk.press_switch(page)
        self.holds = page

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        for k in range(round(seconds / PERIOD)):
            if until():
                return
            if self.holds is not None:
                self.desk.keep_held(self.holds)
            if self.sees and k % 2 == 0:
                self.look()
            self.desk.step_control()
            self.bench.move(self.arm.orders[-1].twist)
            self.now += PERIOD

    @property
    def moves(self) -> bool:
        return bool(self.arm.orders[-1].twist.any())

    @property
    def moment(self) -> ServoMoment:
        return self.desk._describe_moment()

    def start_moving(self) -> None:
        self.press()
        self.run(3.0, until=lambda: bool(self.arm.orders) and self.moves)
        self.run(0.2)
        assert self.moves


def test_nothing_moves_before_the_button_is_held() -> None:
    cell = Cell()
    cell.run(1.0)
    assert not any(order.twist.any() or order.enabled for order in cell.arm.orders)
    assert (cell.moment.word, cell.moment.held) == ("Idle", False)


def test_a_press_alone_moves_nothing() -> None:
    """One that comes late through a slow network is of a button that was let go of since."""
    cell = Cell()
    cell.desk.press_switch("page")
    cell.run(1.0)
    assert not any(order.twist.any() for order in cell.arm.orders)
    assert cell.moment.why == LATE


def test_held_to_the_end_it_closes_at_the_grasp_and_stands() -> None:
    cell = Cell()
    cell.start_moving()
    cell.run(20.0, until=lambda: cell.arm.orders[-1].close)
    across, along, turn = cell.bench.off()
    assert across < 4e-3 and abs(along) < 6e-3 and abs(turn) < 0.1
    cell.arm.reports.append(Report(held=True))
    cell.run(0.5)
    assert not cell.moves and sum(order.close for order in cell.arm.orders) == 1
    assert (cell.moment.word, cell.moment.held) == ("Closed", False)
    assert {"Exploring", "Closing in", "Closing"} <= {moment.word for moment in cell.told}
    with pytest.raises(InputError, match="begin a new one"):
        cell.press()
    cell.desk.begin_anew()
    assert cell.moment.word == "Idle"


CAUSES: dict[str, Callable[[Cell], Any]] = {
    "let go of": lambda cell: cell.desk.switch.let_go("the button was let go of", "page"),
    LATE: lambda cell: None,
    "arm is lost": lambda cell: setattr(cell.arm, "lost", "the arm is lost"),
    "stopped itself: knee": lambda cell: cell.arm.reports.append(Report(stopped="knee")),
    "touched something": lambda cell: cell.arm.reports.append(Report(touched=True)),
    "no object is followed": lambda cell: cell.desk.take_moment(replace(cell.shown, paused=True)),
    "followed any more": lambda cell: cell.desk.take_moment(replace(cell.shown, phase="choosing")),
    "4 x 4": lambda cell: setattr(cell.bench, "hand", np.full((4, 4), math.nan)),
}


@pytest.mark.parametrize("told", CAUSES)
def test_every_cause_ends_with_zero_twists_in_time_and_is_told(told: str) -> None:
    cell = Cell()
    cell.start_moving()
    cell.holds, cell.sees, began = None, False, cell.now
    CAUSES[told](cell)
    cell.run(STOPS - PERIOD)
    assert not cell.moves and cell.now < began + STOPS and not cell.arm.orders[-1].enabled
    cell.run(0.1)
    assert told in cell.moment.why and cell.moment.word == "Stopped" and not cell.moment.held
    cell.holds = "page"  # who holds it still has to press it anew
    cell.bench.hand = cell.bench.start
    cell.arm.lost, cell.sees = "", told != "no object is followed"
    cell.run(0.5)
    assert not cell.moves


def test_an_arm_whose_order_fails_is_told_to_stand_until_it_is_taken() -> None:
    """An arm of a plug-in may raise what it likes: neither the watch nor the control ends."""
    cell = Cell()
    cell.start_moving()
    sound = cell.arm.send_order

    def fail(order: Order) -> None:
        raise RuntimeError("bus off")

    cell.arm.send_order = fail  # type: ignore[method-assign]
    cell.desk.step_control()
    for _ in range(3):
        cell.desk.watch_switch()
    assert not cell.moment.held and "bus off" in cell.moment.why
    cell.arm.send_order = sound  # type: ignore[method-assign]
    cell.desk.watch_switch()
    assert not cell.moves and not cell.arm.orders[-1].enabled


def test_an_arm_that_raises_when_it_is_asked_is_not_moved() -> None:
    cell = Cell()
    cell.start_moving()

    def fail() -> str:
        raise RuntimeError("bus off")

    cell.arm.why_not = fail  # type: ignore[method-assign]
    cell.desk.watch_switch()
    assert not cell.moves
    cell.run(0.1)
    assert not cell.moves and "bus off" in cell.moment.why


def test_the_arm_stands_in_time_while_a_step_of_the_servo_takes_long(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = Cell()
    cell.start_moving()
    began, decide = cell.now, cell.desk._decide_order

    def decide_slowly() -> Order:
        order = decide()
        assert order.twist.any()
        while cell.now < began + 2.0 * STOPS:
            cell.now += PERIOD
            cell.desk.watch_switch()
            assert not cell.moves or cell.now < began + STOPS
        return order

    monkeypatch.setattr(cell.desk, "_decide_order", decide_slowly)
    cell.desk.step_control()
    assert not cell.moves and cell.moment.why == LATE


def test_a_new_goal_stands_and_begins_anew() -> None:
    cell = Cell()
    cell.start_moving()
    cell.desk.set_goal(gt.Goal.taught([(100.0, 100.0), (200.0, 100.0)]))
    cell.run(0.1)
    assert not cell.moves and cell.moment.word == "Idle"


def test_without_a_goal_or_an_object_it_is_not_pressed() -> None:
    cell = Cell()
    cell.desk._setup = replace(cell.desk._setup, goal=None)
    with pytest.raises(InputError, match="goal"):
        cell.press()
    cell.desk.take_moment(replace(cell.shown, phase="choosing"))
    with pytest.raises(InputError, match="object"):
        cell.press()


def test_the_arm_is_told_to_stand_and_let_go_of_at_the_end() -> None:
    cell = Cell()
    cell.desk.start(cell.told.append)
    cell.desk.stop()
    cell.desk.stop()
    assert cell.arm.closed and not cell.moves


PAGES = st.sampled_from(["a", "b", "c"])
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("press"), PAGES),
        st.tuples(st.just("keep"), PAGES, st.floats(0.0, 0.5)),
        st.tuples(st.just("let go"), PAGES),
        st.tuples(st.just("wait"), st.floats(0.0, 0.3)),
    ),
    max_size=60,
)


@given(STEPS)
def test_a_switch_is_held_by_one_who_pressed_it_and_said_so_in_time(steps: list[tuple[Any, ...]]) -> None:
    switch, now, pressed, since, known = HoldSwitch(), 0.0, None, 0.0, -math.inf
    for what, *rest in steps:
        if what == "press":
            if switch.holder not in (None, rest[0]):
                with pytest.raises(InputError, match=TAKEN):
                    switch.press_switch(rest[0], now)
            else:
                switch.press_switch(rest[0], now)
                pressed, since, known = rest[0], now, -math.inf
        elif what == "keep":
            if switch.holder == rest[0]:
                known = max(known, now - rest[1])
            switch.keep_held(rest[0], now - rest[1])
        elif what == "let go":
            switch.let_go("it was let go of", rest[0])
        else:
            now += rest[0]
        if switch.is_held(now):
            assert switch.holder == pressed and known > -math.inf
            assert now <= max(known, since) + HELD
        elif switch.holder is None:
            assert not switch.is_held(now + 1.0)
