# SPDX-License-Identifier: Apache-2.0
"""The tracker's `paper` beside each strategy that it switches between, on images of the paper's three motion paths."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

import grasptrack as gt
from grasptrack.tracking.strategies import PAPER
from grasptrack.transfer import STRATEGIES
from grasptrack.typing import Floats
from grasptrack_bench.methods import method_makers
from grasptrack_bench.metrics.score import FrameScore, errors_of
from grasptrack_bench.scenes import ScenePart, built_in, parts_from_silhouettes, show_scene
from grasptrack_bench.simulation import Scene
from research.paper.footage import FRAMES, MOTIONS, Motion, camera_trajectory
from research.studies import common

METHODS = (PAPER, *STRATEGIES)
OF_ERRORS = "median", "95 %", "mean"
HEAD = (
    "strategy", "answered %", *(f"{x} px" for x in OF_ERRORS), *(f"{x} px of paper there" for x in OF_ERRORS),
    "wrong", "ms", "switches",
)  # fmt: skip
Scores = dict[str, list[FrameScore]]


class PathCase(NamedTuple):
    """A part along a path of the paper's, as in `research.paper.footage:rendered_footage`."""

    part: ScenePart
    motion: Motion
    seed: int
    frames: int

    def scene(self) -> Scene:
        """Its images."""
        return Scene(self.part.shape, camera_trajectory(self.motion, self.frames, self.seed), seed=self.seed)


def follow_path(case: PathCase) -> Scores:
    """Scored frames of each method, which runs by itself, the first left out; none where the first view has no grasp."""
    try:
        start, _ = show_scene(case.scene())
    except gt.GraspError:
        return {}
    frames, makers = list(case.scene()), method_makers(METHODS)
    return {name: common.score_alone(make, start, frames).frames[1:] for name, make in makers.items()}


def count_switches(frames: list[FrameScore]) -> int:
    """How often another strategy answers than before."""
    return sum(a != b for a, b in pairwise(f.strategy for f in frames if f.answered))


def frames_short(run: Scores) -> int:
    """Frames that the best strategy alone answers beyond those of `paper`."""
    return max(sum(f.answered for f in run[name]) for name in STRATEGIES) - sum(f.answered for f in run[PAPER])


def rows_of_path(runs: list[Scores]) -> Iterator[list[object]]:
    """Of each method: answered %, median, 95 % and mean px, those of `paper` in the same frames, wrong ones, ms, switches."""

    def spread(errors: Floats) -> list[object]:
        return [*map(float, np.percentile(errors, [50, 95])), float(errors.mean())] if len(errors) else [np.nan] * 3

    for name in METHODS:
        frames = [f for run in runs for f in run[name]]
        beside = [p for run in runs for p, f in zip(run[PAPER], run[name], strict=True) if f.answered]
        yield [
            name,
            100.0 * float(np.mean([f.answered for f in frames])),
            *spread(errors_of(frames)),
            *spread(errors_of(beside)),
            sum(f.is_false_accept for f in frames),
            float(np.median([f.latency_ms for f in frames if f.answered] or [np.nan])),
            float(np.mean([count_switches(run[name]) for run in runs])),
        ]


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__, frames=FRAMES, workers=1)
    parser.add_argument("--shapes", default="", help="built-in outlines, A,B; all where nothing else is given")
    parser.add_argument("--silhouettes", help="folder or pattern of silhouettes")
    parser.add_argument("--seeds", default="0", help="of the paths, A,B")
    asked = parser.parse_args()
    parts = parts_from_silhouettes(asked.silhouettes) if asked.silhouettes else []
    parts += built_in([name for name in asked.shapes.split(",") if name]) if asked.shapes or not parts else []
    seeds = [int(seed) for seed in asked.seeds.split(",")]
    cases = [PathCase(*case, asked.frames) for case in itertools.product(parts, MOTIONS, seeds)]
    common.begin_section("The strategies in turn")
    runs = list(zip(cases, common.run_all(follow_path, cases, asked.workers), strict=True))
    for motion in MOTIONS:
        here = [(case, run) for case, run in runs if case.motion == motion and run]
        common.add_paragraph(f"{motion}, {len(here)} sequences:")
        common.add_table(HEAD, rows_of_path([run for _, run in here]))
        fewer = [
            f"{case.part.shape.name} {case.seed} by {short}" for case, run in here if (short := frames_short(run)) > 0
        ]
        told = ": " + "; ".join(fewer) if fewer else ""
        common.add_paragraph(f"One strategy alone answers more frames in {len(fewer)} sequences{told}.")
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()
