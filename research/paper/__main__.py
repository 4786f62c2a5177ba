# SPDX-License-Identifier: Apache-2.0
"""`python -m research.paper`: Tables I to VII of the paper, measured again."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from grasptrack.cli import help_groups, options
from grasptrack.cli.help_groups import option
from grasptrack.cli.main import run_app
from grasptrack.cli.terminal import with_progress
from grasptrack_bench import verbs

if TYPE_CHECKING:
    from grasptrack.typing import Progress
    from research.paper import PaperRun

PROGRAM = "python -m research.paper"

app = typer.Typer(
    name=PROGRAM,
    rich_markup_mode=None,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.command(cls=help_groups.GroupedCommand)
def paper(
    frames: Annotated[
        int | None,
        option(help_groups.SCENE, "N", "Number of frames of each synthetic path.", min=4, show_default="100"),
    ] = None,
    seeds: Annotated[
        int | None, option(help_groups.SCENE, "N", "Number of seeds of every shape.", min=1, show_default="10")
    ] = None,
    seed: verbs.Seed = 0,
    quick: Annotated[
        bool,
        option(
            help_groups.SCENE, None, "Short paths, four shapes, two seeds, where nothing else is asked for.", "--quick"
        ),
    ] = False,
    output: options.Output = options.OUTPUT_FOLDER / "evaluate-paper",
    quiet: options.Quiet = False,
    workers: verbs.Workers = None,
    scheduler: verbs.Scheduler = None,
) -> None:
    """Recompute Tables I to VII of the paper in the paper's form, next to the printed values where there are any.

    Our transfers and the paper's to the letter, on three objects and on every built-in shape with several seeds. The
    objects are not the paper's: orders of magnitude compare, digits do not. Ideal contours and rendered images. Then what
    the paper claims, and what came of it. Writes tables.txt, tables.md, tables/*.csv, frames.csv, returns.csv, runs.csv,
    times.csv, claims-times.csv, evaluation.json, figures and report.html.

    \b
    Examples:
      python -m research.paper
      python -m research.paper --quick --output short
    """
    from grasptrack_bench.report.table import to_text
    from grasptrack_bench.schedule import create_scheduler as schedule
    from research.paper import QUICK, Extent, run_paper
    from research.paper.folder import write_paper

    whole = QUICK if quick else Extent()
    extent = replace(whole, frames=frames or whole.frames, seeds=seeds or whole.seeds, seed=seed)
    work = schedule(scheduler, workers)

    def run_and_write(tell: Progress) -> tuple[PaperRun, Path]:
        run = run_paper(extent, schedule=work, progress=tell)
        return run, write_paper(
            output, run, options=asdict(extent), command=shlex.join([*PROGRAM.split(), *sys.argv[1:]])
        )

    run, report = with_progress(output, quiet, run_and_write)
    if not quiet:
        typer.echo("\n".join([*(to_text(table) for table in (*run.tables, run.times, run.time_claims)), str(report)]))


if __name__ == "__main__":
    sys.exit(run_app(app, sys.argv[1:], PROGRAM))
