# SPDX-License-Identifier: Apache-2.0
"""An arm behind a PLC that serves Modbus/TCP: orders are written to holding registers, its state is read there."""

from __future__ import annotations

import contextlib
import math
import socket
import struct
import time
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from grasptrack.errors import InputError
from grasptrack.io.arms import REMEMBERED, RETRY, SILENCE, Order, Report
from grasptrack.io.base import Source
from grasptrack.io.bridges.base import STAND, BridgedArm, parse_arm_url
from grasptrack.io.peers import HEAD
from grasptrack.servo.camera import POSE_ROUNDING, pose_of, rotation_of
from grasptrack.typing import Floats

VERSION = 1
"""Of the registers; raised when one changes its meaning or goes away."""
PORT = 502
READ, WRITE = 3, 16
"""Functions: read holding registers, write several."""
NO_AGE = 0xFFFF
CLOSE, OPEN = 1, 2
HELD, EMPTY, OPENING = 1, 2, 3
ORDER_REGISTERS = (
    ("H", "version, 1"),
    (
        "H",
        f"heartbeat, by one more in each order, modulo 65536: without a new one for {SILENCE:g} s the arm has to stand",
    ),
    ("H", "1 while a person lets it move, else 0 and a twist of 0"),
    ("H", "fingers: 0 nothing was asked, 1 close, 2 open"),
    ("H", "number of that command, by one more with each, modulo 65536: a new one is to be done"),
    ("H", "age of the newest image, ms; 65535: as much or more, or none"),
    ("3f", "twist: m/s along x, y, z of the hand's frame, floats"),
    ("3f", "twist: rad/s about x, y, z of the hand's frame, floats"),
)
"""What is written, and what it means."""
STATE_REGISTERS = (
    ("H", "version, 1"),
    ("H", "the heartbeat that the arm's program read last"),
    ("H", "1 while it can be moved, else 0"),
    ("H", "0, or a number of its own for why it has stopped by itself"),
    ("H", "fingers: 0 not known yet, 1 something is held, 2 nothing is, 3 stopped at the opening below"),
    ("H", "number of the command that this tells of"),
    ("H", "1 where the hand felt something on its way, else 0"),
    ("f", "opening, m, float"),
    ("3f", "position of the hand in the base, m, floats"),
    ("4f", "its orientation, a unit quaternion x, y, z, w, floats"),
)
"""What is read, and what it means."""
_ORDER = struct.Struct(">" + "".join(form for form, _ in ORDER_REGISTERS))
_STATE = struct.Struct(">" + "".join(form for form, _ in STATE_REGISTERS))
REFUSALS = {1: "it knows no such function", 2: "it has no such registers", 3: "it takes no such number of registers"}
_FORM = "modbus:HOST:PORT, as modbus:192.0.2.7:502"


def open_modbus(url: str, source: Source) -> BridgedArm:
    """The arm at modbus:HOST:PORT.

    Settings: `write`, the first register of orders [0]; `read`, the first one of the arm's state [100]; `unit` [1].

    Raises:
        InputError: the URL is none, or what answers there is no such arm.
    """
    address = parse_arm_url(url, _FORM, {"write": 0, "read": 100, "unit": 1}, PORT)
    told = address.settings
    places = all(0 <= told[name] <= 0x10000 - form.size // 2 for name, form in (("write", _ORDER), ("read", _STATE)))
    if not address.host or address.path or not places or not 0 <= told["unit"] <= 255:
        raise InputError(f'an arm over Modbus is {_FORM}, with registers from 0 to 65535, not "{url}"', url=url)
    return BridgedArm(url, ModbusBridge(address.host, address.port, **told))


def pack_order(order: Order, beat: int, fingers: int, number: int) -> bytes:
    """The registers of an order, high byte and high word first.

    Args:
        order: its twist counts only where it is enabled.
        beat: the heartbeat.
        fingers: 0, `CLOSE` or `OPEN`, what they were told last.
        number: of that command.
    """
    age = NO_AGE if order.image is None else min(math.ceil(1e3 * max(time.time() - order.image, 0.0)), NO_AGE)
    twist = order.twist if order.enabled else np.zeros(6)
    return _ORDER.pack(VERSION, beat & 0xFFFF, order.enabled, fingers, number & 0xFFFF, age, *twist.tolist())


@dataclass
class ModbusBridge:
    """A server of registers.

    Args:
        host, port: where it listens.
        write, read: first registers of `ORDER_REGISTERS` and `STATE_REGISTERS`.
        unit: of the server.
    """

    host: str
    port: int
    write: int
    read: int
    unit: int
    _link: socket.socket | None = field(default=None, init=False)

    def reach_arm(self) -> None:
        """Connect, and see that it has the registers."""
        self._link = link = socket.create_connection((self.host, self.port), RETRY)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        link.settimeout(SILENCE)
        self._transaction = self._beat = self._fingers = 0
        self._followed = -math.inf  # when the heartbeat that it follows was written
        self._beats: deque[tuple[int, float]] = deque(maxlen=REMEMBERED)
        self._stopped = self._touched = 0
        self._number = self._answered = int(self._read_state()[5])  # so that the next one is new to it
        self.exchange_order(STAND)

    def exchange_order(self, order: Order) -> tuple[Floats, Report]:
        """Write an order, then read the arm's state."""
        if order.close or order.open:
            self._fingers, self._number = CLOSE if order.close else OPEN, self._number + 1 & 0xFFFF
        self._beat = self._beat + 1 & 0xFFFF
        self._beats.append((self._beat, time.perf_counter()))
        data = pack_order(order, self._beat, self._fingers, self._number)
        self._ask(struct.pack(">BHHB", WRITE, self.write, len(data) // 2, len(data)) + data, 5)
        return self._understand(self._read_state())

    def release_arm(self) -> None:
        """Have it stand, and disconnect."""
        if self._link is not None:
            with self._link, contextlib.suppress(OSError):  # one that is lost stands by its heartbeat
                self.exchange_order(STAND)

    def _read_state(self) -> tuple[float, ...]:
        answer = self._ask(struct.pack(">BHH", READ, self.read, _STATE.size // 2), 2 + _STATE.size)
        return _STATE.unpack(answer[2:])

    def _understand(self, state: tuple[float, ...]) -> tuple[Floats, Report]:
        version, beat, ready, stop, fingers, number, touched, opening = (*map(int, state[:7]), state[7])
        if version != VERSION:
            raise OSError(f"register {self.read} holds {version}, not the version {VERSION}")
        place, turn = np.array(state[8:11]), np.array(state[11:])
        if not np.isfinite(place).all() or not abs(np.linalg.norm(turn) - 1.0) < POSE_ROUNDING:
            first = self.read + _STATE.size // 2 - 14
            raise OSError(f"from register {first} on there are no position and unit quaternion: {[*state[8:]]}")
        now = time.perf_counter()
        self._followed = next((at for told, at in self._beats if told == beat), self._followed)
        not_ready = "" if ready == 1 else "the arm says that it is not ready"
        if stop:
            not_ready = f"the arm has stopped by itself, for its reason {stop}"
        if now - self._followed > SILENCE:
            not_ready = f"its program does not repeat the heartbeat in register {self.read + 1}"
        report = Report(touched=touched == 1 != self._touched, not_ready=not_ready)
        if stop and stop != self._stopped:
            report = report._replace(stopped=f"for its reason {stop}")
        if self._fingers == CLOSE and fingers and number == self._number != self._answered:
            self._answered = number
            if fingers == OPENING:
                report = report._replace(opening=max(opening, 0.0))
            else:
                report = report._replace(held={HELD: True, EMPTY: False}.get(fingers))
        self._stopped, self._touched = stop, touched
        return pose_of(rotation_of(turn), place), report

    def _ask(self, request: bytes, size: int) -> bytes:
        """The answer to a request, both without head, of the size that it should have."""
        assert self._link is not None
        self._transaction = self._transaction + 1 & 0xFFFF
        self._link.sendall(HEAD.pack(self._transaction, 0, len(request) + 1, self.unit) + request)
        transaction, protocol, length, _ = HEAD.unpack(self._read_bytes(HEAD.size))
        if (transaction, protocol) != (self._transaction, 0) or length < 3:
            raise OSError("what answers there does not speak Modbus")
        answer = self._read_bytes(length - 1)
        first = struct.unpack(">H", request[1:3])[0]
        if answer[0] == request[0] | 0x80:
            last = first + struct.unpack(">H", request[3:5])[0] - 1
            why = REFUSALS.get(answer[1], f"it refuses, with exception {answer[1]}")
            what = "write" if request[0] == WRITE else "read"
            raise OSError(f"{why}: {what} holding registers {first} to {last}, by function {request[0]}")
        if answer[0] != request[0] or len(answer) != size:
            raise OSError(f"it answered with {len(answer)} bytes in place of {size} for registers from {first} on")
        return answer

    def _read_bytes(self, count: int) -> bytes:
        assert self._link is not None
        got = b""
        while len(got) < count:
            try:
                piece = self._link.recv(count - len(got))
            except TimeoutError:
                raise OSError(f"it did not answer within {SILENCE:g} s") from None
            if not piece:
                raise OSError("it ended the connection")
            got += piece
        return got
