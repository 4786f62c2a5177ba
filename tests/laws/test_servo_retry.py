# SPDX-License-Identifier: Apache-2.0
"""A hand that closed on nothing tries again; what sightings tell of a tilt, where a chosen grasp is right, room for fingers."""

import copy
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

import grasptrack as gt
from grasptrack.geometry.homographies import apply_homography
from grasptrack.servo.first_estimate import TiltCheck, TiltEstimate
from grasptrack.servo.observation import Observation
from grasptrack.tracking.numbers import NUMBERS
from grasptrack_bench.approach.case import Row
from grasptrack_bench.approach.choosing import closing_grasps, hand_for
from grasptrack_bench.approach.trial import KNOWN
from grasptrack_bench.approach.truth import on_part, record_closing_errors
from grasptrack_bench.physics.gripper import BESIDE, MAX_OPENING
from grasptrack_bench.simulation import SHAPES
from servo_bench import Bench
from test_radial_grasps import SCALE, view


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


@pytest.mark.parametrize("seed", range(3))
def test_a_tilt_is_looked_for_only_where_the_exploratory_moves_are_among_the_sightings(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a part that was pushed aside only a few sightings are left, and those of a hand that goes one way look tilted."""
    begun: list[float] = []
    original = TiltCheck.check_tilt

    def look(self: TiltCheck, seen: Sequence[Observation], *args: Any) -> TiltEstimate | None:
        begun.append(seen[0].time)
        return original(self, seen, *args)

    monkeypatch.setattr(TiltCheck, "check_tilt", look)
    bench = Bench(seed, push=(1.4, 0.04))
    servo = gt.GraspServo(bench.goal(), dof=4)
    assert bench.run(servo).state == "done", servo.reason
    assert begun and max(begun) == min(begun) < 0.2


def told(shift: tuple[float, float], chosen_off: float = 0.0) -> Row:
    """A row of a closing whose contacts lie `shift` px from the chosen ones, which lie so many sqrt(area) off the outline."""
    if find_spec("mujoco") is None:
        pytest.skip("the physical world needs MuJoCo")
    from grasptrack_bench.physics import World

    world, row = World(SHAPES["bracket"](), seed=3, images="planar"), Row(3, "bracket", "static", "gantry", "online")
    ring = world.shape.polygons[0] * world.setting.part.size
    contacts = apply_homography(world.outline_to_image(), ring[[0, len(ring) // 2]])
    chosen = on_part(world, contacts)
    np.testing.assert_allclose(chosen, ring[[0, len(ring) // 2]], atol=1e-9)
    away = chosen - ring.mean(axis=0)
    chosen = chosen + chosen_off * world.setting.part.size * away / np.hypot(*away.T)[:, None]
    record_closing_errors(row, world, chosen, apply_homography(world.outline_to_image(), chosen) + np.array(shift))
    return row


def test_right_is_what_lies_where_it_was_chosen() -> None:
    assert told((0.0, 0.0)).right and told((1.5, -2.0)).right
    assert told((1.5, -2.0)).contact_error_px == pytest.approx(2.5, abs=1e-6)


def test_wrong_is_what_has_slipped_or_was_never_on_the_part() -> None:
    assert told((20.0, 0.0)).right is False
    assert told((0.0, 0.0), chosen_off=3.0 * NUMBERS.tolerance + 0.1).right is False


@pytest.mark.sampled(4)
@pytest.mark.parametrize("told", [1.0 - KNOWN, 1.0 + KNOWN])
@pytest.mark.parametrize("name", ["disc", "rectangle", "guitar", "notched-plate"])
@pytest.mark.parametrize("fingers", [2, 3])
def test_fingers_have_room_beside_a_part_that_is_larger_than_told(name: str, fingers: int, told: float) -> None:
    outline = view(SHAPES[name](), 0.3)
    for size in (0.05, 0.07, 0.095):
        grasps, _ = closing_grasps(outline, fingers, hand_for(told * size, KNOWN))
        arms = [g.contacts - g.contacts.mean(axis=0) for g in grasps]
        across = [2.0 * np.hypot(*arm.T).mean() * size / SCALE for arm in arms]
        assert max(across, default=0.0) <= MAX_OPENING - 2.0 * BESIDE + 1e-3, size
