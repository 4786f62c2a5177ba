# SPDX-License-Identifier: Apache-2.0
"""The servo beside a tracker, its twists for moveit_servo: ros2 launch grasptrack_ros servo.launch.py parameters:=mine.yaml."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.substitutions import FindPackageShare
from lifecycle_msgs.msg import Transition


def generate_launch_description() -> LaunchDescription:
    """Arguments: grasp, twist (topics), parameters (a YAML file). Nothing moves before the service ~/enable is called."""
    own = PathJoinSubstitution([FindPackageShare("grasptrack_ros"), "config", "servo.yaml"])
    node = LifecycleNode(
        package="grasptrack_ros",
        executable="servo",
        name="grasptrack_servo",
        namespace="",
        output="screen",
        parameters=[LaunchConfiguration("parameters")],
        remappings=[
            ("~/grasp", LaunchConfiguration("grasp")),
            ("~/twist_cmds", LaunchConfiguration("twist")),
        ],
    )

    def change(transition: int) -> EmitEvent:
        return EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition))

    configured = OnStateTransition(
        target_lifecycle_node=node, goal_state="inactive", entities=[change(Transition.TRANSITION_ACTIVATE)]
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument("grasp", default_value="/grasptrack/grasp"),
            DeclareLaunchArgument("twist", default_value="/servo_node/delta_twist_cmds"),
            DeclareLaunchArgument("parameters", default_value=own),
            node,
            RegisterEventHandler(configured),
            change(Transition.TRANSITION_CONFIGURE),
        ]
    )
