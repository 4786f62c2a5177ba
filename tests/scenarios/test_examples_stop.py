# SPDX-License-Identifier: Apache-2.0
"""The loops of the examples leave the arm at rest, whatever ends them; that for UR arms keeps to its limits."""

import importlib
import json
import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import grasptrack as gt

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


class Fault:
    """Makes a method raise: the first time that it is called from so many calls on."""

    def __init__(self, error: type[BaseException], where: str, moment: int) -> None:
        self.error, self.where, self.moment, self.calls = error, where, moment, 0

    def wrap(self, owner: Any, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
        """Watch a method of a class or an object."""
        own = getattr(owner, name)

        def call(*args: Any, **named: Any) -> Any:
            self.calls += 1
            if self.calls >= self.moment and name == self.where:
                raise self.error
            return own(*args, **named)

        monkeypatch.setattr(owner, name, call)


def servo_loop() -> tuple[Callable[[], gt.GraspServo], list[Any], list[np.ndarray]]:
    """06_servo: its loop, objects whose methods it calls, and what the arm was told."""
    example = runpy.run_path(str(EXAMPLES / "06_servo.py"))
    robot, told = example["Robot"](), []
    move, stop = robot.move, robot.stop
    robot.move = lambda twist: (told.append(twist), move(twist))
    robot.stop = lambda: (told.append(np.zeros(6)), stop())
    return lambda: example["approach"](robot), [robot], told


def pretend() -> Any:
    """examples/pretend_arm.py."""
    with pytest.MonkeyPatch.context() as m:
        m.syspath_prepend(str(EXAMPLES))
        return importlib.import_module("pretend_arm")


def listened(arm: Any) -> list[np.ndarray]:
    """What an arm will be told."""
    told: list[np.ndarray] = []
    speed, stop = arm.speedL, arm.speedStop
    arm.speedL = lambda v, a, t: (told.append(np.array(v)), speed(v, a, t))[1]
    arm.speedStop = lambda: (told.append(np.zeros(6)), stop())
    return told


def ur_loop() -> tuple[Callable[[], gt.GraspServo], list[Any], list[np.ndarray]]:
    """07_ur, the same."""
    its = pretend()
    example = runpy.run_path(str(EXAMPLES / "07_ur.py"))
    arm = its.PretendArm()
    camera, gripper, told = its.PretendCamera(arm), its.PretendGripper(arm), listened(arm)
    return lambda: example["grasp"](arm, arm, camera, gripper, its.fingertips()), [arm, camera, gripper], told


def notebook_loop() -> tuple[Callable[[], gt.GraspServo], list[Any], list[np.ndarray]]:
    """The notebook, the same."""
    pretend()
    cells = json.loads((EXAMPLES / "notebooks" / "3_servo.ipynb").read_text())["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    loop = next(i for i, text in enumerate(code) if "while" in text)
    names: dict[str, Any] = {}
    exec("\n".join(code[:loop]), names)

    def run() -> gt.GraspServo:
        exec(code[loop], names)
        return names["servo"]

    return run, [names["arm"], names["camera"], names["gripper"]], listened(names["arm"])


LOOPS = {"06_servo": servo_loop, "07_ur": ur_loop, "notebook": notebook_loop}
CALLS = {
    "06_servo": ["image", "time", "pose", "move", "update"],
    "07_ur": ["newest", "getActualTCPPose", "speedL", "waitPeriod", "kickWatchdog", "update", "between"],
    "notebook": ["newest", "speedL", "update", "between"],
}


@pytest.mark.sampled(8)
@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
@pytest.mark.parametrize(("loop", "where"), [(loop, where) for loop, calls in CALLS.items() for where in calls])
def test_whatever_is_raised_the_arm_is_told_to_stand(
    monkeypatch: pytest.MonkeyPatch, loop: str, where: str, error: type[BaseException]
) -> None:
    run, parts, told = LOOPS[loop]()
    moment = int(np.random.default_rng([*where.encode(), len(error.__name__)]).integers(60, 160))
    fault = Fault(error, where, moment)
    for owner in [*parts, gt.GraspServo]:
        for name in CALLS[loop]:
            if hasattr(owner, name):
                fault.wrap(owner, name, monkeypatch)
    with pytest.raises(error):
        run()
    assert any(twist.any() for twist in told), "it was on its way"
    assert not told[-1].any()


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("loop", "states"),
    [("06_servo", "done"), ("06_servo", "failed"), ("06_servo", "gone"), ("07_ur", "empty"), ("notebook", "gone")],
)
def test_however_it_ends_the_arm_is_told_to_stand(monkeypatch: pytest.MonkeyPatch, loop: str, states: str) -> None:
    """Done; nothing is between the fingers, at no try; the part is taken away."""
    run, parts, told = LOOPS[loop]()
    if states == "gone":
        camera, name = (parts[0], "image") if loop == "06_servo" else (parts[1], "newest")
        own, seen = getattr(camera, name), []

        def image() -> Any:
            seen.append(own())
            return seen[-1] if len(seen) < 60 or seen[-1] is None else np.full_like(seen[-1], 210)

        monkeypatch.setattr(camera, name, image)
    elif states == "failed":
        monkeypatch.setattr(parts[0], "close", lambda: False)
    elif states == "empty":
        monkeypatch.setattr(parts[2], "stopped", lambda: 0.0)
    servo = run()
    assert servo.state == states.replace("gone", "failed"), servo.reason
    assert any(twist.any() for twist in told) and not told[-1].any()


@pytest.fixture(scope="module")
def example() -> SimpleNamespace:
    sys.path.insert(0, str(EXAMPLES))
    try:
        import pretend_arm

        return SimpleNamespace(**runpy.run_path(str(EXAMPLES / "07_ur.py")), pretend=pretend_arm)
    finally:
        sys.path.remove(str(EXAMPLES))


def approach(example: SimpleNamespace, **options: Any) -> tuple[Any, Any]:
    arm = example.pretend.PretendArm(**options)
    p = example.pretend
    return arm, example.grasp(arm, arm, p.PretendCamera(arm), p.PretendGripper(arm), p.fingertips())


def test_it_holds_the_part_and_never_exceeds_its_limits(example: SimpleNamespace) -> None:
    arm, servo = approach(example)
    assert servo.state == "done" and not arm._speed.any()
    assert 0.5 * example.LIMITS.linear < arm.fastest <= example.LIMITS.linear + 1e-9


def test_a_protective_stop_ends_the_approach_and_says_what_to_do(
    example: SimpleNamespace, capsys: pytest.CaptureFixture[str]
) -> None:
    arm, servo = approach(example, stop_at=3.0)
    assert servo.state == "failed" and not arm._speed.any()
    assert "release it on the pendant" in capsys.readouterr().out


def test_an_arm_that_takes_no_commands_ends_the_approach(example: SimpleNamespace) -> None:
    p = example.pretend
    arm = p.PretendArm()
    arm.speedL = lambda *_: False
    servo = example.grasp(arm, arm, p.PretendCamera(arm), p.PretendGripper(arm), p.fingertips())
    assert servo.state == "failed" and "takes no commands" in servo.reason


def test_poses_are_read_as_ur_arms_tell_them(example: SimpleNamespace) -> None:
    arm = example.pretend.PretendArm()
    np.testing.assert_allclose(example.pose_matrix(arm.getActualTCPPose()), arm.hand, atol=1e-12)
