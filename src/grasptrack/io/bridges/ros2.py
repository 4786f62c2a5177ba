# SPDX-License-Identifier: Apache-2.0
"""An arm that MoveIt Servo moves, through rclpy: twists to its topic, the hand's pose from tf, a gripper by its action."""

from __future__ import annotations

import contextlib
import threading
import time
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from grasptrack.errors import InputError
from grasptrack.io.arms import SILENCE, Order, Report
from grasptrack.io.base import Source
from grasptrack.io.bridges.base import BEAT, BridgedArm, parse_arm_url
from grasptrack.plugins import is_installed
from grasptrack.servo.camera import pose_of, rotation_of
from grasptrack.typing import Floats

LOOKING = 5.0
"""s in which tf makes known where the hand is."""
ZERO_TWISTS = 5
"""That end a motion, so that one that is lost does no harm; then nothing is sent, and others may move the arm."""
TOPIC = "/servo_node/delta_twist_cmds"
"""Where MoveIt Servo listens, by its tutorials."""
_FORM = f"ros2:/TOPIC, as ros2:{TOPIC}"
_SETTINGS = {"frame": "tool0", "base": "base_link", "gripper": "", "open": 0.08, "closed": 0.0, "effort": 20.0}


def open_ros2(url: str, source: Source) -> BridgedArm:
    """The arm at ros2:/TOPIC, which takes geometry_msgs/TwistStamped.

    Settings: `frame` [tool0], the hand's and the twists', its z along the fingers, x from one to the other; `base` [base_link];
    `gripper`, an action of control_msgs/GripperCommand; its positions `open` [0.08] and `closed` [0], and `effort` [20].

    Raises:
        InputError: there is no rclpy, the URL is none, or tf does not know the hand.
    """
    address = parse_arm_url(url, _FORM, _SETTINGS)
    if address.host or not address.path.strip("/"):
        raise InputError(f'an arm of ROS 2 is {_FORM}, with frame, base and gripper as settings, not "{url}"', url=url)
    if not is_installed("rclpy"):
        raise InputError(
            f'"{url}" needs rclpy, which comes with ROS 2: source its setup first, in an environment that sees its packages '
            "(python3 -m venv --system-site-packages)",
            url=url,
        )
    told = address.settings
    positions = told["open"], told["closed"], told["effort"]
    return BridgedArm(url, RosBridge(address.path, told["frame"], told["base"], told["gripper"], positions))


@dataclass
class RosBridge:
    """A node.

    Args:
        topic: of the twists.
        frame, base: of the hand, and of what its pose is told in.
        gripper: name of its action; empty for none.
        positions: of the open and of the closed gripper, and its effort, as its action takes them.
    """

    topic: str
    frame: str
    base: str
    gripper: str = ""
    positions: tuple[float, float, float] = (0.08, 0.0, 20.0)
    _node: Any = None

    def reach_arm(self) -> None:
        """Begin to listen to tf, and wait until it knows the hand."""
        rclpy, tf2 = import_module("rclpy"), import_module("tf2_ros")
        self._message = import_module("geometry_msgs.msg").TwistStamped
        self._newest, self._unknown = import_module("rclpy.time").Time(), tf2.TransformException
        rclpy.init(signal_handler_options=import_module("rclpy.signals").SignalHandlerOptions.NO)
        self._node = node = import_module("rclpy.node").Node("grasptrack_arm")
        self._twists = node.create_publisher(self._message, self.topic, 1)  # the newest is worth sending
        self._tf = tf2.Buffer()
        self._listener = tf2.TransformListener(self._tf, node)
        if self.gripper:
            self._command = import_module("control_msgs.action").GripperCommand
            self._hand = import_module("rclpy.action").ActionClient(node, self._command, self.gripper)
        self._zeros, self._reports, self._over = 0, list[Report](), threading.Event()
        executor = import_module("rclpy.executors").SingleThreadedExecutor()
        executor.add_node(node)
        threading.Thread(target=self._spin, args=(executor,), daemon=True).start()
        until = time.monotonic() + LOOKING
        while why := self._look_up()[2]:
            if time.monotonic() > until:
                raise OSError(why)
            time.sleep(BEAT)

    def exchange_order(self, order: Order) -> tuple[Floats, Report]:
        """A twist in the hand's frame, zero twists after the last one, and what tf tells."""
        if order.enabled or self._zeros > 0:
            self._zeros = ZERO_TWISTS if order.enabled else self._zeros - 1
            self._publish_twist(order.twist.tolist() if order.enabled else [0.0] * 6)
        if self.gripper and (order.close or order.open):
            self._move_gripper(order.close)
        pose, age, why = self._look_up()
        if pose is None:
            raise OSError(why)
        report = self._reports.pop(0) if self._reports else Report()
        return pose, report._replace(not_ready=why or self._why_not(), pose_age=age)

    def release_arm(self) -> None:
        """Zero twists, and leave."""
        if self._node is None:
            return
        with contextlib.suppress(Exception):  # it may be lost: MoveIt Servo stops an arm that gets no twists
            for _ in range(ZERO_TWISTS if self._zeros else 0):
                self._publish_twist([0.0] * 6)
            time.sleep(BEAT)  # in which they go out
            self._over.set()
            import_module("rclpy").try_shutdown()

    def _spin(self, executor: Any) -> None:
        with contextlib.suppress(Exception):  # it ends with the connection
            while not self._over.is_set():
                executor.spin_once(timeout_sec=BEAT)

    def _publish_twist(self, twist: list[float]) -> None:
        message = self._message()
        message.header.stamp, message.header.frame_id = self._node.get_clock().now().to_msg(), self.frame
        for part, values in ((message.twist.linear, twist[:3]), (message.twist.angular, twist[3:])):
            part.x, part.y, part.z = values
        self._twists.publish(message)

    def _look_up(self) -> tuple[Floats | None, float, str]:
        """The hand's pose in the base, how old it is in s, and why it is not to be gone by."""
        try:
            found = self._tf.lookup_transform(self.base, self.frame, self._newest)
        except self._unknown as error:
            return None, 0.0, f"tf knows no {self.frame} in {self.base}: {error}"
        place, turn, stamp = found.transform.translation, found.transform.rotation, found.header.stamp
        age = 1e-9 * self._node.get_clock().now().nanoseconds - (stamp.sec + 1e-9 * stamp.nanosec)
        old = f"tf told {age:.2f} s ago where {self.frame} is, by its stamps: is it on this clock?"
        pose = pose_of(rotation_of([turn.x, turn.y, turn.z, turn.w]), (place.x, place.y, place.z))
        return pose, age, old if abs(age) > SILENCE else ""

    def _why_not(self) -> str:
        if self._twists.get_subscription_count() < 1:
            return f"nobody listens to {self.topic}: MoveIt Servo does not run"
        if self.gripper and not self._hand.server_is_ready():
            return f"no gripper answers at {self.gripper}"
        return ""

    def _move_gripper(self, close: bool) -> None:
        goal = self._command.Goal()
        opened, closed, effort = self.positions
        goal.command.position, goal.command.max_effort = closed if close else opened, effort

        def on_accepted(future: Any) -> None:
            if not future.result().accepted:
                self._reports.append(Report(stopped="its gripper refuses"))
            elif close:
                future.result().get_result_async().add_done_callback(on_done)

        def on_done(future: Any) -> None:
            self._reports.append(
                Report(held=bool(future.result().result.stalled))
            )  # fingers that stopped before their goal

        self._hand.send_goal_async(goal).add_done_callback(on_accepted)
