# SPDX-License-Identifier: Apache-2.0
"""The live page: how old an image is when the browser has drawn it, and how much a page that is open slows the tracker.

Blocks with a page open and without follow one another in one run, so that whatever else the machine does meets both alike.
"""

from __future__ import annotations

import itertools
import math
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from grasptrack.errors import InputError
from grasptrack.io.base import Image, Source
from grasptrack.live.server import PageServer
from grasptrack.live.session import LiveSession
from grasptrack.live.settings import Settings
from grasptrack.live.state import Shown
from grasptrack.typing import Floats
from grasptrack_bench.simulation import bracket_scene
from research.studies import common

RATE = 30.0
"""Images/s of the camera that is played."""
LATENCY_MS, SLOWED = 60.0, 1.05
"""What is asked: the median age of a drawn image, and the tracker's time with a page open over that without."""
WARM_UP_S, PATIENCE_S = 1.0, 60.0
SEEN = 20
"""Images that a page has drawn before anything is measured."""
BROWSER = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--remote-debugging-port=0"),
    "--window-size=1400,900",
)
CLIENT = """
import json, struct, sys
from websockets.sync.client import connect
with connect(sys.argv[1].replace("http", "ws", 1).replace("/?", "/socket?"), max_size=None) as link:
    while True:
        data = link.recv()
        if isinstance(data, bytes):
            moment = json.loads(data[4 : 4 + struct.unpack(">I", data[:4])[0]])
            link.send(json.dumps({"do": "drawn", "number": moment["number"]}))
"""
"""Draws nothing: what is left is the server's own part."""


class Played(Source):
    """Images to and fro, without end; a camera that never drops one."""

    kind = "camera"

    def __init__(self, images: Sequence[Image]) -> None:
        super().__init__("camera:played")
        self.fps = RATE
        self._images = [*images, *images[-2:0:-1]]

    def _read_images(self) -> Generator[tuple[Image, float | None, str], None, None]:
        for k, image in enumerate(itertools.cycle(self._images)):
            yield image, k / RATE, f"frame {k}"


class Block(NamedTuple):
    """What was measured in one block.

    Attributes:
        update_ms: (n,) the tracker's updates.
        rate: images/s.
        ages_ms: (m,) of images, when a page said that they are drawn.
        waiting_ms: an image, mean: the tracker's thread could go on, and no processor was free; NaN where Linux does not tell.
    """

    update_ms: Floats
    rate: float
    ages_ms: Floats
    waiting_ms: float


@contextmanager
def viewer(kind: str, url: str) -> Iterator[None]:
    """A browser, or a client that draws nothing, as a process of its own."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        if kind == "browser":
            command = [str(shutil.which("chromium")), *BROWSER, f"--user-data-dir={folder}", url]
        else:
            command = [sys.executable, "-c", CLIENT, url]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            yield
        finally:
            process.terminate()
            process.wait(PATIENCE_S)


def measure_block(session: LiveSession, server: PageServer, seconds: float) -> Block:
    """What happens within so many s."""
    latencies: list[float] = []
    waiting: list[float] = []

    def note(shown: Shown) -> None:
        if shown.result is not None:
            latencies.append(shown.result.latency_ms)
            waiting.append(waiting_of_this_thread())

    server.hub.round_trips.clear()
    unlisten, began = session.add_listener(note), time.perf_counter()
    time.sleep(seconds)
    unlisten()
    took = time.perf_counter() - began
    waited = (waiting[-1] - waiting[0]) / max(len(waiting) - 1, 1) if waiting else math.nan
    return Block(np.array(latencies), len(latencies) / took, 1e3 * np.array(server.hub.round_trips), waited)


def waiting_of_this_thread() -> float:
    """ms for which it was ready to run, and others ran."""
    try:
        return int(Path(f"/proc/self/task/{threading.get_native_id()}/schedstat").read_text().split()[1]) / 1e6
    except OSError:
        return math.nan


def measure_pairs(
    kind: str, images: Sequence[Image], blocks: int, seconds: float, pace: bool
) -> list[tuple[Block, Block]]:
    """Blocks without a page and with one, in turns that alternate."""
    pairs = []
    with tempfile.TemporaryDirectory() as folder:
        session = LiveSession(Played(images), Settings(), Path(folder) / "run", at_once=True, pace=pace)
        server = PageServer(session)
        session.start()
        server.start()
        session.wait_for(lambda shown: shown.phase == "tracking", PATIENCE_S)
        for k in range(blocks):
            alone = None if k % 2 else measure_block(session, server, seconds)
            with viewer(kind, server.url):
                wait_until_drawn(server)
                watched = measure_block(session, server, seconds)
            wait_until_alone(server)
            pairs.append((alone or measure_block(session, server, seconds), watched))
        server.stop()
        session.stop()
    return pairs


def wait_until_drawn(server: PageServer) -> None:
    """Until a page has drawn some images, and what starts with it has started."""
    server.hub.round_trips.clear()
    until = time.monotonic() + PATIENCE_S
    while len(server.hub.round_trips) < SEEN:
        if time.monotonic() > until:
            raise InputError("no page has drawn an image")
        time.sleep(0.05)
    time.sleep(WARM_UP_S)


def wait_until_alone(server: PageServer) -> None:
    """Until nobody looks on."""
    until = time.monotonic() + PATIENCE_S
    while server.hub.clients and time.monotonic() < until:
        time.sleep(0.05)
    time.sleep(WARM_UP_S)


def show_viewer(kind: str, images: Sequence[Image], blocks: int, seconds: float) -> None:
    """Both questions, for one kind of viewer."""
    rows: list[list[object]] = []
    for pace in (True, False):
        pairs = measure_pairs(kind, images, blocks, seconds, pace)
        ages = np.concatenate([watched.ages_ms for _, watched in pairs])
        median, p95 = np.percentile(ages, [50, 95]).tolist()
        update = [float(np.median(np.concatenate([pair[i].update_ms for pair in pairs]))) for i in (0, 1)]
        ratios = [float(np.median(b.update_ms) / np.median(a.update_ms)) for a, b in pairs]
        slowed = float(np.median(ratios)) if pace else float(np.median([a.rate / b.rate for a, b in pairs]))
        drawn = float(np.mean([len(watched.ages_ms) / seconds for _, watched in pairs]))
        rate = float(np.median([alone.rate for alone, _ in pairs]))
        met = "yes" if slowed <= SLOWED and (not pace or median <= LATENCY_MS) else "NO"
        waited = [float(np.median([pair[i].waiting_ms for pair in pairs])) for i in (0, 1)]
        name = f"{RATE:g}/s" if pace else "as fast as it can"
        rows.append([name, rate, *update, *waited, slowed, drawn, median, p95, met])
    head = [
        "images", "images/s", "update ms, no page", "with page", "waits ms, no page", "with page", "slowed by",
        "drawn/s", "age ms, median", "95 %", "met",
    ]  # fmt: skip
    common.add_paragraph(
        f"Looking on: {kind}. Waits: of an image's time, what the tracker's thread waited for a processor that others used, "
        f"the {kind} among them; there are {os.cpu_count()}."
    )
    common.add_table(head, rows)


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--frames", type=int, default=60, help="images of the scene, played to and fro")
    parser.add_argument("--blocks", type=int, default=6, help="pairs of blocks, without a page and with one")
    parser.add_argument("--seconds", type=float, default=5.0, help="of a block")
    parser.add_argument("--viewers", default="browser,client", help="browser (chromium), client (draws nothing)")
    args: Any = parser.parse_args()
    common.begin_section("A page that looks on")
    images = [frame.image for frame in bracket_scene(args.frames, colour=True)]
    for kind in args.viewers.split(","):
        if kind == "browser" and shutil.which("chromium") is None:
            common.add_paragraph("Looking on: browser. There is no chromium here.")
        else:
            show_viewer(kind, images, args.blocks, args.seconds)
    common.write_sections(args.output)


if __name__ == "__main__":
    main()
