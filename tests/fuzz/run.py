# SPDX-License-Identifier: Apache-2.0
"""The fuzzer: odd arrays for every kernel and degenerate contours for the public API, for as long as one likes.

    python tests/fuzz/run.py --seconds 600 --seed 1

Whatever dies, hangs for 10 s, raises what no docstring names or answers wrongly is printed with its seed and number and kept in
`tests/fuzz/corpus`, which the tests play again. The same seed gives the same trials.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import _grasptrack_native as native

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[1] / "oracle"), str(Path(__file__).parents[2])]

from children import PATIENCE, run_trials
from contour_trials import draw_pair, judge_number
from corpus import FOLDER, write_case
from kernel_calls import NAMES, draw_call, judge_call

ROUND = 2000
"""Trials between two looks at the clock."""
COUNTED = ("crash", "hang", "internal", "bad stability", "bad contact")


def judge_kernel(seed: int) -> Callable[[int], str]:
    """The trial of that number, of calls of kernels."""
    return lambda index: judge_call(draw_call(seed, index), native)


def main() -> int:
    """Run rounds of calls and of contours in turn; status 1 where something was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--calls", type=int, default=0, help="so many kernel calls instead of a time")
    parser.add_argument("--contours", type=int, default=0, help="so many contours instead of a time")
    parser.add_argument("--patience", type=float, default=PATIENCE, help="seconds for one trial")
    parser.add_argument("--keep", type=Path, default=FOLDER, help="folder for what is found")
    options = parser.parse_args()
    counts: dict[str, Counter[str]] = {"kernel calls": Counter(), "contours": Counter()}
    trials = {"kernel calls": judge_kernel(options.seed), "contours": lambda index: judge_number(options.seed, index)}
    wanted = {"kernel calls": options.calls, "contours": options.contours}
    counted = any(wanted.values())
    end, done = time.monotonic() + options.seconds, dict.fromkeys(trials, 0)
    while any(done[kind] < wanted[kind] for kind in trials) if counted else time.monotonic() < end:
        for kind, trial in trials.items():
            last = min(done[kind] + ROUND, wanted[kind]) if counted else done[kind] + ROUND
            ran = run_trials(trial, done[kind], last, options.patience)
            counts[kind].update(ran.outcomes)
            for found in ran.findings:
                report(kind, options.seed, found.index, found.how, options.keep)
            done[kind] = last
    bad = 0
    for kind, outcomes in counts.items():
        told = ", ".join(f"{outcomes[name]} {name}" for name in COUNTED)
        rest = ", ".join(f"{n} {name}" for name, n in sorted(outcomes.items()) if name not in COUNTED)
        print(f"{kind}: {sum(outcomes.values())}: {told}; {rest}")
        bad += sum(outcomes[name] for name in COUNTED)
    return 1 if bad else 0


def report(kind: str, seed: int, index: int, how: str, folder: Path) -> None:
    """Say what was found, and keep it."""
    if kind == "contours":
        path = write_case(draw_pair(seed, index), f"contour-{seed}-{index}", folder)
    else:
        path = write_case(draw_call(seed, index), f"{NAMES[index % len(NAMES)]}-{seed}-{index}", folder)
    print(f"{kind}, seed {seed}, number {index}: {how} ({path.name if path else 'too large to be kept'})", flush=True)


if __name__ == "__main__":
    sys.exit(main())
