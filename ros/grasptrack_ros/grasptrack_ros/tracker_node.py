# SPDX-License-Identifier: Apache-2.0
"""The tracker as a lifecycle node: images in, grasps out."""

from __future__ import annotations

import dataclasses

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from foxglove_msgs.msg import ImageAnnotations
from geometry_msgs.msg import PointStamped, PolygonStamped
from grasptrack_msgs.msg import TrackedGrasp
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import Trigger
from vision_msgs.msg import Detection2DArray

from grasptrack.errors import GraspTrackError
from grasptrack_ros import messages
from grasptrack_ros.parameters import declare_parameters, read_parameters
from grasptrack_ros.tracking import Answer, ImageTracker, TrackParameters

LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Of images: the newest one, and none is sent twice."""
RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


@dataclasses.dataclass(frozen=True)
class NodeParameters:
    """Of the node itself.

    Attributes:
        image_transport: raw or compressed.
        overlay: publish the picture, where someone listens.
        annotations: publish Foxglove's annotations.
    """

    image_transport: str = "raw"
    overlay: bool = True
    annotations: bool = True


class TrackerNode(LifecycleNode):
    """Topics, parameters and states as ros/README.md lists them."""

    def __init__(self) -> None:
        super().__init__("grasptrack")
        declare_parameters(self, TrackParameters)
        declare_parameters(self, NodeParameters)
        self._active = False
        self._tracker: ImageTracker | None = None

    # --- states -----------------------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the parameters, open the topics."""
        own = read_parameters(self, NodeParameters)
        if own.image_transport not in ("raw", "compressed"):
            self.get_logger().error(f'image_transport is raw or compressed, not "{own.image_transport}"')
            return FAILURE
        try:
            self._tracker = ImageTracker(read_parameters(self, TrackParameters))
        except GraspTrackError as error:
            self.get_logger().error(str(error))
            return FAILURE
        self._own = own
        publish = self.create_lifecycle_publisher
        self._grasp = publish(TrackedGrasp, "~/grasp", RELIABLE)
        self._contacts = publish(PolygonStamped, "~/contacts", RELIABLE)
        self._outline = publish(PolygonStamped, "~/outline", RELIABLE)
        self._detections = publish(Detection2DArray, "~/detections", RELIABLE)
        self._overlay = publish(CompressedImage, "~/overlay/compressed", LATEST)
        self._annotations = publish(ImageAnnotations, "~/annotations", RELIABLE)
        self._diagnostics = publish(DiagnosticArray, "/diagnostics", RELIABLE)
        kind, topic = (Image, "image") if own.image_transport == "raw" else (CompressedImage, "image/compressed")
        listen = self.create_subscription
        self._listening = [
            listen(kind, topic, self._on_image, LATEST),
            listen(CameraInfo, "camera_info", self._on_camera_info, LATEST),
            listen(PointStamped, "image/mouse_click", self._on_click, RELIABLE),
            listen(Image, "~/mask", self._on_mask, LATEST),
        ]
        self._service = self.create_service(Trigger, "~/reset", self._on_reset)
        return SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to track."""
        self._active = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Look at no image any more; the grasp is kept for the next activation."""
        self._active = False
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the object, close the topics."""
        self._active, self._tracker = False, None
        for subscription in self._listening:
            self.destroy_subscription(subscription)
        published = (self._grasp, self._contacts, self._outline, self._detections, self._overlay, self._annotations)
        for publisher in (*published, self._diagnostics):
            self.destroy_publisher(publisher)
        self.destroy_service(self._service)
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop."""
        self._active = False
        return SUCCESS

    # --- messages ---------------------------------------------------------------------------------

    def _on_image(self, message: Image | CompressedImage) -> None:
        if self._active and self._tracker is not None:
            self._publish(self._tracker.take_image(message), message.header)

    def _on_mask(self, message: Image) -> None:
        if self._active and self._tracker is not None:
            self._publish(self._tracker.take_mask(message), message.header)

    def _on_camera_info(self, message: CameraInfo) -> None:
        if self._tracker is not None:
            try:
                self._tracker.take_camera_info(message)
            except GraspTrackError as error:
                self.get_logger().error(f"camera_info: {error}")

    def _on_click(self, message: PointStamped) -> None:
        if self._tracker is not None:
            self._tracker.click(message.point.x, message.point.y)

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._tracker is not None:
            self._tracker.restart()
        response.success, response.message = True, "begins anew with the next image"
        return response

    def _publish(self, answer: Answer | None, header: object) -> None:
        assert self._tracker is not None
        stamp = self.get_clock().now().to_msg()
        told = {"dropped": self._tracker.dropped}
        if answer is None:
            if self._tracker.trouble:
                trouble = messages.diagnostics_message(stamp, self.get_name(), 2, self._tracker.trouble, told)
                self._diagnostics.publish(trouble)
            return
        header, image, result = answer
        self._grasp.publish(messages.grasp_message(header, result))
        self._contacts.publish(messages.polygon_message(header, result.contacts))
        outline = None if result.view is None else result.view.outer.points
        self._outline.publish(messages.polygon_message(header, outline))
        self._detections.publish(messages.detections_message(header, result))
        if self._own.annotations:
            self._annotations.publish(messages.annotations_message(header, result))
        if self._own.overlay and self._overlay.get_subscription_count():
            self._overlay.publish(messages.overlay_message(header, image, result))
        level = 0 if result.status == "tracked" else 1
        told |= {"confidence": f"{result.confidence:.6f}", "latency_ms": f"{result.latency_ms:.2f}"}
        text = result.reason or result.status
        self._diagnostics.publish(messages.diagnostics_message(stamp, self.get_name(), level, text, told))


def main() -> None:
    """Run the node until Ctrl-C."""
    rclpy.init()
    node = TrackerNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
