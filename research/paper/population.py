# SPDX-License-Identifier: Apache-2.0
"""The transfers on every built-in shape with several seeds: the paths, tilt, clipped outlines; Tables P, T and K."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from grasptrack.errors import ObservationError
from grasptrack_bench.report.table import Cell, Table
from grasptrack_bench.simulation import Path
from research.paper.ablation import ablation_runs, sensitivity_runs
from research.paper.choosing import rule_runs, table_of_rule
from research.paper.clipping import BESIDE, CLIPPED, clipped_footage
from research.paper.footage import (
    DISTANCE,
    MOTIONS,
    STARTS,
    TRACKED,
    FilmedPart,
    Footage,
    Kind,
    ideal_footage,
    in_four_dof,
    make_part,
    moved_curves,
    path_homographies,
    resample_view,
    started,
)
from research.paper.runs import SUMMARY, SUMMARY_NOTES, StrategyRun, run_of, summarize
from research.paper.transfers import COMPARED, WAYS, transfer_and_measure, ways_of, without_numbers

EXTRACTED: tuple[Kind, ...] = ("resampled", "pixel chain")
"""Contours that are sampled independently of each other; where they correspond all transfers are exact."""
TILTS = tuple(range(0, 61, 10))
"""Degrees."""
SEEDS_OF_VARIANTS = 3
"""Seeds with which ablation and sensitivity are run: variants are compared on the same sequences, which takes fewer."""


@dataclass(frozen=True, slots=True)
class Task:
    """One shape with one seed."""

    shape: str
    seed: int
    frames: int


def population_runs(task: Task) -> list[StrategyRun] | str:
    """All runs of one shape and seed, or why the shape has none."""
    try:
        part = make_part(task.shape, task.seed)
    except ObservationError as error:
        return str(error)
    runs = [*path_runs(part, task), *tilt_runs(part, task.seed), *clipped_runs(part, task.seed)]
    if task.seed < SEEDS_OF_VARIANTS:
        runs += ablation_runs(part, task.seed, task.frames)
        runs += sensitivity_runs(part, task.seed, task.frames)
        for motion in MOTIONS:
            for kind in EXTRACTED:
                runs += start_runs(ideal_footage(part, kind, motion, task.frames, task.seed), task.seed)
    return runs


def start_runs(footage: Footage, seed: int) -> Iterator[StrategyRun]:
    """The paper's homography on contours that begin by each rule."""
    for start in STARTS:
        begun = started(footage, start, seed)
        for way in ways_of("paper-homography"):
            errors = transfer_and_measure(begun, "paper-homography", way).errors
            setting = footage.part.name, seed, footage.motion, footage.kind, "paper-homography", way
            yield run_of(errors, "starts", *setting, start)


def path_runs(part: FilmedPart, task: Task) -> Iterator[StrategyRun]:
    """Every strategy along every path on every kind of contours, in every way, and the rule that chooses among them."""
    for motion in MOTIONS:
        for kind in EXTRACTED:
            footage = ideal_footage(part, kind, motion, task.frames, task.seed)
            yield from rule_runs(footage, task.seed)
            for strategy in COMPARED:
                for way in ways_of(strategy):
                    errors = transfer_and_measure(footage, strategy, way).errors
                    yield run_of(errors, "paths", part.name, task.seed, motion, kind, strategy, way)


def tilt_footage(part: FilmedPart, seed: int) -> Footage:
    """Contours sampled anew while the camera leans by one degree more from frame to frame, and turns a little."""
    rng = np.random.default_rng((seed, 41))
    frames = TILTS[-1] + 1
    whole = np.arange(frames, dtype=np.float64)
    turned = rng.uniform(-1.0, 1.0) * np.radians(0.5 * whole)
    path = Path(
        np.zeros((frames, 2)),
        np.full(frames, DISTANCE),
        turned,
        np.radians(whole),
        np.full(frames, rng.uniform(0.0, 2.0 * math.pi)),
    )
    H = path_homographies(path)
    views = [part.reference, *(resample_view(moved_curves(part, h), rng) for h in H[1:])]
    areas = np.array([sum(c.signed_area for c in view.contours) for view in views])
    tracked = in_four_dof(part.reference, H)
    return Footage(part, "resampled", "6 DoF", H, areas, tuple(views), tuple(tracked), part.contacts, part.contacts)


def tilt_runs(part: FilmedPart, seed: int) -> Iterator[StrategyRun]:
    """Errors at each tilt."""
    footage = tilt_footage(part, seed)
    for strategy in COMPARED:
        for way in ways_of(strategy):
            errors = transfer_and_measure(footage, strategy, way).errors
            for degrees in TILTS:
                near = errors[max(0, degrees - 1 - BESIDE) : degrees + BESIDE]
                setting = "tilt", part.name, seed, "6 DoF", "resampled", strategy, way
                yield run_of(near, *setting, "tilt, degrees", float(degrees))


def clipped_runs(part: FilmedPart, seed: int) -> Iterator[StrategyRun]:
    """Errors at each share of the outline that a border hides; of RRP nothing, whose outline would be the tracker's."""
    footage = clipped_footage(part, seed)
    if footage is None:
        return
    for strategy in (s for s in COMPARED if s not in TRACKED):
        for way in ways_of(strategy):
            errors = transfer_and_measure(footage, strategy, way).errors
            for percent in CLIPPED:
                near = errors[percent - 1 - BESIDE : percent + BESIDE]
                setting = "clipped", part.name, seed, "6 DoF", "resampled", strategy, way
                yield run_of(near, *setting, "hidden, %", float(percent))


def population_tables(runs: Sequence[StrategyRun], left_out: dict[str, str]) -> list[Table]:
    """Tables P (paths), shapes, W (the rule), B (starts of contours), T (tilt) and K (clipped)."""
    paths = [r for r in runs if r.experiment == "paths"]
    shapes, seeds = len({r.shape for r in paths}), len({r.seed for r in paths})
    notes = (
        f"{seeds} {'seeds' if seeds > 1 else 'seed'} of each shape.",
        *SUMMARY_NOTES,
        *(f"{way}: {meaning}." for way, meaning in WAYS.items()),
        "paper-*: to the letter, see Table VI; a prediction they do not know.",
    )
    names = list(dict.fromkeys(r.shape for r in paths))
    why = {name: without_numbers(told) for name, told in left_out.items() if name not in names}
    out = {"tried": names, "left out": list(why)}
    out |= {f"left out: {told}": [n for n in why if why[n] == told] for told in why.values()}
    starts = [r for r in runs if r.experiment == "starts"]
    tilt = [r for r in runs if r.experiment == "tilt"]
    clipped = [r for r in runs if r.experiment == "clipped"]
    clipped_shapes = len({r.shape for r in clipped})
    return [
        _table(
            "P",
            f"Sequence errors on {shapes} shapes",
            paths,
            ("motion", "contours"),
            (*notes, "Table shapes says which shapes are left out, and why."),
        ),
        Table(
            "shapes",
            "Built-in shapes in Tables P, W, T, K, A, R, S and B, and those that our own refusals leave out",
            ("shapes", "count", "names"),
            tuple((told, len(listed), ", ".join(listed)) for told, listed in out.items()),
            (
                "Left out is a shape without a grasp that every strategy can describe, for the reason of the last one tried.",
            ),
        ),
        table_of_rule(runs),
        _table(
            "B",
            "The paper's homography by where contours begin",
            starts,
            ("motion", "contours", "varied"),
            (
                f"{SEEDS_OF_VARIANTS} seeds of each shape at most; rendered: the three objects.",
                *SUMMARY_NOTES,
                *(f"{start}: {meaning}." for start, meaning in STARTS.items()),
            ),
        ),
        _table(
            "T",
            "Errors against tilt, contours sampled anew, one degree more from frame to frame",
            tilt,
            ("varied", "value"),
            (*notes, f"Each tilt with {BESIDE} frames before and after it; a perfect tracker of 4 DoF carries RRP."),
        ),
        _table(
            "K",
            "Outlines that a border cuts, one per cent more from frame to frame, 6 DoF",
            clipped,
            ("varied", "value"),
            (
                *notes,
                f"Of {clipped_shapes} shapes: those whose contacts stay in view on an outline that stays in one piece. Each "
                f"share of the outline's length with {BESIDE} frames before and after it. The grasp is given on the whole "
                "outline of the first view.",
            ),
        ),
    ]


def _table(number: str, title: str, runs: Sequence[StrategyRun], by: tuple[str, ...], notes: tuple[str, ...]) -> Table:
    """Runs summarised by what they have in common."""
    heads = (*by, "strategy", "way")
    groups: dict[tuple[Cell, ...], list[StrategyRun]] = {}
    for r in runs:
        groups.setdefault(tuple(getattr(r, name) for name in heads), []).append(r)
    rows = tuple((*key, *summarize(group)) for key, group in groups.items())
    shown = tuple("begun" if name == "varied" else name for name in by)
    if "value" in by:
        rows = tuple(row[1:] for row in rows)
        shown = (runs[0].varied if runs else "value",)
    return Table(number, title, (*shown, "strategy", "way", *SUMMARY), rows, notes)
