# SPDX-License-Identifier: Apache-2.0
"""From messages of a camera to the tracker's answers, without ROS: stamps, masks of the same stamp, clicks, restarts."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import grasptrack as gt
from grasptrack.errors import InputError
from grasptrack.io.bags.messages import MessageImages
from grasptrack.typing import Floats

KEPT = 8
"""Images, or masks, that wait for their counterpart."""


@dataclass(frozen=True)
class TrackParameters:
    """What the tracker is told, by the names of the node's parameters.

    Attributes:
        fingers: number of contacts.
        strategy: auto, rrp, grasp-line, homography or paper.
        friction: coefficient of friction.
        risk: probability up to which an answer may be wrong.
        sure: probability from which on the first look counts as sure of its object.
        object: x, y px of the object in the first image; empty for the likeliest.
        segmenter: name of a segmenter; empty for none.
        length: of the object, in the unit in which distances are wanted; 0 for none.
        resynthesize: choose a new grasp where the present one would no longer hold.
        use_masks: wait for a mask of the same stamp with every image.
        use_camera_info: wait for the camera's calibration before the first image.
        bits: that images of 16 bits use; 0 takes what suits the first.
    """

    fingers: int = 2
    strategy: str = "auto"
    friction: float = 0.5
    risk: float = 1e-3
    sure: float = 0.9
    object: tuple[float, ...] = ()
    segmenter: str = ""
    length: float = 0.0
    resynthesize: bool = False
    use_masks: bool = False
    use_camera_info: bool = False
    bits: int = 0


class Answer(NamedTuple):
    """One image's.

    Attributes:
        header: of the image's message.
        image: uint8, grey (H, W) or BGR (H, W, 3).
        result: the tracker's.
    """

    header: Any
    image: Any
    result: gt.TrackResult


class ImageTracker:
    """A tracker that is fed messages.

    Args:
        parameters: what it is told.

    Attributes:
        dropped: images that could not be used, or whose mask never came.
        trouble: why the last image could not be used; empty when it could.
    """

    def __init__(self, parameters: TrackParameters) -> None:
        self._asked = parameters
        self._camera: gt.Camera | None = None
        self._raw = MessageImages("raw", parameters.bits or None)
        self._compressed = MessageImages("compressed", parameters.bits or None)
        self._plain = MessageImages("raw")
        self._images: OrderedDict[int, Any] = OrderedDict()
        self._masks: OrderedDict[int, Any] = OrderedDict()
        self.dropped, self.trouble = 0, ""
        self._shape: tuple[int, ...] = ()
        self.restart(parameters.object)

    def restart(self, object_at: tuple[float, ...] = ()) -> None:
        """Begin anew with the next image.

        Args:
            object_at: x, y px of the object that is meant in it; empty for the likeliest.

        Raises:
            InputError: parameters that the tracker refuses.
        """
        asked = self._asked
        self._tracker = gt.GraspTracker(
            fingers=asked.fingers,
            strategy=asked.strategy,
            friction=asked.friction,
            risk=asked.risk,
            sure=asked.sure,
            object_at=tuple(object_at) or None,  # type: ignore[arg-type]
            segmenter=asked.segmenter or None,
            length=asked.length or None,
            resynthesize=asked.resynthesize,
            camera=self._camera,
        )
        self._first = self._latest = -1

    def click(self, x: float, y: float) -> None:
        """A person points at the object: the tracker begins anew with the next image, on what lies there.

        Raises:
            InputError: a place outside the images; the tracker goes on with what it has.
        """
        if self._shape and not (0.0 <= x < self._shape[1] and 0.0 <= y < self._shape[0]):
            raise InputError(f"{x:g}, {y:g} is outside the image, which is {self._shape[1]}x{self._shape[0]} px")
        self.restart((x, y))

    def take_camera_info(self, message: Any) -> None:
        """A sensor_msgs/CameraInfo: the first one counts, and whatever was tracked without it begins anew.

        Raises:
            InputError: a calibration that is none.
        """
        K = np.array(message.k, dtype=np.float64).reshape(3, 3)
        if not self._asked.use_camera_info or self._camera is not None or not K[0, 0] > 0.0:
            return
        model = "fisheye" if message.distortion_model in ("equidistant", "fisheye") else "brown"
        size = (int(message.width), int(message.height)) if message.width and message.height else None
        self._camera = gt.Camera(K, np.array(message.d, dtype=np.float64), model, size)
        self.restart(self._asked.object)

    def take_image(self, message: Any) -> Answer | None:
        """A sensor_msgs/Image or CompressedImage; None where it waits for its mask, or could not be used (`trouble`)."""
        if self._asked.use_camera_info and self._camera is None:
            return self._drop("waits for the camera's calibration (camera_info)")
        stamp = stamp_ns(message.header.stamp)
        if not self._asked.use_masks:
            return self._answer(message, stamp, None)
        mask = self._masks.pop(stamp, None)
        if mask is not None:
            return self._answer(message, stamp, mask)
        self._keep(self._images, stamp, message)
        return None

    def take_mask(self, message: Any) -> Answer | None:
        """A mask, sensor_msgs/Image mono8, nonzero on the object; the answer, where its image was there already."""
        if not self._asked.use_masks:
            return None
        stamp = stamp_ns(message.header.stamp)
        image = self._images.pop(stamp, None)
        if image is not None:
            return self._answer(image, stamp, message)
        self._keep(self._masks, stamp, message)
        return None

    def _keep(self, waiting: OrderedDict[int, Any], stamp: int, message: Any) -> None:
        waiting[stamp] = message
        while len(waiting) > KEPT:
            waiting.popitem(last=False)
            self.dropped += waiting is self._images

    def _drop(self, why: str) -> None:
        self.dropped, self.trouble = self.dropped + 1, why

    def _answer(self, message: Any, stamp: int, mask: Any) -> Answer | None:
        try:
            image = self._decoded(message)
            if (image.shape != self._shape and self._shape) or stamp < self._latest:
                self.restart(self._asked.object)  # another camera mode, or a bag that begins again
            if stamp == self._latest:
                return self._drop("an image with the stamp of the one before")
            self._first = stamp if self._first < 0 else self._first
            self._latest, self._shape = stamp, image.shape
            own = None if mask is None else self._plain.decode_message(mask, "mask")
            result = self._tracker.update(image, time=(stamp - self._first) * 1e-9, mask=own)
        except gt.GraspTrackError as error:
            return self._drop(str(error))
        self.trouble = ""
        return Answer(message.header, image, result)

    def _decoded(self, message: Any) -> Any:
        kind = self._raw if hasattr(message, "encoding") else self._compressed
        return kind.decode_message(message, "image")


def stamp_ns(stamp: Any) -> int:
    """A builtin_interfaces/Time in ns."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def pose_matrix(transform: Any) -> Floats:
    """(4, 4) of a geometry_msgs/Transform."""
    q, at = transform.rotation, transform.translation
    x, y, z, w = np.array([q.x, q.y, q.z, q.w]) / np.linalg.norm([q.x, q.y, q.z, q.w])
    out = np.eye(4)
    out[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    out[:3, 3] = at.x, at.y, at.z
    return out
