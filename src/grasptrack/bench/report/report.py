# SPDX-License-Identifier: Apache-2.0
"""The report of a run: its figures as files, and one HTML page that holds them all."""

from __future__ import annotations

from pathlib import Path

from grasptrack.bench.metrics.summary import summarise_run, write_summary
from grasptrack.bench.report.page import RunPage
from grasptrack.bench.report.paper_page import paper_report
from grasptrack.bench.report.worst_frames import Picture, Progress, Shown
from grasptrack.bench.run_folder import read_run
from grasptrack.errors import InputError

__all__ = ["FIGURES", "PAGE", "Picture", "Progress", "Shown", "paper_report", "write_report"]

FIGURES = "figures"
PAGE = "report.html"


def write_report(folder: Path, *, picture: Picture | None = None, progress: Progress | None = None) -> Path:
    """Write `summary.csv`, `summary.json`, `figures/*.svg` and `report.html` of a run.

    Args:
        folder: of the run.
        picture: gives what is to be shown of a frame; without it there are no pictures of the worst frames.
        progress: see `Progress`.

    Returns:
        The path of the HTML page.

    Raises:
        InputError: the run cannot be read, or the folder not be written to.
    """
    run = read_run(folder)
    summary = summarise_run(run)
    try:
        figures = folder / FIGURES
        figures.mkdir(exist_ok=True)
        for old in figures.glob("*.svg"):
            old.unlink()
        write_summary(folder, summary)
        return RunPage(run, summary, figures).build(picture, progress).write(folder / PAGE)
    except OSError as error:
        raise InputError(f'"{folder}" cannot be written: {error.strerror or error}', path=str(folder)) from error
