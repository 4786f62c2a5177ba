# SPDX-License-Identifier: Apache-2.0
"""A hand that is let go of stands at once, and goes on where it stood once it is held again, however often and long."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import grasptrack as gt
from grasptrack.servo.steering import Steering
from servo_bench import PERIOD, Bench

PAUSES = st.lists(st.tuples(st.floats(0.02, 1.5), st.floats(0.02, 2.0)), min_size=1, max_size=6)
STEP = 0.02
"""s of a tick; images come in every second one."""


def steered() -> tuple[Bench, Steering]:
    bench = Bench(seed=1, period=STEP)
    limits = gt.Limits(linear=0.3, angular=1.0, linear_acceleration=1.0, angular_acceleration=4.0)
    return bench, Steering(lambda: gt.GraspServo(bench.goal(), limits=limits, time_limit=100.0), 1)


def drive(bench: Bench, steering: Steering, seconds: float) -> None:
    """For so long; while it is let go of, the arm stands."""
    for k in range(max(round(seconds / STEP), 1)):
        if steering.servo.state == "closing":
            return
        if k % round(PERIOD / STEP) == 0:
            steering.take_result(bench.result(), bench.time)
        twist = steering.next_twist(bench.time + 1e-3, bench.hand, bench.time)
        assert steering.enabled or twist is None or not twist.any()
        bench.move(np.zeros(6) if twist is None else twist)


def approach(pauses: list[tuple[float, float]]) -> None:
    bench, steering = steered()
    for moves, stands in [*pauses, (20.0, STEP)]:
        assert steering.enable(bench.time) == "", steering.servo.reason
        drive(bench, steering, moves)
        if steering.servo.state == "closing":
            break
        steering.stand_still()
        drive(bench, steering, stands)
    assert steering.servo.state == "closing", (steering.servo.state, steering.servo.reason)
    across, along, turn = bench.off()
    assert across < 4e-3 and abs(along) < 6e-3 and abs(turn) < 0.1


@pytest.mark.parametrize("moves", [0.02, 0.3, 0.62, 0.94])
def test_it_goes_on_after_pauses(moves: float) -> None:
    approach([(moves, 0.9), (moves, 0.5), (moves, 0.9), (moves, 0.9)])


@given(PAUSES)
@pytest.mark.slow
def test_an_approach_with_pauses_ends_at_the_grasp(pauses: list[tuple[float, float]]) -> None:
    approach(pauses)
