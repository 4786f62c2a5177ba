# SPDX-License-Identifier: Apache-2.0
"""The six-jointed arm: its inverse kinematics, the twist that it makes, its limits, and what its camera does not see."""

from __future__ import annotations

import math
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from grasptrack.errors import InputError
from grasptrack.geometry.homographies import rotation_about_z
from grasptrack.typing import Floats
from grasptrack_bench.physics import frames, model, serial
from grasptrack_bench.physics.gripper import make_gripper
from grasptrack_bench.physics.serial import LENGTH, NEAR, joint_rates
from grasptrack_bench.physics.setting import SCENARIOS, sample_setting
from grasptrack_bench.physics.world import PERIOD_S
from grasptrack_bench.simulation import SHAPES

if TYPE_CHECKING:
    from grasptrack_bench.physics import World

anywhere = st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6).map(lambda shares: math.pi * np.array(shares))
within = st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6).map(
    lambda shares: serial.LOWEST + np.array(shares) * (serial.HIGHEST - serial.LOWEST)
)


def jacobian(joints: Floats) -> Floats:
    """(6, 6) from rates to the twist in the base's frame at the hand's origin, by central differences."""
    columns, h = [], 1e-6
    for i in range(6):
        step = np.zeros(6)
        step[i] = h
        before, after = serial.forward_kinematics(joints - step), serial.forward_kinematics(joints + step)
        turn = (after[:3, :3] - before[:3, :3]) @ serial.forward_kinematics(joints)[:3, :3].T / (2.0 * h)
        way = (after[:3, 3] - before[:3, 3]) / (2.0 * h)
        columns.append([*way, turn[2, 1], turn[0, 2], turn[1, 0]])
    return np.array(columns).T


@given(anywhere)
@example(math.pi * np.array([-0.6, 0.005, -0.2, -0.4, -0.5, -0.9]))  # the hand along the arm's pitch axes
@example(math.pi * np.array([0.7, 0.5, 0.0, 0.5, 0.5, 1.0]))  # and the arm stretched above its base
def test_every_answer_of_the_inverse_leads_back_and_one_of_them_is_what_was_there(joints: Floats) -> None:
    pose = serial.forward_kinematics(joints)
    found = serial.inverse_kinematics(pose)
    assert len(found) == 8
    for answer in found:
        assert serial.forward_kinematics(answer) == pytest.approx(pose, abs=1e-7)
    jac = np.linalg.svd(jacobian(joints))[1]
    if jac[-1] > 1e-3:  # where two joints do the same, only their sum is told
        off = [np.abs((a - joints + math.pi) % (2.0 * math.pi) - math.pi).max() for a in found]
        assert min(off) < 1e-5


def test_what_is_out_of_reach_is_told_in_one_line() -> None:
    pose = serial.forward_kinematics(serial.REST)
    pose[0, 3] += 2.0
    assert serial.inverse_kinematics(pose) == []
    with pytest.raises(InputError, match="does not reach") as told:
        serial.start_joints(pose)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_starts_are_within_limits_and_away_from_singular_poses(scenario: str) -> None:
    for seed in range(8):
        setting = sample_setting(SHAPES["bracket"](), make_gripper(2), seed=seed, scenario=scenario, arm="arm")  # type: ignore[arg-type]
        joints = model.start_joints(setting, "arm")
        assert model.base_pose(setting) @ serial.forward_kinematics(joints) == pytest.approx(setting.hand, abs=1e-9)
        assert (joints > serial.LOWEST + 0.1).all() and (joints < serial.HIGHEST - 0.1).all()
        weight = np.array([1.0, 1.0, 1.0, LENGTH, LENGTH, LENGTH])
        assert np.linalg.svd(weight[:, None] * jacobian(joints))[1][-1] > NEAR


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_the_hand_on_the_part_and_lifted_is_within_reach(scenario: str) -> None:
    for seed in range(8):
        setting = sample_setting(SHAPES["bracket"](), make_gripper(2), seed=seed, scenario=scenario, arm="arm")  # type: ignore[arg-type]
        base, yaw = model.base_pose(setting), math.atan2(setting.hand[1, 0], setting.hand[0, 0])
        speed = float(np.hypot(*setting.belt))
        along = setting.belt / speed if speed else np.zeros(2)
        for travel in (0.0, 0.5, 1.0, 1.5):
            for height in (0.0, 0.12):
                at = np.array([*(travel * along), height])
                pose = frames.pose_of(rotation_about_z(yaw) @ frames.DOWN, at)
                assert serial.start_joints(frames.inverse_pose(base) @ pose) is not None


@given(within, st.lists(st.floats(-0.3, 0.3), min_size=6, max_size=6).map(np.array))
def test_rates_make_the_twist_or_go_its_way_more_slowly_and_keep_every_limit(joints: Floats, twist: Floats) -> None:
    J = jacobian(joints)
    rates = joint_rates(J, twist, joints)
    assert (np.abs(rates) <= serial.SPEED * (1.0 + 1e-9)).all()
    after = joints + 0.1 * rates
    assert (after >= serial.LOWEST - 1e-9).all() and (after <= serial.HIGHEST + 1e-9).all()
    weight = np.array([1.0, 1.0, 1.0, LENGTH, LENGTH, LENGTH])
    if np.linalg.svd(weight[:, None] * J)[1][-1] > NEAR:
        done = J @ rates
        share = float(done @ twist) / max(float(twist @ twist), 1e-12)
        assert share <= 1.0 + 1e-6
        assert done == pytest.approx(share * twist, abs=1e-6)


def test_rates_stay_small_where_two_axes_fall_together() -> None:
    """Undamped, the same twist asks for more than a hundred times what the joints can do."""
    joints = serial.REST.copy()
    joints[4] = math.pi / 2.0 - 1e-4
    J = jacobian(joints)
    twist = np.array([0.0, 0.0, 0.0, 0.3, 0.0, 0.3])
    assert np.abs(np.linalg.lstsq(J, twist, rcond=None)[0]).max() > 100.0 * serial.SPEED.max()
    joints[4] = 0.0  # its limits apart
    assert np.abs(joint_rates(J, twist, joints)).max() < serial.SPEED.max()


needs_mujoco = pytest.mark.skipif(find_spec("mujoco") is None, reason="the physical world needs MuJoCo")


def addresses(world: World, kind: str) -> list[int]:
    """Of the arm's joints in MuJoCo's arrays."""
    return [int(getattr(world.model.joint(name), kind)[0]) for name in model.joint_names("arm")]


@needs_mujoco
def test_the_model_is_the_kinematics_and_the_hand_starts_where_the_setting_says() -> None:
    import mujoco

    from grasptrack_bench.physics import World

    world = World(SHAPES["disc"](), seed=3, arm="arm", images="planar")
    assert world.pose() == pytest.approx(world.setting.hand, abs=1e-9)
    rng = np.random.default_rng(0)
    for _ in range(5):
        joints = serial.REST + rng.uniform(-0.5, 0.5, 6)
        world.data.qpos[addresses(world, "qposadr")] = joints
        mujoco.mj_forward(world.model, world.data)
        assert world.pose() == pytest.approx(
            model.base_pose(world.setting) @ serial.forward_kinematics(joints), abs=1e-9
        )
        for (a, b, radius), name in zip(world.links(), ("base", "shoulder", "elbow", "wrist_roll"), strict=True):
            geom = world.data.geom(name)
            assert geom.xpos == pytest.approx((a + b) / 2.0, abs=1e-9)
            assert world.model.geom(name).size[:2] == pytest.approx([radius, np.linalg.norm(b - a) / 2.0], abs=1e-9)


@needs_mujoco
@pytest.mark.parametrize("twist", [[0.05, 0.02, 0.03, 0.1, -0.2, 0.3], [0.0, -0.1, 0.0, 0.0, 0.0, 0.5]])
def test_the_hand_makes_the_twist_that_it_is_told(twist: list[float]) -> None:
    from grasptrack_bench.physics import World

    world = World(SHAPES["disc"](), seed=2, arm="arm", images="planar")
    for _ in range(5):
        world.move(twist)
    for _ in range(5):
        before = world.pose()
        world.move(twist)
        step = frames.inverse_pose(before) @ world.pose()
        turned = 0.5 * np.array([step[2, 1] - step[1, 2], step[0, 2] - step[2, 0], step[1, 0] - step[0, 1]])
        assert turned / PERIOD_S == pytest.approx(twist[3:], abs=5e-3)
        # the way is along an arc; half the turn brings it back to the middle
        half = np.eye(3) - 0.5 * np.array(
            [[0.0, -turned[2], turned[1]], [turned[2], 0.0, -turned[0]], [-turned[1], turned[0], 0.0]]
        )
        assert half @ step[:3, 3] / PERIOD_S == pytest.approx(twist[:3], abs=2e-3)


@pytest.mark.sampled(1)
@needs_mujoco
@pytest.mark.parametrize("seed", range(2))
def test_no_limit_is_exceeded_whatever_is_asked_for(seed: int) -> None:
    from grasptrack_bench.physics import World

    rng = np.random.default_rng(seed)
    world = World(SHAPES["disc"](), seed=seed, arm="arm", images="planar")

    def watch() -> None:
        joints = world.data.qpos[addresses(world, "qposadr")]
        assert (joints >= serial.LOWEST - 1e-3).all() and (joints <= serial.HIGHEST + 1e-3).all()
        assert (np.abs(world.data.ctrl[:6]) <= serial.SPEED + 1e-9).all()
        # what drives of limited torque make of that where all joints swing at once
        assert (np.abs(world.data.qvel[addresses(world, "dofadr")]) <= 1.2 * serial.SPEED).all()
        assert (np.abs(world.data.actuator_force[:6]) <= serial.TORQUE + 1e-9).all()

    world.watch = watch
    for _ in range(6):
        twist = np.concatenate([rng.uniform(-0.6, 0.6, 3), rng.uniform(-2.0, 2.0, 3)])
        twist[2] = -abs(twist[2])  # away from the table
        for _ in range(25):
            world.move(twist)


@needs_mujoco
def test_an_arm_at_the_end_of_its_reach_stands_there_and_says_so() -> None:
    from grasptrack_bench.physics import World

    world = World(SHAPES["disc"](), seed=1, arm="arm", images="planar")
    away = model.base_pose(world.setting)[:3, 0]

    def outward(seconds: float) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            world.move([*(0.25 * world.pose()[:3, :3].T @ away), 0.0, 0.0, 0.0])

    outward(0.4)
    assert world.short_s == 0.0
    outward(6.0)
    before = world.pose()
    outward(1.0)
    assert np.linalg.norm(world.pose()[:3, 3] - before[:3, 3]) < 0.03
    assert world.short_s > 1.0


@pytest.mark.sampled(1)
@needs_mujoco
@pytest.mark.parametrize("scenario", ["static", "belt"])
def test_the_cameras_view_is_free_of_the_arm(scenario: str) -> None:
    """Every point of every link is behind the camera or beside its image, from the start to the part and back up."""
    from grasptrack_bench.physics import World

    around = np.array([[math.cos(a), math.sin(a)] for a in np.linspace(0.0, 2.0 * math.pi, 12, endpoint=False)])
    for seed in range(3):
        world = World(SHAPES["disc"](), seed=seed, arm="arm", scenario=scenario, images="planar")  # type: ignore[arg-type]
        camera = world.setting.camera
        for _ in range(3):
            for a, b, radius in world.links():
                axis = (b - a) / np.linalg.norm(b - a)
                u = np.linalg.svd(axis[None])[2][1:]
                along = a + np.linspace(0.0, 1.0, 40)[:, None] * (b - a)
                points = (along[:, None] + radius * (around @ u)[None]).reshape(-1, 3)
                seen = points @ (to := frames.inverse_pose(world.camera_pose()))[:3, :3].T + to[:3, 3]
                front = seen[seen[:, 2] > 1e-3] @ camera.matrix.T
                pixels = front[:, :2] / front[:, 2:]
                inside = (pixels > -1.0).all(axis=1) & (pixels < [camera.width, camera.height]).all(axis=1)
                assert not inside.any()
            for _ in range(12):
                world.move([*(world.pose()[:3, :3].T @ np.array([*world.setting.belt, -0.15])), 0.0, 0.0, 0.0])
