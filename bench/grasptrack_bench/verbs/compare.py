# SPDX-License-Identifier: Apache-2.0
"""`grasptrack compare`: two evaluations side by side, and what got worse."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from grasptrack.cli import help_groups, options
from grasptrack.cli.help_groups import option_or
from grasptrack.cli.terminal import tell_line

WORSE = 1
"""Exit status with --strict where something got worse."""


def compare(
    before: Annotated[Path, typer.Argument(metavar="A", help="Folder of the first evaluation.")],
    after: Annotated[Path, typer.Argument(metavar="B", help="Folder of the second, of the same kind.")],
    output: Path | None = option_or(None, help_groups.OUTPUT, "FILE", "Also write the comparison as an HTML page."),
    quiet: options.Quiet = False,
    strict: bool = option_or(
        False, help_groups.LIMITS, None, "Exit with status 1 if anything got worse by more than its noise.", "--strict"
    ),
) -> None:
    """Compare two evaluations case by case, and say what got worse from A to B by more than its noise.

    \b
    Examples:
      grasptrack compare grasptrack-out/evaluate-scenes new
      grasptrack compare old new --output compare.html --strict
    """
    from grasptrack_bench.report.comparison import compare_runs as put_together
    from grasptrack_bench.report.comparison_page import comparison_lines, write_comparison

    found = put_together(before, after)
    if output is not None:
        write_comparison(found, output)
    if not quiet:
        for line in comparison_lines(found):
            tell_line(line)
    if strict and found.worse:
        raise typer.Exit(WORSE)
