# SPDX-License-Identifier: Apache-2.0
"""The loop closed on the kinematic bench: it converges from everywhere, closes on nothing unbelieved, and gives up in time."""

import copy
import itertools
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import grasptrack as gt
from grasptrack.servo.camera import apply_twist, pose_of, rotation_matrix
from grasptrack.servo.estimate import Estimate, refine_estimate
from servo_bench import PERIOD, Bench

SEEDS = range(2)


def servo_for(bench: Bench, **options: object) -> gt.GraspServo:
    return gt.GraspServo(bench.goal(), bench.dof, latency=bench.latency, **options)  # type: ignore[arg-type]


def nominal_for(bench: Bench) -> gt.NominalCamera:
    """About right: some per cent of focal length, some degrees, some centimetres, and nearly twice the distance off."""
    rng = np.random.default_rng(bench.seed)
    mounting = pose_of(
        bench.camera.turn @ rotation_matrix(rng.normal(0.0, 0.06, 3)), bench.camera.offset + rng.normal(0.0, 0.015, 3)
    )
    return gt.NominalCamera(bench.camera.focal * 1.08, mounting, 0.4)


def within(bench: Bench, along_m: float = 4e-3) -> bool:
    across, along, turn = bench.off()
    return across < 2e-3 and abs(along) < along_m and abs(turn) < 0.03


# --- convergence ------------------------------------------------------------------------------------


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "what",
    [
        {},
        {"belt": 320.0},
        {"latency": 0.08},
        {"outliers": 0.4},
        {"blackout": (1.9, 2.4)},
        {"push": (2.4, 0.03)},
        {"fingers": 3},
        {"dof": 6},
        {"noise": 0.3, "camera_tilt": 15.0},
    ],
    ids=lambda w: "-".join(w) or "static",
)
def test_it_converges_with_a_camera_that_nobody_knows(what: dict[str, object]) -> None:
    """Each with a camera of its own; thousands of others: `make fuzz`."""
    bench = Bench(seed=len(str(what)) % 6, **what)  # type: ignore[arg-type]
    servo = bench.run(servo_for(bench))
    assert servo.state == "done", (servo.reason, bench.off())
    assert bench.commands[-1].error_px <= 1.0 and within(bench, 8e-3 if "outliers" in what else 4e-3)


@pytest.mark.slow
def test_a_grasp_that_seems_to_narrow_on_the_way_misleads_less_than_its_contacts_alone() -> None:
    """A side of a thick part that shows in the first view alone: the hand would go down too far."""

    def deepest(seed: int, alone: bool) -> float:
        bench = Bench(seed=seed, narrowing=(0.1, 0.0))
        servo, depth = servo_for(bench), 0.0
        while not servo.over and bench.time < 30.0:
            result = bench.result()
            told = replace(result, homography=None) if alone else result
            command = servo.update(told, time=bench.time, pose=bench.hand)
            depth = max(depth, bench.off()[1])
            if command.close:
                break
            bench.move(command.twist)
        return depth

    alone, whole = ([deepest(seed, how) for seed in range(8)] for how in (True, False))
    assert np.mean(whole) < 0.8 * np.mean(alone), (whole, alone)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", SEEDS)
def test_it_converges_from_a_nominal_camera_that_is_not_quite_right(seed: int) -> None:
    bench = Bench(seed=seed)
    servo = bench.run(servo_for(bench, law="nominal", camera=nominal_for(bench)))
    assert servo.state == "done" and within(bench), (servo.reason, bench.off())
    assert bench.commands[0].reason == "aligns at the stand-off"


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("seed", "dof"), [(0, 4), (1, 6)])
def test_another_grasp_needs_no_new_exploring(seed: int, dof: int) -> None:
    bench = Bench(seed=seed, regrasp=2.0, dof=dof, belt=100.0)
    servo = bench.run(servo_for(bench))
    assert servo.state == "done" and within(bench), (servo.reason, bench.off())
    exploring = [t for t, c in enumerate(bench.commands) if "exploratory" in c.reason]
    assert bench.grasp == 2 and max(exploring) * PERIOD < 2.0


def test_the_textbook_law_converges_with_the_camera_as_it_is() -> None:
    bench = Bench(seed=3, camera_tilt=0.0)
    first = bench.camera.from_hand((bench.contacts() - bench.hand[:3, 3]) @ bench.hand[:3, :3])
    exact = gt.NominalCamera(bench.camera.focal, pose_of(bench.camera.turn, bench.camera.offset), float(first[0, 2]))
    servo = bench.run(servo_for(bench, law="textbook", camera=exact))
    assert servo.state == "done" and within(bench), (servo.reason, bench.off())


def test_a_taught_view_is_reached_again() -> None:
    bench = Bench(seed=4)
    right = bench.right_hand()
    taught = bench.camera.project((bench.contacts() - right[:3, 3]) @ right[:3, :3])
    servo = gt.GraspServo(gt.Goal.taught(taught))
    bench.run(servo)
    assert servo.state == "done" and within(bench), (servo.reason, bench.off())


@pytest.mark.slow
@pytest.mark.parametrize("law", ["online", "textbook"])
def test_only_what_is_carried_ahead_follows_without_lag(law: str) -> None:
    """On a belt the contacts come to rest at the goal; those of the textbook trail behind."""
    bench = Bench(seed=1, belt=120.0, camera_tilt=0.0, aside=0.1)
    strict = gt.Closing(tolerance=1e-9, loosest=1e-9)
    camera = None
    if law == "textbook":
        first = bench.camera.from_hand((bench.contacts() - bench.hand[:3, 3]) @ bench.hand[:3, :3])
        camera = gt.NominalCamera(
            bench.camera.focal, pose_of(bench.camera.turn, bench.camera.offset), float(first[0, 2])
        )
    servo = servo_for(bench, closing=strict, law=law, camera=camera)
    bench.run(servo, seconds=7.0)
    last = [c.error for c in bench.commands[-25:]]
    lag = float(np.hypot(*np.mean(last, axis=0)[:2]))  # in lengths of the segment
    assert lag < 0.005 if law == "online" else lag > 0.1, lag


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", SEEDS)
def test_it_aligns_before_it_goes_down(seed: int) -> None:
    """Within the stand-off the fingers are never far aside: they would hit the object."""
    bench = Bench(seed=seed)
    servo = servo_for(bench)
    while not servo.over and bench.time < 20.0:
        command = servo.update(bench.result(), time=bench.time, pose=bench.hand)
        across, along, turn = bench.off()
        assert along < -0.6 * servo.standoff or (across < 0.008 and abs(turn) < 0.08)
        if command.close:
            return
        bench.move(command.twist)
    pytest.fail(servo.reason)


def test_what_cannot_be_compared_does_no_harm() -> None:
    """Sightings for which the object would lie behind the camera have no weight, and leave everything finite."""
    bench = Bench(seed=2)
    servo = bench.run(servo_for(bench), seconds=2.5)
    known = servo._known
    assert isinstance(known.estimate, Estimate) and known._origin is not None and known._search is not None
    turned = [
        replace(s, hand=s.hand @ pose_of(rotation_matrix((np.pi, 0.0, 0.0)), (0.0, 0.0, 0.0))) for s in known._seen[:6]
    ]
    anew, _ = refine_estimate(known._origin, [*turned, *known._seen], known._search)
    assert np.isfinite(anew.covariance).all()
    assert abs(anew.camera.focal / known.estimate.camera.focal - 1.0) < 0.02
    assert known.estimate.observe(turned[0]) == np.inf


# --- limits -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("what", [{"belt": 320.0, "outliers": 0.4}, {"dof": 6}, {"blackout": (1.0, 99.0)}])
def test_limits_hold_throughout(what: dict[str, object]) -> None:
    bench = Bench(seed=2, **what)  # type: ignore[arg-type]
    limits = gt.Limits(0.3, 0.8, 1.0, 4.0)
    bench.run(servo_for(bench, limits=limits), seconds=12.0)
    twists = np.array([np.zeros(6), *(c.twist for c in bench.commands)])
    for part, most, change in (
        (slice(0, 3), limits.linear, limits.linear_acceleration),
        (slice(3, 6), limits.angular, limits.angular_acceleration),
    ):
        assert np.linalg.norm(twists[:, part], axis=1).max() <= most + 1e-9
        assert np.linalg.norm(np.diff(twists[:, part], axis=0), axis=1).max() <= change * PERIOD + 1e-9


# --- belief -----------------------------------------------------------------------------------------


def at_the_goal() -> tuple[Bench, gt.GraspServo]:
    """A servo that is about to close."""
    return copy.deepcopy(_at_the_goal())


@cache
def _at_the_goal() -> tuple[Bench, gt.GraspServo]:
    bench = Bench(seed=5, noise=0.02)
    servo = servo_for(bench, closing=gt.Closing(images=3), time_limit=1e6)
    while bench.time < 20.0:
        command = servo.update(bench.result(), time=bench.time, pose=bench.hand)
        if command.state == "converged":
            return bench, servo
        bench.move(command.twist)
    raise AssertionError(servo.reason)


WORSE = {
    "tracked": {},
    "unstable": {"status": "unstable", "reason": "chance"},
    "lost": {
        "status": "lost",
        "reason": "covered",
        "contacts": None,
        "seen": None,
        "homography": None,
        "covariance": None,
    },
    "doubtful": {"confidence": 0.2},
    "elsewhere": {"contacts": np.array([[40.0, 40.0], [300.0, 60.0]])},
}


@given(story=st.lists(st.sampled_from(sorted(WORSE)), min_size=3, max_size=25))
def test_it_never_closes_on_what_is_not_believed(story: list[str]) -> None:
    bench, servo = at_the_goal()
    believed = 1
    for what in story:
        bench.move(np.zeros(6))
        told = replace(bench.result(), **WORSE[what])
        command = servo.update(told, time=bench.time, pose=bench.hand)
        believed = believed + 1 if what == "tracked" else 0
        assert not command.close or (believed >= 3 and what == "tracked")
        if command.close:
            assert command.state == "closing" and command.error_px <= 2.5
            return


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("far", "closes"), [(0.0, True), (1.0, False)])
def test_a_contact_may_be_hidden_by_the_fingers_alone(far: float, closes: bool) -> None:
    bench, servo = at_the_goal()
    closed = False
    for _ in range(120):
        bench.move(np.zeros(6))
        told = replace(bench.result(), seen=np.array([0.9, 0.0]))
        if far:  # long out of sight: nobody knows what has become of it
            for _ in range(100):
                bench.move(np.zeros(6))
                told = replace(bench.result(), seen=np.array([0.9, 0.0]), status="unstable")
                servo.update(told, time=bench.time, pose=bench.hand)
            told = replace(bench.result(), time=bench.time, seen=np.array([0.9, 0.0]))
            bench.time += PERIOD
        closed = closed or servo.update(told, time=bench.time, pose=bench.hand).close
        if closed or far:
            break
    assert closed == closes


# --- loss -------------------------------------------------------------------------------------------


def test_a_loss_goes_through_every_step_and_ends_in_time() -> None:
    bench = Bench(seed=0, blackout=(2.5, 1e9))
    policy = gt.LossPolicy(coast=0.6, hold=0.4, back_off=2.0, away=0.05)
    servo = bench.run(servo_for(bench, loss=policy))
    assert servo.state == "failed" and "not found" in servo.reason
    assert 2.5 + 3.0 - 2 * PERIOD <= bench.time <= 2.5 + 3.0 + 3 * PERIOD
    lost = [c for c in bench.commands if c.state in ("holding", "searching")]
    kinds = [k for k, _ in itertools.groupby("coast" if "predicted" in c.reason else c.state for c in lost)]
    assert kinds == ["coast", "holding", "searching"]
    assert all(c.reason for c in bench.commands) and not any(c.close for c in bench.commands)
    back = sum(-c.twist[2] * PERIOD for c in bench.commands if c.state == "searching")
    assert back <= 0.05 + 0.01


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("seed", "what"), [(0, {}), (1, {"belt": 60.0}), (2, {"dof": 6})])
def test_it_goes_on_between_images(seed: int, what: dict[str, Any]) -> None:
    """Every third period brings an image, 8 a second: it closes where it should, and the hand moves on in between."""
    bench = Bench(seed=seed, every=3, **what)
    servo = bench.run(gt.GraspServo(bench.goal(), dof=bench.dof), 40.0)
    assert servo.state == "done", servo.reason
    between = [c for i, c in enumerate(bench.commands) if i % 3]
    assert np.mean([c.twist.any() for c in between]) > 0.8
    assert not any(c.close for c in between)


@pytest.mark.slow
def test_time_stamps_of_images_stand_for_a_latency() -> None:
    one, other = (Bench(seed=4, latency=0.08, stamped=told) for told in (True, False))
    one.run(gt.GraspServo(one.goal()))
    other.run(gt.GraspServo(other.goal(), latency=0.08))
    assert one.commands == other.commands and one.commands[-1].close
    with pytest.raises(gt.InputError, match="one clock"):
        gt.GraspServo(one.goal()).update(one.results[0], time=1.0, pose=one.hand, taken=1.1)


def test_a_camera_that_gives_no_image_any_more_stops_the_hand() -> None:
    bench = Bench(seed=0, frozen=2.0)
    servo = bench.run(gt.GraspServo(bench.goal()), 40.0)
    assert servo.state == "failed" and "no new image within 7.5 s" in servo.reason
    standing = [i for i, c in enumerate(bench.commands) if i * PERIOD >= 2.0 - PERIOD + 0.3]  # after the last image
    assert not any(bench.commands[i].twist.any() for i in standing)
    assert {bench.commands[i].state for i in standing} == {"holding", "failed"}


def test_between_images_before_the_first_it_waits() -> None:
    servo = gt.GraspServo(gt.Goal.fingertips([[300.0, 250.0], [360.0, 250.0]], 0.06))
    for time in (0.0, 0.0, 0.04):
        command = servo.between(time=time, pose=np.eye(4))
        assert command.state == "searching" and "no image yet" in command.reason and not command.twist.any()


def test_an_opening_in_mm_is_refused() -> None:
    with pytest.raises(gt.InputError, match=r"in m: 85 m is no gripper's \(0\.085, if mm were meant\)"):
        gt.Goal.fingertips([[300.0, 250.0], [360.0, 250.0]], 85)


def test_without_a_first_grasp_it_waits_and_gives_up() -> None:
    servo = gt.GraspServo(gt.Goal.fingertips(((100.0, 200.0), (300.0, 200.0)), 0.08), loss=gt.LossPolicy(start=1.0))
    for i in range(40):
        command = servo.update(gt.TrackResult(i, None, "searching", "no object"), time=i * PERIOD, pose=np.eye(4))
        assert (command.twist == 0.0).all() and "no object" in command.reason
        assert command.state == ("searching" if i * PERIOD <= 1.0 else "failed")


def test_a_camera_that_does_not_move_with_the_hand_is_told() -> None:
    bench = Bench(seed=3)
    servo = servo_for(bench)
    still = bench.result()
    hand = bench.hand
    for i in range(1000):
        command = servo.update(replace(still, frame=i, time=i * PERIOD), time=i * PERIOD, pose=hand)
        hand = apply_twist(hand, command.twist, PERIOD)
        if servo.over:
            break
    assert servo.state == "failed" and "do not show" in servo.reason


def test_a_hand_that_touches_before_it_closes_has_failed() -> None:
    bench = Bench(seed=1)
    servo = servo_for(bench)
    while servo.state != "closing":
        other = copy.deepcopy(servo)
        other.touched()
        assert other.over and "touched" in other.reason
        command = other.update(bench.result(), time=bench.time + 0.01, pose=bench.hand)
        assert command.state == "failed" and not command.close
        bench.move(servo.update(bench.result(), time=bench.time, pose=bench.hand).twist)
    servo.touched()
    assert servo.state == "closing"  # fingers that close touch what they close on
    servo.closed(True)
    servo.touched()
    assert servo.state == "done"
