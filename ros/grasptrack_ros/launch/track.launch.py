# SPDX-License-Identifier: Apache-2.0
"""The tracker on a camera, configured and active: ros2 launch grasptrack_ros track.launch.py image:=/camera/image_raw."""

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
    """Arguments: image, camera_info (topics), parameters (a YAML file)."""
    own = PathJoinSubstitution([FindPackageShare("grasptrack_ros"), "config", "track.yaml"])
    image, info = LaunchConfiguration("image"), LaunchConfiguration("camera_info")
    node = LifecycleNode(
        package="grasptrack_ros",
        executable="tracker",
        name="grasptrack",
        namespace="",
        output="screen",
        parameters=[LaunchConfiguration("parameters")],
        remappings=[
            ("image", image),
            ("image/compressed", [image, "/compressed"]),
            ("image/mouse_click", [image, "/mouse_click"]),
            ("image_mouse_left", [image, "_mouse_left"]),
            ("camera_info", info),
        ],
    )

    def change(transition: int) -> EmitEvent:
        return EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition))

    configured = OnStateTransition(
        target_lifecycle_node=node, goal_state="inactive", entities=[change(Transition.TRANSITION_ACTIVATE)]
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument("image", default_value="/camera/image_raw"),
            DeclareLaunchArgument("camera_info", default_value="/camera/camera_info"),
            DeclareLaunchArgument("parameters", default_value=own),
            node,
            RegisterEventHandler(configured),
            change(Transition.TRANSITION_CONFIGURE),
        ]
    )
