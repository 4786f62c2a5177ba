# SPDX-License-Identifier: Apache-2.0
"""An arm from the live page: how old an image is when its twist is at the arm, how evenly twists come, and how soon it stands.

The arm is the stand-in of examples/robots, which sees each line come, or one of tests/helpers for a bridge; what its hand would
see is rendered at 30 images/s. The page is a program of its own, which is killed, or stopped as if its network were cut.
"""

from __future__ import annotations

import contextlib
import os
import random
import runpy
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from grasptrack.io.arms import Arm, Order, TcpArm, open_arm
from grasptrack.io.base import Image
from grasptrack.io.live import LiveSource
from grasptrack.live import commands as told
from grasptrack.live.server import PageServer
from grasptrack.live.servo_desk import ServoDesk
from grasptrack.live.session import LiveSession
from grasptrack.live.settings import Settings
from grasptrack.servo.goal import Goal
from grasptrack.servo.setup import ServoSetup
from grasptrack.servo.steering import SLOW
from grasptrack.typing import Floats
from research.studies import common

RATE = 30.0
NOISE = 4
"""Levels: the same pixels again are those of a camera that hangs."""
ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
PATIENCE_S = 60.0
LONG_GAP_MS = 100.0
"""Between two lines, from which on it is counted."""
MOVES_S = (0.1, 0.5)
"""s for which the arm moves before its page is lost."""
KINDS = ("page killed", "page or network stopped", "arm does not answer", "bridge killed")
SAME_TWIST = 1e-5
"""Share by which the registers of an arm may round a twist."""
PAGE = """
import json, sys, time
from websockets.sync.client import connect
with connect(sys.argv[1].replace("http", "ws", 1).replace("/?", "/hold?")) as link:
    link.send(json.dumps({"do": "press"}))
    while True:
        asked = json.loads(link.recv())
        if asked.get("held"):
            link.send(json.dumps({"do": "keep", "number": asked["held"]}))
        else:
            time.sleep(0.1)
            link.send(json.dumps({"do": "press"}))
"""
"""Draws nothing, and holds the button for as long as it lives."""


class LineStandIn:
    """That of examples/robots; the others tell the same."""

    def __init__(self, hand: Floats) -> None:
        self.arm = runpy.run_path(str(EXAMPLES / "robots" / "arm.py"))["StandInArm"](0, hand)
        self.close = self.arm.close

    hand = property(lambda self: self.arm.hand, lambda self, hand: setattr(self.arm, "hand", hand))

    def open(self) -> Arm:
        """Over TCP."""
        return TcpArm(self.arm.url)

    def orders(self) -> list[tuple[float, Floats]]:
        """Its lines'."""
        return [(came, np.array(line["twist"])) for came, line in self.arm.lines]

    def moves(self) -> bool:
        """By its last line."""
        return bool(self.orders()[-1][1].any())


class UrStandIn:
    """A controller for ur_rtde, in a process of its own."""

    def __init__(self, hand: Floats) -> None:
        self._made = import_module("fake_ur").Processes()
        self._made.start()
        self._fake, self._orders = self._made.FakeUR(), list[tuple[float, Floats]]()
        self.hand = hand
        self._fake.change(inputs=1)  # that something is held

    hand = property(lambda self: self._fake.look()["hand"], lambda self, hand: self._fake.change(hand=hand))

    def open(self) -> Arm:
        """Through ur_rtde."""
        return open_arm(f"ur:{self._fake.look()['host']}?gripper=0&held=0", None)  # type: ignore[arg-type]

    def orders(self) -> list[tuple[float, Floats]]:
        """Its speeds and stops, along the base's axes."""
        self._orders += self._fake.orders_from(len(self._orders))
        return self._orders

    def moves(self) -> bool:
        """By its speed."""
        return bool(self._fake.look()["speed"].any())

    def close(self) -> None:
        """End its process."""
        self._fake.close()
        self._made.shutdown()


class PlcStandIn:
    """A PLC that is scanned."""

    def __init__(self, hand: Floats) -> None:
        self._fake = import_module("fake_plc").FakePlc()
        self.hand, self.close, self._fake.fingers = hand, self._fake.close, 1  # that something is held

    hand = property(lambda self: self._fake.hand, lambda self, hand: setattr(self._fake, "hand", hand))

    def open(self) -> Arm:
        """Over Modbus."""
        return open_arm(self._fake.url, None)  # type: ignore[arg-type]

    def orders(self) -> list[tuple[float, Floats]]:
        """What its program read."""
        return [(came, np.array(order[6:])) for came, order in self._fake.orders]

    def moves(self) -> bool:
        """By what its program has it do."""
        return bool(self._fake.twist.any())


class RosStandIn:
    """A stub of rclpy, in this process."""

    def __init__(self, hand: Floats) -> None:
        self._module, self._patch = import_module("fake_ros_arm"), import_module("pytest").MonkeyPatch()
        self._fake = self._module.FakeRosArm(self._patch)
        self.hand = hand

    hand = property(lambda self: self._fake.hand, lambda self, hand: setattr(self._fake, "hand", hand))

    def open(self) -> Arm:
        """A node."""
        bridge = import_module("grasptrack.io.bridges.ros2").RosBridge(
            self._module.TOPIC, "tool0", "base_link", "/gripper"
        )
        arm: Arm = self._module.ThreadedArm(bridge)
        return arm

    def orders(self) -> list[tuple[float, Floats]]:
        """Its messages'."""
        return [(came, self._module.twist_in(message)) for came, message in self._fake.orders]

    def moves(self) -> bool:
        """As MoveIt Servo would have it."""
        return bool(self._fake.twist.any())

    def close(self) -> None:
        """End."""
        self._fake.close()
        self._patch.undo()


STAND_INS: dict[str, Any] = {"tcp": LineStandIn, "ur": UrStandIn, "ros2": RosStandIn, "modbus": PlcStandIn}
LOSSES = {"tcp": KINDS[:3], "ur": (*KINDS[:2], KINDS[3]), "ros2": KINDS[:2], "modbus": (*KINDS[:2], KINDS[3])}
"""Of `KINDS`, those that can be had with each."""


class ExampleCamera:
    """A device: what the stand-in's hand would see, by the scene of examples/06_servo.py."""

    missed = 0

    def __init__(self, arm: Any, robot: Any) -> None:
        self._arm, self._robot, self._due = arm, robot, time.perf_counter()
        self._rng = np.random.default_rng(1)

    def read(self) -> tuple[Image, float | None]:
        """The next image; its arm's pose is that of the moment before it is rendered."""
        self._due = max(self._due + 1.0 / RATE, time.perf_counter())
        time.sleep(max(self._due - time.perf_counter(), 0.0))
        self._robot.hand = self._arm.hand
        image = self._robot.image()
        return image - self._rng.integers(0, NOISE, image.shape, np.uint8), None

    def close(self) -> None:
        """Nothing is held open."""


class ArmCell:
    """A session with an arm, and what the arm saw."""

    def __init__(self, folder: Path, kind: str) -> None:
        scene = runpy.run_path(str(EXAMPLES / "06_servo.py"))
        robot = scene["Robot"]()
        self._start = robot.hand
        self.arm: Any = STAND_INS[kind](self._start)
        self.sent: list[tuple[float, Order]] = []
        source = LiveSource("camera:hand", "camera", "the rendered camera", lambda: ExampleCamera(self.arm, robot))
        setup = ServoSetup("tcp:", Goal.fingertips(robot.fingertips(), scene["OPENING"]), {"limits": SLOW})
        self.driven = self.arm.open()
        send = self.driven.send_order

        def note_order(order: Order) -> None:
            self.sent.append((time.perf_counter(), order))
            send(order)

        self.driven.send_order = note_order
        self.desk = ServoDesk(setup, self.driven)
        self.session = LiveSession(source, Settings(), folder / "run", at_once=True, servo=self.desk)
        self.server = PageServer(self.session)
        self.session.start()
        self.server.start()
        self.session.wait_for(lambda shown: shown.phase == "tracking", PATIENCE_S)

    def begin_anew(self) -> None:
        """From the start."""
        if isinstance(self.arm, LineStandIn):
            self.arm.arm.answers = True
        self.arm.hand = self._start
        self.desk.begin_anew()
        self.wait(lambda: not self.desk._arm.why_not())
        time.sleep(0.2)  # images of the start, in which the part is elsewhere than the tracker looks for it
        self.session.send_command(told.Rechoose())
        self.session.wait_for(lambda shown: shown.phase == "choosing", PATIENCE_S)
        self.session.send_command(told.Start())
        self.session.wait_for(lambda shown: shown.phase == "tracking", PATIENCE_S)

    def close(self) -> None:
        """End."""
        self.server.stop()
        self.session.stop()
        self.arm.close()

    def wait(self, wanted: Any) -> bool:
        """Wait; False where it took too long."""
        until = time.monotonic() + PATIENCE_S
        while not wanted() and time.monotonic() < until:
            time.sleep(0.002)
        return bool(wanted())

    @property
    def moves(self) -> bool:
        """Whether the last order that came moves the arm."""
        orders = self.arm.orders()
        return bool(orders) and bool(orders[-1][1].any())


@contextlib.contextmanager
def page_on(cell: ArmCell) -> Iterator[subprocess.Popen[bytes]]:
    """A program that holds the button."""
    process = subprocess.Popen([sys.executable, "-c", PAGE, cell.server.url], stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait(PATIENCE_S)


def drive(cell: ArmCell, seconds: float) -> tuple[Floats, Floats, int]:
    """ms from each image to its first twist at the arm, ms between orders while it moves, approaches that closed."""
    closed, until = 0, time.monotonic() + seconds
    late, gaps, offset = list[float](), list[float](), time.time() - time.perf_counter()
    while time.monotonic() < until:
        cell.begin_anew()
        first, begun = len(cell.arm.orders()), len(cell.sent)
        with page_on(cell):
            while time.monotonic() < until and not (cell.session.shown.servo and cell.session.shown.servo.over):
                time.sleep(0.05)
        closed += cell.session.shown.servo is not None and cell.session.shown.servo.word == "Closed"
        came = cell.arm.orders()[first:]
        late += [1e3 * (at + offset - image) for at, image in arrivals(cell.sent[begun:], came)]
        moving = np.array([twist.any() for _, twist in came], dtype=bool)
        steps = 1e3 * np.diff([at for at, _ in came])
        gaps += steps[moving[:-1] & moving[1:]].tolist()
    return np.array(late), np.array(gaps), closed


def arrivals(sent: list[tuple[float, Order]], came: list[tuple[float, Floats]]) -> Iterator[tuple[float, float]]:
    """When the first order of each image that moves the hand came, and Unix time of that image; axes may have been turned."""
    stamp, k = None, 0
    for at, order in sent:
        if not order.enabled or not order.twist.any() or order.image in (None, stamp):
            continue
        wanted = np.linalg.norm(order.twist.reshape(2, 3), axis=1)
        while k < len(came) and came[k][0] < at:
            k += 1
        for there, twist in came[k : k + 3]:  # an order that a newer one overtook never comes
            if np.allclose(np.linalg.norm(twist.reshape(2, 3), axis=1), wanted, rtol=SAME_TWIST, atol=1e-9):
                stamp = order.image
                assert stamp is not None
                yield there, stamp
                break


def stop_times(cell: ArmCell, kind: str, trials: int) -> Floats:
    """ms from the loss until the first line without motion, after which none moves."""
    found = []
    for _ in range(trials):
        cell.begin_anew()
        with page_on(cell) as page:
            if not cell.wait(lambda: cell.moves):
                continue
            time.sleep(random.uniform(*MOVES_S))
            while not cell.moves:  # between two exploratory moves it stands
                time.sleep(0.001)
            began = time.perf_counter()
            if kind == KINDS[0]:
                page.kill()
            elif kind == KINDS[1]:
                os.kill(page.pid, signal.SIGSTOP)
            elif kind == KINDS[2]:
                assert isinstance(cell.arm, LineStandIn)
                cell.arm.arm.answers = False
            else:
                cell.driven._process.kill()
                while cell.arm.moves():  # no order tells when it stands
                    time.sleep(0.001)
                found.append(1e3 * (time.perf_counter() - began))
            time.sleep(0.6)
            orders = cell.arm.orders()
            moving = [k for k, (_, twist) in enumerate(orders) if twist.any()]
            if kind != KINDS[3]:
                found.append(1e3 * max(orders[moving[-1] + 1][0] - began, 0.0))
    return np.array(found)


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--seconds", type=float, default=180.0, help="of approaches, one after the other")
    parser.add_argument("--trials", type=int, default=50, help="of each way to lose the page or the arm")
    parser.add_argument(
        "--arm", choices=STAND_INS, default="tcp", help="what stands in for it; bridges need the tests' packages"
    )
    args: Any = parser.parse_args()
    sys.path.append(str(ROOT / "tests" / "helpers"))
    common.begin_section("An arm from the live page" + ("" if args.arm == "tcp" else f": a bridge, {args.arm}"))
    with tempfile.TemporaryDirectory() as folder:
        cell = ArmCell(Path(folder), args.arm)
        late, gaps, closed = drive(cell, args.seconds)
        stops = {kind: stop_times(cell, kind, args.trials) for kind in LOSSES[args.arm]}
        cell.close()
    common.add_paragraph(
        f"{RATE:g} images/s of 640x480, {os.cpu_count()} processors for images, tracker, servo, page and arm, with load "
        f"{os.getloadavg()[0]:.1f}; {args.seconds:g} s, in which {closed} approaches closed. Late: from when an image "
        f"came until its first twist is at the arm. {int((gaps > LONG_GAP_MS).sum())} of {len(gaps)} gaps were over "
        f"{LONG_GAP_MS:g} ms."
    )
    rows = [
        [name, len(ms), *(f"{v:.1f}" for v in spread(ms))] for name, ms in (("late", late), ("between orders", gaps))
    ]
    common.add_table(["ms", "number", "median", "95 %", "99 %", "worst"], rows)
    common.add_paragraph(
        "From a loss until the first order without motion, after which none moves, at the arm; of a bridge, until it stands:"
    )
    rows = [[kind, len(ms), *(f"{v:.0f}" for v in spread(ms))] for kind, ms in stops.items()]
    common.add_table(["lost", "trials", "ms, median", "95 %", "99 %", "worst"], rows)
    common.write_sections(args.output)


def spread(ms: Floats) -> list[float]:
    """Median, 95th and 99th percentile, and the worst."""
    return np.percentile(ms, [50, 95, 99, 100]).tolist() if len(ms) else [np.nan] * 4


if __name__ == "__main__":
    main()
