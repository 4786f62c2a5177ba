# SPDX-License-Identifier: Apache-2.0
"""The example for UR arms on its pretended arm: frames, limits, a protective stop. The arm itself is nobody's here."""

import runpy
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.servo.camera import apply_twist, pose_of, rotation_matrix

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


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


numbers = st.floats(-1.0, 1.0)


@given(turn=st.tuples(numbers, numbers, numbers), twist=st.tuples(*[numbers] * 6))
def test_velocities_in_the_base_are_those_of_the_same_point(
    example: SimpleNamespace, turn: tuple[float, ...], twist: tuple[float, ...]
) -> None:
    """Against finite differences of the motion that the twist means in the hand's frame."""
    hand, small = pose_of(rotation_matrix(3.0 * np.array(turn)), np.array([0.3, -0.2, 0.4])), 1e-6
    after = apply_twist(hand, np.array(twist), small)
    before = apply_twist(hand, np.array(twist), -small)
    speed = np.array(example.in_base(hand, np.array(twist)))
    np.testing.assert_allclose((after - before)[:3, 3] / (2 * small), speed[:3], atol=1e-6)
    spin = (after - before)[:3, :3] @ hand[:3, :3].T / (2 * small)
    np.testing.assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], speed[3:], atol=1e-6)


def test_poses_are_read_as_ur_arms_tell_them(example: SimpleNamespace) -> None:
    arm = example.pretend.PretendArm()
    np.testing.assert_allclose(example.pose_matrix(arm.getActualTCPPose()), arm.hand, atol=1e-12)
