# SPDX-License-Identifier: Apache-2.0
"""What a recording costs the loop that writes it: encoded within the loop, and in a thread of its own as `--record` does.

Rounds without a recording, with one in the loop and with one in the background follow one another in one run, so that
whatever else the machine does meets all alike.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from grasptrack.io.base import Frame, Image
from grasptrack.io.recording import Recording, create_recording, open_recording
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import Floats
from grasptrack_bench.simulation import bracket_scene
from research.studies import common

RATE = 30.0
WAYS: dict[str, Callable[[Path], Recording] | None] = {
    "none": None,
    "in the loop": create_recording,
    "in the background": open_recording,
}
FIRST = 1
"""Images that are left out: the first look takes hundreds of ms."""


def time_round(images: Sequence[Image], path: Path, way: str, pace: bool) -> tuple[Floats, float]:
    """ms of each image in the loop, tracked and handed to the recording; and s in all, until the file is whole."""
    opener = WAYS[way]
    recording = None if opener is None else opener(path)
    tracker, spent, began = GraspTracker(), [], 0.0
    for k, image in enumerate(images):
        if k == FIRST:
            began = time.perf_counter()
        if pace and k > FIRST:
            time.sleep(max(began + (k - FIRST) / RATE - time.perf_counter(), 0.0))
        start = time.perf_counter()
        result = tracker.update(image, time=k / RATE)
        if recording is not None:
            recording.write(Frame(k, k / RATE, image, "played"), result)
        spent.append(1e3 * (time.perf_counter() - start))
    if recording is not None:
        recording.close()
    return np.array(spent[FIRST:]), time.perf_counter() - began


def measure(images: Sequence[Image], rounds: int, pace: bool) -> list[list[object]]:
    """A row for each way: ms in the loop, median and 95 %, by how much more than without, and images/s in all."""
    spent: dict[str, list[Floats]] = {way: [] for way in WAYS}
    rates: dict[str, list[float]] = {way: [] for way in WAYS}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        for k in range(rounds):
            ways = list(WAYS)
            for way in ways[k % len(ways) :] + ways[: k % len(ways)]:
                times, seconds = time_round(images, path, way, pace)
                spent[way].append(times)
                rates[way].append(len(times) / seconds)
    plain = [float(np.median(times)) for times in spent["none"]]
    rows: list[list[object]] = []
    for way in WAYS:
        median, p95 = np.percentile(np.concatenate(spent[way]), [50, 95]).tolist()
        ratio = float(np.median([np.median(t) / p for t, p in zip(spent[way], plain, strict=True)]))
        rows.append([f"{RATE:g}/s" if pace else "as fast as it can", way, median, p95, ratio, np.median(rates[way])])
    return rows


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--frames", type=int, default=90, help="of the scene, 640x480")
    parser.add_argument("--rounds", type=int, default=6, help="of each way")
    args: Any = parser.parse_args()
    common.begin_section("A recording that is written")
    common.add_paragraph(
        f"An MCAP file with PNG images; {os.cpu_count()} processors for the loop and the writer. Slowed: against no "
        "recording, medians of rounds. Images/s: until the file is whole."
    )
    for colour in (False, True):
        images = [frame.image for frame in bracket_scene(args.frames, colour=colour)]
        common.add_paragraph("Colour." if colour else "Grey.")
        head = ["images", "recording", "ms in the loop", "95 %", "slowed by", "images/s"]
        common.add_table(head, [row for pace in (True, False) for row in measure(images, args.rounds, pace)])
    common.write_sections(args.output)


if __name__ == "__main__":
    main()
