# SPDX-License-Identifier: Apache-2.0
"""A servo that is told nonsense: jumping poses, times that stop, results of another tracker. Its twist stays within limits."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from grasptrack import Command, Goal, GraspServo, InputError, LossPolicy, NominalCamera, TrackResult
from grasptrack.servo import Limits
from grasptrack.servo.camera import pose_of, rotation_matrix

LIMITS = Limits(linear=0.3, angular=0.9, linear_acceleration=2.0, angular_acceleration=6.0)
CONTACTS = np.array([[300.0, 240.0], [340.0, 240.0]])
ROUNDING = 1e-9


def seen(contacts: Any, **more: Any) -> TrackResult:
    """A result that is believed."""
    told: dict[str, Any] = {
        "grasp_id": 1,
        "contacts": np.asarray(contacts, dtype=np.float64),
        "seen": np.ones(len(contacts)),
        "confidence": 0.99,
        "covariance": np.tile(0.04 * np.eye(2), (len(contacts), 1, 1)),
        "homography": np.eye(3),
    }
    return TrackResult(0, None, "tracked", "", **{**told, **more})


def numbered(result: TrackResult, frame: int) -> TrackResult:
    """Of another image: a servo takes no answer twice."""
    return replace(result, frame=frame)


LOST = TrackResult(0, None, "lost", "not found", confidence=0.0, grasp_id=1)
numbers = st.one_of(st.floats(-500.0, 1000.0), st.sampled_from([math.nan, math.inf, -math.inf, 1e12, 1e300, 0.0]))
small = st.floats(-1.0, 1.0)
results = st.one_of(
    st.just(LOST),
    st.none(),
    st.builds(
        lambda x, y, dx, dy: seen([[x, y], [x + dx, y + dy]]),
        *[st.floats(0.0, 640.0)] * 2,
        *[st.floats(-90.0, 90.0)] * 2,
    ),
    st.builds(lambda a, b, c, d: seen([[a, b], [c, d]]), *[numbers] * 4),
    st.builds(lambda v: seen(CONTACTS, covariance=np.full((2, 2, 2), v)), numbers),
    st.builds(lambda v, k: seen(CONTACTS, homography=np.eye(3) + v * np.eye(3, k=k)), numbers, st.integers(-2, 2)),
    st.builds(lambda c, s: seen(CONTACTS, confidence=c, seen=np.array([s, s])), numbers, numbers),
    st.builds(lambda g: seen(CONTACTS, grasp_id=g), st.sampled_from([None, 1, 2, 9])),
    st.builds(lambda n: seen(CONTACTS, object_sure=n), st.booleans()),
)
poses = st.builds(
    lambda x, y, z, turn, far: pose_of(rotation_matrix([0.1 * turn, turn, 3.0 * turn]), far * np.array([x, y, z])),
    small, small, small, small, st.sampled_from([0.01, 1.0, 1e6]),
)  # fmt: skip
steps = st.sampled_from([0.04, 0.04, 0.04, 1e-9, 0.5, 30.0])


def check(command: Command, before: np.ndarray, step: float) -> np.ndarray:
    """A twist that is finite and within the limits of velocity and acceleration."""
    assert np.isfinite(command.twist).all()
    for part, most, change in (
        (slice(0, 3), LIMITS.linear, LIMITS.linear_acceleration),
        (slice(3, 6), LIMITS.angular, LIMITS.angular_acceleration),
    ):
        assert np.linalg.norm(command.twist[part]) <= most + ROUNDING
        assert np.linalg.norm(command.twist[part] - before[part]) <= change * min(step, 0.2) + ROUNDING
    return command.twist


def told_to(hand: GraspServo, result: TrackResult | None, time: float, pose: np.ndarray) -> Command:
    """The step of control with a result, or the one without an image."""
    return hand.between(time=time, pose=pose) if result is None else hand.update(result, time=time, pose=pose)


def servo(law: str, dof: int, goal: Goal, **more: Any) -> GraspServo:
    camera = None if law == "online" else NominalCamera(500.0)
    return GraspServo(goal, dof, law=law, camera=camera, limits=LIMITS, **more)  # type: ignore[arg-type]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("dof", [4, 6])
@pytest.mark.parametrize("law", ["online", "nominal", "textbook"])
@settings(max_examples=60, deadline=None)
@given(told=st.lists(st.tuples(results, poses, steps), min_size=3, max_size=25))
@example(
    told=[
        (LOST, np.eye(4), 0.04),
        (seen(CONTACTS, homography=np.eye(3) + np.eye(3, k=-1)), np.eye(4), 0.04),
        (seen([[0.0, 0.0], [0.0, 1e300]]), np.eye(4), 0.04),
    ]
)
def test_whatever_is_told_the_twist_is_finite_and_within_limits(law: str, dof: int, told: list[Any]) -> None:
    hand = servo(law, dof, Goal.fingertips([[300.0, 250.0], [360.0, 250.0]], 0.06))
    twist, time = np.zeros(6), 0.0
    for frame, (result, pose, step) in enumerate(told):
        time += step
        result = result and numbered(result, frame)
        twist = check(told_to(hand, result, time, pose), twist, step)


@pytest.mark.parametrize("law", ["online", "nominal"])
@settings(max_examples=20, deadline=None)
@given(first=st.lists(st.tuples(results, poses), min_size=1, max_size=8), after=st.sampled_from([LOST, None]))
def test_without_anything_seen_or_any_image_it_stops_in_the_end(
    law: str, first: list[Any], after: TrackResult | None
) -> None:
    hand = servo(
        law, 4, Goal.taught(CONTACTS + 70.0), time_limit=4.0,
        loss=LossPolicy(coast=0.2, hold=0.2, back_off=0.5, follow=0.5, start=1.0),
    )  # fmt: skip
    twist, time = np.zeros(6), 0.0
    for result, pose in first:
        time += 0.04
        twist = check(told_to(hand, result, time, pose), twist, 0.04)
    for _ in range(120):
        time += 0.04
        twist = check(told_to(hand, after, time, first[-1][1]), twist, 0.04)
    assert hand.over and not twist.any()


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_what_is_no_time_or_pose_is_refused_and_changes_nothing(wrong: float) -> None:
    one, other = (servo("nominal", 4, Goal.taught(CONTACTS + 20.0)) for _ in range(2))
    for hand in (one, other):
        hand.update(numbered(seen(CONTACTS), 1), time=0.0, pose=np.eye(4))
    with pytest.raises(InputError, match="time"):
        one.update(numbered(seen(CONTACTS), 2), time=wrong, pose=np.eye(4))
    for bad in (np.full((4, 4), np.nan), 2.0 * np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0])):
        with pytest.raises(InputError, match="pose"):
            one.update(numbered(seen(CONTACTS), 2), time=0.04, pose=bad)
    last = numbered(seen(CONTACTS), 2)
    assert one.update(last, time=0.04, pose=np.eye(4)) == other.update(last, time=0.04, pose=np.eye(4))


def test_results_of_another_trackers_grasp_end_it_or_do_no_harm() -> None:
    hand = servo("nominal", 4, Goal.taught(CONTACTS))
    command = hand.update(replace(seen(CONTACTS), grasp_id=7), time=0.0, pose=np.eye(4))
    assert np.isfinite(command.twist).all()
    three = np.vstack([CONTACTS, [[320.0, 200.0]]])
    command = hand.update(numbered(seen(three), 1), time=0.04, pose=np.eye(4))
    assert command.state == "failed" and "2 points and the grasp 3" in command.reason
