# SPDX-License-Identifier: Apache-2.0
"""The tracker's node against a stub of rclpy, with messages that went through CDR. No ROS runs here."""

import ast
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import grasptrack as gt
from grasptrack.demo import demo_scene, still_life

pytest.importorskip("rosbags", reason="messages are serialised by rosbags")
from stub_ros import ROS, Reply, World

STEP = 40_000_000  # ns


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    made = World()
    made.install(monkeypatch)
    return made


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    return [frame.image for frame in demo_scene(frames=6)]


def started(world: World, **parameters: Any) -> Any:
    world.parameters.update(parameters)
    from grasptrack_ros.tracker_node import TrackerNode

    node = TrackerNode()
    assert node.change("configure") is Reply.SUCCESS, node.get_logger().lines
    assert node.change("activate") is Reply.SUCCESS
    return node


def header(world: World, index: int) -> Any:
    stamp = world.clock.stamp(world.clock.nanoseconds + index * STEP)
    return world.make("std_msgs/Header", stamp=stamp, frame_id="camera")


def raw(world: World, index: int, image: np.ndarray, encoding: str = "bgr8") -> Any:
    return world.make(
        "sensor_msgs/Image", header=header(world, index), height=image.shape[0], width=image.shape[1],
        encoding=encoding, step=image.strides[0], data=image.tobytes(),
    )  # fmt: skip


def test_every_topic_says_what_the_tracker_says(world: World, images: list[np.ndarray]) -> None:
    node = started(world)
    for i, image in enumerate(images):
        node.receive("image", raw(world, i, image))
    tracker = gt.GraspTracker(fingers=2)
    expected = [tracker.update(image, time=i * STEP * 1e-9) for i, image in enumerate(images)]
    sent = {topic: publisher.sent for topic, publisher in node.publishers.items()}
    assert {len(messages) for messages in sent.values()} == {len(images)}
    for i, (result, message) in enumerate(zip(expected, sent["~/grasp"], strict=True)):
        assert result.contacts is not None
        assert (message.status, message.grasp_id, message.header.frame_id) == (1, 1, "camera")
        assert message.header.stamp.nanosec == (world.clock.nanoseconds + i * STEP) % 10**9
        np.testing.assert_array_equal([(c.x, c.y) for c in message.contacts], result.contacts)
        np.testing.assert_array_equal([c.visibility for c in message.contacts], result.seen)
        if result.covariance is not None:
            np.testing.assert_array_equal([c.covariance for c in message.contacts], result.covariance.reshape(-1, 4))
        if result.homography is not None:
            np.testing.assert_array_equal(message.homography, result.homography.ravel())
        assert message.confidence == result.confidence and message.margin == result.analysis.margin
        polygon = sent["~/contacts"][i].polygon.points
        np.testing.assert_allclose([(p.x, p.y) for p in polygon], result.contacts, atol=1e-4)
        box = sent["~/detections"][i].detections[0]
        low, high = result.view.outer.points.min(axis=0), result.view.outer.points.max(axis=0)
        np.testing.assert_allclose((box.bbox.size_x, box.bbox.size_y), high - low)
        assert box.id == "1" and box.results[0].hypothesis.score == result.confidence
        drawn = sent["~/annotations"][i]
        np.testing.assert_allclose([(c.position.x, c.position.y) for c in drawn.circles], result.contacts + 0.5)
        assert len(drawn.points) == len(result.view.contours) and drawn.texts[0].text.startswith("tracked")
    shown = cv2.imdecode(np.asarray(sent["~/overlay/compressed"][-1].data), cv2.IMREAD_COLOR)
    assert shown.shape[1] == images[0].shape[1]
    status = sent["/diagnostics"][-1].status[0]
    assert (status.level, status.name) == (0, "grasptrack")


def test_an_answer_comes_back_from_its_message(world: World, images: list[np.ndarray]) -> None:
    node = started(world)
    from grasptrack_ros.messages import result_of

    tracker = gt.GraspTracker(fingers=2)
    for i, image in enumerate([*images[:3], images[2]]):
        node.receive("image", raw(world, i, image))
        expected = tracker.update(image, time=i * STEP * 1e-9)
        back = result_of(node.publishers["~/grasp"].sent[-1])
        for name in ("frame", "status", "reason", "grasp_id", "confidence", "object_sure", "notice", "repeated"):
            assert getattr(back, name) == getattr(expected, name)
        assert back.time == pytest.approx(1e-9 * (world.clock.nanoseconds + i * STEP), abs=1e-6)
        for name in ("contacts", "covariance", "homography", "seen"):
            own = getattr(expected, name)
            np.testing.assert_equal(getattr(back, name), own)
    assert back.repeated and back.frame == 3, "the camera gave its last image again"


def test_lost_is_lost(world: World, images: list[np.ndarray]) -> None:
    node = started(world)
    node.receive("image", raw(world, 0, images[0]))
    node.receive("image", raw(world, 1, np.full_like(images[0], 120)))
    message, polygon = node.publishers["~/grasp"].sent[-1], node.publishers["~/contacts"].sent[-1]
    assert message.status == 3 and message.reason and message.contacts == [] and polygon.polygon.points == []
    assert node.publishers["~/detections"].sent[-1].detections == []
    assert node.publishers["/diagnostics"].sent[-1].status[0].level == 1


def test_compressed_images(world: World, images: list[np.ndarray]) -> None:
    node = started(world, image_transport="compressed")
    data = cv2.imencode(".png", images[0])[1].tobytes()
    message = world.make(
        "sensor_msgs/CompressedImage", header=header(world, 0), format="bgr8; png compressed bgr8", data=data
    )
    node.receive("image/compressed", message)
    expected = gt.GraspTracker(fingers=2).update(images[0])
    sent = node.publishers["~/grasp"].sent[0]
    np.testing.assert_array_equal([(c.x, c.y) for c in sent.contacts], expected.contacts)


@pytest.fixture(scope="module")
def several() -> tuple[np.ndarray, gt.Contour]:
    """An image of several parts, and the outline of one that is not the first."""
    image = still_life()
    return image, gt.first_look(image)[1].view.outer


@pytest.mark.sampled(1)
@pytest.mark.parametrize("how", ["rviz", "rqt", "service"])
def test_a_click_chooses_the_object(world: World, several: tuple[np.ndarray, gt.Contour], how: str) -> None:
    image, other = several
    node = started(world)
    node.receive("image", raw(world, 0, image))
    x, y = other.points.mean(axis=0).tolist()
    at = world.make("geometry_msgs/Point", x=x, y=y)
    if how == "rviz":
        node.receive("image/mouse_click", world.make("geometry_msgs/PointStamped", header=header(world, 1), point=at))
    elif how == "rqt":
        node.receive("image_mouse_left", at)
    else:
        assert node.call("~/click", x=x, y=y).success
    node.receive("image", raw(world, 1, image))
    box = node.publishers["~/detections"].sent[-1].detections[0].bbox
    middle = 0.5 * (other.points.min(axis=0) + other.points.max(axis=0))
    np.testing.assert_allclose((box.center.position.x, box.center.position.y), middle, atol=1.0)
    assert node.publishers["~/grasp"].sent[-1].object_sure


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("x", "y"), [(640.0, 3.0), (-1.0, 3.0), (float("nan"), 3.0)])
def test_a_click_beside_the_image_is_told_and_changes_nothing(
    world: World, images: list[np.ndarray], x: float, y: float
) -> None:
    node = started(world)
    node.receive("image", raw(world, 0, images[0]))
    answer = node.call("~/click", x=x, y=y)
    assert not answer.success and "outside the image, which is 640x480 px" in answer.message
    node.receive("image", raw(world, 1, images[1]))
    assert [(m.status, m.frame) for m in node.publishers["~/grasp"].sent] == [(1, 0), (1, 1)]


def test_masks_meet_the_image_of_their_stamp(world: World, images: list[np.ndarray]) -> None:
    node = started(world, use_masks=True)
    view = gt.first_look(images[0])[0].view
    mask = np.zeros(images[0].shape[:2], np.uint8)
    cv2.fillPoly(mask, [np.rint(c.points).astype(np.int32) for c in view.contours], 255)
    sent = node.publishers["~/grasp"].sent
    node.receive("image", raw(world, 0, images[0]))
    assert not sent, "it waits for the mask"
    node.receive("~/mask", raw(world, 1, mask, "mono8"))
    assert not sent, "of another image"
    node.receive("~/mask", raw(world, 0, mask, "mono8"))
    assert len(sent) == 1 and sent[0].status == 1
    node.receive("image", raw(world, 1, images[0]))
    assert len(sent) == 2, "the mask was there first"


def test_a_calibration_is_waited_for_and_used(world: World, images: list[np.ndarray]) -> None:
    node = started(world, use_camera_info=True, length=100.0)
    node.receive("image", raw(world, 0, images[0]))
    assert not node.publishers["~/grasp"].sent
    assert "camera_info" in node.publishers["/diagnostics"].sent[-1].status[0].message
    k = [600.0, 0.0, 319.5, 0.0, 600.0, 239.5, 0.0, 0.0, 1.0]
    d = [-0.2, 0.05, 0.0, 0.0, 0.0]
    info = world.make("sensor_msgs/CameraInfo", width=640, height=480, distortion_model="plumb_bob", d=d, k=k)
    node.receive("camera_info", info)
    node.receive("image", raw(world, 1, images[0]))
    camera = gt.Camera(np.reshape(k, (3, 3)), d, "brown", (640, 480))
    expected = gt.GraspTracker(fingers=2, camera=camera, length=100.0).update(images[0])
    message = node.publishers["~/grasp"].sent[-1]
    np.testing.assert_array_equal([(c.x, c.y) for c in message.contacts], expected.contacts)
    assert message.distance == expected.distance


def test_what_cannot_be_used_is_told_and_the_next_image_goes_on(world: World, images: list[np.ndarray]) -> None:
    node = started(world)
    node.receive("image", raw(world, 0, images[0]))
    node.receive("image", raw(world, 1, images[1], "yuv444_planar"))
    trouble = node.publishers["/diagnostics"].sent[-1].status[0]
    assert trouble.level == 2 and "yuv444_planar" in trouble.message
    node.receive("image", raw(world, 2, images[2]))
    assert [m.status for m in node.publishers["~/grasp"].sent] == [1, 1]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("what", ["smaller", "earlier"])
def test_another_size_or_an_earlier_stamp_begins_anew(world: World, images: list[np.ndarray], what: str) -> None:
    node = started(world)
    node.receive("image", raw(world, 5, images[0]))
    again = raw(world, 6, images[0][40:, 40:].copy()) if what == "smaller" else raw(world, 0, images[0])
    node.receive("image", again)
    assert [m.status for m in node.publishers["~/grasp"].sent] == [1, 1]


def test_states_of_the_node(world: World, images: list[np.ndarray]) -> None:
    world.parameters["overlay"] = False
    node = started(world)
    node.change("deactivate")
    sent = node.publishers["~/grasp"].sent
    node.receive("image", raw(world, 0, images[0]))
    assert not sent
    node.change("activate")
    node.receive("image", raw(world, 1, images[1]))
    assert len(sent) == 1 and not node.publishers["~/overlay/compressed"].sent
    assert node.call("~/reset").success
    node.change("deactivate")
    assert node.change("cleanup") is Reply.SUCCESS and not node.open_things
    assert node.change("configure") is Reply.SUCCESS and node.change("shutdown") is Reply.SUCCESS
    assert not node.open_things


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        ({"image_transport": "theora"}, 'image_transport is raw or compressed, not "theora"'),
        ({"fingers": 1}, "at least 2 fingers"),
        ({"strategy": "best"}, "best"),
        ({"friction": "much"}, "the parameter friction is a number, not 'much'"),
    ],
)
def test_parameters_that_cannot_be_are_told(world: World, parameters: dict[str, Any], told: str) -> None:
    from grasptrack_ros.tracker_node import TrackerNode

    assert told in world.refused_by(TrackerNode, parameters)


def test_whole_numbers_serve_as_numbers_and_an_error_ends_no_program(
    world: World, images: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    node = started(world, friction=1, object=[320, 240])
    with monkeypatch.context() as m:
        m.setattr(node._tracker, "take_image", lambda message: 1 / 0)
        node.receive("image", raw(world, 0, images[0]))
    assert node.get_logger().lines == [("error", "division by zero")]
    node.receive("image", raw(world, 1, images[0]))
    assert node.publishers["~/grasp"].sent[-1].status == 1


def test_the_packages_name_what_is_there() -> None:
    """Launch files are Python, every file that setup.py installs exists, every message of CMake has its file."""
    package = ROS / "grasptrack_ros"
    for launch in (package / "launch").glob("*.py"):
        ast.parse(launch.read_text())
    for node in ast.walk(ast.parse((package / "setup.py").read_text())):
        if isinstance(node, ast.Constant) and str(node.value).startswith(("launch/", "config/", "package.xml")):
            assert (package / str(node.value)).is_file()
    cmake = (ROS / "grasptrack_msgs" / "CMakeLists.txt").read_text()
    for kind in ("msg", "srv"):
        assert all(f'"{kind}/{p.name}"' in cmake for p in (ROS / "grasptrack_msgs" / kind).iterdir())
    assert Path(package / "resource" / "grasptrack_ros").is_file()
