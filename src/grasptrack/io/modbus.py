# SPDX-License-Identifier: Apache-2.0
"""The server's half of Modbus/TCP for PLCs, which only tells: registers that are read, at functions 3 and 4; no one writes."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

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
