# SPDX-License-Identifier: Apache-2.0
"""The server's half of protocols that only tell.

Of a WebSocket (RFC 6455) its handshake, text that goes out, pings and closings; of Modbus/TCP, for PLCs, registers that are
read, at functions 3 and 4, and that no one writes.
"""

from __future__ import annotations

import base64
import hashlib
import math
import struct
from collections.abc import Callable

LONGEST_HEAD = 8192
"""Bytes of a request that asks for a WebSocket."""
ANY = "*"
"""Stands for every origin."""
_GUID = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
_TEXT, _CLOSE, _PING, _PONG = 1, 8, 9, 10
_LAST, _MASKED, _SHORT = 0x80, 0x80, 125
_GOING_AWAY, _PROTOCOL_ERROR = (1001).to_bytes(2, "big"), (1002).to_bytes(2, "big")


def text_message(text: bytes) -> bytes:
    """A message of text."""
    return _frame(_TEXT, text)


class WebSocketPeer:
    """What one client has said.

    Args:
        origin: of web pages that may listen, as http://panel.local:3000, or `ANY`; programs, which have none, always may.

    Attributes:
        greeted: it is let in.
        over: it is to be left, once it has taken what is owed to it.
    """

    def __init__(self, origin: str = "") -> None:
        self.greeted = self.over = False
        self._origin, self._got = origin, b""

    def take_bytes(self, data: bytes) -> bytes:
        """What is owed for what came."""
        self._got, owed = self._got + data, b""
        if not self.greeted and not self.over:
            head, ends, rest = self._got.partition(b"\r\n\r\n")
            if ends or len(self._got) > LONGEST_HEAD:
                self._got, owed = rest, self._answer_greeting(head.decode("latin-1"))
        while self.greeted and not self.over and len(self._got) >= 2:
            size = self._got[1] & ~_MASKED
            if not self._got[1] & _MASKED or size > _SHORT:  # nothing long is asked of anybody here
                self.over, owed = True, owed + _frame(_CLOSE, _PROTOCOL_ERROR)
            elif len(self._got) < 6 + size:
                break
            else:
                kind, mask, body = self._got[0] & 0x0F, self._got[2:6], self._got[6 : 6 + size]
                owed += self._answer_frame(kind, bytes(b ^ mask[i % 4] for i, b in enumerate(body)))
                self._got = self._got[6 + size :]
        return owed

    def leave(self) -> bytes:
        """What a client is owed that is left."""
        self.over = True
        return _frame(_CLOSE, _GOING_AWAY)

    def _answer_greeting(self, head: str) -> bytes:
        first, *lines = head.split("\r\n")
        told = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
        key, origin = told.get("sec-websocket-key"), told.get("origin")
        asked = first.startswith("GET ") and told.get("upgrade", "").lower() == "websocket"
        self.greeted = allowed = bool(asked and key) and (origin is None or self._origin in (origin, ANY))
        self.over = not allowed
        if allowed:
            proof = base64.b64encode(hashlib.sha1(str(key).encode("latin-1") + _GUID).digest()).decode()
            return (
                "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                f"Sec-WebSocket-Accept: {proof}\r\n\r\n"
            ).encode()
        why, state = "a WebSocket is served here", "426 Upgrade Required\r\nUpgrade: websocket"
        if asked and key:
            why, state = f"pages of {origin} are not let in: --publish ws://...?origin={origin}", "403 Forbidden"
        body = f"{why}\n".encode("latin-1")
        return f"HTTP/1.1 {state}\r\nConnection: close\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body

    def _answer_frame(self, kind: int, body: bytes) -> bytes:
        if kind == _CLOSE:
            self.over = True
            return _frame(_CLOSE, body[:2])
        return _frame(_PONG, body) if kind == _PING else b""


def _frame(kind: int, body: bytes) -> bytes:
    size = len(body)
    if size <= _SHORT:
        return bytes([_LAST | kind, size]) + body
    if size < 1 << 16:
        return bytes([_LAST | kind, 126]) + size.to_bytes(2, "big") + body
    return bytes([_LAST | kind, 127]) + size.to_bytes(8, "big") + body


# --- Modbus/TCP -----------------------------------------------------------------------------------


READ_FUNCTIONS = (3, 4)
"""Of holding registers, and of input registers: here they are the same."""
MOST_READ = 125
"""Registers of one answer, by the standard."""
HEAD = struct.Struct(">HHHB")
"""Transaction, protocol (0), bytes that follow from the unit on, unit."""
_LONGEST = 254
_ILLEGAL_FUNCTION, _ILLEGAL_ADDRESS, _ILLEGAL_VALUE = 1, 2, 3
FARTHEST = 1e38
"""Beyond it a number is infinite: one of 32 bits ends at 3.4e38."""
_LAYOUT = struct.Struct(">HHHHIff6f")
_STEPS = 2**24
"""Of a share, all of which a float of 32 bits holds."""
REGISTERS = _LAYOUT.size // 2
"""That there are, from address 0 on."""


def pack_registers(
    heads: tuple[int, int, int, int], age_ms: float, shares: tuple[float, float], places: list[float]
) -> bytes:
    """All registers, high byte and high word first.

    Args:
        heads: version, status and count of contacts, and the line's number.
        age_ms: of the image; not finite where there was none, which stands as the largest number.
        shares: confidence, and px of the largest deviation of a contact.
        places: x and y of up to three contacts, px.
    """
    age = 0xFFFFFFFF if not math.isfinite(age_ms) else min(math.ceil(age_ms), 0xFFFFFFFF)
    filled = [*places, *[0.0] * (6 - len(places))]
    sure, spread = shares
    sure = math.floor(sure * _STEPS) / _STEPS  # never rounded up
    spread = math.inf if spread > FARTHEST else spread
    return _LAYOUT.pack(*(value & 0xFFFF for value in heads), age, sure, spread, *filled)


class ModbusPeer:
    """What one client has asked.

    Args:
        registers: all of them as they are now, so that what is read in one request belongs together and its age is true.

    Attributes:
        greeted: it is let in, as everybody is.
        over: it is to be left: what it sends is no Modbus.
    """

    greeted = True

    def __init__(self, registers: Callable[[], bytes]) -> None:
        self.over = False
        self._registers, self._got = registers, b""

    def take_bytes(self, data: bytes) -> bytes:
        """What is owed for what came."""
        self._got, owed = self._got + data, b""
        while not self.over and len(self._got) >= HEAD.size:
            transaction, protocol, size, unit = HEAD.unpack_from(self._got)
            if protocol != 0 or not 2 <= size <= _LONGEST:
                self.over = True
            elif len(self._got) < HEAD.size - 1 + size:
                break
            else:
                body = self._answer_request(self._got[HEAD.size : HEAD.size - 1 + size])
                owed += HEAD.pack(transaction, 0, len(body) + 1, unit) + body
                self._got = self._got[HEAD.size - 1 + size :]
        return owed

    def leave(self) -> bytes:
        """What a client is owed that is left: nothing, for nobody is told what he did not ask."""
        self.over = True
        return b""

    def _answer_request(self, request: bytes) -> bytes:
        function = request[0]
        if function not in READ_FUNCTIONS:
            return bytes([function | 0x80, _ILLEGAL_FUNCTION])
        if len(request) != 5:
            return bytes([function | 0x80, _ILLEGAL_VALUE])
        first, count = struct.unpack(">HH", request[1:])
        if not 1 <= count <= MOST_READ:
            return bytes([function | 0x80, _ILLEGAL_VALUE])
        if first + count > REGISTERS:
            return bytes([function | 0x80, _ILLEGAL_ADDRESS])
        return bytes([function, 2 * count]) + self._registers()[2 * first : 2 * (first + count)]
