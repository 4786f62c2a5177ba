# SPDX-License-Identifier: Apache-2.0
"""The paper's transfers beside other ways of the literature to match outlines, on the same contours of the same paths."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from time import perf_counter
from typing import NamedTuple

import numpy as np

from grasptrack.errors import ObservationError
from grasptrack.transfer import TransferStrategy
from grasptrack_bench.simulation import SHAPES
from research.paper.footage import FRAMES, MOTIONS, Footage, Motion, ideal_footage, make_part
from research.paper.literature import LITERATURE, REPLANNED, PlannedAgain
from research.paper.population import EXTRACTED
from research.paper.runs import OFF_PX, StrategyRun, run_of, summarize
from research.paper.transfers import COMPARED, Way, measure_answers, strategy_called, transferred_contacts, ways_of
from research.studies import common

HEAD = ("method", "way", "median px", "95 % from", "95 % to", "worst px", "refused %", "off %", "us a call")
Entry = tuple[str, Way, TransferStrategy]


class PathTask(NamedTuple):
    """One shape along the paths of one seed."""

    shape: str
    seed: int
    frames: int


def compared_methods() -> Iterator[Entry]:
    """Ours, the paper's to the letter, and those of the literature, each with how its grasp goes along a sequence."""
    for name in COMPARED:
        for way in ways_of(name):
            if way != "carried on":
                yield name, way, strategy_called(name)
    for name, method in LITERATURE.items():
        yield name, "first view", method
    yield REPLANNED, "carried on", PlannedAgain()


def compare_along(footage: Footage, seed: int) -> Iterator[StrategyRun]:
    """Errors of each method along one path, and the us that a call took it, as value."""
    for name, way, method in compared_methods():
        began = perf_counter()
        outlines, contacts = footage.outlines(name), footage.contacts(name)
        answers = transferred_contacts(method, outlines, contacts, way, footage.quantised)
        taken = 1e6 * (perf_counter() - began) / len(answers)
        setting = footage.part.name, seed, footage.motion, footage.kind, name, way, "us a call", taken
        yield run_of(measure_answers(footage, name, answers), "literature", *setting)


def follow_shape(task: PathTask) -> list[StrategyRun]:
    """All runs of one shape and seed; none where no grasp on it can be described by all of the paper's strategies."""
    try:
        part = make_part(task.shape, task.seed)
    except ObservationError:
        return []
    return [
        run
        for motion, kind in itertools.product(MOTIONS, EXTRACTED)
        for run in compare_along(ideal_footage(part, kind, motion, task.frames, task.seed), task.seed)
    ]


def rows_of_methods(runs: Sequence[StrategyRun]) -> Iterator[list[object]]:
    """Under `HEAD`, a row for each method and way."""
    for name, way, _ in compared_methods():
        here = [r for r in runs if (r.strategy, r.way) == (name, way)]
        middle, low, high, worst, _, answered, off = summarize(here)
        refused = 100.0 - answered if isinstance(answered, int | float) else None
        yield [name, way, middle, low, high, worst, refused, off, float(np.median([r.value for r in here]))]


def _add_tables(runs: Sequence[StrategyRun], motion: Motion) -> None:
    for kind in EXTRACTED:
        common.add_paragraph(f"{motion}, {kind} contours:")
        common.add_table(HEAD, rows_of_methods([r for r in runs if (r.motion, r.contours) == (motion, kind)]))


def main() -> None:
    """Run the study."""
    parser = common.create_parser(__doc__, frames=FRAMES, workers=1)
    parser.add_argument("--shapes", default=",".join(SHAPES), help="built-in outlines, A,B [all]")
    parser.add_argument("--seeds", default="0,1", help="of the paths, A,B")
    asked = parser.parse_args()
    seeds = [int(seed) for seed in asked.seeds.split(",")]
    tasks = [PathTask(*task, asked.frames) for task in itertools.product(asked.shapes.split(","), seeds)]
    runs = [run for found in common.run_all(follow_shape, tasks, asked.workers) for run in found]
    common.begin_section("Beside other methods of the literature")
    common.add_paragraph(
        f"{len({r.shape for r in runs})} shapes, {len(seeds)} seeds each; contours and strategies as in "
        "[the paper's tables](paper.md). Median over the runs of their mean error, with its 95 % interval; worst: of all "
        f"contacts answered; off: of the frames answered, those with a contact more than {OFF_PX:g} px from its place. Nothing "
        "judges the answers. RRP has a perfect tracker of 4 DoF; the methods below the paper's are given nothing but the two "
        "outlines, and run in NumPy, as does the paper's to the letter. The texts of [21] and [22] were not at hand: they are "
        "built after their titles and what the paper says of them. us a call: what an earlier row worked out of an outline is "
        "not worked out again. [22] plans a grasp and does not carry one: its error is how far the planned one lies from the "
        "first."
    )
    for motion in MOTIONS:
        _add_tables(runs, motion)
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()
