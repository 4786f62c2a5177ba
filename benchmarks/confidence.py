# SPDX-License-Identifier: Apache-2.0
"""Whether confidence is the probability that it says: wrong answers of a run of scenes, counted and expected."""

from __future__ import annotations

import common

# isort: split
import math
from itertools import pairwise
from pathlib import Path

import numpy as np

from grasptrack.evaluation.run_folder import read_run
from grasptrack.evaluation.score import FrameScore

BINS = (0.0, 0.9, 0.99, 0.995, 0.999, 1.0)


def answered(folder: Path, method: str) -> list[tuple[str, FrameScore]]:
    """Frames that were answered, each with its sequence; those that define the truth left out."""
    return [
        (case, frame)
        for case, scores in read_run(folder).scores.items()
        for frame in scores.get(method, [])
        if frame.answered and not frame.defining and math.isfinite(frame.confidence)
    ]


def main() -> None:
    """Run and print."""
    parser = common.parser(__doc__)
    parser.add_argument("run", type=Path, help="folder of a run of `grasptrack evaluate scenes`")
    parser.add_argument("--method", default="auto")
    asked = parser.parse_args()
    frames = answered(asked.run, asked.method)
    told = np.array([frame.confidence for _, frame in frames])
    wrong = np.array([frame.is_false_accept for _, frame in frames])
    common.heading("Confidence")
    common.say(f"{len(frames)} answers of {asked.method} in {len({case for case, _ in frames})} sequences.")
    rows = []
    for low, high in pairwise(BINS):
        which = (told >= low) & ((told < high) | (high == 1.0))
        if which.any():
            n, counted = int(which.sum()), int(wrong[which].sum())
            most = (counted + 1.0 + math.sqrt(counted + 0.75)) / n
            rows.append((f"{low:g} to {high:g}", n, float((1.0 - told[which]).sum()), counted, most))
    common.say("The bound is that of one sigma on the rate of wrong answers.")
    common.table(("confidence", "answers", "wrong expected", "wrong counted", "bound"), rows)
    common.finish(asked.output)


if __name__ == "__main__":
    main()
