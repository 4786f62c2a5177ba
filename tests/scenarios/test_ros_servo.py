# SPDX-License-Identifier: Apache-2.0
"""The servo's node on the kinematic bench, against a stub of rclpy, its messages through CDR. No ROS runs here."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import grasptrack as gt
from servo_bench import PERIOD, Bench

pytest.importorskip("rosbags", reason="messages are serialised by rosbags")
from stub_ros import Reply, World


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    made = World()
    made.install(monkeypatch)
    return made


def quaternion(turn: np.ndarray) -> list[float]:
    """x, y, z, w of a rotation (3, 3)."""
    values, vectors = np.linalg.eigh(
        np.array(
            [
                [
                    turn[0, 0] - turn[1, 1] - turn[2, 2],
                    turn[0, 1] + turn[1, 0],
                    turn[0, 2] + turn[2, 0],
                    turn[2, 1] - turn[1, 2],
                ],
                [0.0, turn[1, 1] - turn[0, 0] - turn[2, 2], turn[1, 2] + turn[2, 1], turn[0, 2] - turn[2, 0]],
                [0.0, 0.0, turn[2, 2] - turn[0, 0] - turn[1, 1], turn[1, 0] - turn[0, 1]],
                [0.0, 0.0, 0.0, np.trace(turn)],
            ]
        ),
        UPLO="U",
    )
    return vectors[:, values.argmax()].tolist()


@dataclass
class Cell:
    """A bench whose hand obeys the twists of a node: two ticks to a period of the bench, images every second one."""

    world: World
    bench: Bench
    node: Any = None
    twists: list[np.ndarray] = field(default_factory=list)

    def start(self, goal: Path) -> None:
        self.bench.goal().save(goal)
        self.world.parameters.update(goal=str(goal), rate=50.0, linear=0.5, angular=1.2)
        self.world.parameters.update(linear_acceleration=2.5, angular_acceleration=8.0)
        from grasptrack_ros.servo_node import ServoNode

        self.node = ServoNode()
        assert self.node.on_configure(None) is Reply.SUCCESS, self.node.get_logger().lines
        assert self.node.on_activate(None) is Reply.SUCCESS

    def run(self, periods: int) -> None:
        from grasptrack_ros.messages import grasp_message

        for k in range(periods):
            if k % 2 == 0:
                shot = self.world.clock.nanoseconds - round(1e9 * self.bench.latency)
                header = self.world.make("std_msgs/Header", stamp=self.world.clock.stamp(shot), frame_id="camera")
                self.node.receive("~/grasp", grasp_message(header, self.bench.result()))
            for _half in range(2):
                self._tell_transform()
                if self.node.timers:
                    self.node.timers[0]()
                self.world.clock.nanoseconds += round(0.5e9 * PERIOD)
            sent = self.node.publishers["~/twist_cmds"].sent
            if sent:
                t = sent[-1].twist
                self.twists.append(
                    np.array([t.linear.x, t.linear.y, t.linear.z, t.angular.x, t.angular.y, t.angular.z])
                )
            self.bench.move(self.twists[-1] if self.twists else np.zeros(6))

    def _tell_transform(self) -> None:
        x, y, z = self.bench.hand[:3, 3].tolist()
        turn = dict(zip("xyzw", quaternion(self.bench.hand[:3, :3]), strict=True))
        make = self.world.make
        self.world.transform = make(
            "geometry_msgs/Transform",
            translation=make("geometry_msgs/Vector3", x=x, y=y, z=z),
            rotation=make("geometry_msgs/Quaternion", **turn),
        )

    @property
    def sent(self) -> list[Any]:
        return self.node.publishers["~/twist_cmds"].sent

    @property
    def servo(self) -> gt.GraspServo:
        return self.node._steering.servo


@pytest.fixture
def cell(world: World, tmp_path: Path) -> Cell:
    made = Cell(world, Bench(seed=1, latency=0.04))
    made.start(tmp_path / "goal.json")
    return made


def test_an_approach_ends_at_the_grasp_with_zero_twists_and_then_silence(cell: Cell) -> None:
    cell.run(10)
    assert not cell.sent, "nothing moves before it is enabled"
    assert cell.node.call("~/enable", data=True).success
    cell.run(400)
    assert cell.servo.state == "closing", (cell.servo.state, cell.servo.reason)
    across, along, turn = cell.bench.off()
    assert across < 4e-3 and abs(along) < 6e-3 and abs(turn) < 0.1
    assert all(not t.any() for t in cell.twists[-3:])
    count = len(cell.sent)
    cell.run(5)
    assert len(cell.sent) == count, "then it is silent"
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in cell.sent]
    assert max(np.diff(stamps)) <= 0.05, "20 Hz or more throughout, between images too"
    assert {m.header.frame_id for m in cell.sent} == {"tool0"}
    assert cell.node.call("~/closed", data=True).message.startswith("done")


def test_a_gripper_is_closed_by_its_action(world: World, tmp_path: Path) -> None:
    world.parameters.update(gripper="/gripper", gripper_effort=30.0)
    cell = Cell(world, Bench(seed=1))
    cell.start(tmp_path / "goal.json")
    cell.node.call("~/enable", data=True)
    cell.run(400)
    (goal,) = world.goals
    assert goal.command.max_effort == 30.0 and cell.servo.state == "done"


@pytest.mark.parametrize("how", ["disabled", "touched", "deactivated", "reset", "shut down"])
def test_whatever_ends_it_ends_with_zero_twists(cell: Cell, how: str) -> None:
    cell.node.call("~/enable", data=True)
    cell.run(60)
    assert cell.twists[-1].any()
    if how == "disabled":
        cell.node.call("~/enable", data=False)
    elif how == "touched":
        assert "failed" in cell.node.call("~/touched").message
        assert not cell.node.call("~/enable", data=True).success, "reset comes first"
    elif how == "reset":
        cell.node.call("~/reset")
    elif how == "deactivated":
        cell.node.on_deactivate(None)
    else:
        cell.node.on_shutdown(None)
    cell.run(6)
    count = len(cell.sent)
    cell.run(3)
    assert len(cell.sent) == count and not cell.twists[-1].any()


def test_without_a_transform_or_while_time_stands_it_stands(cell: Cell) -> None:
    cell.node.call("~/enable", data=True)
    cell.run(60)
    (tick,) = cell.node.timers
    cell.world.transform = None
    tick()
    last = cell.sent[-1].twist
    assert not any((last.linear.x, last.linear.y, last.linear.z, last.angular.z))
    assert "does not exist" in cell.node.get_logger().lines[-1][1]
    cell._tell_transform()
    cell.world.clock.nanoseconds += 1
    tick()
    tick()
    last = cell.sent[-1].twist
    assert not any((last.linear.x, last.linear.y, last.linear.z, last.angular.z))


def test_when_grasps_stop_coming_it_stops(cell: Cell) -> None:
    cell.node.call("~/enable", data=True)
    cell.run(60)
    for _ in range(1000):
        cell._tell_transform()
        cell.node.timers[0]()
        cell.world.clock.nanoseconds += 20_000_000
    assert cell.servo.state == "failed" and "no image since" in cell.servo.reason
    last = cell.sent[-1].twist
    assert not any((last.linear.x, last.linear.y, last.linear.z, last.angular.z))
    assert cell.node.publishers["/diagnostics"].sent[-1].status[0].level == 2


def test_a_grasp_of_another_number_of_contacts_is_told(cell: Cell) -> None:
    cell.node.call("~/enable", data=True)
    cell.run(10)
    cell.bench = Bench(seed=1, fingers=3)
    cell.run(2)
    assert "the goal has 2 points and the grasp 3 contacts" in cell.node.get_logger().lines[-1][1]
    assert not cell.twists[-1].any()


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        ({}, "the servo needs one goal"),
        ({"fingertips": [300.0, 250.0, 360.0]}, "an even count, not 3"),
        ({"fingertips": [300.0, 250.0, 360.0, 250.0], "opening": 85.0}, "0.085, if mm were meant"),
        ({"goal": "nowhere.json"}, "nowhere.json"),
        ({"fingertips": [300.0, 250.0, 360.0, 250.0], "opening": 0.08, "dof": 5}, "4 or 6"),
        ({"rate": 10.0}, "20 Hz or more"),
    ],
)
def test_parameters_that_cannot_be_are_told(world: World, parameters: dict[str, Any], told: str) -> None:
    world.parameters.update(parameters)
    from grasptrack_ros.servo_node import ServoNode

    node = ServoNode()
    assert node.on_configure(None) is Reply.FAILURE
    ((level, text),) = node.get_logger().lines
    assert level == "error" and told in text and "\n" not in text


def test_poses_are_read_as_tf_tells_them(world: World) -> None:
    from grasptrack_ros.tracking import pose_matrix

    from grasptrack.servo.camera import pose_of, rotation_matrix

    for turn in ((0.3, -0.2, 2.9), (0.0, 0.0, 0.0), (math.pi, 0.0, 0.0)):
        pose = pose_of(rotation_matrix(turn), np.array([0.1, 0.2, 0.3]))
        cell = Cell(world, Bench(seed=0))
        cell.bench.hand = pose
        cell._tell_transform()
        np.testing.assert_allclose(pose_matrix(world.transform), pose, atol=1e-12)


def test_the_goal_is_the_file_that_others_write(world: World, tmp_path: Path) -> None:
    cell = Cell(world, Bench(seed=0))
    cell.start(tmp_path / "goal.json")
    assert json.loads((tmp_path / "goal.json").read_text())["kind"] == "fingertips"
    assert cell.servo.goal == cell.bench.goal()
