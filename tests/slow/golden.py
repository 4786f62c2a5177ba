# SPDX-License-Identifier: Apache-2.0
"""A small fixed suite and its stored scores.

`python tests/slow/golden.py` runs it and shows each score beside the stored one; with `--write` it stores what it finds, and
as noise the standard deviation over redrawn scenes. A score is stored anew only when a change makes it better, or when
the suite changes; a commit that stores worse ones says why.
"""

import argparse
import json
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from grasptrack_bench.metrics.integrity import compute_measures
from grasptrack_bench.metrics.score import FrameScore
from grasptrack_bench.scenes import SceneCase, built_in, make_scene_cases, run_case
from grasptrack_bench.schedule import create_scheduler

STORED = Path(__file__).with_name("golden.json")
SHAPES = ("bracket", "gasket", "spanner", "blob", "rectangle", "hook")
DISTURBANCES = ("clean-6dof", "noise", "light", "fast", "belt", "bar", "clip", "leave", "exchange", "twin")
METHODS = ("auto", "rrp", "grasp-line", "homography")
FRAMES = 24
REDRAWN = 5  # suites, with other seeds, for the noise

WRONG = "false_accepts"
"""Is to be none, whatever is found: its standard is not renewed, and no noise excuses it."""
BETTER = {"located_whole": 1, "located_partly": 1, "false_accepts": -1, "median_px": -1, "p95_px": -1}
"""Fields of `Measures` that are held, and the direction in which each gets better."""
LEAST_NOISE = {
    "located_whole": 0.002, "located_partly": 0.005, "false_accepts": 0.0, "median_px": 0.003, "p95_px": 0.02,
}  # fmt: skip
"""Below these, versions of OpenCV and processors differ."""

Scores = dict[str, dict[str, float]]


class Found(NamedTuple):
    """What the suite gives."""

    scores: Scores  # by method and measure
    wrong: set[tuple[str, str]]  # (method, name of a case) in which something wrong was given as right


def suite(seed: int) -> list[SceneCase]:
    """Each shape under half of the disturbances, and each disturbance with half of the shapes, as on a chessboard."""
    fields = {f"{s}.{d}" for i, s in enumerate(SHAPES) for j, d in enumerate(DISTURBANCES) if (i + j) % 2}
    every = make_scene_cases(built_in(SHAPES), DISTURBANCES, frames=FRAMES, seed=seed)
    return [case for case in every if case.name in fields]


def run(seed: int = 0) -> Found:
    """The suite, with scenes drawn from a seed."""
    cases = suite(seed)
    runs: dict[str, list[list[FrameScore]]] = {name: [] for name in METHODS}
    wrong: set[tuple[str, str]] = set()
    outcomes = sorted(create_scheduler()(run_case, [(case, METHODS) for case in cases]), key=lambda o: o.index)
    for outcome in outcomes:
        if outcome.error:
            raise RuntimeError(f"{cases[outcome.index].name}: {outcome.error}")
        for name, frames in outcome.value.items():
            runs[name].append(frames)
            if compute_measures([frames]).false_accepts:
                wrong.add((name, cases[outcome.index].name))
    scores = {
        name: {key: float(getattr(compute_measures(found), key)) for key in BETTER} for name, found in runs.items()
    }
    return Found(scores, wrong)


def worse(stored: dict[str, dict[str, dict[str, float]]], found: Scores) -> list[str]:
    """What got worse than the stored values by more than their noise, in words."""
    told = []
    for method, measures in stored.items():
        for key, direction in BETTER.items():
            value, noise, now = measures[key]["value"], measures[key]["noise"], found[method][key]
            if not direction * (now - value) >= -noise:
                told.append(f"{method}, {key}: {now:.4g}, stored {value:.4g} with a noise of {noise:.2g}")
    return told


def renewed() -> dict[str, dict[str, dict[str, float]]]:
    """Values of the fixed suite, and the noise of each."""
    fixed, redrawn = run().scores, [run(seed).scores for seed in range(1, REDRAWN + 1)]
    return {
        method: {
            key: {
                "value": round(value, 6),
                "noise": round(max(LEAST_NOISE[key], float(np.std([r[method][key] for r in redrawn], ddof=1))), 6),
            }
            for key, value in measures.items()
            if key != WRONG
        }
        | {WRONG: {"value": 0.0, "noise": 0.0}}
        for method, measures in fixed.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="store what is found")
    if parser.parse_args().write:
        STORED.write_text(json.dumps(renewed(), indent=1) + "\n")
        return
    stored, (found, wrong) = json.loads(STORED.read_text()), run()
    for method, measures in found.items():
        for key, value in measures.items():
            kept = stored.get(method, {}).get(key, {"value": math.nan, "noise": math.nan})
            print(f"{method:12s} {key:16s} {value:9.4g}   stored {kept['value']:9.4g} +- {kept['noise']:.2g}")
    print("\n".join(worse(stored, found)) or "nothing got worse")
    print(*sorted(wrong), sep="\n")


if __name__ == "__main__":
    main()
