# SPDX-License-Identifier: Apache-2.0
"""Results as messages, and back."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from foxglove_msgs.msg import CircleAnnotation, Color, ImageAnnotations, Point2, PointsAnnotation, TextAnnotation
from geometry_msgs.msg import (
    Point,
    Point32,
    PolygonStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    TwistStamped,
)
from grasptrack_msgs.msg import Contact, TrackedGrasp
from sensor_msgs.msg import CompressedImage
from vision_msgs.msg import Detection2D, Detection2DArray, ObjectHypothesisWithPose
from visualization_msgs.msg import Marker, MarkerArray

import grasptrack as gt
from grasptrack.io.columns import NAMED
from grasptrack.io.recording import HALF, status_line
from grasptrack.typing import Floats
from grasptrack.view.draw import draw_overlay
from grasptrack.view.style import STATUS_RGB, Colour
from grasptrack_ros.tracking import stamp_ns

STATUS = {"searching": 0, "tracked": 1, "unstable": 2, "lost": 3}
FIELDS = {
    **{name: name for name in ("reason", "reason_code", "notice", "strategy", "confidence")},
    **{name: name for name in ("margin", "margin_sd", "tilt", "tilt_sd", "distance", "distance_sd")},
    "chance": "closure_probability",
}
"""Columns of `grasptrack.io.columns` with the fields that hold them, angles in rad."""
QUALITY = 80
"""Of the overlay's JPEG."""
SHOWN = 1
"""s for which a marker is shown where no other comes."""
CONTACT, APPROACH = 0.008, 0.06
"""m, of the markers of contacts and approach."""


def grasp_message(header: Any, result: gt.TrackResult) -> TrackedGrasp:
    """The whole answer for an image with this header."""
    m = TrackedGrasp()
    m.header, m.status = header, STATUS[result.status]
    m.frame, m.repeated = result.frame, result.repeated
    for name, field in FIELDS.items():
        setattr(m, field, NAMED[name].value_of(result))
    m.grasp_id, m.object_sure = result.grasp_id or 0, result.object_sure
    m.contacts = [_contact(result, i) for i in range(0 if result.contacts is None else len(result.contacts))]
    m.has_homography = result.homography is not None
    m.homography = [0.0] * 9 if result.homography is None else result.homography.ravel().tolist()
    m.latency = float(result.latency_ms) * 1e-3
    return m


def _contact(result: gt.TrackResult, i: int) -> Contact:
    m = Contact()
    assert result.contacts is not None
    m.x, m.y = result.contacts[i].tolist()
    m.covariance = [math.nan] * 4 if result.covariance is None else result.covariance[i].ravel().tolist()
    m.visibility = 1.0 if result.seen is None else float(result.seen[i])
    return m


def result_of(message: TrackedGrasp) -> gt.TrackResult:
    """What a servo needs of an answer, its time that of the stamp, s; the analysis and the outline are not in a message."""
    contacts = np.array([(c.x, c.y) for c in message.contacts], dtype=np.float64)
    covariance = np.array([c.covariance for c in message.contacts], dtype=np.float64).reshape(-1, 2, 2)
    status = next(name for name, number in STATUS.items() if number == message.status)
    located = len(contacts) > 0
    return gt.TrackResult(
        message.frame,
        1e-9 * stamp_ns(message.header.stamp),
        status,  # type: ignore[arg-type]
        message.reason,
        message.strategy,
        message.grasp_id or None,
        contacts if located else None,
        np.array([c.visibility for c in message.contacts]) if located else None,
        confidence=message.confidence,
        homography=np.array(message.homography, dtype=np.float64).reshape(3, 3) if message.has_homography else None,
        covariance=covariance if located and np.isfinite(covariance).all() else None,
        chance=message.closure_probability,
        reason_code=message.reason_code,
        notice=message.notice,
        object_sure=message.object_sure,
        repeated=message.repeated,
    )


def polygon_message(header: Any, points: Floats | None) -> PolygonStamped:
    """Points (n, 2) px; none for None."""
    m = PolygonStamped()
    m.header = header
    m.polygon.points = [_point32(x, y) for x, y in ([] if points is None else points.tolist())]
    return m


def _point32(x: float, y: float) -> Point32:
    m = Point32()
    m.x, m.y, m.z = x, y, 0.0
    return m


def detections_message(header: Any, result: gt.TrackResult) -> Detection2DArray:
    """The object's box, its id that of the grasp, its score the confidence; none while it is not located."""
    m = Detection2DArray()
    m.header = header
    if result.view is None or not result.located:
        return m
    low, high = result.view.outer.points.min(axis=0), result.view.outer.points.max(axis=0)
    found, guess = Detection2D(), ObjectHypothesisWithPose()
    found.header, found.id = header, str(result.grasp_id)
    found.bbox.center.position.x, found.bbox.center.position.y = (0.5 * (low + high)).tolist()
    found.bbox.size_x, found.bbox.size_y = (high - low).tolist()
    guess.hypothesis.class_id, guess.hypothesis.score = "object", float(result.confidence)
    found.results = [guess]
    m.detections = [found]
    return m


def annotations_message(header: Any, result: gt.TrackResult) -> ImageAnnotations:
    """Outline, contacts and status, in Foxglove's px, which count from the corner of the first pixel."""
    m, colour = ImageAnnotations(), _colour(STATUS_RGB[result.status])
    for contour in () if result.view is None else result.view.contours:
        loop = PointsAnnotation()
        loop.timestamp, loop.type, loop.thickness, loop.outline_color = header.stamp, 2, 2.0, colour
        loop.points = [_point2(p) for p in contour.points]
        m.points.append(loop)
    for contact in () if result.contacts is None else result.contacts:
        circle = CircleAnnotation()
        circle.timestamp, circle.position, circle.outline_color = header.stamp, _point2(contact), colour
        circle.diameter, circle.thickness = 8.0, 2.0
        m.circles.append(circle)
    text = TextAnnotation()
    text.timestamp, text.text, text.font_size, text.text_color = header.stamp, status_line(result), 14.0, colour
    text.position.x, text.position.y = 8.0, 20.0
    m.texts = [text]
    return m


def _point2(point: Floats) -> Point2:
    m = Point2()
    m.x, m.y = float(point[0]) + HALF, float(point[1]) + HALF
    return m


def _colour(rgb: Colour) -> Color:
    m = Color()
    m.r, m.g, m.b, m.a = *(value / 255.0 for value in rgb), 1.0
    return m


def overlay_message(header: Any, image: Any, result: gt.TrackResult) -> CompressedImage:
    """The picture that `grasptrack track` makes a film of, as JPEG."""
    m = CompressedImage()
    m.header, m.format = header, "jpeg"
    drawn = draw_overlay(image, result)
    m.data = cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
    return m


def diagnostics_message(stamp: Any, name: str, level: int, text: str, values: dict[str, object]) -> DiagnosticArray:
    """One status: level 0 is well, 1 a warning, 2 an error."""
    m, status = DiagnosticArray(), DiagnosticStatus()
    m.header.stamp = stamp
    status.level, status.name, status.message = bytes([level]), name, text
    for key, value in values.items():
        pair = KeyValue()
        pair.key, pair.value = key, str(value)
        status.values.append(pair)
    m.status = [status]
    return m


def twist_message(stamp: Any, frame: str, twist: Floats) -> TwistStamped:
    """A twist (6,) in the hand's frame."""
    m = TwistStamped()
    m.header.stamp, m.header.frame_id = stamp, frame
    linear, angular = m.twist.linear, m.twist.angular
    linear.x, linear.y, linear.z, angular.x, angular.y, angular.z = twist.tolist()
    return m


def pose_message(header: Any, position: Floats, rotation: Floats) -> PoseStamped:
    """A position (3,) m and a rotation (3, 3) in the header's frame."""
    m = PoseStamped()
    m.header = header
    turn = cv2.Rodrigues(rotation)[0].ravel()
    angle = float(np.linalg.norm(turn))
    at, q = m.pose.position, m.pose.orientation
    at.x, at.y, at.z = position.tolist()
    q.x, q.y, q.z = (0.5 * np.sinc(angle / math.tau) * turn).tolist()
    q.w = math.cos(0.5 * angle)
    return m


def sure_pose_message(pose: PoseStamped, covariance: Floats) -> PoseWithCovarianceStamped:
    """The pose with its covariance (6, 6) m^2, m rad and rad^2."""
    m = PoseWithCovarianceStamped()
    m.header, m.pose.pose, m.pose.covariance = pose.header, pose.pose, covariance.ravel().tolist()
    return m


def markers_message(header: Any, grasp: Any) -> MarkerArray:
    """Of a grasp in m: its contacts, and an arrow by which the hand comes to it."""
    contacts = _marker(header, 0, Marker.SPHERE_LIST, grasp.contacts, (CONTACT,) * 3)
    way = np.array([grasp.position - APPROACH * grasp.approach, grasp.position])
    arrow = _marker(header, 1, Marker.ARROW, way, (0.1 * APPROACH, 0.2 * APPROACH, 0.0))
    m = MarkerArray()
    m.markers = [contacts, arrow]
    return m


def _marker(header: Any, number: int, kind: int, points: Floats, scale: tuple[float, float, float]) -> Marker:
    m = Marker()
    m.header, m.ns, m.id, m.type, m.action, m.lifetime.sec = header, "grasp", number, kind, Marker.ADD, SHOWN
    m.scale.x, m.scale.y, m.scale.z = scale
    m.color.r, m.color.g, m.color.b, m.color.a = *(value / 255.0 for value in STATUS_RGB["tracked"]), 1.0
    m.pose.orientation.w = 1.0
    for point in points:
        m.points.append(_point(point))
    return m


def _point(point: Floats) -> Point:
    m = Point()
    m.x, m.y, m.z = point.tolist()
    return m
