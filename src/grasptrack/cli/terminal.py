# SPDX-License-Identifier: Apache-2.0
"""What the terminal shows: our own lines alone, progress, the closing table, and Ctrl-C when the files are whole."""

from __future__ import annotations

import atexit
import contextlib
import math
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, TypeVar

from grasptrack.errors import one_line

if TYPE_CHECKING:
    from grasptrack.io.results import RunSummary
    from grasptrack.typing import Progress


INTERRUPTED = 130
"""Exit status after Ctrl-C."""

_held: list[str] = []
_final: list[int] = []  # the status, once all is done


def _ending_signals() -> list[signal.Signals]:
    """Signals that end a run in good order: Ctrl-C, SIGTERM, and a terminal that is closed, unless nohup has that ignored."""
    known = (signal.Signals[name] for name in ("SIGINT", "SIGTERM", "SIGHUP") if name in signal.Signals.__members__)
    return [n for n in known if n.name != "SIGHUP" or signal.getsignal(n) != signal.SIG_IGN]


class RunInterruptedError(Exception):
    """Ctrl-C or SIGTERM ended a run whose files are whole; the message says where they are."""


@contextlib.contextmanager
def signals_as_interrupts() -> Iterator[threading.Event]:
    """Ctrl-C, SIGTERM and SIGHUP raise KeyboardInterrupt, where Python lets us: in the main thread.

    Some C code makes an error of its own of an exception that strikes within it, as the loading of a module does; what is
    yielded is set where it was a signal.
    """
    struck = threading.Event()

    def raise_interrupt(number: int, frame: FrameType | None) -> None:
        struck.set()
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield struck
        return
    before = {number: signal.signal(number, raise_interrupt) for number in _ending_signals()}
    try:
        yield struck
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def end_process(status: int) -> None:
    """From here on Ctrl-C and SIGTERM keep the work's status; one that came before ends the process at once."""
    if status == INTERRUPTED:  # Python's teardown fails on what a signal left half imported
        _leave(status)
    if threading.current_thread() is threading.main_thread():
        for number in _ending_signals():
            signal.signal(number, lambda *_: os._exit(status))
        # Last of all Python takes handlers of its own away, and a signal would kill: one that is ignored stays so.
        atexit.register(lambda: [signal.signal(n, signal.SIG_IGN) for n in _ending_signals()])
        _final.append(status)


def _leave(status: int) -> None:
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
    os._exit(status)


@atexit.register  # now, so that it comes after what others do at the end
def _leave_threads() -> None:
    """A thread that is at work in C++ still, as a search nobody waits for, would make Python's teardown abort."""
    if _final and any(thread.daemon for thread in threading.enumerate()):
        _leave(_final[0])


def tell_error(message: str) -> None:
    """One line on stderr."""
    print(one_line(f"grasptrack: {message.strip()}"), file=sys.stderr, flush=True)


def tell_line(text: str) -> None:
    """One line on the standard output."""
    print(one_line(text), flush=True)


def _table_console() -> Any:
    """Where tables are printed; whatever their cells hold, each is a line that fits."""
    from rich.console import Console

    class FittedConsole(Console):
        def render_str(self, text: str, **more: Any) -> Any:
            return super().render_str(one_line(text), **more)

    return FittedConsole(highlight=False)


@contextlib.contextmanager
def only_our_errors() -> Iterator[None]:
    """Keep what C libraries write to stderr while they decode a bad image from hiding the one line that names it."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: _held.append(str(message))
        if os.environ.get("GRASPTRACK_DEBUG") not in (None, "", "0") or not _is_process_stderr():
            yield
            return
        import logging

        nobody, before = logging.NullHandler(), threading.excepthook
        logging.getLogger().addHandler(nobody)  # without any, Python prints what libraries log
        threading.excepthook = lambda args: _held.append(f"internal error, {args.exc_type.__name__}: {args.exc_value}")
        sys.stderr.flush()
        kept, ours = sys.stderr, os.dup(2)
        with open(os.devnull, "wb") as nowhere, open(ours, "w", encoding=kept.encoding, errors="replace") as stream:  # noqa: PTH123
            os.dup2(nowhere.fileno(), 2)
            sys.stderr = stream
            try:
                yield
            finally:
                stream.flush()
                os.dup2(ours, 2)
                sys.stderr = kept
                threading.excepthook = before
                logging.getLogger().removeHandler(nobody)


def _is_process_stderr() -> bool:
    try:
        return sys.stderr.fileno() == 2
    except (OSError, ValueError, AttributeError):
        return False


def held_warnings() -> list[str]:
    """Warnings since the last call. They are kept for the closing table: stderr is for errors, and quiet is quiet."""
    messages = list(dict.fromkeys(_held))
    _held.clear()
    return messages


class Interruption:
    """Ctrl-C, SIGTERM or SIGHUP, held back until a frame is finished; a second one strikes at once.

    `raise_if_pressed` raises KeyboardInterrupt when it was pressed.
    """

    def __init__(self) -> None:
        self._pressed = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interruption:
        """Take over the signals, where Python lets us: in the main thread."""
        if threading.current_thread() is threading.main_thread():
            self._before = {s: signal.signal(s, self._on_signal) for s in _ending_signals()}
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self._pressed:
            raise KeyboardInterrupt
        self._pressed = True

    def raise_if_pressed(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C was pressed; to be called where nothing is half done."""
        if self._pressed:
            raise KeyboardInterrupt


STATUS_STYLE = {"tracked": "green", "unstable": "yellow", "lost": "red", "searching": "bright_black"}


class ProgressBar:
    """A bar with frames/s, on a terminal only: output that goes to a file or a program stays clean."""

    def __init__(self, quiet: bool) -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as RichProgress
        from rich.text import Text

        class Speed(ProgressColumn):
            def render(self, task: Any) -> Text:
                speed = task.finished_speed or task.speed
                return Text("" if speed is None else f"{speed:.0f} frames/s", style="cyan")

        console = _table_console()
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

    def __enter__(self) -> ProgressBar:
        if self._shown:
            self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._shown:
            self._progress.stop()

    def print(self, lines: Iterable[str]) -> None:
        """Lines of text above the bar, or, without one, on the standard output."""
        for line in lines:
            self._progress.console.print(line, soft_wrap=True, markup=False, highlight=False)

    def show_progress(self, step: str, done: int, total: int | None) -> None:
        """`done` of `total` frames of a step are ready; a total that turns out too small grows along."""
        if not self._shown:
            return
        if step not in self._tasks:
            self._tasks[step] = self._progress.add_task(step, total=total)
        known = None if total is None else max(total, done)
        self._progress.update(self._tasks[step], completed=done, total=known)


def show_run(summary: RunSummary, output: Path, notes: Iterable[str] = ()) -> None:
    """The closing table of a run: frames, statuses and why, latency, speed, files; and lines of text below it."""
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, show_header=False, pad_edge=True, padding=(0, 1))
    for justify in ("left", "right", "left"):
        table.add_column(justify=justify, overflow="fold")
    table.add_row("frames", str(summary.frames), "")
    for status, count in summary.counts.items():
        share = f"{100.0 * count / summary.frames:.1f} %" if summary.frames else ""
        table.add_row(f"[{STATUS_STYLE[status]}]{status}[/]", str(count), share)
        for reason, times in list(summary.reasons.get(status, {}).items())[:4]:
            table.add_row("", "", f"[dim]{times} x[/dim] {escape(reason)}")
    used = ", ".join(f"{name} ({count})" for name, count in summary.strategies.items())
    if used:
        table.add_row("strategy", "", used)
    for switch, times in list(summary.switches.items())[:4]:
        table.add_row("", "", f"[dim]{times} x[/dim] {escape(switch)}")
    if math.isfinite(summary.chance_least):
        chance = f"mean {100.0 * summary.chance_mean:.1f} %, least {100.0 * summary.chance_least:.1f} %"
        table.add_row("chance to close", "", chance)
    if math.isfinite(summary.latency_median_ms):
        latency = f"median {summary.latency_median_ms:.2f} ms, 99th percentile {summary.latency_p99_ms:.2f} ms"
        table.add_row("latency", "", latency)
    table.add_row("speed", "", f"{summary.frames_per_s:.0f} frames/s with reading, drawing and writing")
    console = _table_console()
    console.print(table)
    for note in notes:
        console.print(f"  {escape(note)}", soft_wrap=True)
    console.print(f"  {escape(str(output))}: {', '.join(summary.files)}", soft_wrap=True)
    _print_warnings(console)


def show_rows(
    title: str,
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    notes: Iterable[str] = (),
    *,
    optional: int = 0,
) -> None:
    """A table of short cells, and lines of text below it. Where the output is no terminal it is as wide as it needs.

    Heads are names, with "<" before those of columns that begin at the left; cells are printed as they are and not wrapped. So
    many of the last columns are `optional`: left out where a terminal has no room for all.
    """
    from rich.markup import escape

    console = _table_console()
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


def _result_table(title: str, heads: Iterable[str], rows: Iterable[Iterable[str]]) -> Any:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, collapse_padding=True, pad_edge=False)
    for head in heads:
        table.add_column(head.removeprefix("<"), justify="left" if head.startswith("<") else "right", no_wrap=True)
    for row in rows:
        table.add_row(*(escape(cell) for cell in row))
    return table


def _print_warnings(console: Any) -> None:
    from rich.markup import escape

    for message in held_warnings():
        console.print(f"  [yellow]warning:[/yellow] {escape(message)}", soft_wrap=True)


T = TypeVar("T")


def with_progress(output: Path, quiet: bool, work: Callable[[Progress], T], *, again: str = "") -> T:
    """What `work` returns, called with what tells of progress. Ctrl-C ends it with exit status 130, with the files whole.

    No other run writes to the folder meanwhile; `again` is what the same command would do, for the message.
    """
    from grasptrack.files import hold_folder

    with Interruption() as interruption, hold_folder(output):
        try:
            with ProgressBar(quiet) as bar:

                def report_progress(step: str, done: int, total: int) -> None:
                    bar.show_progress(step, done, total)
                    interruption.raise_if_pressed()

                return work(report_progress)
        except KeyboardInterrupt:
            raise RunInterruptedError(f'interrupted; what was computed is in "{output}"{again}') from None


def format_number(value: float, decimals: int = 2) -> str:
    """A number for a table; a hyphen for what is not finite."""
    return f"{value:.{decimals}f}" if math.isfinite(value) else "-"
