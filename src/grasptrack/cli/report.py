# SPDX-License-Identifier: Apache-2.0
"""Progress while a verb runs, and the table that closes it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from grasptrack.cli.terminal import held_warnings

if TYPE_CHECKING:
    from grasptrack.io.tally import RunSummary

STATUS_STYLE = {"tracked": "green", "unstable": "yellow", "lost": "red", "searching": "bright_black"}


class Progress:
    """A bar with frames/s, on a terminal only: output that goes to a file or a program stays clean.

    Args:
        quiet: show none.
    """

    def __init__(self, quiet: bool) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as RichProgress
        from rich.text import Text

        class Speed(ProgressColumn):
            def render(self, task: Any) -> Text:
                speed = task.finished_speed or task.speed
                return Text("" if speed is None else f"{speed:.0f} frames/s", style="cyan")

        console = Console()
        self._shown = console.is_terminal and not quiet
        self._progress = RichProgress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            Speed(),
            TimeRemainingColumn(compact=True),
            console=console,
            transient=True,
            disable=not self._shown,
        )
        self._tasks: dict[str, Any] = {}

    def __enter__(self) -> Progress:
        """Begin to show."""
        if self._shown:
            self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Clear the bar away."""
        if self._shown:
            self._progress.stop()

    def tell(self, step: str, done: int, total: int | None) -> None:
        """`done` of `total` frames of a step are ready; a total that turns out too small grows along."""
        if not self._shown:
            return
        if step not in self._tasks:
            self._tasks[step] = self._progress.add_task(step, total=total)
        known = None if total is None else max(total, done)
        self._progress.update(self._tasks[step], completed=done, total=known)


def show_run(summary: RunSummary, output: Path, notes: Iterable[str] = ()) -> None:
    """The closing table of a run: frames, statuses and why, latency, speed, files; and lines of text below it."""
    from rich.console import Console
    from rich.markup import escape

    table = _summary_table("", "", "")
    table.add_row("frames", str(summary.frames), "")
    for status, count in summary.counts.items():
        share = f"{100.0 * count / summary.frames:.1f} %" if summary.frames else ""
        table.add_row(f"[{STATUS_STYLE[status]}]{status}[/]", str(count), share)
        for reason, times in list(summary.reasons.get(status, {}).items())[:4]:
            table.add_row("", "", f"[dim]{times} x[/dim] {escape(reason)}")
    used = ", ".join(f"{name} ({count})" for name, count in summary.strategies.items())
    if used:
        table.add_row("strategy", "", used)
    if math.isfinite(summary.chance_least):
        chance = f"mean {100.0 * summary.chance_mean:.1f} %, least {100.0 * summary.chance_least:.1f} %"
        table.add_row("chance to close", "", chance)
    if math.isfinite(summary.latency_median_ms):
        latency = f"median {summary.latency_median_ms:.2f} ms, 99th percentile {summary.latency_p99_ms:.2f} ms"
        table.add_row("latency", "", latency)
    table.add_row("speed", "", f"{summary.frames_per_s:.0f} frames/s with reading, drawing and writing")
    console = Console(highlight=False)
    console.print(table)
    for note in notes:
        console.print(f"  {escape(note)}", soft_wrap=True)
    console.print(f"  {escape(str(output))}: {', '.join(summary.files)}", soft_wrap=True)
    _print_warnings(console)


def show_rows(
    title: str,
    heads: Sequence[tuple[str, str]],
    rows: Sequence[Sequence[str]],
    notes: Iterable[str] = (),
    *,
    optional: int = 0,
) -> None:
    """A table of short cells, and lines of text below it. Where the output is no terminal it is as wide as it needs.

    Args:
        title: above it.
        heads: name and alignment, "left" or "right", of each column.
        rows: cells, which are printed as they are and not wrapped.
        notes: the lines.
        optional: so many of the last columns are left out where a terminal has no room for all.
    """
    from rich.console import Console
    from rich.markup import escape

    console = Console(highlight=False)
    table = _result_table(title, heads, rows)
    wide = console.options.update_width(10_000)
    if not console.is_terminal:
        console.width = max(console.width, console.measure(table, options=wide).maximum)
    elif optional and console.measure(table, options=wide).maximum > console.width:
        table = _result_table(title, heads[:-optional], [row[:-optional] for row in rows])
    console.print(table)
    for note in notes:
        console.print(escape(note), soft_wrap=True)
    _print_warnings(console)


def _result_table(title: str, heads: Iterable[tuple[str, str]], rows: Iterable[Iterable[str]]) -> Any:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, collapse_padding=True, pad_edge=False)
    for name, justify in heads:
        table.add_column(name, justify="right" if justify == "right" else "left", no_wrap=True)
    for row in rows:
        table.add_row(*(escape(cell) for cell in row))
    return table


def _print_warnings(console: Any) -> None:
    from rich.markup import escape

    for message in held_warnings():
        console.print(f"  [yellow]warning:[/yellow] {escape(message)}", soft_wrap=True)


def _summary_table(*heads: str) -> Any:
    from rich.table import Table

    table = Table(box=None, show_header=False, pad_edge=True, padding=(0, 1))
    for i, head in enumerate(heads):
        table.add_column(head, justify="right" if i == 1 else "left", overflow="fold")
    return table
