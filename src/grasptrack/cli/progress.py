# SPDX-License-Identifier: Apache-2.0
"""Work that shows a bar, and that Ctrl-C ends between two steps."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import typer

from grasptrack.cli.terminal import INTERRUPTED, Interruption, tell_error

T = TypeVar("T")
Tell = Callable[[str, int, int], None]
"""Called with the name of the step, what is done of it, and all of it."""


def with_progress(output: Path, quiet: bool, work: Callable[[Tell], T], *, again: str = "") -> T:
    """What `work` returns. Ctrl-C ends it with exit status 130, with the files whole.

    Args:
        output: where the results are, for the message.
        quiet: show no bar.
        work: called with what tells of progress.
        again: what the same command would do, for the message.
    """
    from grasptrack.cli.report import Progress

    with Interruption() as interruption:
        try:
            with Progress(quiet) as bar:

                def tell(step: str, done: int, total: int) -> None:
                    bar.tell(step, done, total)
                    interruption.check()

                return work(tell)
        except KeyboardInterrupt:
            tell_error(f'interrupted; what was computed is in "{output}"{again}')
            raise typer.Exit(INTERRUPTED) from None


def command_line() -> str:
    """The command line that was given, for a shell."""
    return shlex.join(["grasptrack", *sys.argv[1:]])
