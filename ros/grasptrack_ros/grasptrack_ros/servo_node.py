# SPDX-License-Identifier: Apache-2.0
"""The servo as a lifecycle node: tracked grasps in, twists for moveit_servo out, a gripper closed."""

from __future__ import annotations

import dataclasses

import rclpy
from control_msgs.action import GripperCommand
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from grasptrack_msgs.msg import TrackedGrasp
from rclpy.action import ActionClient
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from std_srvs.srv import SetBool, Trigger
from tf2_ros import Buffer, TransformException, TransformListener

from grasptrack.errors import GraspTrackError
from grasptrack.typing import Floats
from grasptrack_ros import messages
from grasptrack_ros.parameters import declare_parameters, read_parameters
from grasptrack_ros.steering import ServoParameters, Steering
from grasptrack_ros.tracking import pose_matrix, stamp_ns

RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
LEAST_RATE = 20.0
"""Hz: moveit_servo drops twists that are older than 0.1 s."""


@dataclasses.dataclass(frozen=True)
class NodeParameters:
    """Of the node itself.

    Attributes:
        rate: Hz of the twists, 20 or more.
        base_frame, hand_frame: of tf; the hand's z points along the fingers, x from one to the other.
        gripper: action of a gripper (control_msgs/GripperCommand); empty where `~/closed` tells what came of closing.
        gripper_position, gripper_effort: of its goal.
    """

    rate: float = 50.0
    base_frame: str = "base_link"
    hand_frame: str = "tool0"
    gripper: str = ""
    gripper_position: float = 0.0
    gripper_effort: float = 20.0


class ServoNode(LifecycleNode):
    """Topics, services, parameters and states as ros/README.md lists them."""

    def __init__(self) -> None:
        super().__init__("grasptrack_servo")
        declare_parameters(self, ServoParameters)
        declare_parameters(self, NodeParameters)
        self._steering: Steering | None = None

    # --- states -----------------------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the parameters and the goal, open topics and services."""
        self._own = own = read_parameters(self, NodeParameters)
        if own.rate < LEAST_RATE:
            self.get_logger().error(f"rate is {LEAST_RATE:g} Hz or more, not {own.rate:g}")
            return FAILURE
        try:
            self._steering = Steering(read_parameters(self, ServoParameters))
        except GraspTrackError as error:
            self.get_logger().error(str(error))
            return FAILURE
        self._tf = Buffer()
        self._tf_listener = TransformListener(self._tf, self)
        self._twists = self.create_lifecycle_publisher(TwistStamped, "~/twist_cmds", RELIABLE)
        self._diagnostics = self.create_lifecycle_publisher(DiagnosticArray, "/diagnostics", RELIABLE)
        self._grasps = self.create_subscription(TrackedGrasp, "~/grasp", self._on_grasp, RELIABLE)
        self._services = [
            self.create_service(SetBool, "~/enable", self._on_enable),
            self.create_service(Trigger, "~/touched", self._on_touched),
            self.create_service(Trigger, "~/reset", self._on_reset),
            self.create_service(SetBool, "~/closed", self._on_closed),
        ]
        self._gripper = ActionClient(self, GripperCommand, own.gripper) if own.gripper else None
        self._timer = None
        return SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to tick; nothing moves before ~/enable."""
        self._timer = self.create_timer(1.0 / self._own.rate, self._on_tick)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stand, and tick no more."""
        self._stand()
        self._stop_ticking()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close topics and services."""
        self.destroy_subscription(self._grasps)
        for service in self._services:
            self.destroy_service(service)
        for publisher in (self._twists, self._diagnostics):
            self.destroy_publisher(publisher)
        self._steering = None
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stand."""
        if self._steering is not None:
            self._stand()
        self._stop_ticking()
        return SUCCESS

    def _stand(self) -> None:
        assert self._steering is not None
        self._steering.enable(False)
        while (twist := self._steering.tick(self._now(), None)) is not None:
            self._publish_twist(twist)

    def _stop_ticking(self) -> None:
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self._timer = None

    # --- messages ---------------------------------------------------------------------------------

    def _on_grasp(self, message: TrackedGrasp) -> None:
        if self._steering is not None:
            self._steering.take_result(messages.result_of(message), 1e-9 * stamp_ns(message.header.stamp))

    def _on_tick(self) -> None:
        steering = self._steering
        assert steering is not None
        before = steering.command
        try:
            twist = steering.tick(self._now(), self._hand_pose())
        except GraspTrackError as error:
            self.get_logger().error(str(error))
            self._stand()
            return
        if twist is not None:
            self._publish_twist(twist)
        command = steering.command
        if command is None or command is before:
            return
        if command.close:
            self._close_gripper()
        level = 2 if command.state == "failed" else 0
        stamp = self.get_clock().now().to_msg()
        told = {"state": command.state, "error_px": f"{command.error_px:.2f}"}
        text = f"{command.state}: {command.reason}"
        self._diagnostics.publish(messages.diagnostics_message(stamp, self.get_name(), level, text, told))

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        assert self._steering is not None
        response.message = self._steering.enable(request.data)
        response.success = not response.message
        return response

    def _on_touched(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        assert self._steering is not None
        self._steering.touched()
        self._stand()
        response.success, response.message = True, f"{self._steering.servo.state}: {self._steering.servo.reason}"
        return response

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        assert self._steering is not None
        self._stand()
        self._steering.reset()
        response.success, response.message = True, "a new approach; ~/enable starts it"
        return response

    def _on_closed(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        assert self._steering is not None
        self._steering.closed(request.data)
        response.success, response.message = True, f"{self._steering.servo.state}: {self._steering.servo.reason}"
        return response

    # --- parts ------------------------------------------------------------------------------------

    def _now(self) -> float:
        return 1e-9 * self.get_clock().now().nanoseconds

    def _hand_pose(self) -> Floats | None:
        try:
            found = self._tf.lookup_transform(self._own.base_frame, self._own.hand_frame, Time())
        except TransformException as error:
            self.get_logger().warning(f"the hand stands: {error}", throttle_duration_sec=2.0)
            return None
        return pose_matrix(found.transform)

    def _publish_twist(self, twist: Floats) -> None:
        stamp = self.get_clock().now().to_msg()
        self._twists.publish(messages.twist_message(stamp, self._own.hand_frame, twist))

    def _close_gripper(self) -> None:
        if self._gripper is None:
            self.get_logger().info("close the gripper now, and call ~/closed with what came of it")
            return
        goal = GripperCommand.Goal()
        goal.command.position, goal.command.max_effort = self._own.gripper_position, self._own.gripper_effort
        self._gripper.send_goal_async(goal).add_done_callback(self._on_gripper_goal)

    def _on_gripper_goal(self, future: object) -> None:
        handle = future.result()  # type: ignore[attr-defined]
        if handle.accepted:
            handle.get_result_async().add_done_callback(self._on_gripper_done)
        elif self._steering is not None:
            self.get_logger().error("the gripper refused to close")
            self._steering.closed(False)

    def _on_gripper_done(self, future: object) -> None:
        done = future.result().result  # type: ignore[attr-defined]
        if self._steering is not None:
            self._steering.closed(bool(done.stalled))  # fingers that are stopped before their goal hold something


def main() -> None:
    """Run the node until Ctrl-C."""
    rclpy.init()
    node = ServoNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
