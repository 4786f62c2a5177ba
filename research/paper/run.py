# SPDX-License-Identifier: Apache-2.0
"""Section V rerun: all tables on three objects, and what holds of them on every built-in shape with several seeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from grasptrack.errors import GraspTrackError, InputError
from grasptrack.typing import Progress
from grasptrack_bench.report.table import Table
from grasptrack_bench.schedule import Scheduler, TaskOutcome
from grasptrack_bench.simulation import SHAPES
from research.paper import contexts
from research.paper.ablation import ablation_tables, sensitivity_table
from research.paper.claims import table_of_claims, table_of_time_claims, table_of_verdicts
from research.paper.contexts import table_of_contexts
from research.paper.curves import table_curves
from research.paper.drawing import Picture
from research.paper.evidence import Evidence
from research.paper.figures import paper_figures, table_pictures
from research.paper.footage import FRAMES, OBJECTS
from research.paper.objects import Ticker, run_objects, tables_of_objects
from research.paper.population import Task, population_runs, population_tables, start_runs
from research.paper.runs import StrategyRun
from research.paper.searching import table_of_searches
from research.paper.times import table_of_times
from research.paper.transfers import Course, Return

LEAST_FRAMES = 4
SEEDS = 10
"""Of every shape."""


@dataclass(frozen=True, slots=True)
class Extent:
    """How much is run.

    Attributes:
        frames: of each path, at least `LEAST_FRAMES`; the reference error is that of the frame in the middle.
        seed: of the three objects' trajectories, textures, noise and starts of contours.
        shapes: on which the transfers are tried with several seeds.
        seeds: how many, from 0 on.
    """

    frames: int = FRAMES
    seed: int = 0
    shapes: tuple[str, ...] = tuple(SHAPES)
    seeds: int = SEEDS


QUICK = Extent(12, 0, (*OBJECTS, "hook"), 2)
"""To see that everything works: short paths, few shapes."""


@dataclass(frozen=True)
class PaperRun:
    """What a run gives. All but `times` and `time_claims` repeats to the last digit; on other machines see `write_paper`.

    Attributes:
        extent: as asked for.
        tables: in the order in which they are to be read.
        courses: every transfer of the three objects, behind Table VII.
        returns: there and back, behind Table VI.
        runs: of every shape and seed, behind Tables P, W, B, T, K, A, R and S.
        pictures: captions and BGR images (H, W, 3).
        figures: of the paper drawn anew, and curves, by the names of their files.
        times: of each step beside the paper's.
        time_claims: what the paper says of time, and what came of it.
    """

    extent: Extent
    tables: tuple[Table, ...]
    courses: tuple[Course, ...]
    returns: tuple[Return, ...]
    runs: tuple[StrategyRun, ...]
    pictures: tuple[Picture, ...]
    figures: tuple[tuple[str, Picture], ...]
    times: Table
    time_claims: Table


def run_paper(
    extent: Extent | None = None, *, schedule: Scheduler | None = None, progress: Progress | None = None
) -> PaperRun:
    """Rerun the paper's tables on three objects, and the transfers on every shape; the same extent gives the same run.

    Ours and the paper's to the letter, without the tracker's judgement: what they refuse they refuse themselves. Without a
    schedule, shapes and seeds are done one after the other in this process.
    """
    extent = extent or Extent()
    _check(extent)
    told = run_objects(extent.frames, extent.seed, progress)
    scenes = Ticker(progress, "contexts", 2 * contexts.FRAMES_ON_IMAGES)
    tables = [
        *tables_of_objects(told),
        table_of_contexts(told.courses, told.parts[0], extent.seed, scenes),
        table_of_searches([f for f in told.footage if f.kind == "rendered"]),
    ]
    runs, left_out = _population(extent, schedule, progress)
    runs += [run for f in told.footage if f.kind == "rendered" for run in start_runs(f, extent.seed)]
    tables += [*population_tables(runs, left_out), *ablation_tables(runs), sensitivity_table(runs)]
    evidence = Evidence.of(tables)
    claims = table_of_claims(evidence)
    tables += [claims, table_of_verdicts(claims)]
    figures = [*paper_figures(told), *table_curves(evidence)]
    times = table_of_times(told.parts[0])
    return PaperRun(
        extent,
        tuple(tables),
        told.courses,
        told.returns,
        tuple(runs),
        tuple(table_pictures(told)),
        tuple(figures),
        times,
        table_of_time_claims(times),
    )


def _check(extent: Extent) -> None:
    frames, seeds = extent.frames, extent.seeds
    if frames < LEAST_FRAMES:
        raise InputError(f"the paper's tables need at least {LEAST_FRAMES} frames, not {frames}", frames=frames)
    if seeds < 1:
        raise InputError(f"at least 1 seed is needed, not {seeds}", seeds=seeds)
    unknown = [name for name in extent.shapes if name not in SHAPES]
    if unknown or not extent.shapes:
        told = f'there is no shape "{unknown[0]}"' if unknown else "at least 1 shape is needed"
        raise InputError(f"{told}; choose from {', '.join(SHAPES)}")


def _population(
    extent: Extent, schedule: Scheduler | None, progress: Progress | None
) -> tuple[list[StrategyRun], dict[str, str]]:
    """Runs of every shape and seed in order, and why some shapes have none."""
    tasks = [Task(shape, seed, extent.frames) for shape in extent.shapes for seed in range(extent.seeds)]
    tick = Ticker(progress, "shapes", len(tasks))
    done: dict[int, list[StrategyRun] | str] = {}
    for outcome in (schedule or _one_after_the_other)(population_runs, tasks):
        if outcome.error:
            task = tasks[outcome.index]
            raise GraspTrackError(f"{task.shape}, seed {task.seed}: {outcome.error}")
        done[outcome.index] = outcome.value
        tick()
    values = [done[i] for i in range(len(tasks))]
    left_out = {task.shape: told for task, told in zip(tasks, values, strict=True) if isinstance(told, str)}
    return [run for value in values if not isinstance(value, str) for run in value], left_out


def _one_after_the_other(function: object, tasks: Sequence[object]) -> Iterator[TaskOutcome]:
    """A `Scheduler` in this process, in which what fails is raised."""
    assert callable(function)
    for i, task in enumerate(tasks):
        yield TaskOutcome(i, function(task), "")
