# SPDX-License-Identifier: Apache-2.0
"""Results over WebSocket: what TCP promises, each line a message, pings answered, and no web page let in that was not named."""

import base64
import contextlib
import json
import os
import socket
import struct
import time
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptrack.io import publishing
from grasptrack.io.peers import LONGEST_HEAD, WebSocketPeer, text_message
from grasptrack.io.publishing import MOST_CLIENTS, WEBSOCKET, PublishAddress, ResultPublisher, parse_publish_address
from test_publishing import PATIENCE, SCHEMA, publish

ADDRESS = PublishAddress("127.0.0.1", 0, scheme=WEBSOCKET)
TEXT, CLOSE, PING, PONG = 1, 8, 9, 10
KEY, PROOF = "dGhlIHNhbXBsZSBub25jZQ==", "s3pPLMBiTxaQ9kYGzzhZRbK+xOo="
"""Of the example in RFC 6455."""


def greeting(key: str = KEY, **more: str) -> bytes:
    heads = {"Host": "h", "Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13", **more}
    lines = "".join(f"{name.replace('_', '-')}: {value}\r\n" for name, value in heads.items())
    return f"GET / HTTP/1.1\r\nSec-WebSocket-Key: {key}\r\n{lines}\r\n".encode()


def masked(kind: int, body: bytes = b"", mask: bytes = b"abcd") -> bytes:
    assert len(body) <= 125
    return bytes([0x80 | kind, 0x80 | len(body)]) + mask + bytes(b ^ mask[i % 4] for i, b in enumerate(body))


def frames(data: bytes) -> list[tuple[int, bytes]]:
    """What a server has sent, frame by frame; the last may be cut off."""
    found = []
    while len(data) >= 2:
        kind, size, at = data[0] & 0x0F, data[1], 2
        assert data[0] & 0x80 and not size & 0x80, "whole and unmasked, as a server sends"
        if size >= 126:
            wide = ">H" if size == 126 else ">Q"
            at += struct.calcsize(wide)
            (size,) = struct.unpack(wide, data[2:at]) if len(data) >= at else (1 << 62,)
        if len(data) < at + size:
            break
        found.append((kind, data[at : at + size]))
        data = data[at + size :]
    return found


class Listener:
    """A client by hand."""

    def __init__(self, publisher: ResultPublisher, receive_buffer: int | None = None, **more: str) -> None:
        self.link = socket.socket()
        if receive_buffer is not None:
            self.link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.link.settimeout(PATIENCE)
        self.link.connect(("127.0.0.1", int(publisher.url.rpartition(":")[2])))
        self.file = self.link.makefile("rb")
        self.link.sendall(greeting(base64.b64encode(os.urandom(16)).decode(), **more))
        self.head = b""
        while (line := self.file.readline()) not in (b"\r\n", b""):
            self.head += line

    def frame(self) -> tuple[int, bytes]:
        start = self.file.read(2)
        size = start[1]
        more = self.file.read(2 if size == 126 else 8 if size == 127 else 0)
        return start[0] & 0x0F, self.file.read(int.from_bytes(more, "big") if more else size)

    def read(self) -> dict[str, Any]:
        kind, body = self.frame()
        assert kind == TEXT
        return dict(json.loads(body))

    def rest(self) -> list[tuple[int, bytes]]:
        with contextlib.suppress(ConnectionResetError):
            return frames(self.file.read())
        return []

    def close(self) -> None:
        self.file.close()
        self.link.close()


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """No line without a frame."""
    monkeypatch.setattr(publishing, "SILENCE", 60.0)


# --- the protocol --------------------------------------------------------------------------------


@given(st.sampled_from([0, 1, 125, 126, 127, 65535, 65536]) | st.integers(0, 70000))
def test_a_message_of_any_length_is_one_frame(size: int) -> None:
    text = bytes(size)
    assert frames(text_message(text)) == [(TEXT, text)]


def test_the_handshake_is_that_of_the_standard() -> None:
    peer = WebSocketPeer()
    answer = peer.take_bytes(greeting()).decode()
    assert answer.startswith("HTTP/1.1 101 ") and f"Sec-WebSocket-Accept: {PROOF}\r\n" in answer and peer.greeted


@given(
    said=st.lists(
        st.tuples(st.sampled_from([TEXT, PING, PONG]), st.binary(max_size=125), st.binary(min_size=4, max_size=4))
    ),
    cuts=st.lists(st.integers(1, 40)),
)
def test_pings_are_answered_in_order_however_what_comes_is_cut(
    said: list[tuple[int, bytes, bytes]], cuts: list[int]
) -> None:
    came = greeting() + b"".join(masked(kind, body, mask) for kind, body, mask in said)
    peer, owed = WebSocketPeer(), b""
    while came:
        size = cuts.pop() if cuts else len(came)
        owed, came = owed + peer.take_bytes(came[:size]), came[size:]
    head, _, rest = owed.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 101 ") and peer.greeted and not peer.over
    assert frames(rest) == [(PONG, body) for kind, body, _ in said if kind == PING]


@given(st.binary(max_size=300))
def test_whatever_comes_ends_in_an_answer_or_a_farewell_and_nothing_grows(noise: bytes) -> None:
    for start in (b"", greeting()):
        peer = WebSocketPeer()
        owed = peer.take_bytes(start + noise)
        assert len(owed) <= 300 + 2 * len(noise)
        assert len(peer._got) <= LONGEST_HEAD + len(noise)
        assert not peer.over or not peer.take_bytes(noise) or not peer.greeted


@pytest.mark.parametrize(
    ("origin", "named", "let_in"),
    [
        (None, "", True),
        ("http://panel.local:3000", "", False),
        ("http://panel.local:3000", "http://panel.local:3000", True),
        ("http://panel.local", "http://panel.local:3000", False),
        ("null", "*", True),
    ],
)
def test_a_web_page_is_let_in_where_it_is_named(origin: str | None, named: str, let_in: bool) -> None:
    peer = WebSocketPeer(named)
    answer = peer.take_bytes(greeting(**({} if origin is None else {"Origin": origin})))
    assert answer.startswith(b"HTTP/1.1 101 " if let_in else b"HTTP/1.1 403 ") and (peer.greeted, peer.over) == (
        let_in,
        not let_in,
    )
    assert let_in or f"origin={origin}".encode() in answer


@pytest.mark.parametrize("said", [b"GET / HTTP/1.1\r\nHost: h\r\n\r\n", b"\x00" * (LONGEST_HEAD + 1), b"\r\n\r\n"])
def test_who_asks_for_no_websocket_is_told_so(said: bytes) -> None:
    peer = WebSocketPeer()
    assert peer.take_bytes(said).startswith(b"HTTP/1.1 426 ") and peer.over


# --- the publisher -------------------------------------------------------------------------------


@pytest.mark.usefixtures("patient")
@settings(max_examples=40)
@given(
    steps=st.lists(st.sampled_from(["come", "leave", "publish", "publish", "read", "ping"]), max_size=30),
    data=st.data(),
)
def test_messages_keep_their_order_and_the_newest_arrives_before_the_farewell(
    steps: list[str], data: st.DataObject
) -> None:
    number, here = 0, list[tuple[Listener, int, list[int]]]()
    with ResultPublisher(ADDRESS) as publisher:
        for step in steps:
            if step == "publish":
                number = publish(publisher)
            elif step == "come" and len(here) < 4:
                here.append((Listener(publisher), number, []))
            elif here:
                listener, since, read = each = data.draw(st.sampled_from(here))
                if step == "leave":
                    here.remove(each)
                    listener.close()
                elif step == "ping":
                    listener.link.sendall(masked(PING, b"still there"))
                elif (read[-1] if read else since) < number:
                    while (frame := listener.frame())[0] == PONG:
                        pass
                    read.append(json.loads(frame[1])["sequence"])
    for listener, since, read in here:
        told = listener.rest()
        assert told[-1][0] == CLOSE
        read += [json.loads(body)["sequence"] for kind, body in told if kind == TEXT]
        assert read == sorted(set(read)) and all(k >= since for k in read)
        assert (read[-1] if read else since) == number
        listener.close()


@pytest.mark.usefixtures("patient")
def test_who_never_reads_slows_nobody() -> None:
    with ResultPublisher(ADDRESS) as publisher:
        stuck, quick = Listener(publisher, 4096), Listener(publisher)
        began = time.perf_counter()
        for _ in range(1000):
            number = publish(publisher)
            line = quick.read()
            SCHEMA.validate(line)
            assert line["sequence"] == number
        assert time.perf_counter() - began < PATIENCE
        stuck.close()
        quick.close()


def test_who_does_not_greet_keeps_no_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(publishing, "STALLED", 0.1)
    with ResultPublisher(ADDRESS) as publisher:
        silent = [
            socket.create_connection(("127.0.0.1", int(publisher.url.rpartition(":")[2]))) for _ in range(MOST_CLIENTS)
        ]
        until = time.monotonic() + PATIENCE
        while len(publisher._clients) < MOST_CLIENTS and time.monotonic() < until:
            time.sleep(0.001)
        while publisher._clients and time.monotonic() < until:
            time.sleep(0.01)
        listener = Listener(publisher)
        publish(publisher)
        assert listener.read()["version"] == 1
        for link in (*silent, listener):
            link.close()


@pytest.mark.usefixtures("patient")
def test_who_spoke_last_hears_the_end_and_no_reset() -> None:
    for _ in range(20):
        with ResultPublisher(ADDRESS) as publisher:
            listener = Listener(publisher)
            number = publish(publisher)
            listener.link.sendall(masked(PING, b"?") * 50)
        told = frames(listener.file.read())
        assert told[-1][0] == CLOSE
        assert [json.loads(body)["sequence"] for kind, body in told if kind == TEXT] == [number]
        listener.close()


def test_half_a_connection_is_a_connection_that_has_gone() -> None:
    with ResultPublisher(ADDRESS) as publisher:
        listener = Listener(publisher)
        listener.link.shutdown(socket.SHUT_WR)
        assert b"-" not in listener.file.read()
        assert not publisher._clients
        listener.close()


def test_another_s_client_hears_the_same_and_is_bidden_farewell() -> None:
    client = pytest.importorskip("websockets.sync.client")
    with contextlib.ExitStack() as left:
        with ResultPublisher(ADDRESS) as publisher:
            link = left.enter_context(client.connect(publisher.url))
            assert link.ping().wait(PATIENCE)
            number = publish(publisher)
            while (line := json.loads(link.recv(PATIENCE)))["sequence"] < number:
                pass
            SCHEMA.validate(line)
        with pytest.raises(Exception, match="1001"):
            for _ in range(9):
                link.recv(PATIENCE)


# --- addresses -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("ws://0.0.0.0:5556", PublishAddress("0.0.0.0", 5556, scheme="ws")),
        ("ws://:0/?format=fixed&rate=5", PublishAddress("127.0.0.1", 0, "fixed", 5.0, "ws")),
        ("ws://h:1?origin=http://panel:3000", PublishAddress("h", 1, scheme="ws", origin="http://panel:3000")),
    ],
)
def test_an_address_of_a_websocket(text: str, address: PublishAddress) -> None:
    assert parse_publish_address(text) == address
