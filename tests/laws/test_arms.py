# SPDX-License-Identifier: Apache-2.0
"""An arm over TCP, against the stand-in of the examples: what goes out, what comes back, and what is made of a lost one."""

import json
import math
import socket
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.errors import InputError
from grasptrack.io.arms import ARM_FIELDS, SILENCE, Order, Report, TcpArm, parse_arm_line

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "examples" / "robots"))
from arm import START, StandInArm  # noqa: E402

SCHEMAS = json.loads((ROOT / "docs" / "arm.schema.json").read_text())
OUT, IN = (jsonschema.Draft202012Validator(SCHEMAS["$defs"][name]) for name in ("order", "answer"))
PATIENCE = 20.0
STAND = Order(np.zeros(6))


@pytest.fixture
def stand_in() -> Iterator[StandInArm]:
    made = StandInArm()
    yield made
    made.close()


@pytest.fixture
def arm(stand_in: StandInArm) -> Iterator[TcpArm]:
    made = TcpArm(stand_in.url)
    yield made
    made.close()


def wait(arm: TcpArm, wanted: Callable[[], object], order: Order = STAND) -> None:
    """Send orders until something is so."""
    until = time.monotonic() + PATIENCE
    while not wanted():
        assert time.monotonic() < until, arm.why_not()
        arm.send_order(order)
        time.sleep(0.01)


def test_each_order_is_a_line_of_the_schema_and_is_acknowledged(stand_in: StandInArm, arm: TcpArm) -> None:
    assert "not answered" in arm.why_not()
    wait(arm, lambda: not arm.why_not())
    pose, at = arm.hand_pose()
    assert pose is not None and at <= time.perf_counter()
    np.testing.assert_allclose(pose, START)
    wait(
        arm,
        lambda: stand_in.hand[0, 3] > START[0, 3] + 1e-4,
        Order(np.array([0.01, 0, 0, 0, 0, 0]), True, image=time.time()),
    )
    for _, line in stand_in.lines:
        OUT.validate(line)
    numbers = [line["sequence"] for _, line in stand_in.lines]
    assert numbers == list(range(1, len(numbers) + 1)) and stand_in.lines[-1][1]["enabled"]


def test_what_came_of_closing_is_reported_once(stand_in: StandInArm, arm: TcpArm) -> None:
    arm.send_order(Order(np.zeros(6), True, close=True))
    told: list[Report] = []
    wait(arm, lambda: told.extend(arm.take_reports()) or told)
    assert told == [Report(held=True)] and not arm.take_reports()


def test_an_arm_that_does_not_answer_is_lost_and_one_that_answers_again_is_there(
    stand_in: StandInArm, arm: TcpArm
) -> None:
    wait(arm, lambda: not arm.why_not())
    stand_in.answers = False
    wait(arm, lambda: "acknowledged nothing" in arm.why_not())
    stand_in.answers = True
    wait(arm, lambda: not arm.why_not())


def test_a_connection_that_ends_is_made_again(stand_in: StandInArm, arm: TcpArm) -> None:
    wait(arm, lambda: not arm.why_not())
    stand_in.hang_up()
    wait(arm, lambda: "connection to the arm is lost" in arm.why_not())
    wait(arm, lambda: not arm.why_not())


def test_an_arm_that_reads_nothing_holds_nobody_up_and_is_lost() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        arm = TcpArm(f"tcp://127.0.0.1:{listener.getsockname()[1]}")
        link, _ = listener.accept()
        with link:
            for _ in range(200_000):
                arm.send_order(Order(np.zeros(6)))
                if "lost" in arm.why_not():
                    break
        assert "does not read" in arm.why_not()
        arm.close()


POSE = START.tolist()


@pytest.mark.parametrize(
    "line",
    [
        b"", b"{", b"[]", b"3", b"{}", b'{"sequence": 1}', b"\xff",
        *(json.dumps(told).encode() for told in (
            {"sequence": 1, "pose": [[1.0]]},
            {"sequence": "1", "pose": POSE},
            {"sequence": 1, "pose": np.diag([2.0, 2.0, 2.0, 1.0]).tolist()},
            {"sequence": 1, "pose": POSE, "held": "yes"},
            {"sequence": 1, "pose": POSE, "opening_m": math.nan},
            {"sequence": 1, "pose": POSE, "stopped": 3},
            {"sequence": 1, "pose": POSE, "not_ready": None},
            {"sequence": 1, "pose": POSE, "pose_age_s": math.inf},
        )),
    ],
)  # fmt: skip
def test_a_line_that_is_none_is_refused(line: bytes) -> None:
    with pytest.raises(InputError, match="it sent a line"):
        parse_arm_line(line)


ANSWERS = st.fixed_dictionaries(
    {"sequence": st.integers(0, 1000), "pose": st.just(POSE)},
    optional={
        "held": st.none() | st.booleans(),
        "opening_m": st.none() | st.floats(0.0, 1.0),
        "touched": st.booleans(),
        "stopped": st.text(max_size=20),
        "not_ready": st.text(max_size=20),
        "pose_age_s": st.floats(0.0, 1.0),
    },
)


@given(ANSWERS)
def test_any_answer_of_the_schema_is_understood(answer: dict[str, Any]) -> None:
    IN.validate(answer)
    pose, sequence, report = parse_arm_line(json.dumps(answer).encode())
    assert sequence == answer["sequence"] and np.array_equal(pose, START)
    assert report == Report(*(answer.get(name, left_out) for name, left_out in ARM_FIELDS.items()))


@given(st.binary(max_size=60))
def test_any_bytes_are_a_line_or_refused(line: bytes) -> None:
    with pytest.raises(InputError):
        parse_arm_line(line)


def test_silence_leaves_a_period_of_control_and_some() -> None:
    from grasptrack.live.servo_desk import HELD, PERIOD

    assert max(SILENCE, HELD) + PERIOD < 0.2
