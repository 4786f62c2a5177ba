# SPDX-License-Identifier: Apache-2.0
"""Arms by URL: what takes twists of a hand and tells where the hand is. Over TCP both are JSON, an object a line."""

from __future__ import annotations

import contextlib
import json
import math
import select
import socket
import threading
import time
from collections import deque
from typing import Any, NamedTuple, Protocol
from urllib.parse import urlsplit

from grasptrack import arguments
from grasptrack.errors import InputError, bench_hint
from grasptrack.io.base import Source
from grasptrack.plugins import load_plugin, plugin_names
from grasptrack.servo.camera import check_pose
from grasptrack.servo.goal import Goal
from grasptrack.typing import Floats

VERSION = 1
"""Of the lines; raised when a field changes its meaning or goes away."""
SILENCE = 0.15
"""s without an acknowledgement after which an arm is lost: with a period of control it stands within 0.2 s."""
RETRY = 0.5
"""s between two attempts to reach an arm that is lost, and that one is given to answer."""
LONGEST_LINE = 1 << 14
"""Bytes of a line of an arm's."""
REMEMBERED = 256
"""Lines whose acknowledgement is waited for."""


class Order(NamedTuple):
    """What an arm is told in a period of control.

    Attributes:
        twist: (6,) m/s and rad/s in the hand's frame, to be kept until the next order.
        enabled: a person lets it move; else the twist is 0.
        close, open: the fingers shall do so now; true in one order each time.
        image: Unix time at which the newest image came, s; None before there was one.
    """

    twist: Floats
    enabled: bool = False
    close: bool = False
    open: bool = False
    image: float | None = None


class Report(NamedTuple):
    """What an arm tells beside its pose.

    Attributes:
        held: of closing: whether something is held; None where it is not known.
        opening: of closing: m between the fingers where they stopped; None where it is not known.
        touched: the hand felt something on its way.
        stopped: why the arm itself has stopped; empty where it has not.
        not_ready: why it cannot be moved for now; empty where it can.
        pose_age: s by which the pose was old when it was told.
    """

    held: bool | None = None
    opening: float | None = None
    touched: bool = False
    stopped: str = ""
    not_ready: str = ""
    pose_age: float = 0.0


class Arm(Protocol):
    """An arm; its methods return at once. It may know the servo's `goal` by itself."""

    goal: Goal | None

    def why_not(self) -> str:
        """Why it cannot be moved now; empty where it can."""

    def hand_pose(self) -> tuple[Floats | None, float]:
        """(4, 4) of the hand in the base, or None, and when that was, s of `time.perf_counter`."""

    def send_order(self, order: Order) -> None:
        """Have it do this until the next order; one that cannot be sent shows in `why_not`."""

    def take_reports(self) -> list[Report]:
        """What it told since the last call."""

    def close(self) -> None:
        """Let go of it."""


def open_arm(url: str, source: Source) -> Arm:
    """The arm at a URL: tcp://HOST:PORT, or that of an entry point "grasptrack.arms": modbus:, ros2:, sim:, ur: and others.

    Args:
        url: of the arm.
        source: whose images the hand's camera gives: the simulated hand is that of its source.

    Raises:
        InputError: no arm is known by this URL, or none answers there.
    """
    kind, _, _ = url.partition(":")
    if kind == "tcp":
        return TcpArm(url)
    found = load_plugin("grasptrack.arms", kind)
    if found is not None:
        arm: Arm = found(url, source)
        return arm
    if kind == "sim":
        raise InputError('"sim:" is the simulated hand of grasptrack-bench, ' + bench_hint("sim"), url=url)
    known = ", ".join(["tcp://HOST:PORT", *(f"{name}:" for name in sorted({"sim", *plugin_names("grasptrack.arms")}))])
    raise InputError(f'"{url}" is no arm; there are {known}', url=url)


class LineArm:
    """An arm behind a socket. It is sent a line for every order, and answers each; lost, it is tried again.

    Args:
        url: of the arm, for messages.

    Raises:
        InputError: nobody answers there.
    """

    goal: Goal | None = None

    def __init__(self, url: str) -> None:
        self._lock, self._closing = threading.Lock(), threading.Event()
        self._link: socket.socket | None = None
        self._sequence = 0
        self._reports: list[Report] = []
        try:
            self._connect()
        except OSError as error:
            raise InputError(f'no arm answers at "{url}": {error.strerror or error}', url=url) from None
        self._thread = threading.Thread(target=self._read_lines, name="grasptrack-arm", daemon=True)
        self._thread.start()

    def why_not(self) -> str:
        """Why it cannot be moved now."""
        with self._lock:
            if self._link is None:
                return f"the connection to the arm is lost: {self._why}"
            if self._heard == -math.inf:
                return "the arm has not answered yet"
            late = time.perf_counter() - self._heard
            return f"the arm has acknowledged nothing for {late:.2f} s" if late > SILENCE else self._not_ready

    def hand_pose(self) -> tuple[Floats | None, float]:
        """Of its newest line."""
        with self._lock:
            return self._pose, self._at

    def send_order(self, order: Order) -> None:
        """Send a line, whole or not at all."""
        now = time.perf_counter()
        with self._lock:
            link, self._sequence = self._link, self._sequence + 1
            self._sent.append((self._sequence, now))
        if link is None:
            return
        age = None if order.image is None else round(1e3 * max(time.time() - order.image, 0.0), 2)
        fields = {
            "version": VERSION,
            "sequence": self._sequence,
            "stamp_s": order.image,
            "age_ms": age,
            "enabled": order.enabled,
            "twist": [float(v) for v in order.twist],
            "close": order.close,
            "open": order.open,
        }
        data = json.dumps(fields, separators=(",", ":")).encode() + b"\n"
        try:
            if link.send(data) < len(data):
                raise BlockingIOError
        except BlockingIOError:
            self._drop_link(link, "it does not read its lines")
        except OSError as error:
            self._drop_link(link, error.strerror or str(error))

    def take_reports(self) -> list[Report]:
        """What it told since the last call."""
        with self._lock:
            told, self._reports = self._reports, []
            return told

    def close(self) -> None:
        """Disconnect."""
        self._closing.set()
        self._thread.join()
        if self._link is not None:
            self._drop_link(self._link, "it was let go of")

    def open_link(self) -> socket.socket:
        """A connection to the arm.

        Raises:
            OSError: there is none; it says why.
        """
        raise NotImplementedError

    # --- its thread ------------------------------------------------------------------------------

    def _connect(self) -> None:
        link = self.open_link()
        link.setblocking(False)
        with self._lock:  # an earlier connection's acknowledgements count for nothing
            self._link, self._heard, self._why, self._not_ready = link, -math.inf, "", ""
            self._pose: Floats | None = None
            self._at = -math.inf
            self._sent: deque[tuple[int, float]] = deque(maxlen=REMEMBERED)

    def _drop_link(self, link: socket.socket, why: str) -> None:
        with self._lock:
            if self._link is link:
                self._link, self._why = None, why
                link.close()

    def _read_lines(self) -> None:
        rest = b""
        while not self._closing.is_set():
            link = self._link
            if link is None:
                rest = b""
                self._closing.wait(RETRY)
                try:
                    self._connect()
                except (OSError, ValueError) as error:
                    self._why = getattr(error, "strerror", None) or str(error)
                continue
            try:
                if not select.select([link], [], [], SILENCE)[0]:
                    continue
                piece = link.recv(LONGEST_LINE)
                if not piece or len(rest) > LONGEST_LINE:
                    raise ConnectionResetError("it ended it" if not piece else "its line has no end")
                *lines, rest = (rest + piece).split(b"\n")
                for line in lines:
                    self._take_line(line)
            except InputError as error:
                self._drop_link(link, str(error))
            except (OSError, ValueError) as error:  # closed by who sends, too
                self._drop_link(link, getattr(error, "strerror", None) or str(error))

    def _take_line(self, line: bytes) -> None:
        pose, sequence, report = parse_arm_line(line)
        with self._lock:
            while self._sent and self._sent[0][0] < sequence:
                self._sent.popleft()
            if self._sent and self._sent[0][0] == sequence:
                self._heard = self._sent[0][1]
            self._pose, self._at, self._not_ready = pose, time.perf_counter() - report.pose_age, report.not_ready
            news = report._replace(not_ready="", pose_age=0.0)
            if news != Report():
                self._reports.append(news)


class TcpArm(LineArm):
    """An arm that listens at tcp://HOST:PORT.

    Raises:
        InputError: the URL is none, or nobody listens there.
    """

    def __init__(self, url: str) -> None:
        self._address = _parse_address(url)
        super().__init__(url)

    def open_link(self) -> socket.socket:
        """A connection to its port."""
        link = socket.create_connection(self._address, timeout=RETRY)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return link


def _parse_address(url: str) -> tuple[str, int]:
    with contextlib.suppress(ValueError):
        parts = urlsplit(url)
        if parts.hostname and parts.port and url.endswith(f":{parts.port}"):
            return parts.hostname, parts.port
    raise InputError(f'an arm over TCP is tcp://HOST:PORT, as tcp://192.0.2.7:5556, not "{url}"', url=url)


def parse_arm_line(line: bytes) -> tuple[Floats, int, Report]:
    """The pose (4, 4) in a line of an arm's, the number of the order that it acknowledges, and what else it tells.

    Raises:
        InputError: it is no such line.
    """
    try:
        told: Any = json.loads(line)
        sequence, report = told["sequence"], Report(*(told.get(n, d) for n, d in ARM_FIELDS.items()))
        pose = check_pose(told["pose"])
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, InputError) as error:
        raise InputError(f"it sent a line that is none: {type(error).__name__}, {error}") from None
    optional = arguments.optional
    truth, number, text = arguments.truth, arguments.finite, arguments.text
    checks = (optional(truth), optional(number), truth, text, text, number)
    if arguments.whole(sequence) or any(check(value) for check, value in zip(checks, report, strict=True)):
        raise InputError("it sent a line with a value of another type")
    return pose, sequence, report


ARM_FIELDS = {
    "held": None, "opening_m": None, "touched": False, "stopped": "", "not_ready": "", "pose_age_s": 0.0
}  # fmt: skip
"""Of a line of an arm's beside pose and sequence, in the order of `Report`, with what stands for one that is left out."""
