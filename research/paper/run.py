# SPDX-License-Identifier: Apache-2.0
"""Section V rerun: all tables on three objects, and what holds of them on every built-in shape with several seeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from grasptrack.errors import GraspTrackError, InputError
from grasptrack.images import Grey
from grasptrack.typing import Progress
from grasptrack_bench.report.table import Table
from grasptrack_bench.schedule import Scheduler, TaskOutcome
from grasptrack_bench.simulation import SHAPES
from research.paper import contexts
from research.paper.ablation import ablation_tables, sensitivity_table
from research.paper.claims import table_of_claims, table_of_time_claims, table_of_verdicts
from research.paper.contexts import table_of_contexts
from research.paper.correspondences import (
    Correspondences,
    RefusedPair,
    find_correspondences,
    find_literal_correspondences,
    table_five,
    table_two,
)
from research.paper.curves import table_curves
from research.paper.descriptions import table_four, table_one, table_three
from research.paper.error_tables import at_a_glance, table_seven, table_six
from research.paper.evidence import Evidence
from research.paper.figures import Images, Picture, paper_figures, table_pictures
from research.paper.footage import (
    FRAMES,
    IN_IMAGES,
    KINDS,
    MOTIONS,
    OBJECTS,
    FilmedPart,
    Footage,
    ideal_footage,
    make_part,
    middle_frame,
    rendered_footage,
)
from research.paper.population import Task, population_runs, population_tables, start_runs
from research.paper.runs import StrategyRun
from research.paper.searching import table_of_searches
from research.paper.times import table_of_times
from research.paper.transfers import COMPARED, Course, Return, transfer_and_measure, transfer_and_return, ways_of

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
    """What a run gives. All but `times` and `time_claims` repeats to the last digit on one machine, to 1e-9 on another.

    Attributes:
        extent: as asked for.
        tables: in the order in which they are to be read.
        courses: every transfer of the three objects, behind Table VII.
        returns: there and back, behind Table VI.
        runs: of every shape and seed, behind Tables P, B, T, K, A, R and S.
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

    Ours and the paper's to the letter, without the tracker's judgement: what they refuse they refuse themselves.

    Args:
        extent: how much; None for all.
        schedule: of the shapes and seeds; None does one after the other in this process.
        progress: see `Progress`.

    Raises:
        InputError: too few frames, no seed, or a shape that there is not.
        ObservationError: an object has no grasp that every strategy can describe, or is not found in its first image.
        GraspTrackError: a worker failed.
    """
    extent = extent or Extent()
    _check(extent)
    parts = [make_part(name, extent.seed) for name in OBJECTS]
    footage, images = _all_footage(parts, extent, progress)
    tell = _Ticker(progress, "transfers", sum(len(ways_of(s)) for s in COMPARED) * len(footage))
    courses = []
    for f in footage:
        for strategy in COMPARED:
            for way in ways_of(strategy):
                courses.append(transfer_and_measure(f, strategy, way))
                tell()
    half = middle_frame(extent.frames)
    returns = [transfer_and_return(f, strategy, half) for f in footage for strategy in COMPARED]
    examples = [f for f in footage if f.motion == "4 DoF" and f.kind in ("resampled", "rendered")]
    tilted = [f for f in footage if f.motion == "6 DoF" and f.kind == "rendered"]
    found = [_name_if_refused(f, "ours", find_correspondences(f, half)) for f in tilted]
    letter = [_name_if_refused(f, "to the letter", find_literal_correspondences(f, half)) for f in tilted]
    both = [pair for pairs in zip(found, letter, strict=True) for pair in pairs]
    scenes = _Ticker(progress, "contexts", 2 * contexts.FRAMES_ON_IMAGES)
    tables = [
        table_one(parts),
        table_two(both),
        table_three(examples, half),
        table_four(examples, half),
        table_five(both),
        *_tables_six(returns),
        at_a_glance(courses),
        *_tables_seven(courses, half),
        table_of_contexts(courses, parts[0], extent.seed, scenes),
        table_of_searches([f for f in footage if f.kind == "rendered"]),
    ]
    runs, left_out = _population(extent, schedule, progress)
    runs += [run for f in footage if f.kind == "rendered" for run in start_runs(f, extent.seed)]
    tables += [*population_tables(runs, left_out), *ablation_tables(runs), sensitivity_table(runs)]
    evidence = Evidence.of(tables)
    claims = table_of_claims(evidence)
    tables += [claims, table_of_verdicts(claims)]
    pictures = table_pictures(examples, found, images, half)
    sampled = [f for f in footage if (f.kind, f.motion) == ("resampled", "6 DoF")]
    answered = [c for c in found if isinstance(c, Correspondences)]
    figures = [*paper_figures(examples, answered, sampled, images, half), *table_curves(evidence)]
    times = table_of_times(parts[0])
    return PaperRun(
        extent,
        tuple(tables),
        tuple(courses),
        tuple(returns),
        tuple(runs),
        tuple(pictures),
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


def _all_footage(
    parts: Sequence[FilmedPart], extent: Extent, progress: Progress | None
) -> tuple[list[Footage], Images]:
    """All contours of the three objects, and the images of which there are pictures."""
    frames, seed = extent.frames, extent.seed
    tick = _Ticker(progress, "images", len(parts) * len(IN_IMAGES) * frames)
    footage: list[Footage] = []
    images: dict[tuple[str, str], list[Grey]] = {}
    for motion in MOTIONS:
        for kind in KINDS:
            for p in parts:
                if kind != "rendered":
                    footage.append(ideal_footage(p, kind, motion, frames, seed))
                elif motion in IN_IMAGES:
                    seen, images[p.name, motion] = rendered_footage(p, motion, frames, seed, tick)
                    footage.append(seen)
    return footage, images


def _tables_six(returns: Sequence[Return]) -> Iterator[Table]:
    """One table VI for each motion."""
    for number, motion in enumerate(MOTIONS, start=1):
        yield table_six(number, [r for r in returns if r.footage.motion == motion])


def _tables_seven(courses: Sequence[Course], half: int) -> list[Table]:
    """One table VII for each motion and kind of contours."""
    groups: dict[tuple[str, str], list[Course]] = {}
    for c in courses:
        groups.setdefault((c.footage.motion, c.footage.kind), []).append(c)
    return [table_seven(number, group, half) for number, group in enumerate(groups.values(), start=1)]


def _name_if_refused(footage: Footage, transfer: str, found: Correspondences | str) -> Correspondences | RefusedPair:
    return (footage.part.name, transfer, found) if isinstance(found, str) else found


def _population(
    extent: Extent, schedule: Scheduler | None, progress: Progress | None
) -> tuple[list[StrategyRun], dict[str, str]]:
    """Runs of every shape and seed in order, and why some shapes have none."""
    tasks = [Task(shape, seed, extent.frames) for shape in extent.shapes for seed in range(extent.seeds)]
    tick = _Ticker(progress, "shapes", len(tasks))
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


class _Ticker:
    """Counts the steps done and tells of them."""

    def __init__(self, progress: Progress | None, step: str, total: int) -> None:
        self._progress, self._step, self._total, self._done = progress, step, total, 0

    def __call__(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(self._step, self._done, self._total)
