# SPDX-License-Identifier: Apache-2.0
"""The servo as a lifecycle node: tracked grasps in, twists for moveit_servo out, a gripper opened and closed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

from control_msgs.action import GripperCommand
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TwistStamped
from grasptrack_msgs.msg import TrackedGrasp
from rclpy.action import ActionClient
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.time import Time
from std_msgs.msg import Header
from std_srvs.srv import SetBool, Trigger
from tf2_ros import Buffer, TransformException, TransformListener
from visualization_msgs.msg import MarkerArray

import grasptrack as gt
from grasptrack.errors import InputError
from grasptrack.servo.steering import SLOW, Steering
from grasptrack.typing import Floats
from grasptrack_ros import messages
from grasptrack_ros.managed import ManagedNode, guarded, run
from grasptrack_ros.parameters import read_parameters
from grasptrack_ros.tracking import pose_matrix, stamp_ns

RATES = 20.0, 1000.0
"""Hz: moveit_servo drops twists that are older than 0.1 s."""
LATE = 1.0
"""s: a grasp that is older when it comes was stamped by another clock."""


@dataclasses.dataclass(frozen=True)
class NodeParameters:
    """Of the node itself.

    Attributes:
        rate: Hz of the twists, 20 or more.
        base_frame, hand_frame: of tf; the hand's z points along the fingers, x from one to the other.
        gripper: action of a gripper (control_msgs/GripperCommand); empty where `~/closed` tells what came of closing.
        gripper_position, gripper_effort: of its goal when it closes.
        gripper_open_position: of its goal when it opens, before another try.
        gripper_reports_opening: its position is the distance of the fingertips in m, which tells what is between them; else
            fingers that are stopped before their goal (`stalled`) hold something.
    """

    rate: float = 50.0
    base_frame: str = "base_link"
    hand_frame: str = "tool0"
    gripper: str = ""
    gripper_position: float = 0.0
    gripper_effort: float = 20.0
    gripper_open_position: float = 0.08
    gripper_reports_opening: bool = False


@dataclasses.dataclass(frozen=True)
class ServoParameters:
    """What the servo is told, by the names of the node's parameters.

    Attributes:
        goal: a file of `Goal.save`, or of the live page's fingertips; empty where `fingertips` says it.
        fingertips: x1, y1, x2, y2, ... px of the open gripper's fingertips in the images.
        opening: m between the first two.
        beyond: m by which they shall reach past the contacts.
        dof: 4, or 6 with the tilt.
        width, height: px of the images.
        linear, angular: m/s and rad/s, the limits.
        linear_acceleration, angular_acceleration: m/s^2 and rad/s^2.
        time_limit: s after which it gives up.
        max_age: s, the oldest image that counts, by its stamp; 0 for three times what lies between images, at least 0.3 s.
        retries: how often it tries again after closing on nothing.
        zero_twists: how many zero twists end an approach, so that one that is lost does no harm.
    """

    goal: str = ""
    fingertips: tuple[float, ...] = ()
    opening: float = 0.0
    beyond: float = 0.0
    dof: int = 4
    width: int = 640
    height: int = 480
    linear: float = SLOW.linear
    angular: float = SLOW.angular
    linear_acceleration: float = SLOW.linear_acceleration
    angular_acceleration: float = SLOW.angular_acceleration
    time_limit: float = 60.0
    max_age: float = 0.0
    retries: int = 0
    zero_twists: int = 5

    def make_goal(self) -> gt.Goal:
        """The goal that the parameters name.

        Raises:
            InputError: none, two, or one that is none.
        """
        if bool(self.goal) == bool(self.fingertips):
            raise InputError("the servo needs one goal: the parameter goal (a file), or fingertips and opening")
        if self.goal:
            return gt.Goal.load(Path(self.goal))
        if len(self.fingertips) % 2:
            raise InputError(f"fingertips are x1, y1, x2, y2, ...: an even count, not {len(self.fingertips)}")
        points = [self.fingertips[i : i + 2] for i in range(0, len(self.fingertips), 2)]
        return gt.Goal.fingertips(points, self.opening, beyond_m=self.beyond)

    def make_servo(self) -> gt.GraspServo:
        """A servo of these parameters.

        Raises:
            InputError: parameters that it refuses.
        """
        return gt.GraspServo(
            self.make_goal(),
            self.dof,
            size=(self.width, self.height),
            limits=gt.Limits(self.linear, self.angular, self.linear_acceleration, self.angular_acceleration),
            time_limit=self.time_limit,
            max_age=self.max_age or None,
            retries=self.retries,
        )


class ServoNode(ManagedNode):
    """Topics, services, parameters and states as ros/README.md lists them."""

    def __init__(self) -> None:
        super().__init__("grasptrack_servo", ServoParameters, NodeParameters)
        self._steering: Steering | None = None
        self._timer: Any = None
        self._told = ""

    # --- states -----------------------------------------------------------------------------------

    def open(self) -> None:
        """Read the parameters and the goal, open topics and services."""
        self._own = own = read_parameters(self, NodeParameters)
        if not RATES[0] <= own.rate <= RATES[1]:
            raise InputError(f"rate is {RATES[0]:g} Hz or more, {RATES[1]:g} at most, not {own.rate:g}")
        asked = read_parameters(self, ServoParameters)
        steering = Steering(asked.make_servo, asked.zero_twists)
        self._tf = Buffer()
        self.opened.callback(TransformListener(self._tf, self).unregister)
        self._twists = self.publisher(TwistStamped, "~/twist_cmds")
        self._pose = self.publisher(PoseStamped, "~/grasp_pose")
        self._sure_pose = self.publisher(PoseWithCovarianceStamped, "~/grasp_pose_with_covariance")
        self._markers = self.publisher(MarkerArray, "~/markers")
        self._diagnostics = self.publisher(DiagnosticArray, "/diagnostics")
        self.listen(TrackedGrasp, "~/grasp", self._on_grasp)
        self.serve(SetBool, "~/enable", self._on_enable)
        self.serve(Trigger, "~/touched", self._on_touched)
        self.serve(Trigger, "~/reset", self._on_reset)
        self.serve(SetBool, "~/closed", self._on_closed)
        self._gripper = ActionClient(self, GripperCommand, own.gripper) if own.gripper else None
        if self._gripper is not None:
            self.opened.callback(self._gripper.destroy)
        self._steering = steering
        self.opened.callback(setattr, self, "_steering", None)
        self.opened.callback(self._stop_ticking)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to tick; nothing moves before ~/enable."""
        self._timer = self.create_timer(1.0 / self._own.rate, self._on_tick)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stand, and tick no more."""
        self._stop_ticking()
        return super().on_deactivate(state)

    def rest(self, why: str = "") -> None:
        """Stand; where something went wrong, the approach is over."""
        steering = self._steering
        if steering is None:
            return
        if why:
            steering.servo.stop(why)
        steering.stand_still()
        while (twist := steering.next_twist(self._now(), None, 0.0)) is not None:
            self._publish_twist(twist)
        if why:
            self._tell_state()

    def _stop_ticking(self) -> None:
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self._timer = None

    # --- messages ---------------------------------------------------------------------------------

    @guarded
    def _on_grasp(self, message: TrackedGrasp) -> None:
        taken = 1e-9 * stamp_ns(message.header.stamp)
        late = self._now() - taken
        if abs(late) > LATE:
            text = f"a grasp's stamp is {late:.1f} s ago: camera, robot and this node have to be on one clock"
            self.get_logger().warning(text, throttle_duration_sec=2.0)
        if self._steering is not None:
            self._steering.take_result(messages.result_of(message), taken)

    @guarded
    def _on_tick(self) -> None:
        steering = self._steering
        assert steering is not None
        pose, at = self._hand_pose() if steering.enabled else (None, 0.0)
        before = steering.command
        twist = steering.next_twist(self._now(), pose, at)
        if twist is not None:
            self._publish_twist(twist)
        if steering.why and pose is not None:
            self.get_logger().warning(f"the hand stands: {steering.why}", throttle_duration_sec=2.0)
        command = steering.command
        if command is None or command is before:
            return
        if command.close:
            self._close_gripper()
        if command.open:
            self._move_gripper("open", self._own.gripper_open_position)
        if getattr(command, "grasp_pose", None) is not None:
            self._publish_grasp(command.grasp_pose, at)
        self._tell_state()

    @guarded
    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        assert self._steering is not None
        if not request.data:
            self.rest()
        elif self._gripper is not None and not self._gripper.server_is_ready():
            response.message = f"no gripper answers at {self._own.gripper}"
        else:
            response.message = self._steering.enable(self._now())
        response.success = not response.message
        return response

    @guarded
    def _on_touched(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        assert self._steering is not None
        self._steering.servo.touched()
        if self._steering.servo.over:  # fingers that close may feel something
            self.rest()
        return self._answer(response)

    @guarded
    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        assert self._steering is not None
        self.rest()
        self._steering.reset()
        response.success, response.message = True, "a new approach; ~/enable starts it"
        return response

    @guarded
    def _on_closed(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        assert self._steering is not None
        self._steering.servo.closed(request.data)
        return self._answer(response)

    # --- parts ------------------------------------------------------------------------------------

    def _now(self) -> float:
        return 1e-9 * self.get_clock().now().nanoseconds

    def _hand_pose(self) -> tuple[Floats | None, float]:
        """Where the hand was last, and when, s."""
        try:
            found = self._tf.lookup_transform(self._own.base_frame, self._own.hand_frame, Time())
        except TransformException as error:
            self.get_logger().warning(f"no pose of the hand: {error}", throttle_duration_sec=2.0)
            return None, 0.0
        return pose_matrix(found.transform), 1e-9 * stamp_ns(found.header.stamp)

    def _publish_twist(self, twist: Floats) -> None:
        stamp = self.get_clock().now().to_msg()
        self._twists.publish(messages.twist_message(stamp, self._own.hand_frame, twist))

    def _publish_grasp(self, grasp: Any, at: float) -> None:
        header = Header()
        header.stamp, header.frame_id = Time(nanoseconds=round(1e9 * at)).to_msg(), self._own.base_frame
        pose = messages.pose_message(header, grasp.position, grasp.rotation)
        self._pose.publish(pose)
        self._sure_pose.publish(messages.sure_pose_message(pose, grasp.covariance))
        self._markers.publish(messages.markers_message(header, grasp))

    def _answer(self, response: Any) -> Any:
        """Of a service: what became of the approach."""
        assert self._steering is not None
        self._tell_state()
        response.success, response.message = True, f"{self._steering.servo.state}: {self._steering.servo.reason}"
        return response

    def _tell_state(self) -> None:
        assert self._steering is not None
        servo, command = self._steering.servo, self._steering.command
        told = {"state": servo.state} | ({} if command is None else {"error_px": f"{command.error_px:.2f}"})
        text, stamp = f"{servo.state}: {servo.reason}", self.get_clock().now().to_msg()
        level = 2 if servo.state == "failed" else 0
        if servo.state != self._told:
            self._told = servo.state
            (self.get_logger().error if level else self.get_logger().info)(text)
        self._diagnostics.publish(messages.diagnostics_message(stamp, self.get_name(), level, text, told))

    # --- gripper ----------------------------------------------------------------------------------

    def _close_gripper(self) -> None:
        assert self._steering is not None
        servo = self._steering.servo

        def tell(done: Any) -> None:
            if self._own.gripper_reports_opening:
                servo.closed(opening=max(float(done.position), 0.0))
            else:
                servo.closed(bool(done.stalled))

        self._move_gripper("close", self._own.gripper_position, tell)

    def _move_gripper(self, what: str, position: float, tell: Callable[[Any], None] | None = None) -> None:
        """Send it a goal, and tell the servo what came of it."""
        if self._gripper is None:
            then = ", and call ~/closed with what came of it" if tell else ""
            self.get_logger().info(f"{what} the gripper now{then}")
            return
        goal = GripperCommand.Goal()
        goal.command.position, goal.command.max_effort = position, self._own.gripper_effort

        @guarded
        def on_accepted(node: ServoNode, future: Any) -> None:
            if not future.result().accepted:
                raise RuntimeError(f"the gripper refused to {what}")
            if tell is not None:
                future.result().get_result_async().add_done_callback(lambda f: on_done(node, f))

        @guarded
        def on_done(node: ServoNode, future: Any) -> None:
            assert tell is not None
            tell(future.result().result)

        self._gripper.send_goal_async(goal).add_done_callback(lambda f: on_accepted(self, f))


def main() -> None:
    """Run the node until Ctrl-C."""
    run(ServoNode)
