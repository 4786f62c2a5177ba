# SPDX-License-Identifier: Apache-2.0
"""Rows of a summary as tables: of pages, and of the terminal after a run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Literal

from grasptrack_bench.charts import format_number, format_percent
from grasptrack_bench.charts.palette import format_fixed
from grasptrack_bench.metrics.summary import MethodRow, summarise_run
from grasptrack_bench.report.glossary import TERMS, Term
from grasptrack_bench.report.pages import Cell, CellLike, Column, Line, PageTable, Tone
from grasptrack_bench.run_folder import read_run

ANSWERS = (
    "frames", "frames_whole", "located_whole", "located_partly", "tracked_visible", "false_accepts", "false_given_gone",
    "false_bound", "risk_area", "recoveries", "returns", "recovery_frames", "losses", "lost_median", "lost_p95",
)  # fmt: skip
"""Columns of the table that says how often there were contacts, and how often wrong ones."""
ERRORS = (
    "median_px", "rms_px", "p95_px", "max_px", "median_percent", "in_ellipse", "aligned_5", "aligned_15", "median_ms",
    "p99_ms",
)  # fmt: skip
"""Columns of the table that says how exact they were, and how long they took."""
_APART = (
    "located_whole", "false_accepts", "median_percent", "risk_area", "recoveries", "losses", "in_ellipse", "aligned_5",
    "median_ms",
)  # fmt: skip
_BEST_OF = ("median_px", "rms_px", "p95_px", "median_ms")
"""Not the shares located: whoever always answers has the best of these, right or wrong."""


_CLOSING = "method", "located %\nwhole", "\npartly", "wrong\nframes", "\nbelow %"
_ERROR_HEADS, _MS_HEADS = ("error px\nmedian", "\n95 %"), ("ms\nmedian", "\n99 %")
CLOSING_HEADS = *_CLOSING, *_ERROR_HEADS, "\nRMS", *_MS_HEADS, "frames"
_LOST_HEADS = "lost frames\nmedian", "\n95 %"
VIDEO_HEADS = (
    "video", "method", "frames\nwhole", "located %\nof these", "wrong\nframes", *_ERROR_HEADS, "p@5\n%", *_LOST_HEADS,
    _MS_HEADS[0],
)  # fmt: skip


def format_measure(term: Term, value: float | int) -> str:
    """A value of a measure as it stands in tables."""
    if term.kind == "share":
        return format_percent(float(value), 2 if term.key in ("false_bound", "risk_area") else 1)
    if term.kind == "count":
        return format_number(int(value))
    return format_fixed(float(value), {"px": 3, "percent": 3, "frames": 1, "ms": 2}[term.kind])


def measure_column(key: str) -> Column:
    """The head of a measure's column."""
    term = TERMS[key]
    return Column(term.label, term.unit, term.meaning, rule=key in _APART)


def measures_table(
    rows: Sequence[MethodRow], which: Literal["answers", "errors"], first: str, by_method: bool = True
) -> PageTable:
    """A line for each row with some measures; the best value of a column is set in weight where methods compete.

    Lines are methods (`by_method`), or levels of one method.
    """
    keys = ANSWERS if which == "answers" else ERRORS
    best = {key: _best_value(key, [value_of(r, key) for r in rows]) for key in _BEST_OF} if by_method else {}
    lines = []
    for row in rows:
        cells: list[CellLike] = [row.method if by_method else row.level]
        for key in keys:
            value = value_of(row, key)
            tone: Tone = "bad" if key == "false_accepts" and value > 0 else ""
            won = key in best and not math.isnan(value) and value == best[key] and len(rows) > 1
            cells.append(Cell(format_measure(TERMS[key], value), float(value), tone=tone, best=won))
        lines.append(Line(cells, series=row.method if by_method else ""))
    return PageTable([Column(first, words=True), *map(measure_column, keys)], lines)


def heat_table(
    rows: Iterable[MethodRow],
    key: str,
    methods: Sequence[str],
    levels: Sequence[str],
    first: str,
    groups: dict[str, str] | None = None,
) -> PageTable:
    """One measure: a line for each level, a column for each method, tinted by size.

    Shares are tinted as they are; counts and errors by their logarithm. What is wrong has a colour of its own.
    """
    term = TERMS[key]
    found = {(r.level, r.method): r for r in rows}
    values = [value_of(r, key) for r in found.values()]
    columns = [Column(first, words=True), *(Column(m, series=m) for m in methods)]
    lines, group = [], None
    for level in levels:
        cells: list[CellLike] = [level]
        for method in methods:
            row = found.get((level, method))
            if row is None:
                cells.append(None)
                continue
            value = float(value_of(row, key))
            heat, tone = _cell_tint(term, value, values)
            tip = f"{method}, {level}: {row.cases} sequences, {row.measures.frames} frames"
            cells.append(Cell(format_measure(term, value_of(row, key)), value, heat, tone, tip))
        here = (groups or {}).get(level, "")
        lines.append(Line(cells, rule=group is not None and here != group))
        group = here
    return PageTable(columns, lines)


def value_of(row: MethodRow, key: str) -> float | int:
    """A measure of a row by its name."""
    value: float | int = getattr(row if key in ("located", "risk_area") else row.measures, key)
    return value


def closing_table(folder: Path) -> tuple[list[str], list[list[str]]]:
    """Heads as of `show_rows`, and a row for each method over all cases; of videos also one for each method and video."""
    run = read_run(folder)
    summary = summarise_run(run)
    heads: Sequence[str] = CLOSING_HEADS
    cells = [[row.method, *_row_cells(row)] for row in summary.overall]
    if run.kind == "real":
        rows = sorted(summary.by_level, key=lambda row: summary.levels.index(row.level))
        heads, cells = VIDEO_HEADS, [_of_video(row) for row in (*rows, *summary.overall)]
    return ["<" * (head in ("method", "video")) + head for head in heads], cells


def _cell_tint(term: Term, value: float, values: Sequence[float]) -> tuple[float | None, Tone]:
    if math.isnan(value):
        return None, "muted"
    if term.key == "false_accepts":
        return (None, "muted") if value == 0 else (_log_fraction(value, 1.0, max(30.0, *values)), "bad")
    if term.kind == "share":
        return (1.0 - value) if term.better == "less" else value, ""
    known = [v for v in values if math.isfinite(v) and v > 0.0]
    return (_log_fraction(value, min(known), max(known)) if known else None), "warm"


def _log_fraction(value: float, low: float, high: float) -> float:
    if value <= 0.0 or high <= low:
        return 0.0
    return min(1.0, math.log(value / low) / math.log(high / low)) if math.isfinite(value) else 1.0


def _best_value(key: str, values: Sequence[float]) -> float:
    known = [v for v in values if math.isfinite(v)]
    if not known:
        return math.nan
    return max(known) if TERMS[key].better == "more" else min(known)


def _row_cells(row: MethodRow) -> list[str]:
    m = row.measures
    return [
        _format_percent(m.located_whole),
        _format_percent(m.located_partly),
        str(m.false_accepts),
        _format_percent(m.false_bound, 3),
        *(_format_number(v) for v in (m.median_px, m.p95_px, m.rms_px)),
        *(_format_number(v, 1) for v in (m.median_ms, m.p99_ms)),
        str(m.frames),
    ]


def _of_video(row: MethodRow) -> list[str]:
    m = row.measures
    return [
        row.level,
        row.method,
        str(m.frames_whole),
        _format_percent(m.located_whole),
        str(m.false_accepts),
        *(_format_number(v) for v in (m.median_px, m.p95_px)),
        _format_percent(m.aligned_5),
        *("never" if math.isinf(v) else _format_number(v, 0) for v in (m.lost_median, m.lost_p95)),
        _format_number(m.median_ms, 1),
    ]


def _format_percent(value: float, decimals: int = 1) -> str:
    return _format_number(100.0 * value, decimals)


def _format_number(value: float, decimals: int = 2) -> str:
    return f"{value:.{decimals}f}" if math.isfinite(value) else "-"
