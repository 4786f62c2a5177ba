# SPDX-License-Identifier: Apache-2.0
"""The whole loop, grey image to result, on a rendered scene: time, error, growth with pixels, memory in a long run, and how
long a start takes."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from grasptrack.demo import STRATEGIES
from grasptrack.tracking.tracker import GraspTracker
from grasptrack_bench.baselines import available_baselines
from grasptrack_bench.method import Maker, MethodStart
from grasptrack_bench.metrics.score import Score
from grasptrack_bench.simulation import DISTURBANCES, SHAPES, SceneFrame, bracket_scene
from research.studies import common

SIZES = ((640, 480), (1280, 960))
MEDIAN_MS, P99_MS = 1.5, 3.0
EARLY = 200
"""Updates after which all that is made once has been made; from then on memory is sampled as often."""
LOSSES = ("leave", "exchange")
"""Disturbances in which the object is lost again and again, so that it is also looked for."""
STARTS: tuple[tuple[str, list[str], float | None], ...] = (
    ("python -c pass", [sys.executable, "-c", "pass"], None),
    ("import grasptrack", [sys.executable, "-c", "import grasptrack"], 0.3),
    ("import grasptrack, GraspTracker", [sys.executable, "-c", "from grasptrack import GraspTracker"], None),
    ("grasptrack --help", [sys.executable, "-m", "grasptrack.cli.main", "--help"], 0.5),
)
"""What is started, and s that it may take."""


def strategy_maker(strategy: str) -> Maker:
    """A tracker that chooses its own grasp."""
    return lambda _: GraspTracker(strategy=strategy)


def score_figures(score: Score) -> list[object]:
    """Located %, median, 95 % and largest error in px, false accepts."""
    return [100.0 * score.located, *(score.error_percentile(p) for p in (50, 95, 100)), score.false_accepts]


def resident_mb() -> float:
    """Memory of this process in MB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024.0
    return float("nan")


def memory_growth(frames: Sequence[SceneFrame], strategy: str, long: int) -> list[object]:
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


def show_start(runs: int) -> None:
    """Seconds of fresh processes."""
    common.begin_section("Start")
    common.add_paragraph("Seconds of a fresh process, median and largest.")
    rows: list[list[object]] = []
    for name, command, target in STARTS:
        taken = []
        for _ in range(runs):
            start = time.perf_counter()
            subprocess.run(command, check=True, capture_output=True)
            taken.append(time.perf_counter() - start)
        median = float(np.median(taken))
        rows.append(
            [name, median, max(taken), target or "", "" if target is None else "yes" if median < target else "NO"]
        )
    common.add_table(["what", "median", "largest", "target", "met"], rows)


def show_loop(count: int, repeat: int) -> None:
    """Every strategy and every peer on the demonstration's scene, in two sizes."""
    common.begin_section("Whole loop on the demonstration's scene")
    common.add_paragraph(f"{count} grey frames, each strategy {repeat} times; contact errors in px.")
    medians: dict[str, list[float]] = {}
    for width, height in SIZES:
        frames = list(bracket_scene(count, width=width, height=height, colour=False))
        growth = width * height / (SIZES[0][0] * SIZES[0][1])
        first = GraspTracker(strategy=STRATEGIES[0]).update(frames[0].image)
        assert first.contacts is not None, first.reason
        start = MethodStart(first.contacts, frames[0].outline, (width, height))
        rows: list[list[object]] = []
        for strategy in STRATEGIES:
            runs = [common.score_alone(strategy_maker(strategy), start, frames) for _ in range(repeat)]
            median, p99 = np.percentile(
                np.concatenate([common.update_latencies(run) for run in runs]), [50, 99]
            ).tolist()
            met = "yes" if median <= MEDIAN_MS * growth and p99 <= P99_MS * growth else "NO"
            rows.append([strategy, median, p99, met, *score_figures(runs[0])])
            medians.setdefault(strategy, []).append(median)
        for name, make in available_baselines().items():
            score = common.score_alone(make, start, frames)
            rows.append(
                [name, *np.percentile(common.update_latencies(score), [50, 99]).tolist(), "", *score_figures(score)]
            )
        common.add_paragraph(f"{width}x{height}.")
        head = ["method", "median ms", "p99 ms", "met", "located %", "error median", "95 %", "max px", "wrong"]
        common.add_table(head, rows)
    common.add_paragraph("Growth of the median time for 4 times the pixels; at most 4.")
    common.add_table(["strategy", "ratio"], [[name, m[1] / m[0]] for name, m in medians.items()])


def show_memory(count: int, long: int) -> None:
    """Memory over many updates."""
    common.add_paragraph(f"Memory: MB after {EARLY} updates, after half and all of {long}, and the most that it rose.")
    frames = list(bracket_scene(count, colour=False))
    rows: list[list[object]] = [[name, "demonstration", *memory_growth(frames, name, long)] for name in STRATEGIES]
    for name in LOSSES:
        frames = list(DISTURBANCES[name].scene(SHAPES["bracket"](), count, seed=1))
        rows.append(["auto", name, *memory_growth(frames, "auto", long)])
    common.add_table(["strategy", "scene", "located %", f"after {EARLY}", "half", "all", "rose by"], rows)


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__, frames=120)
    parser.add_argument("--repeat", type=int, default=3, help="runs of each strategy; times of all are pooled")
    parser.add_argument("--long", type=int, default=2000, help="updates of the memory run; 0 leaves it out")
    parser.add_argument("--starts", type=int, default=11, help="fresh processes of each kind; 0 leaves them out")
    args = parser.parse_args()
    if args.starts:
        show_start(args.starts)
    show_loop(args.frames, args.repeat)
    if args.long:
        show_memory(args.frames, args.long)
    common.write_sections(args.output)


if __name__ == "__main__":
    main()
