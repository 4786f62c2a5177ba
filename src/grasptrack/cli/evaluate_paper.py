# SPDX-License-Identifier: Apache-2.0
"""`grasptrack evaluate paper`: Tables I to VII again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from grasptrack.cli import options
from grasptrack.cli.progress import command_line, with_progress

if TYPE_CHECKING:
    from grasptrack.bench import Progress
    from grasptrack.bench.paper import PaperRun


def paper(
    output: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the results; written over.")] = Path(
        "evaluation-paper"
    ),
    frames: Annotated[int, typer.Option(metavar="N", min=4, help="Frames of the synthetic path.")] = 100,
    seed: Annotated[int, typer.Option(metavar="S", min=0, help="Of the path, light and noise.")] = 0,
    quiet: options.Quiet = False,
) -> None:
    """Rerun Tables I to VII of the paper in the paper's form, beside the printed values where there are any.

    Three objects, others than the paper's: sizes compare, digits do not. On ideal contours and on rendered images.
    Writes tables.txt, tables.md, tables/*.csv, evaluation.json, figures and report.html.

    \b
    Examples:
      grasptrack evaluate paper
      grasptrack evaluate paper --frames 40 --output short
    """
    from grasptrack.bench.paper import run_paper
    from grasptrack.bench.paper.run import write_paper
    from grasptrack.bench.report.table import to_text
    from grasptrack.io.run import prepare_folder

    prepare_folder(output)

    def work(tell: Progress) -> tuple[PaperRun, Path]:
        run = run_paper(frames=frames, seed=seed, progress=tell)
        return run, write_paper(output, run, options={"frames": frames, "seed": seed}, command=command_line())

    run, report = with_progress(output, quiet, work)
    if not quiet:
        typer.echo("\n".join([*(to_text(table) for table in run.tables), str(report)]))
