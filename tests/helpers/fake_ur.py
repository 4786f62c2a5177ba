# SPDX-License-Identifier: Apache-2.0
"""A controller of Universal Robots' as ur_rtde meets it, on an address of this machine: dashboard, script server and RTDE.

It is a process of its own, for ur_rtde waits for it without letting other threads of Python run. No URScript is run: a script
that is uploaded stands for the control script of ur_rtde, whose answers to the commands in its registers are repeated here. The
hand follows `speedL` with the acceleration that it names; nobody sees it.
"""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import os
import random
import socket
import struct
import threading
import time
from collections.abc import Callable
from multiprocessing.managers import BaseManager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.servo.camera import pose_of, quaternion_of, rotation_matrix

DASHBOARD, SCRIPTS, RTDE = 29999, 30003, 30004
STEP_S = 0.002
RUNNING, NORMAL, PROTECTIVE_STOP = 7, 1, 3
"""Modes of the robot and of its safety, as its documentation numbers them."""
SET_WATCHDOG, SPEED_L, SPEED_STOP, STOP_SCRIPT = 35, 10, 15, 255
"""Commands of the control script."""
READY, DONE = 1, 2
START = pose_of(np.diag([1.0, -1.0, -1.0]), (0.4, -0.2, 0.3))
_FORMATS = {"DOUBLE": "d", "VECTOR6D": "6d", "VECTOR3D": "3d", "INT32": "i", "UINT32": "I", "UINT64": "Q", "UINT8": "B"}
_OUTPUTS = {
    "actual_TCP_pose": "VECTOR6D", "timestamp": "DOUBLE", "robot_mode": "INT32", "safety_mode": "INT32",
    "actual_digital_input_bits": "UINT64", "robot_status_bits": "UINT32", "safety_status_bits": "UINT32",
    "runtime_state": "UINT32",
}  # fmt: skip
_DIALOG = {
    "polyscopeversion": "URSoftware 5.11.0.108249 (Jul 06 2021)",
    "is in remote control": "true",
    "get serial number": "20205500001",
    "get robot model": "UR5",
    "stop": "Stopped",
}


def own_address() -> str:
    """An address of this machine that no other program is likely to have; on Linux all of 127.0.0.0/8 are."""
    return f"127.{os.getpid() % 250 + 1}.{random.randrange(1, 250)}.{random.randrange(2, 250)}"


class FakeUR:
    """Listens at the three ports of a controller.

    Attributes:
        hand: (4, 4), where the hand is now.
        speed: (6,) m/s and rad/s, of the hand now, along the axes of the base.
        safety: mode of the safety; robot: mode of the robot.
        remote: whether it takes scripts over the network.
        outputs: bits of the digital outputs; inputs: of the inputs.
        stopped_by_watchdog: s of `time.perf_counter`; None where it was not.
    """

    def __init__(self, host: str = "", remote: bool = True) -> None:
        self.host, self.remote = host or own_address(), remote
        self.hand, self.speed = START.copy(), np.zeros(6)
        self._orders: list[tuple[float, NDArray[np.float64]]] = []
        self.safety, self.robot, self.inputs, self.outputs = NORMAL, RUNNING, 0, 0
        self.stopped_by_watchdog: float | None = None
        self.runs, self.scripts = False, 0
        self._ints, self._doubles = dict.fromkeys(range(48), 0), dict.fromkeys(range(48), 0.0)
        self._state, self._executing, self._patience, self._fed = 0, False, np.inf, 0.0
        self._target, self._acceleration = np.zeros(6), 1.0
        self._over, self._lock = False, threading.Lock()
        self._links: list[socket.socket] = []
        serving = {DASHBOARD: self._serve_dashboard, SCRIPTS: self._serve_scripts, RTDE: self._serve_rtde}
        self._listeners = [socket.create_server((self.host, port)) for port in serving]
        runs: list[tuple[Callable[..., None], tuple[Any, ...]]] = [(self._run, ())]
        runs += [(self._accept, each) for each in zip(self._listeners, serving.values(), strict=True)]
        self._threads = [threading.Thread(target=target, args=args, daemon=True) for target, args in runs]
        for thread in self._threads:
            thread.start()

    def look(self) -> dict[str, Any]:
        """All attributes."""
        with self._lock:
            return {name: value for name, value in vars(self).items() if name[0] != "_"}

    def orders_from(self, first: int) -> list[tuple[float, NDArray[np.float64]]]:
        """When each command that moves came, from some on, s of `time.perf_counter`, and its twist along the base's axes."""
        with self._lock:
            return self._orders[first:]

    def change(self, **values: Any) -> None:
        """Set attributes."""
        with self._lock:
            vars(self).update(values)

    def hang_up(self) -> None:
        """Lose all connections; others are taken."""
        links, self._links = self._links, []
        for link in links:
            with contextlib.suppress(OSError):
                link.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """End."""
        self._over = True
        for listener in self._listeners:
            with contextlib.suppress(OSError):
                listener.shutdown(socket.SHUT_RDWR)
            listener.close()
        self.hang_up()
        for thread in self._threads:
            thread.join()

    # --- servers ------------------------------------------------------------------------------------

    def _accept(self, listener: socket.socket, serve: Callable[[socket.socket], None]) -> None:
        while not self._over:
            with contextlib.suppress(OSError):
                link, _ = listener.accept()
                link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._links.append(link)
                threading.Thread(target=self._serve, args=(serve, link), daemon=True).start()

    @staticmethod
    def _serve(serve: Callable[[socket.socket], None], link: socket.socket) -> None:
        with link, contextlib.suppress(OSError, EOFError):
            serve(link)

    def _serve_dashboard(self, link: socket.socket) -> None:
        link.sendall(b"Connected: Universal Robots Dashboard Server\n")
        for line in link.makefile("r"):
            asked = line.strip().lower()
            said = str(self.remote).lower() if asked == "is in remote control" else _DIALOG.get(asked, "none")
            if asked == "stop":
                self._stop_program()
            link.sendall(f"{said}\n".encode())

    def _serve_scripts(self, link: socket.socket) -> None:
        for line in link.makefile("r"):
            if line.rstrip() == "end" and self.remote and self.robot == RUNNING and self.safety == NORMAL:
                with self._lock:
                    self.runs, self._executing, self._patience, self.scripts = True, False, np.inf, self.scripts + 1
                    self._state = READY

    def _serve_rtde(self, link: socket.socket) -> None:
        stream, recipes, names = link.makefile("rb"), list[tuple[str, list[str]]](), list[str]()
        period, begun = STEP_S, threading.Event()

        def send(kind: str, body: bytes) -> None:
            link.sendall(struct.pack(">HB", 3 + len(body), ord(kind)) + body)

        def tell() -> None:
            with contextlib.suppress(OSError):
                while not self._over:
                    send("U", b"\x01" + b"".join(self._pack_output(name) for name in names))
                    time.sleep(period)

        while head := stream.read(3):
            size, kind = struct.unpack(">HB", head)
            body = stream.read(size - 3)
            if chr(kind) == "V":
                send("V", b"\x01")
            elif chr(kind) == "v":
                send("v", struct.pack(">4I", 5, 11, 0, 0))
            elif chr(kind) == "O":
                period = 1.0 / struct.unpack(">d", body[:8])[0]
                names = [name for name in body[8:].decode().split(",") if name]
                send("O", b"\x01" + ",".join(map(_type_of, names)).encode())
            elif chr(kind) == "I":
                recipe = [name for name in body.decode().split(",") if name]
                recipes.append((">" + "".join(_FORMATS[_type_of(name)] for name in recipe), recipe))
                send("I", bytes([len(recipes)]) + ",".join(map(_type_of, recipe)).encode())
            elif chr(kind) == "S":
                send("S", b"\x01")
                if not begun.is_set():
                    begun.set()
                    threading.Thread(target=tell, daemon=True).start()
            elif chr(kind) == "U":
                form, recipe = recipes[body[0] - 1]
                self._take_inputs(dict(zip(recipe, struct.unpack_from(form, body, 1), strict=True)))

    def _take_inputs(self, values: dict[str, Any]) -> None:
        with self._lock:
            for name, value in values.items():
                kind, _, number = name.removeprefix("input_").partition("_register_")
                if kind == "double":
                    self._doubles[int(number)] = value
                elif kind == "int":
                    self._ints[int(number)] = value
                    self._fed = time.perf_counter() if number == "0" else self._fed
            if (command := values.get("input_int_register_0")) in (SPEED_L, SPEED_STOP):
                twist = [self._doubles[k] if command == SPEED_L else 0.0 for k in range(6)]
                self._orders.append((time.perf_counter(), np.array(twist)))
            if "standard_digital_output_mask" in values:
                mask = values["standard_digital_output_mask"]
                self.outputs = (self.outputs & ~mask) | (values["standard_digital_output"] & mask)

    def _pack_output(self, name: str) -> bytes:
        value: Any = {
            "timestamp": time.monotonic(),
            "robot_mode": self.robot,
            "safety_mode": self.safety,
            "actual_digital_input_bits": self.inputs,
            "robot_status_bits": 1 | (2 if self.runs else 0),
            "safety_status_bits": 1 if self.safety == NORMAL else 4,
            "runtime_state": 2 if self.runs else 1,
            "output_int_register_0": self._state,
        }.get(name, 0)
        if name == "actual_TCP_pose":
            hand = self.hand
            x, y, z, w = quaternion_of(hand[:3, :3]).tolist()  # a hand that points down has made half a turn
            sine = math.hypot(x, y, z)
            turn = 2.0 * math.atan2(sine, w) / max(sine, 1e-12) * np.array([x, y, z])
            return struct.pack(">6d", *hand[:3, 3], *turn)
        form = _FORMATS[_type_of(name)]
        return struct.pack(f">{form}", *([value] * (int(form[:-1]) if len(form) > 1 else 1)))

    # --- what stands for the control script ---------------------------------------------------------

    def _run(self) -> None:
        last = time.perf_counter()
        while not self._over:
            time.sleep(STEP_S)
            now = time.perf_counter()
            with self._lock:
                self._run_script(now)
                self._move(now - last)
            last = now

    def _run_script(self, now: float) -> None:
        if not self.runs:
            return
        if self._paused:  # as if somebody let the program go on afterwards
            self._fed = now
        elif now - self._fed > self._patience:
            self.stopped_by_watchdog = now
            self._stop_program()
        elif (command := self._ints[0]) == SPEED_L:
            registers = np.array([self._doubles[k] for k in range(8)])
            self._target, self._acceleration = registers[:6], registers[6]
            self._state = READY
        elif command == 0:
            self._executing, self._state = False, READY
        elif not self._executing:
            self._executing, self._state = True, DONE
            if command == SET_WATCHDOG:
                self._patience = 1.0 / self._doubles[0]
            elif command == SPEED_STOP:
                self._target, self._acceleration = np.zeros(6), self._doubles[0]
            elif command == STOP_SCRIPT:
                self._stop_program()

    @property
    def _paused(self) -> bool:
        return self.safety != NORMAL or self.robot != RUNNING

    def _stop_program(self) -> None:
        self.runs, self._state = False, 0
        self._target, self._acceleration = np.zeros(6), 10.0

    def _move(self, passed: float) -> None:
        gap = (np.zeros(6) if self._paused else self._target) - self.speed
        most = self._acceleration * passed
        self.speed = self.speed + gap * min(
            most / max(float(np.abs(gap[:3]).max()), float(np.abs(gap[3:]).max()), 1e-12), 1.0
        )
        turn = rotation_matrix(self.speed[3:] * passed)
        self.hand = pose_of(turn @ self.hand[:3, :3], self.hand[:3, 3] + self.speed[:3] * passed)


def _type_of(name: str) -> str:
    if "double_register" in name:
        return "DOUBLE"
    if "int_register" in name:
        return "INT32"
    return _OUTPUTS.get(name) or ("UINT8" if "digital_output" in name or "analog_output_" in name else "DOUBLE")


class Processes(BaseManager):
    """Makes a `FakeUR` in a process of its own: `with Processes() as made: made.FakeUR()`."""

    def __init__(self) -> None:
        super().__init__(ctx=multiprocessing.get_context("spawn"))


Processes.register("FakeUR", FakeUR)
