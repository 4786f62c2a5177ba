# SPDX-License-Identifier: Apache-2.0
"""Results over TCP or WebSocket, a line for every frame, or as registers of Modbus/TCP: for controllers, PLCs and panels.

Whoever tracks hands a result over and goes on; a thread of its own sends. A client gets the newest result once it has taken
the line before: one that is slow misses results, and nothing waits for it here. Nothing is read from a client of TCP.
"""

from __future__ import annotations

import contextlib
import math
import selectors
import socket
import threading
import time
from dataclasses import dataclass
from typing import Any, NamedTuple
from urllib.parse import parse_qsl, urlsplit

from grasptrack.errors import InputError
from grasptrack.io.base import Frame
from grasptrack.io.columns import IN_JSON, result_fields
from grasptrack.io.peers import FARTHEST, ModbusPeer, WebSocketPeer, pack_registers, text_message
from grasptrack.io.recording import json_line
from grasptrack.tracking.result import TrackResult

VERSION = 1
"""Of the lines; raised when a field changes its meaning or goes away."""
FORMATS = ("json", "fixed")
TCP, WEBSOCKET, MODBUS = "tcp", "ws", "modbus"
SILENT = "silent"
"""Status of a line without a frame."""
SILENCE = 1.0
"""s without a frame after which a line says so, and again after as many."""
STALLED = 2.0
"""s after which a client that takes nothing is dropped."""
FAREWELL = 0.5
"""s that clients are given at the end to take the last result."""
MOST_CLIENTS = 16
_SEND_BUFFER = 4096
"""Bytes that the system is asked to hold for a client: what waits there grows old."""
_NO_ROOM_PAUSE = 0.05
"""s in which nobody is let in where the process has no descriptor left."""
WIDTH = 80
"""Bytes of a fixed line with its newline: what a string of RAPID holds."""
_PLACES, _COORDINATE = 3, 7
"""Contacts in a fixed line, and characters of a coordinate."""
FIXED_STATUS = {SILENT: 0, "tracked": 2, "unstable": 3, "lost": 4, "searching": 5}
MAY_CLOSE, DOES_NOT_FIT = 1, 9
"""Statuses of a fixed line: tracked, and nothing speaks against closing; contacts that it has no room for."""


class PublishAddress(NamedTuple):
    """Where results are published, and how.

    Attributes:
        host: name or address of this machine to listen at.
        port: 0 takes a free one.
        form: one of `FORMATS`.
        rate: lines/s that a client is sent at most.
        scheme: `TCP`; `WEBSOCKET`, where each line is a message; or `MODBUS`, where registers are read in place of lines.
        origin: of web pages that may listen to a WebSocket; see `WebSocketPeer`.
    """

    host: str
    port: int
    form: str = "json"
    rate: float = math.inf
    scheme: str = TCP
    origin: str = ""


def parse_publish_address(text: str) -> PublishAddress:
    """The address as `--publish` takes it: tcp, ws or modbus://HOST:PORT, HOST:PORT or PORT; ?format=, &rate=, &origin=."""
    try:
        parts = urlsplit(text if "://" in text else f"tcp://{'127.0.0.1:' * text.partition('?')[0].isdecimal()}{text}")
        settings = dict(parse_qsl(parts.query, strict_parsing=True) if parts.query else ())
        lines = parts.scheme != MODBUS
        form, rate = FORMATS[0], math.inf
        if lines:
            form, rate = settings.pop("format", form), float(settings.pop("rate", "inf"))
        origin = settings.pop("origin", "") if parts.scheme == WEBSOCKET else ""
        path = parts.path if parts.scheme == TCP else parts.path.strip("/")
        plain = parts.scheme in (TCP, WEBSOCKET, MODBUS) and not (path or parts.fragment or parts.username or settings)
        if plain and parts.port is not None and form in FORMATS and rate >= 1.0:
            return PublishAddress(parts.hostname or "127.0.0.1", parts.port, form, rate, parts.scheme, origin)
    except ValueError:
        pass
    raise InputError(
        f"--publish takes tcp://HOST:PORT, as tcp://0.0.0.0:5555, ws://HOST:PORT, or a port of this machine, with ?format=json "
        f'or fixed and &rate=N lines/s, at least 1; ws with &origin=http://PAGE; or modbus://HOST:PORT; not "{text}"',
        address=text,
    )


class _Moment(NamedTuple):
    """What is told: a frame's result, or that none came."""

    number: int  # from 1
    came: float | None  # when the last image came out of its source, s of `time.perf_counter`
    frame: Frame | None = None
    result: TrackResult | None = None


def line_fields(moment: _Moment, now: float) -> dict[str, Any]:
    """A line in JSON, in the order of its fields; `now` is the time of `time.perf_counter` at which it is sent, s."""
    age = None if moment.came is None else max(now - moment.came, 0.0)
    head = {
        "version": VERSION,
        "sequence": moment.number,
        "stamp_s": None if age is None else round(time.time() - age, 4),
        "age_ms": None if age is None else round(1e3 * age, 1),
        "may_close": moment.result is not None and may_close(moment.result),
    }
    if moment.frame is None or moment.result is None:
        return {**head, **dict.fromkeys(IN_JSON), "status": SILENT}
    return {**head, **result_fields(moment.frame, moment.result)}


def may_close(result: TrackResult) -> bool:
    """Whether nothing speaks against closing on a result's contacts now, as for the page's OK TO CLOSE."""
    seen_now = result.last_seen is None or bool((result.last_seen >= result.frame).all())
    return result.status == "tracked" and result.object_sure and seen_now and not (result.notice or result.repeated)


def fixed_line(fields: dict[str, Any]) -> str:
    """A line's numbers in columns that never move, `WIDTH` characters; see docs/files.md."""
    contacts = fields["contacts"] or []
    texts = ["" if v is None else f"{v:0{_COORDINATE}.2f}" for contact in contacts for v in contact]
    status = _status_number(fields)
    if len(contacts) > _PLACES or any(len(text) != _COORDINATE for text in texts):
        status, contacts, texts = DOES_NOT_FIT, [], []
    texts += ["0000.00"] * (2 * _PLACES - len(texts))
    age = 999999 if fields["age_ms"] is None else min(math.ceil(fields["age_ms"]), 999999)  # never younger than it is
    confidence = math.floor(1e4 * (fields["confidence"] or 0.0)) / 1e4  # never rounded up
    spread = min(_widest_deviation(fields), 9.99)
    head = f"{VERSION},{status},{len(contacts)},{fields['sequence'] % 10000:04d},{age:06d},{confidence:.4f}"
    return f"({head},{','.join(texts)},{spread:.2f})\n"


def register_bytes(fields: dict[str, Any]) -> bytes:
    """A line's numbers as registers of Modbus; see docs/files.md."""
    contacts = fields["contacts"] or []
    places = [value for contact in contacts for value in contact]
    status, count = _status_number(fields), len(contacts)
    if count > _PLACES or any(value is None or abs(value) > FARTHEST for value in places):
        status, count, places = DOES_NOT_FIT, 0, []
    age = math.inf if fields["age_ms"] is None else fields["age_ms"]
    shares = fields["confidence"] or 0.0, _widest_deviation(fields)
    return pack_registers((VERSION, status, count, fields["sequence"]), age, shares, places)


def _status_number(fields: dict[str, Any]) -> int:
    return MAY_CLOSE if fields["may_close"] else FIXED_STATUS[fields["status"]]


def _widest_deviation(fields: dict[str, Any]) -> float:
    """px, of the least sure contact; infinite where nothing is known."""
    return max(map(_largest_deviation, fields["covariances"] or ()), default=math.inf)


def _largest_deviation(covariance: Any) -> float:
    """px, along the longer axis of a contact's covariance."""
    values = [value for row in covariance for value in row]
    if None in values:
        return math.inf
    xx, xy, _, yy = values
    return math.sqrt(max((xx + yy) / 2.0 + math.hypot((xx - yy) / 2.0, xy), 0.0))


@dataclass(eq=False)
class _Client:
    """A connection."""

    link: socket.socket
    number: int  # of the last moment that it was sent
    peer: WebSocketPeer | ModbusPeer | None  # None of TCP
    taken: float  # when it came or last took something, s of `time.perf_counter`
    rest: bytes = b""  # of its line, what it has not taken
    due: float = 0.0  # when it may be sent the next line
    watched: int = 0  # for what the selector looks at it
    lost: bool = False  # it has gone

    @property
    def greeted(self) -> bool:
        """Whether it may be sent lines."""
        return self.peer is None or (self.peer.greeted and not self.peer.over)

    @property
    def owes(self) -> bool:
        """Whether it is its turn: to take what waits for it, or to say that it is a WebSocket."""
        return bool(self.rest) or not self.greeted


def _hang_up(link: socket.socket) -> None:
    """End a connection; were there anything unread, its client would be told of a reset in place of the end."""
    with contextlib.suppress(OSError):
        link.shutdown(socket.SHUT_WR)
        for _ in range(MOST_CLIENTS):
            link.recv(_SEND_BUFFER)
    link.close()


class ResultPublisher:
    """Listens from the beginning, at `url` with the port that it has, and sends while it is open as a context."""

    def __init__(self, address: PublishAddress) -> None:
        self._form, self._gap = address.form, 1.0 / address.rate
        self._scheme, self._origin = address.scheme, address.origin
        host = f"[{address.host}]" if ":" in address.host else address.host
        try:
            family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
            self._listener = socket.create_server((address.host, address.port), family=family)
        except (OSError, OverflowError, UnicodeError) as error:
            why = getattr(error, "strerror", None) or str(error)
            where = f"{address.scheme}://{host}:{address.port}"
            raise InputError(
                f"--publish cannot listen at {where}: {why.split(' (')[0]}; give an address of this "
                "machine (127.0.0.1, or 0.0.0.0 for all) and a port that no other program has (0 takes a free one)",
                host=address.host,
                port=address.port,
            ) from None
        self._listener.setblocking(False)
        self.url = f"{address.scheme}://{host}:{self._listener.getsockname()[1]}"
        self._wakes, self._waker = socket.socketpair()
        for end in (self._wakes, self._waker):
            end.setblocking(False)
        self._clients: list[_Client] = []
        self._lock = threading.Lock()
        self._newest, self._told = _Moment(0, None), time.perf_counter()
        self._ends: float | None = None  # when who has not taken the last result is left
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._selector.register(self._wakes, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._serve_clients, name="grasptrack-publisher", daemon=True)

    def publish(self, frame: Frame, result: TrackResult, came: float) -> None:
        """Have a result sent; does not wait. `came` is when its image came out of the source, s of `time.perf_counter`."""
        with self._lock:
            self._newest = _Moment(self._newest.number + 1, came, frame, result)
            self._told = time.perf_counter()
        if self._clients:
            self._wake_thread()

    def __enter__(self) -> ResultPublisher:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Give clients a moment to take the last result, and free the port."""
        with self._lock:
            self._ends = time.perf_counter() + FAREWELL
        self._wake_thread()
        self._thread.join()
        self._selector.close()
        for link in (self._listener, self._wakes, self._waker):
            link.close()
        for client in self._clients:
            _hang_up(client.link)

    def _wake_thread(self) -> None:
        with contextlib.suppress(BlockingIOError):  # it is woken already
            self._waker.send(b"\0")

    # --- its thread ------------------------------------------------------------------------------

    def _serve_clients(self) -> None:
        wait = 0.0
        while True:
            for key, events in self._selector.select(wait):
                if key.fileobj is self._listener:
                    self._let_in()
                elif key.fileobj is self._wakes:
                    self._wakes.recv(_SEND_BUFFER)
                elif events & selectors.EVENT_READ:
                    self._hear_client(key.data)
            now = time.perf_counter()
            with self._lock:
                if now - self._told >= SILENCE and self._ends is None:
                    self._newest, self._told = _Moment(self._newest.number + 1, self._newest.came), now
                moment, ends, due = self._newest, self._ends, self._told + SILENCE
            for client in self._clients[:]:
                self._serve_one(client, moment, now, hurry=ends is not None)
            behind = [client for client in self._clients if client.owes or client.number < moment.number]
            if ends is not None and (not behind or now >= ends):
                return
            dues = (client.taken + STALLED if client.owes else client.due for client in behind)
            wait = max(min(due if ends is None else ends, *dues, math.inf) - time.perf_counter(), 0.0)

    def _let_in(self) -> None:
        try:
            link, _ = self._listener.accept()
        except OSError:
            time.sleep(_NO_ROOM_PAUSE)  # else it would be tried again at once, and in vain
            return
        if len(self._clients) >= MOST_CLIENTS:
            link.close()
            return
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        link.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        peer: WebSocketPeer | ModbusPeer | None = None
        if self._scheme != TCP:
            peer = WebSocketPeer(self._origin) if self._scheme == WEBSOCKET else ModbusPeer(self._read_registers)
        self._clients.append(_Client(link, self._newest.number, peer, time.perf_counter()))

    def _hear_client(self, client: _Client) -> None:
        """Take what the client of a WebSocket says."""
        try:
            came = client.link.recv(_SEND_BUFFER)
        except BlockingIOError:
            return
        except OSError:
            came = b""
        if came and client.peer is not None:
            client.rest += client.peer.take_bytes(came)
        client.lost = not came

    def _serve_one(self, client: _Client, moment: _Moment, now: float, hurry: bool) -> None:
        """Send what a client has not taken of its line, then the newest, as far as it takes them."""
        try:
            while not client.lost:
                if not client.rest and client.greeted:
                    if client.number < moment.number and (hurry or now >= client.due):
                        client.rest, client.number = self._line_of(moment), moment.number
                        client.taken, client.due = now, now + self._gap
                    elif hurry and client.peer is not None:
                        client.rest = client.peer.leave()
                if not client.rest:
                    break
                sent = client.link.send(client.rest)
                client.rest, client.taken = client.rest[sent:], now
        except BlockingIOError:
            pass
        except OSError:
            client.lost = True
        left = client.peer is not None and client.peer.over and not client.rest
        gone = client.lost or left or (client.owes and now - client.taken > STALLED)
        # Who has not taken what waits for it is not heard: what it is owed would grow.
        hears = selectors.EVENT_READ if client.peer is not None else 0
        self._watch_client(client, 0 if gone else selectors.EVENT_WRITE if client.rest else hears)
        if gone:
            self._clients.remove(client)
            _hang_up(client.link)

    def _watch_client(self, client: _Client, wanted: int) -> None:
        if client.watched and not wanted:
            self._selector.unregister(client.link)
        elif wanted and not client.watched:
            self._selector.register(client.link, wanted, client)
        elif wanted != client.watched:
            self._selector.modify(client.link, wanted, client)
        client.watched = wanted

    def _read_registers(self) -> bytes:
        return register_bytes(line_fields(self._newest, time.perf_counter()))

    def _line_of(self, moment: _Moment) -> bytes:
        if self._scheme == MODBUS:  # its clients ask
            return b""
        fields = line_fields(moment, time.perf_counter())
        line = (json_line(fields) if self._form == "json" else fixed_line(fields)).encode()
        return text_message(line.rstrip()) if self._scheme == WEBSOCKET else line
