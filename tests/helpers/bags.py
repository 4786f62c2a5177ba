# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1 and ROS 2, and MCAP files, with images of any encoding, written by rosbags."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

KINDS = ("ros1.bag", "ros2", "ros2-mcap", "plain.mcap")
BEGIN = 1_700_000_000_000_000_000
"""ns at which a bag begins."""


def message(store: Any, image: np.ndarray, encoding: str, stamp: int, *, ros1: bool) -> tuple[Any, str]:
    """A message with this image, and its type. Encodings jpeg and png, or one of sensor_msgs/Image."""
    types = store.types
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    number = {"seq": 0} if ros1 else {}
    header = types["std_msgs/msg/Header"](**number, stamp=time, frame_id="camera")
    if encoding in ("jpeg", "png"):
        data = cv2.imencode(f".{encoding}", image)[1].ravel()
        name = "sensor_msgs/msg/CompressedImage"
        return types[name](header=header, format=f"bgr8; {encoding} compressed bgr8", data=data), name
    name = "sensor_msgs/msg/Image"
    data = np.ascontiguousarray(image).view(np.uint8).ravel()
    height, width = image.shape[:2]
    return types[name](header, height, width, encoding, 0, data.size // height, data), name


def write_bag(
    folder: Path,
    kind: str,
    topics: dict[str, tuple[str, list[np.ndarray]]],
    period: int = 33_333_333,
    stamped: bool = True,
) -> Path:
    """A bag with images on topics: for each its encoding and the images. The recording's times lag 5 ms behind the stamps."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    ros1 = kind.endswith(".bag")
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    path = folder / ("for-mcap" if kind == "plain.mcap" else kind)
    plugin = StoragePlugin.SQLITE3 if kind == "ros2" else StoragePlugin.MCAP
    with Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=plugin) as writer:
        for topic, (encoding, images) in topics.items():
            connection = None
            for i, image in enumerate(images):
                stamp = BEGIN + i * period
                content, name = message(store, image, encoding, stamp if stamped else 0, ros1=ros1)
                connection = connection or writer.add_connection(topic, name, typestore=store)
                data = store.serialize_ros1(content, name) if ros1 else store.serialize_cdr(content, name)
                writer.write(connection, stamp + 5_000_000, data)
    return next(path.glob("*.mcap")).rename(folder / kind) if kind == "plain.mcap" else path


def write_text_bag(path: Path) -> Path:
    """A ROS 1 bag that holds text alone."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    name = "std_msgs/msg/String"
    with Writer(path) as writer:
        connection = writer.add_connection("/chatter", name, typestore=store)
        writer.write(connection, BEGIN, store.serialize_ros1(store.types[name]("hello"), name))
    return path
