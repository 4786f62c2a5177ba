# SPDX-License-Identifier: Apache-2.0
"""The whole loop, grey image to result, on a rendered scene: time, error, growth with pixels, memory in a long run."""

from __future__ import annotations

import common

# isort: split
import time
from pathlib import Path

import numpy as np

from grasptrack import GraspTracker
from grasptrack.bench.baselines import available_baselines
from grasptrack.bench.demo import STRATEGIES
from grasptrack.bench.method import Start
from grasptrack.bench.metrics.score import Score, Truth
from grasptrack.bench.simulation import SHAPES, SceneFrame, demo_scene
from grasptrack.bench.simulation.disturbances import DISTURBANCES

SIZES = ((640, 480), (1280, 960))
MEDIAN_MS, P99_MS = 1.5, 3.0
EARLY = 200
"""Updates after which all that is made once has been made; from then on memory is sampled as often."""
LOSSES = ("leave", "exchange")
"""Disturbances in which the object is lost again and again, so that it is also looked for."""


def run_strategy(frames: list[SceneFrame], strategy: str) -> tuple[Score, list[float]]:
    """The score of one strategy, and s of every update after the first, which also synthesises."""
    tracker, score, taken = GraspTracker(strategy=strategy), Score(strategy), []
    for frame in frames:
        start = time.perf_counter()
        result = tracker.update(frame.image, time=frame.time)
        taken.append(time.perf_counter() - start)
        score.add(result, Truth.of_scene(frame))
    return score, taken[1:]


def run_peers(frames: list[SceneFrame], contacts: np.ndarray) -> list[list[object]]:
    """Time and contact error of what a user would otherwise pick, on the same frames."""
    size = frames[0].image.shape[1], frames[0].image.shape[0]
    rows = []
    for name, make in available_baselines().items():
        peer, score, taken = make(Start(contacts, frames[0].outline, size)), Score(name), []
        for frame in frames:
            start = time.perf_counter()
            result = peer.update(frame.image, frame.time)
            taken.append(time.perf_counter() - start)
            score.add(result, Truth.of_scene(frame))
        errors = [score.error_percentile(p) for p in (50, 95, 100)]
        row = [name, *common.percentiles(taken[1:]), "", 100.0 * score.located, *errors, score.false_accepts]
        rows.append(row)
    return rows


def resident_mb() -> float:
    """Memory of this process in MB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024.0
    return float("nan")


def memory_growth(frames: list[SceneFrame], strategy: str, long: int) -> list[object]:
    """Located %, MB after 200 updates, after half and all of `long`, and by how much it ever rose above the first.

    The frames go to and fro.
    """
    tracker = GraspTracker(strategy=strategy)
    order = [*frames, *frames[-2:0:-1]]
    located, samples = 0, {}
    for i in range(long):
        located += tracker.update(order[i % len(order)].image, time=i / 30.0).located
        if i >= EARLY - 1 and ((i + 1) % EARLY == 0 or i + 1 == long):
            samples[i + 1] = resident_mb()
    if not samples:
        return [100.0 * located / max(long, 1), *[float("nan")] * 4]
    early, late = samples[min(samples)], samples[max(samples)]
    half = samples[min(samples, key=lambda n: abs(n - long / 2))]
    return [100.0 * located / long, early, half, late, max(samples.values()) - early]


def main() -> None:
    parser = common.parser(__doc__)
    parser.add_argument("--frames", type=int, default=120)
    parser.add_argument("--repeat", type=int, default=3, help="runs of each strategy; times of all are pooled")
    parser.add_argument("--long", type=int, default=2000, help="updates of the memory run; 0 leaves it out")
    args = parser.parse_args()
    common.heading("Whole loop on the demonstration's scene")
    common.say(f"{args.frames} grey frames, each strategy {args.repeat} times; contact errors in px.")
    head = ["method", "median ms", "p99 ms", "met", "located %", "error median", "95 %", "max px", "wrong"]
    medians: dict[str, list[float]] = {}
    for width, height in SIZES:
        frames = list(demo_scene(args.frames, width=width, height=height, colour=False))
        rows: list[list[object]] = []
        contacts = None
        for strategy in STRATEGIES:
            runs = [run_strategy(frames, strategy) for _ in range(args.repeat)]
            score, (median, p99) = runs[0][0], common.percentiles([s for _, taken in runs for s in taken])
            growth = (width * height) / (SIZES[0][0] * SIZES[0][1])
            met = "yes" if median <= MEDIAN_MS * growth and p99 <= P99_MS * growth else "NO"
            errors = [score.error_percentile(p) for p in (50, 95, 100)]
            rows.append([strategy, median, p99, met, 100.0 * score.located, *errors, score.false_accepts])
            medians.setdefault(strategy, []).append(median)
            if contacts is None:
                first = GraspTracker(strategy=strategy).update(frames[0].image)
                contacts = first.contacts
        if contacts is not None:
            rows += run_peers(frames, contacts)
        common.say(f"{width}x{height}.")
        common.table(head, rows)
    common.say("Growth of the median time for 4 times the pixels; at most 4.")
    common.table(["strategy", "ratio"], [[name, m[1] / m[0]] for name, m in medians.items()])
    if args.long:
        common.say(f"Memory: MB after {EARLY} updates, after half and all of {args.long}, and the most that it rose.")
        frames = list(demo_scene(args.frames, colour=False))
        rows = [[name, "demonstration", *memory_growth(frames, name, args.long)] for name in STRATEGIES]
        for name in LOSSES:
            frames = list(DISTURBANCES[name].scene(SHAPES["bracket"](), args.frames, seed=1))
            rows.append(["auto", name, *memory_growth(frames, "auto", args.long)])
        head = ["strategy", "scene", "located %", f"after {EARLY}", "half", "all", "rose by"]
        common.table(head, rows)
    common.finish(args.output)


if __name__ == "__main__":
    main()
