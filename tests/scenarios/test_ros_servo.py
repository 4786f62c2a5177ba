# SPDX-License-Identifier: Apache-2.0
"""The servo's node on the kinematic bench, against a stub of rclpy, its messages through CDR. No ROS runs here."""

import contextlib
import json
import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import grasptrack as gt
from grasptrack.servo.camera import pose_of, rotation_matrix
from servo_bench import PERIOD, Bench

pytest.importorskip("rosbags", reason="messages are serialised by rosbags")
from stub_ros import Reply, World


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    made = World()
    made.install(monkeypatch)
    return made


@dataclass
class Cell:
    """A bench whose hand obeys the twists of a node: two ticks to a period of the bench, images every second one."""

    world: World
    bench: Bench
    node: Any = None
    twists: list[np.ndarray] = field(default_factory=list)
    sees: bool = True
    hangs: bool = False
    behind: float = 0.0
    """s by which the camera's clock is behind."""
    tf_late: bool = False
    """Transforms come once in a period, and a period late: after the image of their time."""

    _transform: tuple[Any, int] | None = None
    enabled: Any = None
    """The answer of the service."""

    def start(self, goal: Path) -> None:
        self.bench.goal().save(goal)
        self.world.parameters.update(goal=str(goal), rate=50.0, linear=0.5, angular=1.2)
        self.world.parameters.update(linear_acceleration=2.5, angular_acceleration=8.0)
        from grasptrack_ros.servo_node import ServoNode

        self.begin(ServoNode())

    def begin(self, node: Any) -> None:
        self.node = node
        assert node.change("configure") is Reply.SUCCESS, node.get_logger().lines
        assert node.change("activate") is Reply.SUCCESS
        self.twist_cmds = node.publishers["~/twist_cmds"]

    def run(self, periods: int, until: str = "") -> None:
        """For so many periods, or until the servo is in a state."""
        from grasptrack_ros.messages import grasp_message

        for k in range(periods):
            if until and self.servo.state == until:
                return
            if k % 2 == 0 and self.sees:
                shot = self.world.clock.nanoseconds - round(1e9 * (self.bench.latency + self.behind))
                header = self.world.make("std_msgs/Header", stamp=self.world.clock.stamp(shot), frame_id="camera")
                self.node.receive("~/grasp", grasp_message(header, replace(self.bench.result(), repeated=self.hangs)))
            for half in range(2):
                if not (self.tf_late and half):
                    self._tell_transform()
                if self.node.timers:
                    self.node.timers[0]()
                self.world.clock.nanoseconds += round(0.5e9 * PERIOD)
            if self.sent:
                self.twists.append(self.last)
            self.bench.move(self.twists[-1] if self.twists else np.zeros(6))

    def _tell_transform(self) -> None:
        x, y, z = self.bench.hand[:3, 3].tolist()
        turn = dict(zip("xyzw", Rotation.from_matrix(self.bench.hand[:3, :3]).as_quat().tolist(), strict=True))
        make, told = self.world.make, self._transform
        self._transform = (
            make(
                "geometry_msgs/Transform",
                translation=make("geometry_msgs/Vector3", x=x, y=y, z=z),
                rotation=make("geometry_msgs/Quaternion", **turn),
            ),
            self.world.clock.nanoseconds,
        )
        self.world.transform, self.world.transform_ns = told if self.tf_late and told else self._transform

    @property
    def sent(self) -> list[Any]:
        return self.twist_cmds.sent

    @property
    def last(self) -> np.ndarray:
        t = self.sent[-1].twist
        return np.array([t.linear.x, t.linear.y, t.linear.z, t.angular.x, t.angular.y, t.angular.z])

    @property
    def servo(self) -> gt.GraspServo:
        return self.node._steering.servo


@pytest.fixture
def cell(world: World, tmp_path: Path) -> Cell:
    made = Cell(world, Bench(seed=1, latency=0.04))
    made.start(tmp_path / "goal.json")
    return made


def enabled(world: World, tmp_path: Path, *, tf_late: bool = False, **parameters: Any) -> Cell:
    """A cell whose images have no latency, with parameters of its node."""
    world.parameters.update(parameters)
    cell = Cell(world, Bench(seed=1), tf_late=tf_late)
    cell.start(tmp_path / "goal.json")
    cell.enabled = cell.node.call("~/enable", data=True)
    return cell


def test_an_approach_ends_at_the_grasp_with_zero_twists_and_then_silence(cell: Cell) -> None:
    cell.run(10)
    assert not cell.sent, "nothing moves before it is enabled"
    assert cell.node.call("~/enable", data=True).success
    cell.run(400, until="closing")
    assert cell.servo.state == "closing", (cell.servo.state, cell.servo.reason)
    across, along, turn = cell.bench.off()
    assert across < 4e-3 and abs(along) < 6e-3 and abs(turn) < 0.1
    cell.run(5)
    assert cell.node.call("~/closed", data=True).message.startswith("done")
    cell.run(20)
    assert all(not t.any() for t in cell.twists[-3:])
    count = len(cell.sent)
    cell.run(5)
    assert len(cell.sent) == count, "then it is silent"
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in cell.sent]
    assert max(np.diff(stamps)) <= 0.05, "20 Hz or more throughout, between images too"
    assert {m.header.frame_id for m in cell.sent} == {"tool0"}


@pytest.mark.slow
def test_a_gripper_is_closed_by_its_action(world: World, tmp_path: Path) -> None:
    cell = enabled(world, tmp_path, gripper="/gripper", gripper_effort=30.0)
    cell.run(400)
    (goal,) = world.goals
    assert goal.command.max_effort == 30.0 and cell.servo.state == "done"


@pytest.mark.slow
def test_a_gripper_opens_and_the_hand_tries_again(world: World, tmp_path: Path) -> None:
    world.gripper.position = -1e-4  # closed, nothing between the fingers
    told: dict[str, Any] = {"gripper_open_position": 0.07, "gripper_reports_opening": True, "retries": 1}
    cell = enabled(world, tmp_path, gripper="/gripper", **told)
    cell.run(400, until="retreating")
    assert cell.servo.state == "retreating" and "nothing is in it" in cell.servo.reason
    world.gripper.position = float(np.linalg.norm(np.diff(cell.bench.shape, axis=0)))
    cell.run(400, until="done")
    assert [g.command.position for g in world.goals] == [0.0, 0.07, 0.0]
    assert cell.servo.state == "done", cell.servo.reason


@pytest.mark.sampled(1)
@pytest.mark.parametrize("what", ["away", "refuses"])
def test_without_a_gripper_nothing_moves(world: World, tmp_path: Path, what: str) -> None:
    setattr(world.gripper, {"away": "ready", "refuses": "accepted"}[what], False)
    cell = enabled(world, tmp_path, gripper="/gripper")
    cell.run(400, until="failed")
    if what == "away":
        assert not cell.enabled.success and "/gripper" in cell.enabled.message and not cell.sent
    else:
        assert cell.enabled.success and cell.servo.reason == "the gripper refused to close" and not cell.last.any()


WAYS = ["disabled", "touched", "deactivated", "reset", "shut down", "cleaned up", "an error", "a failed transition"]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("how", WAYS)
def test_whatever_ends_it_ends_with_zero_twists(cell: Cell, how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    cell.node.call("~/enable", data=True)
    cell.run(20)
    assert cell.last.any()
    if how == "disabled":
        cell.node.call("~/enable", data=False)
    elif how == "touched":
        assert "failed" in cell.node.call("~/touched").message
        assert not cell.node.call("~/enable", data=True).success, "reset comes first"
    elif how == "reset":
        cell.node.call("~/reset")
    elif how == "an error":
        monkeypatch.setattr(cell.servo, "between", lambda **_: 1 / 0)
        cell.run(1)
        assert (cell.servo.state, cell.servo.reason) == ("failed", "division by zero")
        assert ("error", "division by zero") in cell.node.get_logger().lines
    elif how == "a failed transition":
        with monkeypatch.context() as m:
            m.setattr(cell.node, "_stop_ticking", lambda: 1 / 0)
            assert cell.node.change("deactivate") is Reply.ERROR
        assert not cell.node.open_things
    else:
        cell.node.change({"deactivated": "deactivate", "shut down": "shutdown", "cleaned up": "cleanup"}[how])
    assert not cell.last.any()
    count = len(cell.sent)
    if cell.node.timers:
        cell.run(3)
    assert not any(m.twist.linear.x or m.twist.angular.z for m in cell.sent[count:])


def test_what_a_service_raises_is_answered(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cell.servo, "touched", lambda: 1 / 0)
    answer = cell.node.call("~/touched")
    assert (answer.success, answer.message) == (False, "division by zero")


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
@pytest.mark.parametrize("after", [0, 17])
def test_the_program_ends_with_zero_twists(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type[BaseException], after: int
) -> None:
    """Ctrl-C or an error at some moment: before the connection is closed the hand is told to stand."""
    from grasptrack_ros.servo_node import main

    cell, handled = Cell(world, Bench(seed=1)), {}
    monkeypatch.setattr("signal.signal", handled.__setitem__)
    world.parameters.update(goal=str(tmp_path / "goal.json"))
    cell.bench.goal().save(tmp_path / "goal.json")

    def spin() -> None:
        if cell.node is None:
            cell.begin(world.nodes[0])
            cell.node.call("~/enable", data=True)
        if cell.bench.time > after * PERIOD - 1e-9:
            raise error
        cell.run(2)

    world.spin = spin
    with contextlib.suppress(RuntimeError):
        main()
    assert not world.up and not world.nodes and len(handled) == 2
    assert after == 0 or (cell.twists[-1].any() and len(cell.sent) > 10)
    assert not cell.sent or not cell.last.any()


def test_after_cleanup_nothing_is_left_and_it_begins_anew(world: World, tmp_path: Path) -> None:
    world.parameters.update(gripper="/gripper")
    cell = Cell(world, Bench(seed=1))
    cell.start(tmp_path / "goal.json")
    assert "/tf" in cell.node.open_things
    cell.node.change("deactivate")
    cell.node.change("cleanup")
    assert not cell.node.open_things
    cell.begin(cell.node)
    cell.node.call("~/enable", data=True)
    cell.run(10)
    assert cell.last.any()


def test_results_from_before_do_not_count(cell: Cell) -> None:
    """Neither those that came before it was enabled, nor such as come a minute late, nor what was seen a minute ago."""
    cell.run(10)
    cell.sees = False
    cell.world.clock.nanoseconds += 60 * 10**9
    assert cell.node.call("~/enable", data=True).success
    cell.run(20)
    cell.sees, cell.behind = True, 60.0
    cell.run(20)
    assert not any(t.any() for t in cell.twists)
    assert any("60.0 s ago" in text for _, text in cell.node.get_logger().lines)
    cell.behind = 0.0
    cell.run(30)
    assert cell.last.any()
    cell.node.call("~/enable", data=False)
    cell.sees = False
    cell.world.clock.nanoseconds += 60 * 10**9
    count = len(cell.twists)
    cell.node.call("~/enable", data=True)
    cell.run(20)
    assert not any(t.any() for t in cell.twists[count:])
    cell.sees = True
    cell.run(400, until="closing")
    assert cell.servo.state == "closing", cell.servo.reason


def test_what_was_seen_just_before_it_was_enabled_does_not_count(cell: Cell) -> None:
    cell.run(4)
    cell.node.call("~/enable", data=True)
    cell.behind = 0.1  # young enough, but taken before
    cell.run(2)
    assert not cell.last.any()
    cell.behind = 0.0
    cell.run(30)
    assert cell.last.any()
    cell.node.call("~/enable", data=False)
    cell.node.call("~/enable", data=True)
    cell.sees = False
    cell.run(3)
    assert not any(t.any() for t in cell.twists[-3:])


def test_a_camera_that_hangs_stops_the_hand(cell: Cell) -> None:
    cell.node.call("~/enable", data=True)
    cell.run(60)
    assert cell.last.any()
    cell.hangs = True
    cell.run(round(0.5 / PERIOD))
    assert not cell.last.any() and cell.servo.state == "holding"
    told = cell.node.publishers["/diagnostics"].sent[-20:]
    assert any("the same image again" in m.status[0].message for m in told)


def test_a_result_waits_for_the_pose_of_its_image(world: World, tmp_path: Path) -> None:
    """25 transforms a second, each 40 ms late, and images without latency: the hand's way is known only after the image."""
    cell = enabled(world, tmp_path, tf_late=True)
    cell.run(400, until="closing")
    assert cell.servo.state == "closing", cell.servo.reason
    across, along, turn = cell.bench.off()
    assert across < 4e-3 and abs(along) < 6e-3 and abs(turn) < 0.1


def test_without_a_transform_or_while_time_stands_it_stands(cell: Cell) -> None:
    cell.node.call("~/enable", data=True)
    cell.run(60)
    (tick,) = cell.node.timers
    transform, cell.world.transform = cell.world.transform, None
    tick()
    assert not cell.last.any() and "does not exist" in cell.node.get_logger().lines[-1][1]
    cell.world.transform = transform
    cell.world.clock.nanoseconds += 150_000_000
    tick()
    assert not cell.last.any() and "its pose is of 0.1" in cell.node.get_logger().lines[-1][1]
    cell._tell_transform()
    cell.world.clock.nanoseconds += 1
    tick()
    tick()
    assert not cell.last.any() and "time stands still" in cell.node.get_logger().lines[-1][1]


def test_when_grasps_stop_coming_it_stops(cell: Cell) -> None:
    cell.node.call("~/enable", data=True)
    cell.run(60)
    cell.sees = False
    cell.run(round(0.5 / PERIOD))
    assert not cell.last.any() and cell.servo.state == "holding"
    cell.run(500, until="failed")
    cell.run(1)
    assert cell.servo.state == "failed" and "no image" in cell.servo.reason and not cell.last.any()
    assert cell.node.publishers["/diagnostics"].sent[-1].status[0].level == 2


def test_a_grasp_of_another_number_of_contacts_is_told(cell: Cell) -> None:
    cell.node.call("~/enable", data=True)
    cell.run(10)
    cell.bench = Bench(seed=1, fingers=3)
    cell.run(3)
    assert cell.node.get_logger().lines[-1] == ("error", "failed: the goal has 2 points and the grasp 3 contacts")
    assert not cell.last.any()


def test_a_grasp_in_metres_is_a_pose_and_markers(cell: Cell) -> None:
    grasp = SimpleNamespace(
        contacts=np.array([[0.4, -0.2, 0.01], [0.44, -0.2, 0.01]]),
        position=np.array([0.42, -0.2, 0.01]),
        approach=np.array([0.0, 0.0, -1.0]),
        rotation=rotation_matrix((math.pi, 0.0, 0.0)) @ rotation_matrix((0.0, 0.0, 0.3)),
        opening=0.04,
        covariance=np.diag(np.arange(1.0, 7.0)) * 1e-6,
    )
    cell.node._publish_grasp(grasp, 12.5)
    from grasptrack_ros.tracking import pose_matrix

    (pose,), (sure,), (markers,) = (
        cell.node.publishers[t].sent for t in ("~/grasp_pose", "~/grasp_pose_with_covariance", "~/markers")
    )
    back = pose_matrix(SimpleNamespace(rotation=pose.pose.orientation, translation=pose.pose.position))
    np.testing.assert_allclose(back, pose_of(grasp.rotation, grasp.position), atol=1e-9)
    assert (pose.header.frame_id, pose.header.stamp.sec, pose.header.stamp.nanosec) == ("base_link", 12, 500_000_000)
    np.testing.assert_array_equal(np.reshape(sure.pose.covariance, (6, 6)), grasp.covariance)
    contacts, arrow = markers.markers
    np.testing.assert_array_equal([(p.x, p.y, p.z) for p in contacts.points], grasp.contacts)
    np.testing.assert_allclose(arrow.points[1].z - arrow.points[0].z, -0.06)
    assert {m.header.frame_id for m in markers.markers} == {"base_link"}


def test_whole_numbers_serve_as_numbers(world: World, tmp_path: Path) -> None:
    cell = enabled(world, tmp_path, time_limit=30, opening=0, fingertips=[], gripper_effort=5)
    assert cell.servo._time_limit == 30.0


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        ({}, "the servo needs one goal"),
        ({"fingertips": [300.0, 250.0, 360.0]}, "an even count, not 3"),
        ({"fingertips": [300.0, 250.0, 360.0, 250.0], "opening": 85.0}, "0.085, if mm were meant"),
        ({"goal": "nowhere.json"}, "nowhere.json"),
        ({"fingertips": [300.0, 250.0, 360.0, 250.0], "opening": 0.08, "dof": 5}, "4 or 6"),
        ({"rate": 10.0}, "20 Hz or more"),
        ({"rate": math.nan}, "20 Hz or more"),
        ({"linear": "fast"}, "the parameter linear is a number, not 'fast'"),
        ({"dof": 4.0}, "the parameter dof is a whole number, not 4.0"),
        ({"dof": True}, "the parameter dof is a whole number, not True"),
        ({"fingertips": ["a", "b"]}, "the parameter fingertips is a list of numbers"),
        ({"gripper_reports_opening": 1}, "the parameter gripper_reports_opening is true or false, not 1"),
    ],
)
def test_parameters_that_cannot_be_are_told(world: World, parameters: dict[str, Any], told: str) -> None:
    from grasptrack_ros.servo_node import ServoNode

    assert told in world.refused_by(ServoNode, parameters)


def test_poses_are_read_as_tf_tells_them(world: World) -> None:
    from grasptrack_ros.tracking import pose_matrix

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
