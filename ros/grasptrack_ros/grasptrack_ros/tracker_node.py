# SPDX-License-Identifier: Apache-2.0
"""The tracker as a lifecycle node: images in, grasps out."""

from __future__ import annotations

import dataclasses

from diagnostic_msgs.msg import DiagnosticArray
from foxglove_msgs.msg import ImageAnnotations
from geometry_msgs.msg import Point, PointStamped, PolygonStamped
from grasptrack_msgs.msg import TrackedGrasp
from grasptrack_msgs.srv import Click
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import Trigger
from vision_msgs.msg import Detection2DArray

from grasptrack.errors import InputError
from grasptrack_ros import messages
from grasptrack_ros.managed import ManagedNode, guarded, run
from grasptrack_ros.parameters import read_parameters
from grasptrack_ros.tracking import Answer, ImageTracker, TrackParameters

LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Of images: the newest one, and none is sent twice."""


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


class TrackerNode(ManagedNode):
    """Topics, parameters and states as ros/README.md lists them."""

    def __init__(self) -> None:
        super().__init__("grasptrack", TrackParameters, NodeParameters)
        self._active = False
        self._tracker: ImageTracker | None = None

    # --- states -----------------------------------------------------------------------------------

    def open(self) -> None:
        """Read the parameters, open the topics."""
        self._own = own = read_parameters(self, NodeParameters)
        if own.image_transport not in ("raw", "compressed"):
            raise InputError(f'image_transport is raw or compressed, not "{own.image_transport}"')
        tracker = ImageTracker(read_parameters(self, TrackParameters))
        self._grasp = self.publisher(TrackedGrasp, "~/grasp")
        self._contacts = self.publisher(PolygonStamped, "~/contacts")
        self._outline = self.publisher(PolygonStamped, "~/outline")
        self._detections = self.publisher(Detection2DArray, "~/detections")
        self._overlay = self.publisher(CompressedImage, "~/overlay/compressed", LATEST)
        self._annotations = self.publisher(ImageAnnotations, "~/annotations")
        self._diagnostics = self.publisher(DiagnosticArray, "/diagnostics")
        kind, topic = (Image, "image") if own.image_transport == "raw" else (CompressedImage, "image/compressed")
        self.listen(kind, topic, self._on_image, LATEST)
        self.listen(CameraInfo, "camera_info", self._on_camera_info, LATEST)
        self.listen(PointStamped, "image/mouse_click", lambda message: self._on_click(message.point))
        self.listen(Point, "image_mouse_left", self._on_click)
        self.listen(Image, "~/mask", self._on_mask, LATEST)
        self.serve(Click, "~/click", self._on_click_service)
        self.serve(Trigger, "~/reset", self._on_reset)
        self._tracker = tracker
        self.opened.callback(setattr, self, "_tracker", None)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to track."""
        self._active = True
        return super().on_activate(state)

    def rest(self, why: str = "") -> None:
        """Look at no image any more, except after an error; the grasp is kept for the next activation."""
        self._active = self._active and bool(why)

    # --- messages ---------------------------------------------------------------------------------

    @guarded
    def _on_image(self, message: Image | CompressedImage) -> None:
        if self._active and self._tracker is not None:
            self._publish(self._tracker.take_image(message), message.header)

    @guarded
    def _on_mask(self, message: Image) -> None:
        if self._active and self._tracker is not None:
            self._publish(self._tracker.take_mask(message), message.header)

    @guarded
    def _on_camera_info(self, message: CameraInfo) -> None:
        if self._tracker is not None:
            self._tracker.take_camera_info(message)

    @guarded
    def _on_click(self, at: Point | Click.Request) -> None:
        if self._tracker is not None:
            self._tracker.click(at.x, at.y)

    @guarded
    def _on_click_service(self, request: Click.Request, response: Click.Response) -> Click.Response:
        assert self._tracker is not None
        self._tracker.click(request.x, request.y)
        response.success, response.message = True, "begins anew with the next image, on what lies there"
        return response

    @guarded
    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        assert self._tracker is not None
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
    run(TrackerNode)
