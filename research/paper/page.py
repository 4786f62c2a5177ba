# SPDX-License-Identifier: Apache-2.0
"""The page of the paper's tables after `page.html`: the tables, the errors over the frames, and pictures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError
from grasptrack.typing import Floats
from grasptrack_bench.charts import Axis, Chart, format_percent, series_palette
from grasptrack_bench.charts.chart import log_range
from grasptrack_bench.charts.palette import format_fixed
from grasptrack_bench.metrics.integrity import cumulative_share
from grasptrack_bench.report.pages import Cell, CellLike, Column, Figure, Line, PageTable, keep_chart, write_page
from grasptrack_bench.report.table import Table, is_number
from research.paper.transfers import Course


def paper_report(
    folder: Path,
    tables: Sequence[Table],
    series: Sequence[Course] = (),
    pictures: Iterable[tuple[str, NDArray[np.uint8]]] = (),
    *,
    title: str = "The paper's tables, measured again",
    lead: str = "",
    facts: Sequence[tuple[str, str]] = (),
) -> Path:
    """Write `report.html` and `figures/*.svg`.

    Args:
        folder: that is there.
        tables: in order.
        series: every transfer, for the charts.
        pictures: caption and BGR picture; the first line of a caption stands out.
        title: of the page.
        lead: what a hurried reader takes away; `code` and **weight** are marked as in Markdown.
        facts: names and values: machine, versions, command.

    Returns:
        The path of the page.
    """
    try:
        figures = folder / "figures"
        figures.mkdir(exist_ok=True)
        return write_page(
            folder / "report.html",
            Path(__file__).with_name("page.html"),
            title,
            "grasptrack evaluation",
            series_palette(dict.fromkeys(s.strategy for s in series)),
            lead=lead,
            facts=facts,
            tables=tables,
            printed_table=_printed_table,
            pictures=list(pictures),
            **_draw_charts(series, figures),
        )
    except OSError as error:
        raise InputError(f'"{folder}" cannot be written: {error.strerror or error}', path=str(folder)) from error


def _draw_charts(series: Sequence[Course], figures: Path) -> dict[str, Any]:
    """Error over the frames for each object and setting, and how often it stays below a limit."""
    if not series:
        return {"over_frames": {}}
    palette = series_palette(dict.fromkeys(s.strategy for s in series))
    values = [(s, np.array(s.errors_px("maximum_px"), dtype=np.float64)) for s in series]
    settings = tuple(dict.fromkeys(_setting_name(s) for s in series))
    over_frames: dict[str, list[Figure]] = {}
    for setting in settings:
        here = [(s, v) for s, v in values if _setting_name(s) == setting]
        ends = log_range(np.concatenate([v for _, v in here]), 1e-3, 1e3, floor=10.0)
        parts = over_frames[_capitalize_first(setting)] = []
        for name in dict.fromkeys(s.footage.part.name for s, _ in here):
            mine = [(s, v) for s, v in here if s.footage.part.name == name]
            x = Axis("frame", 0.0, max(2.0, *(float(len(v)) for _, v in mine)))
            y = Axis("error, px", *ends, "log")
            chart = Chart(f"Error over the frames, {setting}, {name}", x, y, 340, 216, (40, 26, 10, 40))
            for s, v in mine:
                chart.draw_line(np.arange(1, len(v) + 1), v, palette[s.strategy])
            parts.append(Figure(name, "", keep_chart(figures, f"error-{setting}-{name}", chart, palette)))
    low, high = log_range(np.concatenate([v for _, v in values]), 1e-3, 1e3, floor=100.0)
    at, precision = np.geomspace(low, high, 141), []
    for setting in settings:
        x, y = Axis("error at most, px", low, high, "log"), Axis("share of frames", 0.0, 1.0, unit="%")
        chart = Chart(f"Precision, {setting}", x, y)
        for strategy in palette:
            pooled = [v for s, v in values if _setting_name(s) == setting and s.strategy == strategy]
            if pooled:
                errors = np.concatenate(pooled)
                chart.draw_line(at, cumulative_share(np.where(np.isnan(errors), np.inf, errors), at), palette[strategy])
        drawn = keep_chart(figures, f"precision-{setting}", chart, palette)
        precision.append(Figure(_capitalize_first(setting), "", drawn))
    return {"over_frames": over_frames, "precision": precision, "error_table": _error_table(values)}


def _printed_table(table: Table) -> PageTable:
    columns = [Column(name, words=i == 0 or not is_number(table, i)) for i, name in enumerate(table.head)]
    return PageTable(columns, [Line(row) for row in table.rows])


def _error_table(values: Sequence[tuple[Course, Floats]]) -> PageTable:
    columns = [Column("strategy", words=True), Column("of", words=True), Column("frames"), Column("answered", "%")]
    columns += [Column("median", "px"), Column("RMS", "px"), Column("95th pct", "px"), Column("largest", "px")]
    lines = []
    for setting, strategy in dict.fromkeys((_setting_name(s), s.strategy) for s, _ in values):
        errors = np.concatenate([v for s, v in values if (_setting_name(s), s.strategy) == (setting, strategy)])
        known = errors[np.isfinite(errors)]
        figures = [math.nan] * 4
        if len(known):
            rms = float(np.sqrt(np.mean(known**2)))
            figures = [float(np.median(known)), rms, float(np.percentile(known, 95)), float(known.max())]
        share = len(known) / len(errors) if len(errors) else math.nan
        cells: list[CellLike] = [strategy, setting, len(errors), Cell(format_percent(share), share)]
        lines.append(Line([*cells, *(Cell(format_fixed(f, 3), f) for f in figures)], series=strategy))
    return PageTable(columns, lines)


def _setting_name(s: Course) -> str:
    return f"{s.footage.kind} contours, {s.footage.motion}, {s.way}"


def _capitalize_first(text: str) -> str:
    return text[:1].upper() + text[1:]
