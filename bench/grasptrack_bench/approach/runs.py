# SPDX-License-Identifier: Apache-2.0
"""What is written of approaches: a film of one, or the table and the figures of many at random."""

from __future__ import annotations

import csv
import math
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np

from grasptrack.files import hold_folder, whole_file, write_json
from grasptrack.geometry.contours import View
from grasptrack.io.results import software_versions
from grasptrack.io.video import VideoWriter
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack.typing import Floats, Pixels
from grasptrack_bench.approach.case import ApproachCase, Law, Row
from grasptrack_bench.approach.pictures import hold_result, plot_approach, side_by_side
from grasptrack_bench.approach.trial import Step, run_trial
from grasptrack_bench.metrics.statistics import wilson_interval
from grasptrack_bench.physics import World
from grasptrack_bench.physics.setting import Arm, Scenario
from grasptrack_bench.physics.world import PERIOD_S
from grasptrack_bench.run_folder import index_head, read_unfinished
from grasptrack_bench.schedule import Scheduler
from grasptrack_bench.simulation.outlines import Shape

Progress = Callable[[str, int, int], None]

VIDEO, PLOTS, VERDICT = "approach.mp4", "approach.png", "approach.json"
HELD_S = 1.5
"""Of the last picture with the outcome."""
_EXPECTED = 250


class TrialRecord:
    """Keeps what the plots show, and writes the video, if it is given a file, as it goes.

    `progress` is called with stage, images so far, and how many are to be expected.
    """

    def __init__(self, video: Path | None, progress: Progress | None) -> None:
        self._writer = None if video is None else VideoWriter(video, 1.0 / PERIOD_S)
        self._progress = progress
        self.time: list[float] = []
        self.errors: list[Floats] = []
        self.error_px: list[float] = []
        self.twists: list[Floats] = []
        self.states: list[str] = []
        self.count = 0
        self._last: View | None = None
        self._picture: Pixels | None = None

    def __call__(self, world: World, step: Step) -> None:
        """Take in one step."""
        if self._writer is not None:
            if step.result is not None and step.result.contacts is not None:
                self._last = step.result.view
            self._picture = side_by_side(world, step, self._last)
            self._writer.write(self._picture)
        self.count += 1
        if self._progress is not None:
            self._progress(step.stage, self.count, max(_EXPECTED, self.count))
        if step.stage == "approach" and step.command is not None:
            self.time.append(step.time)
            self.errors.append(np.asarray(step.command.error, dtype=np.float64))
            self.error_px.append(step.command.error_px)
            self.twists.append(step.command.twist)
            self.states.append(step.command.state)

    def end(self, row: Row) -> None:
        """Hold the last picture with what became of it."""
        if self._writer is not None and self._picture is not None:
            held = hold_result(self._picture, row)
            for _ in range(round(HELD_S / PERIOD_S)):
                self._writer.write(held)

    def close(self) -> None:
        """Finish the video."""
        if self._writer is not None:
            self._writer.close()


def run_and_film(
    case: ApproachCase, output: Path, *, video: bool, options: dict[str, Any], progress: Progress | None
) -> Row:
    """Run one approach; write approach.mp4, approach.png and approach.json."""
    with hold_folder(output):
        for name in (VIDEO, PLOTS, VERDICT):
            (output / name).unlink(missing_ok=True)
        record = TrialRecord(output / VIDEO if video else None, progress)
        try:
            row, _ = run_trial(case, record)
            record.end(row)
        finally:
            record.close()
        blind = [state in ("unsure", "holding", "searching") for state in record.states]
        title = f"{row.shape}, {row.scenario}, {row.law}: {row.outcome}. {row.reason}"[:110]
        plot_approach(record.time, record.errors, record.error_px, record.twists, blind, title, output / PLOTS)
        write_json(output / VERDICT, {"options": options, "versions": software_versions(), "verdict": row.values()})
    return row


TABLE, INDEX, FAILURES = "trials.csv", "trials.json", "failures"
MEASURED = "time_s", "error_px", "contact_error_px", "aside_mm", "servo_ms", "loop_ms", "loop_p99_ms", "look_ms"


def draw_cases(
    shapes: Sequence[Shape],
    count: int,
    *,
    seed: int,
    scenario: Scenario,
    arm: Arm,
    law: Law,
    images: Literal["auto", "mujoco", "planar"] = "planar",
    fingers: Literal[2, 3] = 2,
    risk: float = DEFAULT_RISK,
    sure: float = 0.0,
) -> list[ApproachCase]:
    """Trials with shapes in an order that the seed decides, each as often as the others, give or take one."""
    rng = np.random.default_rng((seed, 73))
    order: list[int] = []
    while len(order) < count:
        order += rng.permutation(len(shapes)).tolist()
    return [
        ApproachCase(shapes[i], 100_000 * seed + k, scenario, arm, law, images, fingers=fingers, risk=risk, sure=sure)
        for k, i in enumerate(order[:count])
    ]


@dataclass
class Trials:
    """What many trials came to.

    Attributes:
        rows: by the order of the cases; without those that broke.
        broken: reason by name of a case that did not run to its end.
        resumed: how many of the rows an interrupted run had left.
    """

    rows: list[Row] = field(default_factory=list)
    broken: dict[str, str] = field(default_factory=dict)
    resumed: int = 0

    def count_outcome(self, outcome: str) -> int:
        """Trials that ended so."""
        return sum(row.outcome == outcome for row in self.rows)

    @property
    def tried(self) -> int:
        """Trials on shapes that were not refused, broken ones included."""
        return len(self.rows) + len(self.broken) - self.count_outcome("refused")

    @property
    def success_rate(self) -> float:
        """Share lifted and held of those tried; NaN for none."""
        return self.count_outcome("lifted") / self.tried if self.tried else math.nan

    def success_interval(self) -> tuple[float, float]:
        """95 % interval of the rate (E. B. Wilson 1927)."""
        return wilson_interval(self.count_outcome("lifted"), self.tried)

    def count_reasons(self) -> list[tuple[str, int]]:
        """Why trials failed, the most frequent first; numbers within a reason are left out."""
        found = [kind_of(row.reason) for row in self.rows if row.outcome == "failed"]
        return Counter([*found, *(f"broken: {kind_of(r)}" for r in self.broken.values())]).most_common()

    @property
    def unbelieved(self) -> int:
        """How often the hand closed on what was not believed."""
        return sum(row.believed is False for row in self.rows)

    @property
    def wrong(self) -> int:
        """How often the hand closed on what was believed, and was elsewhere in truth."""
        return sum(bool(row.believed) and row.right is False for row in self.rows)

    def index_figures(self) -> dict[str, Any]:
        """For the index."""
        low, high = self.success_interval()
        refused = [row for row in self.rows if row.outcome == "refused"]
        return {
            "trials": len(self.rows) + len(self.broken),
            "shapes": len({row.shape for row in self.rows}),
            "lifted": self.count_outcome("lifted"),
            "failed": self.count_outcome("failed") + len(self.broken),
            "refused": len(refused),
            "refusals_confirmed": sum(bool(row.confirmed) for row in refused),
            "rate": self.success_rate,
            "rate_95": [low, high],
            "closed": sum(row.believed is not None for row in self.rows),
            "closed_unbelieved": self.unbelieved,
            "closed_wrong": self.wrong,
            "empty": sum(row.noticed is not None for row in self.rows),
            "empty_noticed": sum(bool(row.noticed) for row in self.rows),
            "empty_lifted": sum(row.noticed is not None and row.outcome == "lifted" for row in self.rows),
            "reasons": dict(self.count_reasons()),
            "median": {name: _finite_median([getattr(row, name) for row in self.rows]) for name in MEASURED},
        }


def run_trials(
    output: Path,
    cases: Sequence[ApproachCase],
    schedule: Scheduler,
    *,
    options: dict[str, Any],
    progress: Progress | None = None,
) -> Trials:
    """Try every case; write trials.csv, trials.json, and a picture of the end of each failure.

    A folder that holds a run which did not finish, with the same options and the same code, is gone on with; any other run
    in it is written over.

    Args:
        output: folder, made when missing.
        cases: with distinct names.
        schedule: who does the work.
        options: what was asked for, for the index; what decides the cases.
        progress: called with a step's name, trials done, and all of them; when it raises, the run stops and can be gone on
            with.
    """
    head = index_head("trials", options)
    with hold_folder(output):
        rows = _rows_before(output, head, cases)
        trials, left = Trials(resumed=len(rows)), [i for i in range(len(cases)) if i not in rows]
        write_trial_rows(output / TABLE, [rows[i] for i in sorted(rows)])
        write_json(output / INDEX, {**head, "ended": "running"})
        if progress is not None:
            progress("trials", len(rows), len(cases))
        for outcome in schedule(run_trial, [cases[i] for i in left]):
            case = cases[left[outcome.index]]
            if outcome.error:
                trials.broken[case.name] = outcome.error
            else:
                row, picture = outcome.value
                if picture:
                    (output / FAILURES).mkdir(exist_ok=True)
                    with whole_file(_picture_file(output, case)) as part:
                        part.write_bytes(picture)
                rows[left[outcome.index]] = _parse_row(_format_row(row))  # as one that is gone on with will read it
                write_trial_rows(output / TABLE, [rows[i] for i in sorted(rows)])  # whatever stops the rest
            if progress is not None:
                progress("trials", len(rows) + len(trials.broken), len(cases))
        trials.rows = [rows[i] for i in sorted(rows)]
        told = {"ended": "finished", "figures": trials.index_figures(), "broken": trials.broken}
        write_json(output / INDEX, {**head, **told})
    return trials


def _rows_before(output: Path, head: Mapping[str, Any], cases: Sequence[ApproachCase]) -> dict[int, Row]:
    """What an interrupted run of these cases left, by their numbers; files of any other run are removed."""
    found: dict[int, Row] = {}
    if read_unfinished(output / INDEX, head) is not None:
        with suppress(OSError, ValueError, KeyError, TypeError, csv.Error):
            with (output / TABLE).open(newline="", encoding="utf-8") as file:
                known = {row.seed: row for row in map(_parse_row, csv.DictReader(file))}
            found = {i: known[case.seed] for i, case in enumerate(cases) if case.seed in known}
    kept = {_picture_file(output, cases[i]) for i in found}
    for old in (output / FAILURES).glob("*.p*"):
        if old not in kept:
            old.unlink()
    return found


def kind_of(reason: str) -> str:
    """A reason without its numbers, so that the same ones can be counted."""
    return re.sub(r"\s+", " ", re.sub(r"[-+]?\d+(\.\d+)?", "#", reason)).strip()[:110] or "no reason"


def _finite_median(values: list[float]) -> float | None:
    known = [v for v in values if math.isfinite(v)]
    return round(float(np.median(known)), 3) if known else None


def write_trial_rows(path: Path, rows: Sequence[Row], kind: type[Row] = Row) -> None:
    """A table of rows of one kind, with a header, whole at any moment."""
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(f.name for f in fields(kind))
        writer.writerows(_format_row(row).values() for row in rows)


def _format_row(row: Row) -> dict[str, str]:
    return {name: _format_cell(value) for name, value in row.values().items()}


def _parse_row(cells: Mapping[str, str]) -> Row:
    """The inverse of `_format_row`, but for digits that it leaves out."""
    read: dict[str, Callable[[str], Any]] = {
        "int": int,
        "float": lambda cell: float(cell) if cell else math.nan,
        "bool | None": lambda cell: bool(int(cell)) if cell else None,
    }
    return Row(**{f.name: read.get(str(f.type), str)(cells[f.name]) for f in fields(Row)})


def _format_cell(value: Any) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    if isinstance(value, bool):
        return str(int(value))
    return f"{value:.4f}" if isinstance(value, float) else str(value)


def _picture_file(output: Path, case: ApproachCase) -> Path:
    name = re.sub(r"[^\w.-]+", "_", case.name)
    return output / FAILURES / f"{name}.png"
