# SPDX-License-Identifier: Apache-2.0
"""Topics of a running ROS 2 system, without ROS: zenoh on the wire, rosbags for the messages. Extra `zenoh`.

For systems whose middleware is rmw_zenoh: its keys name domain, topic, type and the type's hash, and every publisher stands in
the graph as a liveliness token. Nothing is published.
"""

from __future__ import annotations

import json
import os
import time
from collections import deque
from collections.abc import Mapping
from threading import Condition
from typing import Any, NamedTuple

from grasptrack.errors import SourceError
from grasptrack.io.bags.messages import MessageImages, image_kind, stamp_of
from grasptrack.io.base import Image
from grasptrack.io.live import LiveSource, parse_address, take_patience
from grasptrack.plugins import import_extra

ROUTER = "tcp/localhost:7447"
"""Where rmw_zenoh's router listens if nothing else is said."""
_WAIT_S = 1.0
_LOOKING_S = 3.0
"""s in which publishers that are there make themselves known."""
_HELD = 2
"""Messages that may wait: one is decoded while the next one comes."""


class Published(NamedTuple):
    """A topic that somebody publishes."""

    topic: str
    type: str


def published_in(tokens: list[str]) -> list[Published]:
    """The topics in keys of liveliness tokens, as rmw_zenoh writes them."""
    found = set()
    for key in tokens:
        parts = key.split("/")
        if len(parts) >= 12 and parts[0] == "@ros2_lv" and parts[5] == "MP":
            kind = parts[10].replace("::dds_::", "::").replace("::", "/").rstrip("_")  # sensor_msgs::msg::dds_::Image_
            found.add(Published(parts[9].replace("%", "/"), kind))
    return sorted(found)


class _Topic:
    """An open subscription."""

    missed = 0

    def __init__(self, spec: str, topic: str, domain: int, endpoint: str, bits: int | None) -> None:
        zenoh = import_extra("zenoh", "zenoh", "a topic of ROS 2")
        typesys = import_extra("rosbags.typesys", "zenoh", "a topic of ROS 2")
        self._store = typesys.get_typestore(typesys.Stores.LATEST)
        config = zenoh.Config()
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("connect/exit_on_failure", "true")
        config.insert_json5("connect/timeout_ms", str(round(1000 * _LOOKING_S)))
        config.insert_json5("listen/endpoints", "[]")
        config.insert_json5("scouting/multicast/enabled", "false")
        try:
            self._session: Any = zenoh.open(config)
        except zenoh.ZError:
            raise SourceError(
                f'"{spec}": nothing of zenoh answers at {endpoint}: is ROS 2 running with rmw_zenoh? '
                "(--set connect=tcp/HOST:7447)",
                spec=spec,
            ) from None
        try:
            kind = self._find_type(spec, topic, domain)
            self._images = MessageImages(image_kind(kind), bits)
            self._type, self._name = kind, f"an image of {topic}"
            self._begin: int | None = None
            self._waiting: deque[bytes] = deque()
            self._came = Condition()
            self._subscriber = self._session.declare_subscriber(f"{domain}/{topic.strip('/')}/*/*", self._take_sample)
        except BaseException:
            self._session.close()
            raise

    def _find_type(self, spec: str, topic: str, domain: int) -> str:
        """The type of the topic's messages."""
        until, there = time.monotonic() + _LOOKING_S, list[Published]()
        while True:
            replies = self._session.liveliness().get(f"@ros2_lv/{domain}/**", timeout=_WAIT_S)
            there = published_in([str(reply.ok.key_expr) for reply in replies if reply.ok is not None])
            found = next((p for p in there if p.topic == topic), None)
            if found is not None and image_kind(found.type):
                return found.type
            if found is not None or time.monotonic() > until:
                break
            time.sleep(0.1)
        pictures = ", ".join(p.topic for p in there if image_kind(p.type)) or "none with images"
        why = f"holds {found.type}, no images" if found is not None else "is published by nobody"
        raise SourceError(f'"{spec}": topic {topic} {why}; there is {pictures}', topic=topic)

    def _take_sample(self, sample: Any) -> None:
        with self._came:
            while len(self._waiting) >= _HELD:
                self._waiting.popleft()
                self.missed += 1
            self._waiting.append(sample.payload.to_bytes())
            self._came.notify()

    def read(self) -> tuple[Image, float | None] | None:
        with self._came:
            if not self._waiting and not self._came.wait(_WAIT_S):
                return None
            data = self._waiting.popleft()
        message = self._store.deserialize_cdr(data, self._type)
        image = self._images.decode_message(message, self._name)
        stamp = stamp_of(message)
        if self._begin is None:
            self._begin = stamp
        if image is None:
            return None
        # A float holds s since 1970 to a tenth of a microsecond only.
        return image, None if stamp is None or self._begin is None else (stamp - self._begin) / 1e9

    def close(self) -> None:
        self._session.close()


def open_topic(spec: str, fps: float | None = None, settings: Mapping[str, str] | None = None) -> LiveSource:
    """A topic of ROS 2 as a source; its messages are sensor_msgs/Image or CompressedImage.

    Args:
        spec: ``ros2:/topic``.
        settings: `connect`, zenoh's address of the router [tcp/localhost:7447]; `domain` [``ROS_DOMAIN_ID``, or 0]; `bits`, as
            for bags; `wait`, s without an image after which it is given up.
    """
    import_extra("zenoh", "zenoh", "a topic of ROS 2")
    import_extra("rosbags", "zenoh", "a topic of ROS 2")
    address = parse_address(spec, settings)
    more = address.settings
    patience, endpoint = take_patience(more), more.pop("connect", ROUTER)
    numbers = {"domain": more.pop("domain", os.environ.get("ROS_DOMAIN_ID") or "0"), "bits": more.pop("bits", "16")}
    for name, text in numbers.items():
        if not text.isdecimal():
            raise SourceError(f"the setting {name} is a number, not {text!r}", name=name)
    if more:
        raise SourceError(f'"{spec}" has no setting {next(iter(more))}, only connect, domain, bits and wait', spec=spec)
    if not address.where.strip("/"):
        raise SourceError(f'"{spec}" names no topic, as ros2:/camera/image_raw does', spec=spec)
    topic = "/" + address.where.strip("/")
    domain, bits = int(numbers["domain"]), int(numbers["bits"])
    if not 9 <= bits <= 16:
        raise SourceError(f"the setting bits is 9 to 16, not {bits}", bits=bits)
    return LiveSource(
        spec, "ros2", f"topic {topic}", lambda: _Topic(spec, topic, domain, endpoint, bits), fps, patience
    )
