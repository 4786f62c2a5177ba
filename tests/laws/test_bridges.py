# SPDX-License-Identifier: Apache-2.0
"""Arms that speak a protocol of their own, each against something that stands in for it: none was tried on an arm.

ur_rtde and the client of registers are real, and rclpy is a stub.
"""

import json
import math
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from typing import Any, NamedTuple
from urllib.parse import urlencode

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fake_ros_arm import FRAME, FakeRosArm, ThreadedArm
from grasptrack.errors import InputError
from grasptrack.io.arms import LineArm, Order, Report, open_arm
from grasptrack.io.bridges.base import BridgedArm, parse_arm_url
from grasptrack.io.bridges.modbus import _ORDER, ORDER_REGISTERS, pack_order
from grasptrack.io.bridges.ros2 import TOPIC, RosBridge
from grasptrack.servo.camera import apply_twist, inverse_pose, pose_of, rotation_matrix, rotation_vector, twist_in_base
from watched import FedCamera

PATIENCE = 20.0
SOON = 1.0
STAND = Order(np.zeros(6))
TWIST = np.array([0.01, 0.0, 0.02, 0.0, 0.0, 0.1])
MOVE = Order(TWIST, True)
NUMBERS = st.floats(-1.0, 1.0).map(lambda v: v if abs(v) > 1e-6 else 0.0)
TWISTS, PLACES = arrays(float, 6, elements=NUMBERS), arrays(float, 3, elements=NUMBERS)
POSES = st.builds(lambda turn, place: pose_of(rotation_matrix(3.0 * turn), place), PLACES, PLACES)


class Cell(NamedTuple):
    """An arm, and what stands in for it."""

    kind: str
    arm: LineArm
    look: Callable[[], np.ndarray]  # the twist that moves the hand now, in the hand's frame
    change: Callable[..., Any]  # what the stand-in tells
    lose: Callable[[], object]  # the connection, in the middle
    restarts: bool = True

    def run(self, order: Order, seconds: float) -> None:
        """Send an order again and again."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.arm.send_order(order)
            time.sleep(0.02)

    def wait(self, wanted: Callable[[], object], order: Order = STAND) -> float:
        """s until something is so, while an order is sent."""
        began = time.monotonic()
        while not wanted():
            assert time.monotonic() < began + PATIENCE, (self.arm.why_not(), self.look())
            self.run(order, 0.02)
        return time.monotonic() - began

    def stands_soon(self) -> bool:
        """Whether the hand stands, while nothing is sent, and goes on to stand; `research.studies.robot_page` measures when."""
        until = time.monotonic() + SOON
        while self.look().any():
            if time.monotonic() > until:
                return False
            time.sleep(0.005)
        time.sleep(0.3)
        return not self.look().any()


@contextmanager
def ur_cell(settings: str = "") -> Iterator[Cell]:
    pytest.importorskip("rtde_control", reason="ur_rtde is not installed")
    from fake_ur import Processes

    with Processes() as made:
        fake = made.FakeUR()

        def look() -> np.ndarray:
            seen = fake.look()
            return twist_in_base(inverse_pose(seen["hand"]), seen["speed"])

        with closing(open_arm(f"ur:{fake.look()['host']}{settings}", FedCamera())) as arm:
            yield Cell("ur", arm, look, fake.change, fake.hang_up)
        fake.close()


@contextmanager
def modbus_cell() -> Iterator[Cell]:
    pytest.importorskip("pymodbus.simulator", reason="pymodbus is not installed")
    from fake_plc import FakePlc

    with closing(FakePlc()) as fake, closing(open_arm(fake.url, FedCamera())) as arm:
        yield Cell("modbus", arm, lambda: fake.twist, lambda **what: vars(fake).update(what), fake.hang_up)


@contextmanager
def ros_cell() -> Iterator[Cell]:
    bridge = RosBridge(TOPIC, FRAME, "base_link", "/gripper")
    with pytest.MonkeyPatch.context() as patch, closing(FakeRosArm(patch)) as fake, closing(ThreadedArm(bridge)) as arm:
        yield Cell(
            "ros2", arm, lambda: fake.twist, lambda **what: vars(fake).update(what),
            lambda: setattr(fake.world, "up", False), False,
        )  # fmt: skip


CELLS = {"ur": ur_cell, "modbus": modbus_cell, "ros2": ros_cell}


@pytest.fixture(params=CELLS)
def cell(request: pytest.FixtureRequest) -> Iterator[Cell]:
    with CELLS[request.param]() as made:
        made.wait(lambda: not made.arm.why_not())
        yield made


# --- frames and units ------------------------------------------------------------------------------


@given(POSES, TWISTS)
def test_a_twist_along_the_bases_axes_moves_the_hand_as_that_of_its_own_frame(
    pose: np.ndarray, twist: np.ndarray
) -> None:
    step = 1e-6
    after, base = apply_twist(pose, twist, step), twist_in_base(pose, twist)
    np.testing.assert_allclose((after[:3, 3] - pose[:3, 3]) / step, base[:3], atol=1e-5)
    np.testing.assert_allclose(rotation_vector(after[:3, :3] @ pose[:3, :3].T) / step, base[3:], atol=1e-5)


@given(POSES, POSES, TWISTS)
def test_frames_of_twists_go_there_and_back_and_one_after_the_other(
    first: np.ndarray, second: np.ndarray, twist: np.ndarray
) -> None:
    there = twist_in_base(first, twist)
    np.testing.assert_allclose(twist_in_base(inverse_pose(first), there), twist, atol=1e-12)
    np.testing.assert_allclose(twist_in_base(second, there), twist_in_base(second @ first, twist), atol=1e-12)
    assert math.isclose(np.linalg.norm(there[:3]), np.linalg.norm(twist[:3]), abs_tol=1e-12)


@given(TWISTS, st.booleans(), st.integers(0, 10**6), st.none() | st.floats(-1e4, 1e4))
def test_registers_hold_the_order(twist: np.ndarray, enabled: bool, beat: int, ago: float | None) -> None:
    image = None if ago is None else time.time() - ago
    data = pack_order(Order(twist, enabled, image=image), beat, 2, 7)
    assert len(data) == _ORDER.size == 2 * sum(1 if form == "H" else 6 for form, _ in ORDER_REGISTERS)
    version, told, moves, fingers, number, age, *values = struct.unpack(">6H6f", data)
    assert (version, told, moves, fingers, number) == (1, beat % 65536, enabled, 2, 7)
    np.testing.assert_array_equal(values, np.float32(twist) if enabled else np.zeros(6))
    assert age == 65535 if ago is None or ago > 65.535 else max(1e3 * ago, 0.0) <= age < max(1e3 * ago, 0.0) + 100.0


def test_the_hand_moves_as_its_twist_says(cell: Cell) -> None:
    before, _ = cell.arm.hand_pose()
    assert before is not None
    cell.wait(lambda: np.allclose(cell.look(), TWIST, atol=1e-3), MOVE)
    cell.run(MOVE, 0.5)
    after, at = cell.arm.hand_pose()
    assert after is not None and abs(time.perf_counter() - at) < 0.15
    moved = inverse_pose(before) @ after
    assert moved[2, 3] > 0.004 and rotation_vector(moved[:3, :3])[2] > 0.02  # ahead, and about its own z
    assert not cell.arm.why_not()


# --- stops -----------------------------------------------------------------------------------------


def test_it_stands_at_once_when_it_is_told_to(cell: Cell) -> None:
    cell.wait(lambda: cell.look().any(), MOVE)
    cell.arm.send_order(STAND)
    assert cell.stands_soon()


def test_it_stands_when_no_order_comes(cell: Cell) -> None:
    cell.wait(lambda: cell.look().any(), MOVE)
    assert cell.stands_soon() and "acknowledged nothing" in cell.arm.why_not()
    cell.wait(lambda: cell.look().any(), MOVE)


def test_it_stands_when_it_is_let_go_of(cell: Cell) -> None:
    cell.wait(lambda: cell.look().any(), MOVE)
    cell.arm.close()
    assert cell.stands_soon()


def test_it_stands_when_the_connection_is_lost_and_goes_on_when_it_is_back(cell: Cell) -> None:
    cell.wait(lambda: cell.look().any(), MOVE)
    cell.lose()
    assert cell.stands_soon()
    why = cell.wait(cell.arm.why_not)
    assert why < 1.0
    if cell.restarts:
        cell.wait(lambda: not cell.arm.why_not())
        cell.wait(lambda: cell.look().any(), MOVE)


@pytest.mark.parametrize("kind", ["ur", "modbus"])
def test_its_own_watchdog_stops_it_where_the_bridge_is_killed(kind: str) -> None:
    with CELLS[kind]() as cell:
        cell.wait(lambda: cell.look().any(), MOVE)
        cell.arm._process.kill()  # type: ignore[attr-defined]
        assert cell.stands_soon()
        cell.wait(lambda: not cell.arm.why_not())


# --- what it tells ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "trouble", "right", "told", "stopped"),
    [
        ("ur", {"safety": 3}, {"safety": 1}, "protective stop", "protective stop"),
        ("ur", {"safety": 7}, {"safety": 1}, "emergency stop of the robot", "emergency stop"),
        ("ur", {"robot": 5}, {"robot": 7}, "brakes", "brakes"),
        ("ur", {"runs": False}, {}, "program on it has ended", ""),
        ("modbus", {"stop": 7}, {"stop": 0}, "for its reason 7", "reason 7"),
        ("modbus", {"ready": 0}, {"ready": 1}, "not ready", ""),
        ("modbus", {"runs": False}, {"runs": True}, "does not repeat the heartbeat in register 101", ""),
        ("modbus", {"quaternion": np.zeros(4)}, {"quaternion": None}, "no position and unit quaternion", ""),
        ("ros2", {"tells": False}, {"tells": True}, "is it on this clock", ""),
    ],
)
def test_why_it_cannot_be_moved_is_one_line_until_it_can(
    kind: str, trouble: dict[str, Any], right: dict[str, Any], told: str, stopped: str
) -> None:
    with CELLS[kind]() as cell:
        cell.wait(lambda: cell.look().any(), MOVE)
        cell.arm.take_reports()
        cell.change(**trouble)
        cell.wait(lambda: told in cell.arm.why_not(), MOVE)
        assert "\n" not in cell.arm.why_not()
        reasons = [report.stopped for report in cell.arm.take_reports()]
        assert [stopped in reason for reason in reasons] == ([True] if stopped else [])
        cell.change(**right)
        cell.wait(lambda: not cell.arm.why_not())
        cell.wait(lambda: cell.look().any(), MOVE)


def test_a_program_that_goes_on_after_a_stop_does_not_go_on_moving() -> None:
    with ur_cell() as cell:
        cell.wait(lambda: cell.look().any(), MOVE)
        cell.change(safety=3)
        cell.wait(lambda: "protective stop" in cell.arm.why_not() and not cell.look().any(), MOVE)
        cell.change(safety=1)
        for _ in range(30):
            assert np.abs(cell.look()[:3]).max() < 1e-3
            cell.run(STAND, 0.01)
        cell.wait(lambda: not cell.arm.why_not())
        cell.wait(lambda: cell.look().any(), MOVE)


def test_fingers_close_once_and_what_they_hold_is_told_once() -> None:
    told: list[Report] = []
    with modbus_cell() as cell:
        cell.arm.send_order(Order(np.zeros(6), True, close=True))
        cell.run(Order(np.zeros(6), True), 0.1)
        cell.change(fingers=3, opening=0.02)
        cell.wait(lambda: told.extend(cell.arm.take_reports()) or told)
        cell.run(STAND, 0.1)
        assert [round(report.opening or 0.0, 6) for report in told] == [0.02] and not cell.arm.take_reports()
    with ros_cell() as cell:
        cell.arm.send_order(Order(np.zeros(6), True, close=True))
        told.clear()
        cell.wait(lambda: told.extend(cell.arm.take_reports()) or told)
        assert told == [Report(held=True)]
    with ur_cell("?gripper=1&held=2") as cell:
        cell.arm.send_order(Order(np.zeros(6), True, close=True))
        cell.run(STAND, 0.1)
        assert not cell.arm.take_reports()
        cell.change(inputs=4)
        told.clear()
        cell.wait(lambda: told.extend(cell.arm.take_reports()) or told)
        assert told == [Report(held=True)]


@pytest.mark.parametrize(
    ("url", "told"),
    [
        ("ur:", "ur:HOST"),
        ("ur:host:1", "ur:HOST"),
        ("ur:host?gripper=8", "0 to 7"),
        ("ur:host?tool=1", "gripper, held"),
        ("modbus:", "modbus:HOST:PORT"),
        ("modbus:host:x", "modbus:HOST:PORT"),
        ("modbus:host?unit=900", "0 to 65535"),
        ("modbus:host?read=65530", "0 to 65535"),
        ("modbus:host?write=a", "write, read, unit"),
        ("modbus:127.0.0.1:1", "Connection refused"),
        ("ros2:", "ros2:/TOPIC"),
        ("ros2:/topic?open=nan", "ros2:/TOPIC"),
        ("ros2:/topic", "needs rclpy"),
    ],
)
def test_a_url_that_is_none_names_what_would_be_right(url: str, told: str) -> None:
    with pytest.raises(InputError) as error:
        open_arm(url, FedCamera())
    assert told in str(error.value) and "\n" not in str(error.value)


KNOWN = {"gripper": -1, "open": 0.5, "frame": "tool0"}
PARTS = st.tuples(
    st.from_regex(r"[a-z][a-z0-9.-]{0,20}", fullmatch=True),
    st.integers(1, 65535),
    st.fixed_dictionaries(
        {}, optional={"gripper": st.integers(-9, 9), "open": st.floats(-9, 9), "frame": st.just("a/b c")}
    ),
)


@given(PARTS, st.sampled_from(("", "//")))
def test_a_url_is_taken_apart_with_slashes_and_without(parts: tuple[str, int, dict[str, Any]], slashes: str) -> None:
    host, port, told = parts
    query = f"?{urlencode(told)}" if told else ""
    assert parse_arm_url(f"arm:{slashes}{host}:{port}{query}", "", KNOWN) == (host, port, "", {**KNOWN, **told})
    assert parse_arm_url(f"arm:{slashes}{host}{query}", "", KNOWN, 502).port == 502


@given(st.text(max_size=40), st.text(max_size=40))
@example("h?gripper=" + "9" * 400, "")
@example("h?open=1e999", "")
@example("[::1", "")
def test_any_url_is_taken_apart_or_refused_in_a_line(url: str, value: str) -> None:
    for each in (f"arm:{url}", f"arm:host?gripper={value}"):
        with suppress(InputError):
            told = parse_arm_url(each, "arm:HOST", KNOWN).settings
            assert [*map(type, told.values())] == [*map(type, KNOWN.values())] and math.isfinite(told["open"])


def test_registers_that_are_not_there_are_named() -> None:
    pytest.importorskip("pymodbus.simulator", reason="pymodbus is not installed")
    from fake_plc import FakePlc

    with closing(FakePlc()) as fake:
        for where, told in (
            ("write=190", "write holding registers 190 to 207"),
            ("read=190", "read holding registers 190 to 212"),
        ):
            with pytest.raises(InputError, match=told):
                open_arm(f"{fake.url}?{where}", FedCamera())


def test_a_controller_that_takes_no_programs_says_so() -> None:
    pytest.importorskip("rtde_control", reason="ur_rtde is not installed")
    from fake_ur import Processes

    with Processes() as made:
        fake = made.FakeUR("", False)
        with pytest.raises(InputError, match="enable remote control"):
            open_arm(f"ur:{fake.look()['host']}", FedCamera())
        fake.close()


def test_without_ur_rtde_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    from grasptrack.io.bridges import ur

    monkeypatch.setattr(ur, "is_installed", lambda package: False)
    with pytest.raises(InputError, match=r"needs ur_rtde: .* -m pip install .*\[ur\]"):
        open_arm("ur:192.0.2.7", FedCamera())


def test_a_line_of_errors_ends_a_bridge_in_a_sentence() -> None:
    class Broken:
        def reach_arm(self) -> None:
            raise RuntimeError("no\narm")

        exchange_order = release_arm = lambda self, *order: None

    with pytest.raises(InputError) as error:
        ThreadedArm(Broken())  # type: ignore[arg-type]
    assert str(error.value) == 'no arm answers at "ros2:": no arm' and json.dumps(str(error.value))


def test_a_greeting_is_read_and_nothing_that_follows_at_once() -> None:
    arm = object.__new__(BridgedArm)
    arm._closing = threading.Event()
    near, far = socket.socketpair()
    with near, far:
        far.sendall(b'{"error":""}\n{"sequence":1}\n')
        assert arm._read_greeting(near) == "" and near.recv(99) == b'{"sequence":1}\n'
