# SPDX-License-Identifier: Apache-2.0
"""An arm from the live page: how old an image is when its twist is at the arm, how evenly twists come, and how soon it stands.

The arm is the stand-in of examples/robots, which sees each line come; what its hand would see is rendered at 30 images/s. The
page is a program of its own, which is killed, or stopped as if its network were cut.
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
from pathlib import Path
from typing import Any

import numpy as np

from grasptrack.io.arms import TcpArm
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
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
PATIENCE_S = 60.0
LONG_GAP_MS = 100.0
"""Between two lines, from which on it is counted."""
MOVES_S = (0.1, 0.5)
"""s for which the arm moves before its page is lost."""
KINDS = ("page killed", "page or network stopped", "arm does not answer")
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

    def __init__(self, folder: Path) -> None:
        scene = runpy.run_path(str(EXAMPLES / "06_servo.py"))
        robot = scene["Robot"]()
        self._start = robot.hand
        self.arm = runpy.run_path(str(EXAMPLES / "robots" / "arm.py"))["StandInArm"](0, self._start)
        source = LiveSource("camera:hand", "camera", "the rendered camera", lambda: ExampleCamera(self.arm, robot))
        setup = ServoSetup("tcp:", Goal.fingertips(robot.fingertips(), scene["OPENING"]), {"limits": SLOW})
        self.desk = ServoDesk(setup, TcpArm(self.arm.url))
        self.session = LiveSession(source, Settings(), folder / "run", at_once=True, servo=self.desk)
        self.server = PageServer(self.session)
        self.session.start()
        self.server.start()
        self.session.wait_for(lambda shown: shown.phase == "tracking", PATIENCE_S)

    def begin_anew(self) -> None:
        """From the start."""
        self.arm.answers, self.arm.hand = True, self._start
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
        """Whether the last line that came moves the arm."""
        return bool(self.arm.lines) and any(self.arm.lines[-1][1]["twist"])


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
    """ms from each image to its first line at the arm, ms between lines while the button is held, approaches that closed."""
    closed, until = 0, time.monotonic() + seconds
    late, gaps, offset = list[float](), list[float](), time.time() - time.perf_counter()
    while time.monotonic() < until:
        cell.begin_anew()
        first = len(cell.arm.lines)
        with page_on(cell):
            while time.monotonic() < until and not (cell.session.shown.servo and cell.session.shown.servo.over):
                time.sleep(0.05)
        closed += cell.session.shown.servo is not None and cell.session.shown.servo.word == "Closed"
        lines, stamp = [line for line in cell.arm.lines[first:] if line[1]["enabled"]], None
        for came, line in lines:
            if line["stamp_s"] != stamp:
                stamp = line["stamp_s"]
                late.append(1e3 * (came + offset - stamp))
        gaps += (1e3 * np.diff([came for came, _ in lines])).tolist()
    return np.array(late), np.array(gaps), closed


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
            else:
                cell.arm.answers = False
            time.sleep(0.6)
            moving = [k for k, (_, line) in enumerate(cell.arm.lines) if any(line["twist"])]
            stood = cell.arm.lines[moving[-1] + 1][0]
            found.append(1e3 * max(stood - began, 0.0))
    return np.array(found)


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--seconds", type=float, default=180.0, help="of approaches, one after the other")
    parser.add_argument("--trials", type=int, default=50, help="of each way to lose the page or the arm")
    args: Any = parser.parse_args()
    common.begin_section("An arm from the live page")
    with tempfile.TemporaryDirectory() as folder:
        cell = ArmCell(Path(folder))
        late, gaps, closed = drive(cell, args.seconds)
        stops = {kind: stop_times(cell, kind, args.trials) for kind in KINDS}
        cell.close()
    common.add_paragraph(
        f"{RATE:g} images/s of 640x480, {os.cpu_count()} processors for images, tracker, servo, page and arm, with load "
        f"{os.getloadavg()[0]:.1f}; {args.seconds:g} s, in which {closed} approaches closed. Late: from when an image "
        f"came until its first twist is at the arm. {int((gaps > LONG_GAP_MS).sum())} of {len(gaps)} gaps were over "
        f"{LONG_GAP_MS:g} ms."
    )
    rows = [
        [name, len(ms), *(f"{v:.1f}" for v in spread(ms))] for name, ms in (("late", late), ("between lines", gaps))
    ]
    common.add_table(["ms", "number", "median", "99 %", "worst"], rows)
    common.add_paragraph("From a loss until the first line without motion, after which none moves, at the arm:")
    rows = [[kind, len(ms), *(f"{v:.0f}" for v in spread(ms))] for kind, ms in stops.items()]
    common.add_table(["lost", "trials", "ms, median", "99 %", "worst"], rows)
    common.write_sections(args.output)


def spread(ms: Floats) -> tuple[float, float, float]:
    """Median, 99th percentile and the worst."""
    if not len(ms):
        return np.nan, np.nan, np.nan
    return float(np.median(ms)), float(np.percentile(ms, 99)), float(ms.max())


if __name__ == "__main__":
    main()
