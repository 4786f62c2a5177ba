# SPDX-License-Identifier: Apache-2.0
"""A PLC that moves an arm by orders in its registers, which pymodbus serves; its program goes by the heartbeat."""

from __future__ import annotations

import asyncio
import struct
import threading
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from grasptrack.servo.camera import apply_twist, pose_of, quaternion_of

SCAN_S = 0.01
SILENCE_S = 0.15
"""Without a new heartbeat for so long the arm stands."""
WRITE, READ, UNIT, REGISTERS = 0, 100, 1, 200
HOLDING = 3
"""Function by which registers are named here."""
START = pose_of(np.diag([1.0, -1.0, -1.0]), (0.4, -0.2, 0.3))


class FakePlc:
    """Listens at a port of this machine, with `REGISTERS` from 0 on.

    Attributes:
        hand: (4, 4), where the hand is now.
        twist: what moves it now, (6,).
        orders: when the program read each new order, s of `time.perf_counter`, and its numbers.
        runs: the program runs; a server answers without it, too.
        stop, fingers, ready, touched, opening: what it tells.
    """

    def __init__(self) -> None:
        self.hand, self.twist = START.copy(), np.zeros(6)
        self.orders: list[tuple[float, tuple[Any, ...]]] = []
        self.runs, self.stop, self.fingers, self.ready, self.touched, self.opening = True, 0, 0, 1, 0, 0.0
        self.quaternion: NDArray[np.float64] | None = None
        self._loop, self._up = asyncio.new_event_loop(), threading.Event()
        self._thread = threading.Thread(target=lambda: self._loop.run_until_complete(self._serve()), daemon=True)
        self._thread.start()
        self._up.wait()
        self.url = f"modbus:127.0.0.1:{self._port}"

    def hang_up(self) -> None:
        """Lose all connections; others are taken."""

        def end() -> None:
            for link in [*self._server.active_connections.values()]:
                link.transport.abort()

        self._loop.call_soon_threadsafe(end)

    def close(self) -> None:
        """End."""
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()

    async def _serve(self) -> None:
        held = SimData(0, values=[0] * REGISTERS, datatype=DataType.REGISTERS)
        self._ended = asyncio.Event()
        self._server = server = ModbusTcpServer(SimDevice(UNIT, simdata=[held]), address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        self._port = server.transport.sockets[0].getsockname()[1]
        await self._scan(time.perf_counter(), 0.0)
        self._up.set()
        last = time.perf_counter()
        while not self._ended.is_set():
            await asyncio.sleep(SCAN_S)
            now = time.perf_counter()
            if self.runs:
                await self._scan(now, now - last)
            last = now
        await server.shutdown()

    async def _scan(self, now: float, passed: float) -> None:
        """The program: read the order, move, tell."""
        words = await self._server.async_getValues(UNIT, HOLDING, WRITE, 18)
        order = struct.unpack(">6H6f", struct.pack(">18H", *words))
        if not self.orders or order[1] != self.orders[-1][1][1]:
            self.orders.append((now, order))
        fresh = now - self.orders[-1][0] < SILENCE_S
        self.twist = np.array(order[6:]) if fresh and order[2] == 1 and not self.stop else np.zeros(6)
        self.hand = apply_twist(self.hand, self.twist, passed)
        turn = quaternion_of(self.hand[:3, :3]) if self.quaternion is None else self.quaternion
        told = struct.pack(
            ">7Hf3f4f", 1, order[1], self.ready, self.stop, self.fingers, order[4], self.touched, self.opening,
            *self.hand[:3, 3], *turn,
        )  # fmt: skip
        await self._server.async_setValues(UNIT, HOLDING + 13, READ, [*struct.unpack(">23H", told)])
