# SPDX-License-Identifier: Apache-2.0
"""What goes wrong around a servo: cameras that hang, answers given twice, clocks that jump, arms that stand, empty hands."""

import copy
import runpy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import grasptrack as gt
from servo_bench import PERIOD, Bench
from setup_errors import try_right, try_wrong

LOST = gt.TrackResult(0, None, "lost", "the camera is dead")


def begun(seed: int, retries: int = 0, **options: float) -> tuple[Bench, gt.GraspServo]:
    """A bench, and a servo with its goal."""
    bench = Bench(seed=seed, **options)  # type: ignore[arg-type]
    return bench, gt.GraspServo(bench.goal(), retries=retries)


def step(bench: Bench, servo: gt.GraspServo, result: gt.TrackResult | None = None, **more: Any) -> gt.Command:
    """One period: what the servo says of a result (the bench's, by default), and the hand does it."""
    command = servo.update(result or bench.result(), time=bench.time, pose=bench.hand, **more)
    bench.commands.append(command)
    bench.move(command.twist)
    return command


def until(
    bench: Bench,
    servo: gt.GraspServo,
    met: Callable[[gt.Command], bool],
    clock: Callable[[float], float] = lambda time: time,
) -> gt.Command:
    """Steps until a command is met, which is not carried out any more; the clock may tell another time than the bench's."""
    for _ in range(1000):
        time = clock(bench.time)
        command = servo.update(replace(bench.result(), time=time), time=time, pose=bench.hand)
        if met(command):
            return command
        assert not servo.over, servo.reason
        bench.move(command.twist)
    raise AssertionError(servo.reason)


def test_once_it_is_over_the_hand_comes_to_rest_and_stays() -> None:
    for ends in ("touched", "stop", "time limit", "another number of contacts"):
        bench = Bench(seed=3)
        servo = gt.GraspServo(bench.goal(), time_limit=1.6 if ends == "time limit" else 40.0)
        fast = until(bench, servo, lambda c: bool(np.linalg.norm(c.twist[:3]) > 0.15))
        before = fast.twist
        if ends == "touched":
            servo.touched()
        elif ends == "stop":
            servo.stop("a person said\nso")
        for k in range(40):
            result = bench.result()
            if ends == "another number of contacts":
                result = replace(Bench(seed=3, fingers=3).result(), frame=1000, time=bench.time)
            command = step(bench, servo, result) if k % 2 else servo.between(time=bench.time, pose=bench.hand)
            bench.time += 0.0 if k % 2 else PERIOD
            if servo.over:
                assert np.linalg.norm(command.twist[:3]) <= np.linalg.norm(before[:3]) + 1e-12
            before = command.twist
        assert servo.over and not before.any() and "\n" not in servo.reason, (ends, servo.reason)


def test_an_answer_that_is_given_again_and_again_never_closes_the_hand() -> None:
    bench, servo = begun(seed=2)
    until(bench, servo, lambda c: c.error_px < 30.0)
    last, taken = bench.results[-1], bench.time
    bench.at = bench.at + 0.05 * np.array([0.6, 0.8, 0.0])  # nobody sees that the part is moved
    for k in range(100):
        command = step(bench, servo, last, taken=taken)
        assert not command.close
        assert k * PERIOD < 0.3 or not command.twist.any()
    assert servo.state == "holding" and "s old" in servo.reason


def test_a_result_that_is_old_does_not_move_the_hand() -> None:
    bench, servo = begun(seed=2)
    for _ in range(60):
        command = step(bench, servo, taken=bench.time - 60.0)
    assert not any(c.twist.any() for c in bench.commands) and "no image yet" in command.reason


def test_closing_latches_and_ends_in_time_where_nobody_tells_what_came_of_it() -> None:
    bench = Bench(seed=5, belt=100.0)
    servo = gt.GraspServo(bench.goal(), closing=gt.Closing(timeout=2.0))
    until(bench, servo, lambda c: c.close)
    begun, at = bench.time, bench.hand[:3, 3].copy()
    step(bench, servo, replace(bench.result(), object_sure=False))
    commands = []
    for k in range(100):
        commands.append(step(bench, servo, replace(LOST, frame=k + 1) if k < 50 else None))
        if servo.over:
            break
    assert not any(c.close for c in commands) and {c.state for c in commands} == {"closing", "failed"}
    assert "call closed()" in servo.reason and 2.0 <= bench.time - begun <= 2.0 + 3 * PERIOD
    assert np.linalg.norm(bench.hand[:3, 3] - at) < 0.1  # it stays with the belt while it sees the part, and not after
    servo.closed(True)
    assert servo.state == "failed"


@pytest.mark.sampled(1)
@pytest.mark.parametrize("fingers", [2, 3])
def test_a_result_without_a_number_of_its_grasp_is_the_grasps_before(fingers: int) -> None:
    bench, servo = begun(seed=1, fingers=fingers)
    for k in range(400):
        result = bench.result()
        bare = replace(result, grasp_id=None, homography=None) if k % 9 == 8 else result
        if step(bench, servo, bare).close:
            return
    pytest.fail(servo.reason)


def test_a_fault_of_the_program_stops_the_hand_and_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    bench, servo = begun(seed=3)
    until(bench, servo, lambda c: bool(np.linalg.norm(c.twist[:3]) > 0.1))
    monkeypatch.setattr(
        "grasptrack.servo.controller.compute_aim", lambda *a: 1 / np.zeros(3, dtype=object)[0] + [].pop()
    )
    monkeypatch.setattr(servo, "_decide_motion", lambda now: [].pop())
    for _ in range(20):
        command = step(bench, servo)
    assert command.state == "failed" and "internal error" in command.reason and not command.twist.any()


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("law", ["online", "nominal", "textbook"])
def test_a_horizon_through_the_grasp_and_contacts_at_no_distance_leave_the_twist_finite(law: str) -> None:
    bench = Bench(seed=1)
    camera = None if law == "online" else gt.NominalCamera(500.0)
    servo = gt.GraspServo(bench.goal(), law=law, camera=camera)  # type: ignore[arg-type]
    seen = bench.result()
    for odd in (
        LOST,
        replace(seen, homography=np.eye(3) + np.eye(3, k=-1), frame=1),
        replace(seen, contacts=np.array([[0.0, 0.0], [0.0, 1e300]]), frame=2),
    ):
        twist = step(bench, servo, odd).twist
        assert np.isfinite(twist).all() and np.linalg.norm(twist[:3]) <= servo.limits.linear


# --- clocks -----------------------------------------------------------------------------------------


@pytest.mark.sampled(1)
@pytest.mark.parametrize("jump", [3600.0, -3600.0])
def test_a_clock_that_jumps_an_hour_is_a_gap(jump: float) -> None:
    bench, servo = begun(seed=1)
    until(bench, servo, lambda c: c.close, lambda time: time + (jump if time > 1.5 else 0.0))
    across, along, turn = bench.off()
    assert across < 2e-3 and abs(along) < 4e-3 and abs(turn) < 0.03


def test_times_that_repeat_are_no_error() -> None:
    bench, servo = begun(seed=1)
    found = until(bench, servo, lambda c: c.close, lambda time: int(time * 12.5) / 12.5)  # half as fine as the loop
    assert found.close


@pytest.mark.parametrize(("scale", "told"), [(1e3, "40 s"), (1e9, "4e+07 s")])
def test_times_in_other_units_are_named(scale: float, told: str) -> None:
    bench, servo = begun(seed=1)
    for _ in range(10):
        command = servo.update(bench.result(), time=scale * bench.time, pose=bench.hand)
        bench.move(command.twist)
    assert command.state == "failed" and f"times differ by {told} between calls: are they in seconds?" in command.reason
    assert not any(c.twist.any() for c in bench.commands)


# --- the image, and the hand --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def example() -> SimpleNamespace:
    return SimpleNamespace(**runpy.run_path(str(Path(__file__).resolve().parents[2] / "examples" / "06_servo.py")))


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("hangs_at", "noise"), [(1.0, 0.0), (1.0, 2.0), (1.6, 2.0), (2.2, 0.0)])
def test_a_camera_that_hangs_stops_the_hand(example: SimpleNamespace, hangs_at: float, noise: float) -> None:
    """With noise it is a still picture that is filmed: pixels are new, but the scene does not follow the hand."""
    robot, rng = example.Robot(), np.random.default_rng(1)
    tracker, servo = gt.GraspTracker(fingers=2), gt.GraspServo(gt.Goal.fingertips(robot.fingertips(), example.OPENING))
    kept, moved_after = robot.image(), 0.0
    while not servo.over and robot.time() < hangs_at + 2.0:
        kept = robot.image() if robot.time() < hangs_at else kept
        shown = kept if not noise else np.clip(kept + rng.normal(0.0, noise, kept.shape), 0, 255).astype(np.uint8)
        command = servo.update(tracker.update(shown, time=robot.time()), time=robot.time(), pose=robot.pose())
        assert not command.close
        if robot.time() > hangs_at + 0.3:
            moved_after = max(moved_after, float(np.abs(command.twist).max()))
        robot.move(command.twist)
    assert moved_after == 0.0, (servo.state, servo.reason)
    assert robot.pose()[2, 3] > 0.0
    assert ("same image again" if not noise else "does not follow the hand") in servo.reason


def test_an_arm_that_stops_in_the_middle_is_told() -> None:
    bench, servo = begun(seed=3)
    until(bench, servo, lambda c: bool(np.linalg.norm(c.twist[:3]) > 0.1))
    stopped = bench.time
    while not servo.over:
        servo.update(bench.result(), time=bench.time, pose=bench.hand)
        bench.move(np.zeros(6))
    assert "does not move as it is told" in servo.reason and bench.time - stopped <= 0.45


# --- another try --------------------------------------------------------------------------------------


@pytest.mark.sampled(1)
@pytest.mark.parametrize("belt", [0.0, 80.0])
@pytest.mark.parametrize("how", [{"held": False}, {"opening": 0.001}])
def test_it_goes_back_along_its_path_and_tries_again(how: dict[str, Any], belt: float) -> None:
    bench, servo = begun(seed=1, belt=belt, retries=1)
    until(bench, servo, lambda c: c.close)
    low = bench.hand[2, 3]
    servo.closed(**how)
    assert servo.state == "retreating" and not servo.over
    bench.at = bench.at + 0.02 * np.array([0.6, 0.8, 0.0])  # what took the part from between the fingers
    commands = [step(bench, servo)]
    while not commands[-1].close:
        assert not servo.over, servo.reason
        commands.append(step(bench, servo))
    assert [c.open for c in commands].count(True) == 1 and commands[0].open
    assert [c.close for c in commands].count(True) == 1
    heights = [c.state for c in commands]
    assert "retreating" in heights and max(low, bench.hand[2, 3]) < low + 0.02
    across, along, turn = bench.off()
    assert across < 3e-3 and abs(along) < 5e-3 and abs(turn) < 0.03
    servo.closed(opening=0.0)
    assert servo.state == "empty" and servo.over and "nothing is in it" in servo.reason


def test_what_the_gripper_reports_tells_whether_it_holds_the_part() -> None:
    bench, servo = begun(seed=1)
    until(bench, servo, lambda c: c.close)
    width = float(np.linalg.norm(bench.shape[1] - bench.shape[0]))
    other = copy.deepcopy(servo)
    other.closed(False)
    assert other.over and other.update(LOST, time=bench.time + 1.0, pose=bench.hand).state == other.state == "failed"
    with pytest.raises(gt.InputError, match="needs to be told"):
        servo.closed()
    with pytest.raises(gt.InputError, match="0 or more"):
        servo.closed(opening=-0.01)
    servo.closed(opening=width)
    assert servo.state == "done"


def test_a_hand_goes_back_the_way_it_came() -> None:
    bench, servo = begun(seed=4, retries=1)
    came = []

    def met(command: gt.Command) -> bool:
        came.append(bench.hand[:3, 3].copy())
        return command.close

    until(bench, servo, met)
    servo.closed(False)
    while step(bench, servo).state == "retreating":
        assert min(np.linalg.norm(np.array(came) - bench.hand[:3, 3], axis=1)) < 0.006
    assert np.linalg.norm(bench.hand[:3, 3] - came[-1]) > 0.9 * servo.standoff


@pytest.mark.parametrize("kind", ["twist in the base's frame", "dof=4 on a tilted part"])
def test_an_error_of_the_set_up_is_named_soon(kind: str) -> None:
    found = try_wrong(kind, 0)
    assert found.names(kind), found


def test_a_set_up_that_is_right_is_not_refused() -> None:
    found = try_right(0)
    assert not found.refused and found.near, found
