# SPDX-License-Identifier: Apache-2.0
"""A topic of ROS 2 by zenoh alone: a publisher on loopback with rmw_zenoh's keys, and topics that are absent."""

import itertools
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from bags import message
from grasptrack import SourceError, open_source
from grasptrack.io import ros2
from recordings import picture

zenoh = pytest.importorskip("zenoh", reason="the extra zenoh is not installed")
pytest.importorskip("rosbags", reason="the extra zenoh is not installed")

IMAGES = [picture(i) for i in range(4)]


@contextmanager
def publisher(topic: str, encoding: str, domain: int = 0) -> Iterator[str]:
    """Publishes IMAGES over and over, 50 a second, as rmw_zenoh does; gives its address."""
    from rosbags.typesys import Stores, get_typestore

    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{found.getsockname()[1]}"
    store = get_typestore(Stores.LATEST)
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    over = threading.Event()
    with zenoh.open(config) as session:
        name = message(store, IMAGES[0], encoding, 1, ros1=False)[1]
        mangled = name.replace("/", "::").replace("::msg::", "::msg::dds_::") + "_"
        kind = f"{mangled}/{store.hash_rihs01(name)}"
        node = f"@ros2_lv/{domain}/{session.zid()}/0/1/MP/%/%/camera"
        token = session.liveliness().declare_token(f"{node}/{topic.replace('/', '%')}/{kind}/::,7:,:,:,,")
        key = f"{domain}{topic}/{kind}"

        def send() -> None:
            for i in itertools.count():
                if over.wait(0.02):
                    return
                content, _ = message(store, IMAGES[i % 4], encoding, 10**18 + i * 20_000_000, ros1=False)
                session.put(key, bytes(store.serialize_cdr(content, name)))

        thread = threading.Thread(target=send, daemon=True)
        thread.start()
        try:
            yield endpoint
        finally:
            over.set()
            thread.join()
            token.undeclare()


@pytest.mark.parametrize("encoding", ["bgr8", "png"])
def test_a_topic_is_a_live_source_with_the_stamps_of_its_headers(encoding: str) -> None:
    with publisher("/camera/image", encoding) as endpoint:
        source = open_source("ros2:/camera/image", settings={"connect": endpoint})
        frames = list(itertools.islice(source, 5))
    assert (source.kind, source.live) == ("ros2", True)
    steps = np.diff([f.time for f in frames]) / 0.02
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert all(any(np.array_equal(f.image, image) for image in IMAGES) for f in frames)


def test_the_domain_is_part_of_the_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros2, "_LOOKING_S", 0.5)
    with publisher("/image", "bgr8", domain=7) as endpoint:
        monkeypatch.setenv("ROS_DOMAIN_ID", "7")
        assert next(iter(open_source(f"ros2:/image?connect={endpoint}"))).index == 0
        with pytest.raises(SourceError, match="is published by nobody; there is none with images"):
            next(iter(open_source(f"ros2:/image?connect={endpoint}&domain=0")))


def test_an_absent_topic_is_told_with_those_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros2, "_LOOKING_S", 0.5)
    with publisher("/camera/image", "bgr8") as endpoint, pytest.raises(SourceError) as caught:
        next(iter(open_source(f"ros2:/camera/imag?connect={endpoint}")))
    assert str(caught.value).endswith("topic /camera/imag is published by nobody; there is /camera/image")


@pytest.mark.parametrize(
    ("spec", "reason"),
    [
        ("ros2:/image?connect=tcp/127.0.0.1:1", "nothing of zenoh answers at tcp/127.0.0.1:1"),
        ("ros2:", "names no topic"),
        ("ros2:/image?domain=x", "domain is a number"),
        ("ros2:/image?qos=best", "has no setting qos"),
    ],
)
def test_wrong_topics_are_one_line(monkeypatch: pytest.MonkeyPatch, spec: str, reason: str) -> None:
    monkeypatch.setattr(ros2, "_LOOKING_S", 0.5)
    with pytest.raises(SourceError, match=reason):
        next(iter(open_source(spec)))
