# SPDX-License-Identifier: Apache-2.0
"""The figures of a run: every measure by method, disturbance, group and part, its worst frames, its reasons of loss."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from grasptrack.files import write_json
from grasptrack.typing import Floats
from grasptrack_bench.metrics.integrity import PARTLY, Measures, compute_measures, risk_coverage
from grasptrack_bench.metrics.score import FrameScore, Score
from grasptrack_bench.run_folder import Case, EvaluationRun

ALL = "all"
"""In the place of a disturbance, group or part: over all of them."""
PER_METHOD, PER_CASE = 12, 2
"""Worst frames that are kept of a method, and of one case of it."""
APART = 10
"""Frames between two worst frames of one case: the frames beside a bad one are bad for the same reason."""


@dataclass(frozen=True, slots=True)
class MethodRow:
    """One method over some of the cases.

    Attributes:
        method: its name.
        level: the disturbance, group or part; "all" over all cases.
        cases: sequences.
        located: contacts given, of the frames with 70 % of the outline in view or more, 0 to 1.
        risk_area: mean risk as answers are taken by falling confidence, see `risk_area`.
        measures: all others.
    """

    method: str
    level: str
    cases: int
    located: float
    risk_area: float
    measures: Measures

    def flat(self) -> dict[str, float | int | str]:
        """All figures by name."""
        head = {key: getattr(self, key) for key in ("method", "level", "cases", "located", "risk_area")}
        return {**head, **asdict(self.measures)}


@dataclass(frozen=True, slots=True)
class Worst:
    """A frame that was answered badly; `error` is in px and infinite where the truth is behind the camera."""

    method: str
    case: str
    level: str
    frame: int
    error: float
    limit: float
    gone: bool
    false_accept: bool
    contacts: tuple[tuple[float, float], ...]
    confidence: float


@dataclass(frozen=True)
class Summary:
    """What is told of a run.

    Attributes:
        factor: what levels are: "disturbance" or "video".
        methods, levels, groups, shapes: names in order.
        group_of: group by level.
        overall, by_level, by_group, by_shape: rows, method by method.
        worst: frames by method, wrong ones first.
        reasons: of measured frames without contacts, with their number, the most frequent first, by method.
    """

    factor: str
    methods: tuple[str, ...]
    levels: tuple[str, ...]
    groups: tuple[str, ...]
    shapes: tuple[str, ...]
    group_of: dict[str, str]
    overall: tuple[MethodRow, ...]
    by_level: tuple[MethodRow, ...]
    by_group: tuple[MethodRow, ...]
    by_shape: tuple[MethodRow, ...]
    worst: dict[str, tuple[Worst, ...]]
    reasons: dict[str, tuple[tuple[str, int], ...]]

    def row(self, method: str, level: str = ALL) -> MethodRow | None:
        """Of one method over all, or at one level; None where it took no part."""
        rows = self.overall if level == ALL else self.by_level
        return next((r for r in rows if r.method == method and r.level == level), None)


def summarise_run(run: EvaluationRun) -> Summary:
    """All figures of a run."""
    cases = run.scored

    def rows_by(of: Callable[[Case], str], names: Sequence[str]) -> tuple[MethodRow, ...]:
        sorted_out = {name: [c for c in cases if of(c) == name] for name in names}
        return tuple(
            row_of(method, name, runs)
            for method in run.methods
            for name, here in sorted_out.items()
            if (runs := run.runs(method, here))
        )

    levels = tuple(dict.fromkeys(c.disturbance for c in cases))
    groups = tuple(dict.fromkeys(c.group for c in cases if c.group))
    shapes = tuple(dict.fromkeys(c.shape for c in cases if c.shape))
    return Summary(
        factor=run.factor,
        methods=run.methods,
        levels=levels,
        groups=groups,
        shapes=shapes,
        group_of={c.disturbance: c.group for c in cases},
        overall=rows_by(lambda _: ALL, (ALL,)),
        by_level=rows_by(lambda c: c.disturbance, levels),
        by_group=rows_by(lambda c: c.group, groups),
        by_shape=rows_by(lambda c: c.shape, shapes),
        worst={m: tuple(worst_frames(run, m)) for m in run.methods},
        reasons={
            m: tuple(Score("", [f for frames in run.runs(m, cases) for f in frames if f.measured]).reasons())
            for m in run.methods
        },
    )


def row_of(method: str, level: str, runs: Sequence[Sequence[FrameScore]]) -> MethodRow:
    """All figures of one method over some of its runs."""
    frames = [f for run in runs for f in run if f.measured]
    shown = [f.answered for f in frames if f.present and f.visible >= PARTLY]
    located = sum(shown) / len(shown) if shown else math.nan
    return MethodRow(method, level, len(runs), located, risk_area(risk_coverage(frames)), compute_measures(runs))


def risk_area(curve: Floats) -> float:
    """Area under a risk-coverage curve (n, 3) over the coverage that it reaches: the mean risk on the way there.

    0 when nothing that was given is wrong; low when what is wrong comes last. NaN for an empty curve.
    """
    if not len(curve):
        return math.nan
    widths = np.diff(curve[:, 1], prepend=0.0)
    return float((widths * curve[:, 2]).sum() / curve[-1, 1])


def worst_frames(run: EvaluationRun, method: str, count: int = PER_METHOD) -> list[Worst]:
    """The worst answers of a method: wrong ones first, then by error; at most two of a case, some frames apart."""
    found: list[Worst] = []
    for case in run.scored:
        frames = run.scores[case.name].get(method, [])
        measured = [f for f in frames if f.distances is not None and not f.defining]
        bad = sorted(measured, key=lambda f: (not f.is_false_accept, -f.error, f.frame))
        kept: list[FrameScore] = []
        for f in bad:
            if len(kept) < PER_CASE and all(abs(f.frame - k.frame) >= APART for k in kept):
                kept.append(f)
        found += [_worst_record(method, case, f) for f in kept]
    found.sort(key=lambda w: (not w.false_accept, -w.error / w.limit if w.limit > 0.0 else 0.0, w.case, w.frame))
    return found[:count]


def write_summary(folder: Path, summary: Summary) -> None:
    """Write `summary.csv`, a row for each method over all and at each level, and `summary.json`, everything."""
    names = ["method", "level", "cases", "located", "risk_area", *(f.name for f in fields(Measures))]
    with (folder / "summary.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([summary.factor if name == "level" else name for name in names])
        for row in (*summary.overall, *summary.by_level):
            writer.writerow([_format_cell(row.flat()[name]) for name in names])
    rows = {key: [r.flat() for r in getattr(summary, key)] for key in ("overall", "by_level", "by_group", "by_shape")}
    content: dict[str, Any] = {
        "factor": summary.factor,
        **rows,
        "worst": {m: [asdict(w) for w in found] for m, found in summary.worst.items()},
        "reasons": {m: [{"reason": r, "frames": n} for r, n in found] for m, found in summary.reasons.items()},
    }
    write_json(folder / "summary.json", content)


def _format_cell(value: float | int | str) -> str:
    if isinstance(value, str):
        return value
    return "" if math.isnan(value) else repr(value)


def _worst_record(method: str, case: Case, f: FrameScore) -> Worst:
    contacts = () if f.contacts is None else tuple((float(x), float(y)) for x, y in f.contacts)
    wrong = f.is_false_accept
    return Worst(method, case.name, case.disturbance, f.frame, f.error, f.limit, f.gone, wrong, contacts, f.confidence)
