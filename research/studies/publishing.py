# SPDX-License-Identifier: Apache-2.0
"""Results over TCP: how long one takes from the tracker to a client on this machine, and what clients cost the tracker.

Clients are processes of their own. Rounds without one, with some, and with one that never reads follow one another in one run,
so that whatever else the machine does meets all alike.
"""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from grasptrack.io.base import Frame, Image
from grasptrack.io.publishing import FORMATS, PublishAddress, ResultPublisher
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import Floats
from grasptrack_bench.simulation import bracket_scene
from research.studies import common

RATE = 30.0
FIRST = 1
"""Images that are left out: the first look takes hundreds of ms."""
CLIENTS = {"none": (0, 0), "one": (1, 0), "four": (4, 0), "one, and one that never reads": (1, 1)}
"""How many read, and how many do not."""
CLIENT = """
import socket, sys, time
with socket.create_connection(("127.0.0.1", int(sys.argv[1]))) as link:
    print("here", flush=True)
    for _ in link.makefile("rb"):
        print(time.perf_counter())
"""
"""Its clock is that of all processes, at least on Linux."""


def time_round(images: Sequence[Image], form: str, readers: int, stuck: int) -> tuple[Floats, Floats]:
    """ms of each update with the handing over; and ms from there until each reader has the line."""
    tracker, spent, handed = GraspTracker(), list[float](), list[float]()
    with contextlib.ExitStack() as held:
        publisher = ResultPublisher(PublishAddress("127.0.0.1", 0, form))
        port = publisher.url.rpartition(":")[2]
        for _ in range(stuck):
            held.enter_context(socket.create_connection(("127.0.0.1", int(port))))
        command = [sys.executable, "-c", CLIENT, port]
        processes = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(readers)]
        tracker.update(images[0], time=0.0)
        with publisher:
            for process in processes:
                assert process.stdout is not None
                process.stdout.readline()
            began = time.perf_counter()
            for k, image in enumerate(images[FIRST:], FIRST):
                time.sleep(max(began + k / RATE - time.perf_counter(), 0.0))
                start = time.perf_counter()
                result = tracker.update(image, time=k / RATE)
                handed.append(time.perf_counter())
                publisher.publish(Frame(k, k / RATE, image, "played"), result, start)
                spent.append(1e3 * (time.perf_counter() - start))
        outputs = [process.communicate()[0].split() for process in processes]
    got = [np.array(output, dtype=float)[-len(handed) :] for output in outputs]  # before may be lines of silence
    late = [1e3 * (times - np.array(handed)[-len(times) :]) for times in got if len(times)]
    return np.array(spent), np.concatenate([np.empty(0), *late])


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--frames", type=int, default=90, help="of the scene, 640x480")
    parser.add_argument("--rounds", type=int, default=4, help="of each kind")
    args: Any = parser.parse_args()
    images = [frame.image for frame in bracket_scene(args.frames)]
    rows = []
    for form in FORMATS:
        rounds: list[dict[str, tuple[Floats, Floats]]] = []
        for k in range(args.rounds):
            names = [*CLIENTS][k % len(CLIENTS) :] + [*CLIENTS][: k % len(CLIENTS)]  # each is first as often
            rounds.append({name: time_round(images, form, *CLIENTS[name]) for name in names})
        alone = np.median([np.median(each["none"][0]) for each in rounds])
        for name in CLIENTS:
            spent = np.median([np.median(each[name][0]) for each in rounds])
            late = np.concatenate([each[name][1] for each in rounds])
            median, most = np.percentile(late, [50, 99]) if len(late) else (np.nan, np.nan)
            lines = len(late)
            cells = [f"{median:.2f}", f"{most:.2f}"] if lines else ["", ""]
            rows.append([form, name, lines, *cells, f"{spent:.2f}", f"{spent / alone:.2f}"])
    common.begin_section("Results over TCP")
    common.add_paragraph(
        f"{RATE:g} images/s of 640x480, {os.cpu_count()} processors for tracker and clients. Late: from the end of the update "
        "until a client has the line. Slowed: the update with handing over, against no client."
    )
    head = ["lines", "clients", "read", "ms late, median", "99 %", "ms an update", "slowed by"]
    common.add_table(head, rows)
    common.write_sections(args.output)


if __name__ == "__main__":
    main()
