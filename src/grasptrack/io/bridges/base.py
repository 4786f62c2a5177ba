# SPDX-License-Identifier: Apache-2.0
"""What all bridges share: a process beside this one that has the arm stand when no order comes, whatever happened here.

It gets the lines that an arm at tcp://HOST:PORT gets, and answers as such an arm does. So a driver that blocks, keeps other
threads waiting or ends its process harms neither tracker nor page, and one that is lost is started again.
"""

from __future__ import annotations

import contextlib
import json
import math
import multiprocessing
import os
import select
import signal
import socket
import time
from collections.abc import Mapping
from multiprocessing.process import BaseProcess
from typing import Any, NamedTuple, Protocol
from urllib.parse import parse_qsl, urlsplit

import numpy as np

from grasptrack.errors import InputError, one_line
from grasptrack.io.arms import ARM_FIELDS, LONGEST_LINE, SILENCE, LineArm, Order, Report
from grasptrack.typing import Floats

BEAT = SILENCE / 3.0
"""s at most between two exchanges with the arm: one that is late by as much again is not lost yet."""
STARTING = 20.0
"""s that a bridge is given to start Python, load its driver and reach the arm."""
ENDING = 2.0
"""s that a bridge is given to have the arm stand and to end."""
STAND = Order(np.zeros(6))


class Bridge(Protocol):
    """One kind of arm, made where its URL is read and opened in another process: until then it can be pickled."""

    def reach_arm(self) -> None:
        """Reach the arm; raises what says why it cannot be reached."""

    def exchange_order(self, order: Order) -> tuple[Floats, Report]:
        """Have the arm do this for now; its pose (4, 4) and what else it tells. What it raises loses the arm."""

    def release_arm(self) -> None:
        """Have it stand and let go of it, opened or not."""


class ArmAddress(NamedTuple):
    """Parts of an arm's URL; `settings` are those of its query, of the types of their defaults."""

    host: str
    port: int
    path: str
    settings: dict[str, Any]


def parse_arm_url(url: str, form: str, known: Mapping[str, Any], port: int = 0) -> ArmAddress:
    """The parts of KIND:HOST:PORT/PATH?NAME=VALUE&..., with // before HOST or without.

    Args:
        url: as the user wrote it.
        form: how it should look, for the message.
        known: the settings with their defaults.
        port: where none is told.

    Raises:
        InputError: it does not look so.
    """
    try:
        parts = urlsplit(f"//{url.partition(':')[2].removeprefix('//')}")
        told = dict(parse_qsl(parts.query, strict_parsing=True) if parts.query else ())
        given = {name: type(known[name])(value) for name, value in told.items()}
        if not (parts.fragment or parts.username) and all(
            math.isfinite(v) for v in given.values() if type(v) is not str
        ):
            return ArmAddress(
                parts.hostname or "", port if parts.port is None else parts.port, parts.path, {**known, **given}
            )
    except (ValueError, KeyError, OverflowError):
        pass
    names = ", ".join(known)
    raise InputError(f'an arm of this kind is {form}, with {names} as settings (?NAME=VALUE&...), not "{url}"', url=url)


class BridgedArm(LineArm):
    """An arm through a bridge, which is a process of its own.

    Raises:
        InputError: the bridge cannot reach the arm.
    """

    def __init__(self, url: str, bridge: Bridge) -> None:
        self._bridge = bridge
        self._process: BaseProcess | None = None
        super().__init__(url)

    def open_link(self) -> socket.socket:
        """Start the process, and wait until it has reached the arm."""
        self._end_process()
        mine, other = socket.socketpair()
        with other:
            started = multiprocessing.get_context("spawn").Process(
                target=serve_bridge, args=(self._bridge, other), name="grasptrack-arm", daemon=True
            )
            started.start()
        self._process = started
        try:
            if why := self._read_greeting(mine):
                raise OSError(why)
        except BaseException:
            mine.close()
            self._end_process()
            raise
        return mine

    def _read_greeting(self, link: socket.socket) -> str:
        until, line = time.monotonic() + STARTING, b""
        while not line.endswith(b"\n"):
            if self._closing.is_set() or time.monotonic() > until:
                return f"its bridge has not reached it within {STARTING:g} s"
            if select.select([link], [], [], BEAT)[0]:
                piece = link.recv(1)  # what follows the greeting may have come already
                if not piece:
                    return "its driver has ended the bridge"
                line += piece
        return str(json.loads(line)["error"])

    def _take_line(self, line: bytes) -> None:
        if line.startswith(b'{"error"'):
            raise OSError(json.loads(line)["error"])
        super()._take_line(line)

    def close(self) -> None:
        """Have the arm stand, and end the process."""
        super().close()
        self._end_process()

    def _end_process(self) -> None:
        """Wait for it, which ends with its connection."""
        process, self._process = self._process, None
        if process is not None:
            process.join(ENDING)
            if process.is_alive():
                process.kill()
                process.join()


# --- in its process ------------------------------------------------------------------------------


def serve_bridge(bridge: Bridge, link: socket.socket) -> None:
    """A process's life: it ends with the connection, or by SIGTERM, and the arm stands then."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for whoever started it
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if os.environ.get("GRASPTRACK_DEBUG") in (None, "", "0"):  # drivers write to the terminal
        with open(os.devnull, "w") as nowhere:  # noqa: PTH123
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
    try:
        run_bridge(bridge, link)
    finally:
        os._exit(0)  # threads of a driver may wait for what is lost


def run_bridge(bridge: Bridge, link: socket.socket) -> None:
    """Open a bridge, and have it follow the orders that come until their connection ends; then the arm stands."""
    with link, contextlib.suppress(KeyboardInterrupt):
        try:
            bridge.reach_arm()
            _send(link, {"error": ""})
            _follow_orders(bridge, link)
        except Exception as error:  # whatever a driver raises
            with contextlib.suppress(OSError):
                why = getattr(error, "strerror", None) or str(error) or type(error).__name__
                _send(link, {"error": one_line(why)})
        finally:
            bridge.release_arm()


def _follow_orders(bridge: Bridge, link: socket.socket) -> None:
    rest, order, sequence, came = b"", STAND, 0, time.perf_counter()
    while True:
        if select.select([link], [], [], BEAT)[0]:
            piece = link.recv(LONGEST_LINE)
            if not piece:
                return
            *lines, rest = (rest + piece).split(b"\n")
            for told in map(json.loads, lines):  # fingers are told once, the last twist counts
                close, open_ = order.close or told["close"], order.open or told["open"]
                order = Order(np.array(told["twist"]), told["enabled"], close, open_, told["stamp_s"])
                sequence, came = told["sequence"], time.perf_counter()
        if time.perf_counter() - came > SILENCE:
            order = order._replace(twist=np.zeros(6), enabled=False)
        pose, report = bridge.exchange_order(order)
        order = order._replace(close=False, open=False)
        _send(link, {"sequence": sequence, "pose": pose.tolist(), **dict(zip(ARM_FIELDS, report, strict=True))})


def _send(link: socket.socket, fields: dict[str, Any]) -> None:
    link.sendall(json.dumps(fields, separators=(",", ":")).encode() + b"\n")
