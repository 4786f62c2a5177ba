# SPDX-License-Identifier: Apache-2.0
"""ROS 1 bags (.bag) and folders that `ros2 bag` wrote, through rosbags. Extra `bags`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from grasptrack.io.bags.messages import Topic
from grasptrack.io.extras import import_extra


class RosBag:
    """An open bag.

    Args:
        path: a file .bag, or the folder of a ROS 2 bag.
    """

    def __init__(self, path: Path) -> None:
        highlevel = import_extra("rosbags.highlevel", "bags", "a bag of ROS")
        typesys = import_extra("rosbags.typesys", "bags", "a bag of ROS")
        # Bags of ROS 2 before Iron hold no definitions; those of images are the same in all.
        known = typesys.get_typestore(typesys.Stores.LATEST)
        self._reader: Any = highlevel.AnyReader([path], default_typestore=known)
        self._reader.open()

    def topics(self) -> list[Topic]:
        """All topics."""
        return [Topic(name, info.msgtype or "", info.msgcount) for name, info in self._reader.topics.items()]

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Times of recording in ns and messages, in that order."""
        chosen = [c for c in self._reader.connections if c.topic == topic]
        for connection, time, data in self._reader.messages(connections=chosen):
            yield time, self._reader.deserialize(data, connection.msgtype)

    def close(self) -> None:
        """Close the files."""
        self._reader.close()
