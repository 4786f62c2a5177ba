# SPDX-License-Identifier: Apache-2.0
"""The report of a run: its figures as files, and one HTML page that holds them all, after `templates/run.html`."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError
from grasptrack.typing import Floats, Progress
from grasptrack_bench.charts import Chart, Series, format_number, format_percent, series_palette
from grasptrack_bench.charts.answer import draw_answer
from grasptrack_bench.metrics.integrity import precision_curve
from grasptrack_bench.metrics.statistics import upper_bound
from grasptrack_bench.metrics.summary import MethodRow, Summary, Worst, summarise_run, write_summary
from grasptrack_bench.report import charts
from grasptrack_bench.report.glossary import CURVES, TERMS
from grasptrack_bench.report.pages import TEMPLATES, Cell, Column, Figure, Line, PageTable, keep_chart, write_page
from grasptrack_bench.report.tables import heat_table, measures_table
from grasptrack_bench.run_folder import EvaluationRun, read_run

FIGURES = "figures"
PAGE = "report.html"
AT_PX = (0.1, 0.25, 0.5, 1.0, 2.0, 3.0, 5.0)
"""Distances of the table of precision."""
REASONS = 10
"""Reasons of loss that are told one by one."""
ENOUGH = 0.5
"""Share of the frames that a method must locate to be named as the most accurate."""
OF_FIRST, OF_OTHERS = 8, 3
"""Worst frames that are shown of the first method, and of each other one."""

Shown = tuple[NDArray[Any], Floats | None, Sequence[Floats]]
"""An image, the true contacts (k, 2) px or None where the object is gone, the true outline's polygons in px."""
Picture = Callable[[str, str, int], Shown | None]
"""Called with a case, a method and a frame; gives what is to be shown of it, or None where it cannot be had."""


class Best(NamedTuple):
    """The best methods: fewest wrong answers, most contacts, smallest error of those that locate half or more."""

    fewest: list[MethodRow]
    most: list[MethodRow]
    exact: list[MethodRow]


class Loss(NamedTuple):
    """Why a method gave no contacts: frames of all, and frames by reason."""

    method: str
    total: int
    frames: int
    reasons: list[tuple[int, str]]


def write_report(folder: Path, *, picture: Picture | None = None, progress: Progress | None = None) -> Path:
    """Write `summary.csv`, `summary.json`, `figures/*.svg` and `report.html`, whose path it returns, of a run.

    `picture` gives what is to be shown of a frame; without it there are no pictures of the worst frames.
    """
    run = read_run(folder)
    summary = summarise_run(run)
    first = headline_method(summary.methods)
    row = summary.row(first)
    assert row is not None
    series = series_palette(summary.methods)
    tell = progress or (lambda *_: None)
    losses = [_loss_of(summary, m) for m in summary.methods if summary.reasons[m]]
    levels = [r for r in summary.by_level if r.method == first and not math.isnan(r.located)]
    several = len(levels) > 1
    try:
        figures = folder / FIGURES
        figures.mkdir(exist_ok=True)
        for old in figures.glob("*.svg"):
            old.unlink()
        write_summary(folder, summary)
        return write_page(
            folder / PAGE,
            TEMPLATES / "run.html",
            f"Grasp tracking on {'rendered scenes' if run.kind == 'scenes' else 'real videos'}",
            "grasptrack evaluation",
            series,
            first,
            run=run,
            summary=summary,
            first=first,
            row=row,
            images=sum(len(run.scores[case.name].get(first, ())) for case in run.scored),
            bound=upper_bound(row.measures.false_accepts, row.measures.frames),
            best=_best_methods(summary),
            hardest=min(levels, key=lambda r: r.located) if several else None,
            wrong_levels=[r.level for r in levels if r.measures.false_accepts] if several else [],
            facts=_run_facts(run),
            charts=_draw_charts(run, summary, series, first, figures, tell),
            precision_table=_precision_table(run, summary),
            worst=_worst_pictures(summary, first, picture, tell) if picture is not None else [],
            losses=losses,
            never_lost=[m for m in summary.methods if not summary.reasons[m]],
            terms=[
                *((f"{t.label}, {t.unit}" if t.unit else t.label, t.meaning, t.source) for t in TERMS.values()),
                *CURVES,
            ],
            measures_table=measures_table,
            heat_table=heat_table,
        )
    except OSError as error:
        raise InputError(f'"{folder}" cannot be written: {error.strerror or error}', path=str(folder)) from error


def headline_method(methods: Sequence[str]) -> str:
    """The method that a report speaks of first."""
    return "auto" if "auto" in methods else methods[0]


def _draw_charts(
    run: EvaluationRun, summary: Summary, series: dict[str, Series], first: str, figures: Path, tell: Progress
) -> dict[str, Any]:
    """All charts by the section in which they stand; each is a file of its own, too."""

    def save_chart(name: str, chart: Chart) -> str:
        return keep_chart(figures, name, chart, series, first)

    ends, over_time = charts.error_ends(run, summary.methods), []
    for i, level in enumerate(summary.levels):
        upper, lower = charts.time_charts(run, level, series, ends)
        drawn = save_chart(f"error-over-time-{level}", upper) + save_chart(f"located-over-time-{level}", lower)
        over_time.append(Figure(level, summary.group_of.get(level, ""), drawn))
        tell("charts", i + 1, len(summary.levels))
    confidence = [Figure("Risk over coverage", "", save_chart("risk-coverage", charts.risk_chart(run, series)))]
    recovery = charts.recovery_chart(run, series)
    if recovery is not None:
        confidence.append(Figure("Frames until recovery", "", save_chart("recovery", recovery)))
    return {
        "over_time": over_time,
        "precision": [
            Figure("In px", "", save_chart("precision-px", charts.precision_chart(run, series, False))),
            Figure(
                "In per cent of the grasp's opening",
                "",
                save_chart("precision-opening", charts.precision_chart(run, series, True)),
            ),
        ],
        "spread": save_chart("errors", charts.spread_chart(run, series, summary.levels)),
        "confidence": confidence,
        "latency": [Figure("", "", save_chart("latency", charts.latency_chart(run, series)))],
    }


def _precision_table(run: EvaluationRun, summary: Summary) -> PageTable:
    lines = []
    for method in summary.methods:
        shares = precision_curve(run.runs(method, run.scored), np.array(AT_PX)).tolist()
        lines.append(Line([method, *(Cell(format_percent(v), v, v) for v in shares)], series=method))
    return PageTable([Column("method", words=True), *(Column(f"{t:g} px") for t in AT_PX)], lines)


def _worst_pictures(
    summary: Summary, first: str, picture: Picture, tell: Progress
) -> list[tuple[Worst, NDArray[np.uint8]]]:
    """The worst frames, drawn: more of the first method, and of the others those that are bad indeed."""
    wanted = [
        w
        for m in summary.methods
        for w in summary.worst[m][: OF_FIRST if m == first else OF_OTHERS]
        if w.false_accept or m == first or w.error > 0.5 * w.limit
    ]
    found = []
    for i, w in enumerate(wanted):
        shown = picture(w.case, w.method, w.frame)
        if shown is not None:
            image, truth, outline = shown
            found.append((w, draw_answer(image, None if w.gone else truth, outline, np.array(w.contacts))))
        tell("worst frames", i + 1, len(wanted))
    return found


def _loss_of(summary: Summary, method: str) -> Loss:
    found, row = summary.reasons[method], summary.row(method)
    reasons = [(n, reason or "no reason given") for reason, n in found[:REASONS]]
    rest = sum(n for _, n in found[REASONS:])
    frames = row.measures.frames if row is not None else 0
    return Loss(method, sum(n for _, n in found), frames, [*reasons, (rest, "other reasons")] if rest else reasons)


def _best_methods(summary: Summary) -> Best | None:
    """The best of all methods in three respects, where there are several."""
    rows = [r for r in summary.overall if r.measures.frames]
    if len(rows) < 2:
        return None

    def lowest_rows(of: Callable[[MethodRow], float], among: Sequence[MethodRow]) -> list[MethodRow]:
        known = [r for r in among if not math.isnan(of(r))]
        return [r for r in known if of(r) == min(map(of, known))]

    return Best(
        lowest_rows(lambda r: float(r.measures.false_accepts), rows),
        lowest_rows(lambda r: -r.measures.located_whole, rows),
        lowest_rows(lambda r: r.measures.median_px, [r for r in rows if r.measures.located_whole >= ENOUGH]),
    )


def _run_facts(run: EvaluationRun) -> list[tuple[str, str]]:
    """How to do it again; "" for what is not known."""
    index, versions = run.index, run.index.get("versions") or {}
    names = ("grasptrack", "python", "numpy", "opencv")
    return [
        ("Machine", str(index.get("machine") or "")),
        ("Software", ", ".join(f"{n} {versions[n]}" for n in names if versions.get(n))),
        ("Kernels", str(index.get("backend") or "")),
        ("Run", _format_run_time(index)),
        ("Again", f"`{index['command']}`" if index.get("command") else ""),
    ]


def _format_run_time(index: Mapping[str, Any]) -> str:
    started, seconds = str(index.get("started") or ""), index.get("seconds")
    with contextlib.suppress(ValueError):
        started = datetime.fromisoformat(started).strftime("%d %B %Y, %H:%M").lstrip("0")
    took = ""
    if isinstance(seconds, int | float):
        took = f"{seconds / 60.0:.1f} minutes" if seconds >= 90.0 else f"{format_number(float(seconds), 2)} s"
    return ", ".join(part for part in (started, took) if part)
