# SPDX-License-Identifier: Apache-2.0
"""A hand that is let go of stands at once, and goes on where it stood once it is held again, however often and long."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import grasptrack as gt
from grasptrack.servo.steering import Steering
from servo_bench import PERIOD, Bench

PAUSES = st.lists(st.tuples(st.integers(1, 40), st.integers(1, 50)), min_size=1, max_size=6)


def drive(bench: Bench, steering: Steering, periods: int, start: float) -> None:
    """So many periods; while it is let go of, the arm stands."""
    for _ in range(periods):
        if steering.servo.state == "closing":
            return
        steering.take_result(bench.result(), start + bench.time)
        twist = steering.tick(start + bench.time + 1e-3, bench.hand, start + bench.time)
        assert steering.enabled or twist is None or not twist.any()
        bench.move(np.zeros(6) if twist is None else twist)


@given(PAUSES)
@pytest.mark.slow
def test_an_approach_with_pauses_ends_at_the_grasp(pauses: list[tuple[int, int]]) -> None:
    bench = Bench(seed=1)
    steering = Steering(lambda: gt.GraspServo(bench.goal(), time_limit=100.0), 1)
    for moves, stands in [*pauses, (400, 1)]:
        assert steering.enable(1e3 + bench.time) == "", steering.servo.reason
        drive(bench, steering, moves, 1e3)
        if steering.servo.state == "closing":
            break
        steering.stand()
        drive(bench, steering, stands, 1e3)
    assert steering.servo.state == "closing", (steering.servo.state, steering.servo.reason)
    across, along, turn = bench.off()
    assert across < 4e-3 and abs(along) < 6e-3 and abs(turn) < 0.1


@pytest.mark.parametrize("presses", [1, 2, 5])
def test_short_presses_are_no_wrong_clock(presses: int) -> None:
    bench = Bench(seed=1)
    steering = Steering(lambda: gt.GraspServo(bench.goal()), 1)
    for _ in range(presses):
        assert steering.enable(1e3 + bench.time) == ""
        drive(bench, steering, 2, 1e3)
        steering.stand()
        drive(bench, steering, round(0.7 / PERIOD), 1e3)
    assert steering.enable(1e3 + bench.time) == ""
    drive(bench, steering, 400, 1e3)
    assert steering.servo.state == "closing", steering.servo.reason
