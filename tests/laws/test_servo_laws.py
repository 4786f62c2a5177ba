# SPDX-License-Identifier: Apache-2.0
"""Laws of the servo's parts: derivatives are those of finite differences, limits hold, goals are where they should be."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import grasptrack as gt
from grasptrack.geometry.homographies import apply_homography
from grasptrack.servo import law
from grasptrack.servo.camera import (
    HandCamera,
    apply_twist,
    check_pose,
    interpolate_pose,
    inverse_pose,
    pose_of,
    rotation_matrix,
    rotation_vector,
)
from grasptrack.servo.closing import CloseGate
from grasptrack.servo.estimate import SHAPE, Estimate, Placed, pack_state, unpack_state
from grasptrack.servo.features import Features, rms_diameter, wrap_angle
from grasptrack.servo.law import Aim, Approach, compute_aim, twist_for
from grasptrack.servo.model import expected_sightings, retract_state
from grasptrack.servo.observation import MAX_NOISE_PX, MIN_NOISE_PX, Observation, Poses, ResultObserver
from servo_bench import Bench

SEEDS = st.integers(0, 10_000)


def camera(rng: np.random.Generator, tilt: float = 0.2) -> HandCamera:
    turn = rotation_matrix((0.0, 0.0, rng.uniform(-3.0, 3.0))) @ rotation_matrix((*rng.uniform(-tilt, tilt, 2), 0.0))
    return HandCamera(rng.uniform(400.0, 900.0), np.array([319.5, 239.5]), turn, rng.uniform(-0.1, 0.1, 3))


def in_front(rng: np.random.Generator, cam: HandCamera, k: int) -> np.ndarray:
    """(k, 3) m in the hand's frame, in view."""
    depth = rng.uniform(0.15, 0.6)
    rays = cam.ray_directions(rng.uniform((120.0, 90.0), (520.0, 390.0), (k, 2)))
    return np.asarray(cam.offset + depth * rays * rng.uniform(0.95, 1.05, (k, 1)))


# --- rigid motions --------------------------------------------------------------------------------


@given(v=st.tuples(*[st.floats(-1.7, 1.7)] * 3))
def test_a_rotation_and_its_vector(v: tuple[float, float, float]) -> None:
    R = rotation_matrix(v)
    assert np.abs(R @ R.T - np.eye(3)).max() < 1e-12 and np.linalg.det(R) > 0.0
    assert np.abs(rotation_vector(R) - v).max() < 1e-7


@given(seed=SEEDS)
def test_a_held_twist_goes_on_where_it_was(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose, twist = pose_of(rotation_matrix(rng.normal(size=3)), rng.normal(size=3)), rng.normal(size=6)
    once, twice = apply_twist(pose, twist, 0.7), apply_twist(apply_twist(pose, twist, 0.3), twist, 0.4)
    assert np.abs(once - twice).max() < 1e-12
    assert np.abs(inverse_pose(once) @ once - np.eye(4)).max() < 1e-12
    assert (
        np.abs(interpolate_pose(pose, once, 0.0) - pose).max() < 1e-12
        and np.abs(interpolate_pose(pose, once, 1.0) - once).max() < 1e-9
    )


def test_poses_between_reports() -> None:
    poses, twist = Poses(), np.array([0.1, 0.0, 0.2, 0.0, 0.0, 0.5])
    for t in (0.0, 8.1, 8.2, 8.3):
        poses.add_pose(t, apply_twist(np.eye(4), twist, t))
    between = apply_twist(np.eye(4), twist, 8.26)
    assert np.abs(poses.pose_at(8.26)[:3, :3] - between[:3, :3]).max() < 1e-9
    assert np.abs(poses.pose_at(8.26) - between).max() < 1e-4
    for outside, nearest in ((9.0, 8.3), (-1.0, 8.1)):
        assert np.abs(poses.pose_at(outside) - apply_twist(np.eye(4), twist, nearest)).max() < 1e-12


# --- derivatives ----------------------------------------------------------------------------------


@given(seed=SEEDS, k=st.integers(2, 4))
def test_slopes_of_features(seed: int, k: int) -> None:
    rng = np.random.default_rng(seed)
    contacts, goal = rng.uniform(0.0, 600.0, (2, k, 2))
    features = Features(goal, np.array([319.5, 239.5]))
    about = [(points - points.mean(axis=0)) @ (1.0, 1.0j) for points in (goal, contacts)]
    if abs(np.vdot(*about)) < 0.05 * rms_diameter(contacts) * rms_diameter(goal):
        return  # no turn to speak of
    found, step = features.jacobian_at(contacts), 1e-3
    for i in range(2 * k):
        d = np.zeros(2 * k)
        d[i] = step
        by = features.feature_values(contacts + d.reshape(k, 2)) - features.feature_values(contacts - d.reshape(k, 2))
        by[3] = wrap_angle(by[3])
        assert np.abs(found[:, i] - by / (2.0 * step)).max() < 1e-5 * (1.0 + np.abs(found).max())


@given(seed=SEEDS)
def test_the_interaction_matrix_is_what_the_hand_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cam = camera(rng)
    points = in_front(rng, cam, 3)
    found = cam.interaction_matrices(points)
    for axis, step in itertools.product(range(6), (1e-5,)):
        twist = np.eye(6)[axis]
        seen = [
            cam.project((points - h[:3, 3]) @ h[:3, :3])
            for h in (apply_twist(np.eye(4), s * twist, step) for s in (1, -1))
        ]
        assert np.abs(found[:, :, axis] - (seen[0] - seen[1]) / (2.0 * step)).max() < 1e-3 * (1.0 + np.abs(found).max())


@given(seed=SEEDS)
def test_derivatives_by_all_that_is_unknown(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cam, n = camera(rng), 3
    turn = rotation_matrix((np.pi, 0.0, 0.0)) @ rotation_matrix(rng.normal(0.0, 0.1, 3))
    hand = pose_of(rotation_matrix((np.pi, 0.0, 0.0)), (0.0, 0.0, 0.5))
    middle = hand[:3, :3] @ (cam.offset + 0.4 * cam.ray_directions(np.array([[320.0, 240.0]]))[0]) + hand[:3, 3]
    object_ = Placed(rng.uniform(-0.03, 0.03, (n, 2)), turn, middle, rng.normal(0.0, 0.1, 3), turn * (1.0, 1.0, 0.3))
    hands = np.array([apply_twist(hand, rng.normal(0.0, 0.1, 6), 0.3) for _ in range(2)])
    later = np.array([0.0, 0.4])
    state = pack_state(cam, object_)
    _, found = expected_sightings(state, hands, later)
    found = found.reshape(2 * n, 2, -1)
    step = 1e-6
    for i in range(SHAPE + 2 * n):
        d = np.zeros(SHAPE + 2 * n)
        d[i] = step
        up, down = (expected_sightings(retract_state(state, s * d), hands, later)[0] for s in (1.0, -1.0))
        assert np.abs(found[..., i] - (up - down) / (2.0 * step)).max() < 1e-4 * (1.0 + np.abs(found[..., i]).max())


@given(seed=SEEDS)
def test_a_state_keeps_camera_and_object(seed: int) -> None:
    """What is expected of a packed state is what the camera sees of the object's points."""
    rng = np.random.default_rng(seed)
    cam, n, hand = camera(rng), 3, pose_of(rotation_matrix(rng.normal(size=3)), rng.normal(size=3))
    there, turn = in_front(rng, cam, 1)[0], rotation_matrix(rng.normal(size=3))
    place = hand[:3, :3] @ there + hand[:3, 3]
    object_ = Placed(
        rng.uniform(-0.03, 0.03, (n, 2)), turn, place, rng.normal(0.0, 0.1, 3), rotation_matrix(rng.normal(size=3))
    )
    state = pack_state(cam, object_)
    pixels, _ = expected_sightings(state, hand[None], np.array([0.2]))
    in_hand = (object_.predict_after(0.2).in_base() - hand[:3, 3]) @ hand[:3, :3]
    np.testing.assert_allclose(pixels, cam.project(in_hand), atol=1e-6)
    assert (pack_state(*unpack_state(state)) == state).all()


@given(seed=SEEDS)
def test_a_segment_parallel_to_the_image_decouples(seed: int) -> None:
    """x/l and y/l fall by the camera's shift over L, l*/l by its approach over the depth at the goal, the angle by its turn."""
    rng = np.random.default_rng(seed)
    cam = HandCamera(rng.uniform(400, 900), np.array([319.5, 239.5]), np.eye(3), np.zeros(3))
    L, depth, spin = rng.uniform(0.02, 0.1), rng.uniform(0.2, 0.6), rng.uniform(-3, 3)
    half = 0.5 * L * np.array([math.cos(spin), math.sin(spin), 0.0])
    middle = np.array([*rng.uniform(-0.1, 0.1, 2), depth])
    points = np.array([middle - half, middle + half])
    goal = cam.project(np.array([(-L / 2, 0.0, 0.15), (L / 2, 0.0, 0.15)]))
    features = Features(goal, cam.centre)
    J = features.jacobian_at(cam.project(points)) @ cam.interaction_matrices(points).reshape(4, 6)
    wanted = np.zeros((4, 6))
    wanted[0, 0] = wanted[1, 1] = -1.0 / L
    wanted[2, 2], wanted[3, 5] = -1.0 / 0.15, -1.0
    wanted[:2, 5] = middle[1] / L, -middle[0] / L  # the camera turns about its own axis
    assert np.abs(J - wanted)[:, [0, 1, 2, 5]].max() < 1e-9 * np.abs(wanted).max()


# --- law and limits -------------------------------------------------------------------------------


@given(seed=SEEDS, dof=st.sampled_from([4, 6]))
def test_errors_fall_at_the_rate_of_the_gain(seed: int, dof: int) -> None:
    rng = np.random.default_rng(seed)
    J = np.eye(6)[[0, 1, 2, 5] if dof == 4 else list(range(6))] + 0.1 * rng.normal(size=(dof, 6))
    error, gain = 0.1 * rng.normal(size=dof), gt.Gain()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(law, "DAMPING", 1e-6)
        twist = twist_for(error, J, np.eye(dof) * 1e-8, dof=dof, length=1.0, gain=gain)
    rate = gain.at(float(np.linalg.norm(error)))
    J_used = J if dof == 6 else J * [1, 1, 1, 0, 0, 1]
    assert np.abs(J_used @ twist + rate * error).max() < 1e-5
    assert dof == 6 or (twist[3:5] == 0.0).all()


def test_what_is_poorly_known_is_followed_slowly() -> None:
    J, error, gain = np.eye(6)[[0, 1, 2, 5]], np.full(4, 0.1), gt.Gain()
    unsure = np.diag([1e-8, 1e-8, 100.0, 1e-8])
    twist = twist_for(error, J, unsure, dof=4, length=1.0, gain=gain)
    assert abs(twist[2]) < 0.5 * abs(twist[0])


@given(seed=SEEDS, size=st.floats(0.0, 100.0), seconds=st.floats(0.0, 0.2))
def test_no_command_exceeds_the_limits(seed: int, size: float, seconds: float) -> None:
    rng = np.random.default_rng(seed)
    limits = gt.Limits(*rng.uniform(0.05, 3.0, 4))
    last = limits.reachable(rng.normal(size=6), rng.normal(size=6) * 0.01, 1.0)
    out = limits.reachable(size * rng.normal(size=6), last, seconds)
    for part, most, change in (
        (slice(0, 3), limits.linear, limits.linear_acceleration),
        (slice(3, 6), limits.angular, limits.angular_acceleration),
    ):
        assert np.linalg.norm(out[part]) <= most * (1.0 + 1e-12)
        assert np.linalg.norm(out[part] - last[part]) <= change * seconds + 1e-12


@given(seed=SEEDS)
def test_a_limit_slows_the_approach_and_not_the_following(seed: int) -> None:
    rng = np.random.default_rng(seed)
    limits = gt.Limits(0.5, 1.0)
    carried, wanted = np.zeros(6), rng.normal(size=6)
    carried[:2] = rng.uniform(-0.3, 0.3, 2)
    out = limits.joined(wanted, carried)
    assert np.linalg.norm(out[:3]) <= 0.5 + 1e-9 and np.linalg.norm(out[3:]) <= 1.0 + 1e-9
    share = float((out - carried) @ wanted / (wanted @ wanted))
    assert 0.0 <= share <= 1.0 and np.abs(out - carried - share * wanted).max() < 1e-9


def test_the_gain_falls_with_the_error() -> None:
    gain = gt.Gain(4.0, 1.0, 0.5)
    values = [gain.at(e) for e in np.linspace(0.0, 5.0, 50)]
    assert values[0] == 4.0 and all(a > b for a, b in itertools.pairwise(values)) and values[-1] >= 1.0


# --- goals ----------------------------------------------------------------------------------------


@given(seed=SEEDS, k=st.sampled_from([2, 3]))
def test_contacts_at_the_goal_lie_between_the_fingertips(seed: int, k: int) -> None:
    rng = np.random.default_rng(seed)
    cam, opening = camera(rng), rng.uniform(0.05, 0.1)
    around = 2.0 * np.pi * np.arange(k) / k
    radius = 0.5 * opening / math.sin(math.pi / k)
    middle = cam.offset + rng.uniform(0.15, 0.3) * cam.ray_directions(np.array([[300.0, 260.0]]))[0]
    tips = np.column_stack([radius * np.cos(around), radius * np.sin(around), np.zeros(k)]) + middle
    goal = gt.Goal.fingertips(cam.project(tips), opening, beyond_m=0.002)
    spin, share = rng.uniform(-3.0, 3.0), rng.uniform(0.3, 0.9)
    c, s = math.cos(spin), math.sin(spin)
    shape = share * (tips - middle)[:, :2] @ np.array([[c, s], [-s, c]])
    contacts = np.column_stack([shape, np.full(k, 0.3)])
    order = goal.orders(cam, contacts)[0]
    right = goal.targets(cam, shape, order)
    assert np.abs(right.mean(axis=0) - middle + (0.0, 0.0, 0.002)).max() < 1e-6
    assert np.abs(right[:, :2] - middle[:2] - share * (tips - middle)[list(order), :2]).max() < 1e-6
    turn = np.angle(complex(*(right[0] - right.mean(axis=0))[:2]) / complex(*shape[0]))
    assert abs(turn) <= math.pi / k + 1e-6  # never more than the gripper's symmetry asks for


@given(seed=SEEDS)
def test_a_taught_goal_is_the_view_that_taught_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cam = camera(rng, tilt=0.3)
    depth = rng.uniform(0.1, 0.3)
    right = np.column_stack([rng.uniform(-0.04, 0.04, (2, 2)), np.full(2, cam.offset[2] + depth)])
    if not np.isfinite(cam.project(right)).all() or rms_diameter(right[:, :2]) < 0.01:
        return
    goal = gt.Goal.taught(cam.project(right), symmetric=False)
    c, s = math.cos(1.0), math.sin(1.0)
    found = goal.targets(cam, right[:, :2] @ np.array([[c, s], [-s, c]]), (0, 1))
    assert np.abs(cam.project(found) - goal.points).max() < 1e-6 and np.abs(found - right).max() < 1e-8


# --- what is handed in ------------------------------------------------------------------------------

GOOD = ((100.0, 200.0), (300.0, 200.0))


@pytest.mark.parametrize(
    "make",
    [
        lambda: gt.Goal.fingertips(GOOD[:1], 0.1),
        lambda: gt.Goal.fingertips((GOOD[0], GOOD[0]), 0.1),
        lambda: gt.Goal.fingertips(GOOD, 0.0),
        lambda: gt.Goal.fingertips(GOOD, math.nan),
        lambda: gt.Goal.taught(gt.TrackResult(0, None, "lost", "gone")),
        lambda: gt.GraspServo(gt.Goal.fingertips(GOOD, 0.1), dof=5),
        lambda: gt.GraspServo(gt.Goal.fingertips(GOOD, 0.1), law="nominal"),
        lambda: gt.GraspServo(gt.Goal.fingertips(GOOD, 0.1), law="guess"),  # type: ignore[arg-type]
        lambda: gt.GraspServo(gt.Goal.fingertips(GOOD, 0.1), latency=-1.0),
        lambda: gt.NominalCamera(0.0),
        lambda: gt.NominalCamera(500.0, np.ones((4, 4))),
        lambda: gt.Limits(linear=0.0),
        lambda: gt.Gain(near=-1.0),
        lambda: gt.Exploration(way=0.0),
        lambda: gt.LossPolicy(hold=-1.0),
        lambda: gt.Closing(tolerance=3.0, loosest=1.0),
        lambda: gt.Closing(confidence=2.0),
        lambda: check_pose(np.diag([1.0, 1.0, -1.0, 1.0])),
        lambda: check_pose(np.eye(3)),
    ],
)
def test_bad_input_gets_one_clear_line(make: object) -> None:
    with pytest.raises(gt.InputError) as found:
        make()  # type: ignore[operator]
    assert str(found.value) and "\n" not in str(found.value)


@given(seed=SEEDS, spoilt=st.sampled_from([None, math.nan, math.inf, -1.0, 1e9]))
def test_covariances_of_sightings_are_bounded_and_else_as_told(seed: int, spoilt: float | None) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(2, 2, 2))
    told = root @ np.swapaxes(root, 1, 2)
    if spoilt is not None:
        told[0, 0, 0] = spoilt
    result = gt.TrackResult(0, 0.0, "tracked", "", contacts=np.array(GOOD), covariance=told)
    seen = ResultObserver(square=False).observe_result(result, 0.0, np.eye(4))
    assert seen is not None
    np.testing.assert_allclose(seen.noise[1], told[1] + MIN_NOISE_PX**2 * np.eye(2), rtol=1e-12)
    sizes = np.linalg.eigvalsh(seen.noise)
    assert (sizes > 0.99 * MIN_NOISE_PX**2).all() and (sizes < 1.001 * (MAX_NOISE_PX**2 + MIN_NOISE_PX**2)).all()


@pytest.mark.parametrize("needed", [False, True])
def test_a_homography_shows_a_square_round_the_contacts(needed: bool) -> None:
    sighter = ResultObserver(square=needed)
    first = gt.TrackResult(0, 0.0, "tracked", "", grasp_id=1, contacts=np.array(GOOD), homography=np.eye(3))
    H = np.array([[1.1, 0.1, 5.0], [-0.1, 1.2, 3.0], [0.0, 0.0, 1.0]])
    later = replace(first, contacts=apply_homography(H, np.array(GOOD)), homography=H)
    one, two = (sighter.observe_result(r, 0.0, np.eye(4)) for r in (first, later))
    assert one is not None and two is not None
    assert one.contacts == two.contacts == 2 and len(one.points) == len(two.points) == 6
    np.testing.assert_allclose(two.points, apply_homography(H, one.points), atol=1e-9)
    middle = one.points[:2].mean(axis=0)
    np.testing.assert_allclose(one.points[2:].mean(axis=0), middle, atol=1e-9)
    # an image without one shows other points than those before, and nothing can be made of it
    assert sighter.observe_result(replace(later, homography=None), 0.0, np.eye(4)) is None


def test_without_a_homography_contacts_serve_for_four_degrees_of_freedom_alone() -> None:
    bare = gt.TrackResult(0, 0.0, "tracked", "", grasp_id=1, contacts=np.array(GOOD))
    seen = ResultObserver(square=False).observe_result(bare, 0.0, np.eye(4))
    assert seen is not None and len(seen.points) == seen.contacts == 2
    assert ResultObserver(square=True).observe_result(bare, 0.0, np.eye(4)) is None


@pytest.mark.parametrize("turn", [0.0, 0.05, -0.3])
@pytest.mark.parametrize("seed", range(4))
def test_what_is_seen_at_the_goal_is_there_whatever_was_predicted(seed: int, turn: float) -> None:
    bench = Bench(seed=seed)
    hand, goal = bench.right_hand(), bench.goal()
    right = bench.contacts() - bench.at
    facing = rotation_matrix((0.0, 0.0, turn))
    object_ = Placed(right[:, :2], facing, bench.at, np.zeros(3), np.eye(3))
    known = Estimate(pack_state(bench.camera, object_), 1e-10 * np.eye(SHAPE + 2 * len(right)), 0.0)
    bench.hand = hand
    seen = Observation(0.0, hand, bench.seen(), np.tile(1e-4 * np.eye(2), (2, 1, 1)), 2)
    found = compute_aim(known, Approach(goal, (0, 1), 4, 0.04, gt.Gain()), seen, hand, 0.0)
    assert found is not None
    assert found.aligned and found.error_px < 1e-6
    assert np.abs(found.twist).max() < 1e-6


# --- policies ---------------------------------------------------------------------------------------


@given(times=st.tuples(*[st.floats(0.0, 3.0)] * 3), can=st.booleans())
def test_the_policy_on_loss_goes_through_its_steps_in_order(times: tuple[float, float, float], can: bool) -> None:
    policy = gt.LossPolicy(coast=times[0], hold=times[1], back_off=times[2])
    order = ("coast", "hold", "back off", "give up")
    steps = [order.index(policy.step(t, can)) for t in np.linspace(0.0, 10.0, 500)]
    assert steps == sorted(steps) and steps[-1] == 3
    assert can or 0 not in steps
    ends = sum(times) if can else times[1] + times[2]
    assert policy.step(ends + 1e-9, can) == "give up"


def test_the_tolerance_grows_only_after_patience_near_the_goal() -> None:
    doubt = CloseGate(gt.Closing(tolerance=1.0, patience=2.0, loosest=3.0))
    told = gt.TrackResult(0, 0.0, "tracked", "", contacts=np.array(GOOD), seen=np.ones(2), confidence=0.9)
    tolerances = []
    for t in np.arange(0.0, 8.0, 0.1):
        found = Aim(np.zeros(6), np.zeros(4), 2.9 if t < 5.0 else 9.0, 0.0, np.array(GOOD), "", True, 0.0)
        doubt.why_not(told, found, float(t))
        tolerances.append(doubt.position_tolerance(float(t)))
    assert all(v == 1.0 for v in tolerances[:20]) and abs(tolerances[30] - 2.0) < 1e-9 and tolerances[49] == 3.0
    assert tolerances[-1] == 1.0  # far away again: strict again
