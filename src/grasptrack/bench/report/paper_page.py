# SPDX-License-Identifier: Apache-2.0
"""The page of the paper's tables: the tables themselves, the errors behind them over the frames, and pictures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.metrics.integrity import cumulative_share
from grasptrack.errors import InputError
from grasptrack.typing import Floats
from grasptrack.view.report import Axis, Cell, Chart, Column, Line, Page, format_percent
from grasptrack.view.report.chart import log_range
from grasptrack.view.report.palette import standalone_svg
from grasptrack.view.report.parts import format_fixed, make_slug


class TableLike(Protocol):
    """A table; `grasptrack.bench.report.table.Table` is one."""

    @property
    def number(self) -> str:
        """As the paper numbers it."""
        ...

    @property
    def title(self) -> str:
        """What it shows."""
        ...

    @property
    def head(self) -> Sequence[str]:
        """Names of the columns."""
        ...

    @property
    def rows(self) -> Sequence[Sequence[str | float | int | None]]:
        """Cells by row."""
        ...

    @property
    def notes(self) -> Sequence[str]:
        """Sentences to be read with it."""
        ...


class SeriesLike(Protocol):
    """Errors of one strategy on one object; `grasptrack.bench.paper.run.Series` is one."""

    @property
    def object(self) -> str:
        """The object's name."""
        ...

    @property
    def strategy(self) -> str:
        """The strategy's name."""
        ...

    @property
    def kind(self) -> str:
        """How the contours came about, as "ideal" or "rendered"."""
        ...

    @property
    def motion(self) -> str:
        """What the camera did, as "4 DoF"."""
        ...

    @property
    def carried_on(self) -> bool:
        """Whether each frame was reached from the one before; else from the first."""
        ...

    @property
    def maximum_px(self) -> Sequence[float | None]:
        """Error of the worst contact by frame, from frame 1 on, px; None where there was no answer."""
        ...


def paper_report(
    folder: Path,
    tables: Sequence[TableLike],
    series: Sequence[SeriesLike] = (),
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
        series: error by frame, for the charts.
        pictures: caption and BGR picture; the first line of a caption stands out.
        title: of the page.
        lead: what a hurried reader takes away; `code` and **weight** are marked as in Markdown.
        facts: names and values: machine, versions, command.

    Returns:
        The path of the page.

    Raises:
        InputError: the folder cannot be written.
    """
    strategies = tuple(dict.fromkeys(s.strategy for s in series))
    page = Page(title, "grasptrack evaluation", strategies)
    if lead:
        page.lead(lead)
    if facts:
        page.facts(facts)
    if tables:
        page.section("Tables", "Rows of the paper stand beside ours where it prints any.")
    for table in tables:
        columns = [Column(name, words=_is_words(table, i)) for i, name in enumerate(table.head)]
        page.table(columns, table.rows, table.notes, f"**Table {table.number}.** {table.title}")
    try:
        figures = folder / "figures"
        figures.mkdir(exist_ok=True)
        if series:
            _add_charts(page, series, figures)
        shown = list(pictures)
        if shown:
            page.section("Pictures")
            page.pictures(shown)
        return page.write(folder / "report.html")
    except OSError as error:
        raise InputError(f'"{folder}" cannot be written: {error.strerror or error}', path=str(folder)) from error


def _add_charts(page: Page, series: Sequence[SeriesLike], figures: Path) -> None:
    """Error over the frames for each object and setting, and how often it stays below a limit."""
    values = [(s, np.array([np.nan if e is None else e for e in s.maximum_px], dtype=np.float64)) for s in series]
    settings = tuple(dict.fromkeys(_setting_name(s) for s in series))

    def keep(name: str, chart: Chart) -> str:
        svg = chart.svg()
        (figures / f"{make_slug(name)}.svg").write_text(
            standalone_svg(svg, page.series.values()) + "\n", encoding="utf-8"
        )
        return svg

    page.section(
        "Error over the frames",
        "The worst contact's distance from its true place. A line breaks where a strategy gave no answer.",
    )
    for setting in settings:
        here = [(s, v) for s, v in values if _setting_name(s) == setting]
        ends = log_range(np.concatenate([v for _, v in here]), 1e-3, 1e3, floor=10.0)
        parts = []
        for name in dict.fromkeys(s.object for s, _ in here):
            mine = [(s, v) for s, v in here if s.object == name]
            x = Axis("frame", 0.0, max(2.0, *(float(len(v)) for _, v in mine)))
            y = Axis("error, px", *ends, "log")
            chart = Chart(f"Error over the frames, {setting}, {name}", x, y, 340, 216, (40, 26, 10, 40))
            for s, v in mine:
                chart.line(np.arange(1, len(v) + 1), v, page.series[s.strategy])
            parts.append((name, "", keep(f"error-{setting}-{name}", chart)))
        page.heading(_capitalize_first(setting))
        page.figures(parts, "px, on one logarithmic scale for these charts.")
    page.section("Precision", "Over all objects; a frame without an answer counts as missed.")
    low, high = log_range(np.concatenate([v for _, v in values]), 1e-3, 1e3, floor=100.0)
    at, parts = np.geomspace(low, high, 141), []
    for setting in settings:
        x, y = Axis("error at most, px", low, high, "log"), Axis("share of frames", 0.0, 1.0, unit="%")
        chart = Chart(f"Precision, {setting}", x, y)
        for strategy in page.series:
            pooled = [v for s, v in values if _setting_name(s) == setting and s.strategy == strategy]
            if pooled:
                errors = np.concatenate(pooled)
                chart.line(at, cumulative_share(np.where(np.isnan(errors), np.inf, errors), at), page.series[strategy])
        parts.append((_capitalize_first(setting), "", keep(f"precision-{setting}", chart)))
    page.figures(parts, "Share of the frames whose worst contact is at most so far off.", large=True)
    page.table(*_error_table(values), caption="The same in numbers. Errors are over the frames answered.")


def _error_table(values: Sequence[tuple[SeriesLike, Floats]]) -> tuple[list[Column], list[Line]]:
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
        cells: list[Cell | str | float | int | None] = [
            strategy,
            setting,
            len(errors),
            Cell(format_percent(share), share),
        ]
        lines.append(Line([*cells, *(Cell(format_fixed(f, 3), f) for f in figures)], series=strategy))
    return columns, lines


def _setting_name(s: SeriesLike) -> str:
    return f"{s.kind} contours, {s.motion}, {'from frame to frame' if s.carried_on else 'from the first view'}"


def _capitalize_first(text: str) -> str:
    return text[:1].upper() + text[1:]


def _is_words(table: TableLike, column: int) -> bool:
    return column == 0 or not any(isinstance(row[column], int | float) for row in table.rows)
