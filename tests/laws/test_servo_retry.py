# SPDX-License-Identifier: Apache-2.0
"""A hand that closed on nothing opens and goes back first, whatever the next images say, and then has all its time again."""

import copy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import grasptrack as gt
from servo_bench import Bench


@cache
def _closed_on_nothing() -> tuple[Bench, gt.GraspServo]:
    return closed_on_nothing()


def closed_on_nothing(**options: float) -> tuple[Bench, gt.GraspServo]:
    bench = Bench(1)
    servo = gt.GraspServo(bench.goal(), dof=4, retries=1, **options)  # type: ignore[arg-type]
    while not (command := servo.update(bench.result(), time=bench.time, pose=bench.hand)).close:
        assert not servo.over, servo.reason
        bench.move(command.twist)
    bench.move(command.twist)
    servo.closed(False)
    return bench, servo


def next_try(bench: Bench, servo: gt.GraspServo, first: gt.TrackResult) -> list[gt.Command]:
    """What it is told from a first result on, until it closes again."""
    told = [servo.update(first, time=bench.time, pose=bench.hand)]
    while not (told[-1].close or servo.over):
        bench.move(told[-1].twist)
        told.append(servo.update(bench.result(), time=bench.time, pose=bench.hand))
    return told


@pytest.mark.sampled(1)
@pytest.mark.parametrize("first", ["sure", "unsure", "nonsense"])
def test_it_opens_once_and_goes_back_before_it_closes_again(first: str) -> None:
    bench, servo = copy.deepcopy(_closed_on_nothing())
    result = bench.result()
    if first == "unsure":
        result = replace(result, object_sure=False)
    elif first == "nonsense":
        result = replace(result, contacts=np.full((2, 2), 1e300))
    told = next_try(bench, servo, result)
    assert [command.open for command in told] == [True] + [False] * (len(told) - 1)
    assert told[-1].close, servo.reason
    states = [command.state for command in told]
    assert states[0] == "retreating" and states.index("approaching") > states.count("retreating") - 1


def test_each_try_has_its_own_time_limit() -> None:
    bench, _ = _closed_on_nothing()
    bench, servo = closed_on_nothing(time_limit=bench.time + 0.5)
    for _ in range(20):  # the fingers take longer than what was left
        bench.move(np.zeros(6))
    told = next_try(bench, servo, bench.result())
    assert told[-1].close, servo.reason
