# SPDX-License-Identifier: Apache-2.0
"""A run in a few columns: for the terminal, and as Markdown for a page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from grasptrack.bench.metrics.summary import Row, Summary, summarise_run
from grasptrack.bench.run_folder import read_run

HEADS = (
    ("method", "left"),
    ("located %\nwhole", "right"),
    ("\npartly", "right"),
    ("wrong\nframes", "right"),
    ("\nbelow %", "right"),
    ("error px\nmedian", "right"),
    ("\n95 %", "right"),
    ("\nRMS", "right"),
    ("ms\nmedian", "right"),
    ("\n99 %", "right"),
    ("frames", "right"),
)


VIDEO_HEADS = (
    ("video", "left"),
    ("method", "left"),
    ("frames\nwhole", "right"),
    ("located %\nof these", "right"),
    ("wrong\nframes", "right"),
    ("error px\nmedian", "right"),
    ("\n95 %", "right"),
    ("ms\nmedian", "right"),
)


def closing_table(folder: Path) -> tuple[Sequence[tuple[str, str]], list[list[str]]]:
    """Heads with their alignment, and a row for each method over all cases; of videos also one for each method and video.

    Raises:
        InputError: the run cannot be read.
    """
    run = read_run(folder)
    summary = summarise_run(run)
    if run.kind == "real":
        rows = sorted(summary.by_level, key=lambda row: summary.levels.index(row.level))
        return VIDEO_HEADS, [_of_video(row) for row in (*rows, *summary.overall)]
    return HEADS, [[row.method, *_row_cells(row)] for row in summary.overall]


def to_markdown(summary: Summary) -> str:
    """Two tables: methods over all cases; and for each disturbance or video located %, wrong frames and RMS."""
    heads = ["method", "located %, whole", "partly", "wrong frames", "rate below %"]
    heads += ["median px", "95 %", "RMS", "median ms", "99 %", "frames"]
    lines = [_markdown_row(heads), _markdown_row(["---"] * len(heads))]
    lines += [_markdown_row([f"`{row.method}`", *_row_cells(row)]) for row in summary.overall]
    heads = [summary.factor, *(f"`{name}`" for name in summary.methods)]
    lines += ["", _markdown_row(heads), _markdown_row(["---"] * len(heads))]
    for level in summary.levels:
        rows = [summary.row(name, level) for name in summary.methods]
        lines.append(_markdown_row([level, *("" if row is None else _short_cell(row) for row in rows)]))
    return "\n".join(lines) + "\n"


def _row_cells(row: Row) -> list[str]:
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


def _of_video(row: Row) -> list[str]:
    m = row.measures
    return [
        row.level,
        row.method,
        str(m.frames_whole),
        _format_percent(m.located_whole),
        str(m.false_accepts),
        *(_format_number(v) for v in (m.median_px, m.p95_px)),
        _format_number(m.median_ms, 1),
    ]


def _short_cell(row: Row) -> str:
    m = row.measures
    return f"{_format_percent(row.located, 0)} / {m.false_accepts} / {_format_number(m.rms_px)}"


def _format_percent(value: float, decimals: int = 1) -> str:
    return _format_number(100.0 * value, decimals)


def _format_number(value: float, decimals: int = 2) -> str:
    return f"{value:.{decimals}f}" if math.isfinite(value) else "-"


def _markdown_row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
