# SPDX-License-Identifier: Apache-2.0
"""How long a user waits before anything happens: `import grasptrack` and `grasptrack --help`."""

from __future__ import annotations

import common

# isort: split
import subprocess
import sys
import time
from pathlib import Path

import numpy as np


def medians(command: list[str], runs: int) -> tuple[float, float]:
    """Median and largest s of a command that succeeds."""
    taken = []
    for _ in range(runs):
        start = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        taken.append(time.perf_counter() - start)
    return float(np.median(taken)), max(taken)


def main() -> None:
    parser = common.parser(__doc__)
    parser.add_argument("--runs", type=int, default=11)
    args = parser.parse_args()
    runs = args.runs
    common.heading("Start")
    common.say("Seconds of a fresh process, median and largest.")
    script = Path(sys.executable).with_name("grasptrack")
    shown = [str(script)] if script.exists() else [sys.executable, "-m", "grasptrack.cli.main"]
    bare, slowest = medians([sys.executable, "-c", "pass"], runs)
    rows: list[list[object]] = [["python -c pass", bare, slowest, "", ""]]
    for name, command, target in (
        ("import grasptrack", [sys.executable, "-c", "import grasptrack"], 0.3),
        ("import grasptrack, GraspTracker", [sys.executable, "-c", "from grasptrack import GraspTracker"], None),
        ("grasptrack --help", [*shown, "--help"], 0.5),
    ):
        median, worst = medians(command, runs)
        rows.append([name, median, worst, target or "", "" if target is None else "yes" if median < target else "NO"])
    common.table(["what", "median", "largest", "target", "met"], rows)
    common.finish(args.output)


if __name__ == "__main__":
    main()
