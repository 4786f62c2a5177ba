# SPDX-License-Identifier: Apache-2.0
"""The folder of a rerun of the paper's tables."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from grasptrack import kernels
from grasptrack.bench.paper import PaperRun
from grasptrack.bench.report.paper_page import paper_report
from grasptrack.bench.report.table import to_csv, to_json, to_markdown, to_text
from grasptrack.errors import InputError
from grasptrack.io.results import describe_machine, software_versions, write_json

LEAD = (
    "Tables I to VII of Recatalá et al. (2008), rerun with three other objects, on ideal contours and on rendered images. "
    "The printed values stand beside ours where there are any: **sizes compare, digits do not**, because the paper's "
    "objects are not at hand."
)


def write_paper(folder: Path, run: PaperRun, *, options: Mapping[str, Any], command: str = "") -> Path:
    """Write `tables.txt`, `tables.md`, `tables/*.csv`, `evaluation.json`, figures and `report.html`.

    Args:
        folder: that is there.
        run: of the tables.
        options: what was asked for.
        command: that repeats it.

    Returns:
        The path of the page.

    Raises:
        InputError: the folder cannot be written.
    """
    made = software_versions()
    head = {"format": 1, "kind": "paper", "options": dict(options), "versions": made, "backend": kernels.BACKEND}
    series = [
        {
            **{name: getattr(s, name) for name in ("object", "strategy", "kind", "motion", "carried_on")},
            "average_px": list(s.average_px),
            "maximum_px": list(s.maximum_px),
        }
        for s in run.series
    ]
    try:
        (folder / "tables").mkdir(exist_ok=True)
        for table in run.tables:
            to_csv(table, folder / "tables" / f"{table.number}.csv")
        (folder / "tables.txt").write_text("\n".join(map(to_text, run.tables)), encoding="utf-8")
        (folder / "tables.md").write_text("\n".join(map(to_markdown, run.tables)), encoding="utf-8")
        tables = [to_json(table) for table in run.tables]
        told = {**head, "machine": describe_machine(), "command": command, "tables": tables, "series": series}
        write_json(folder / "evaluation.json", told)
    except OSError as error:
        raise InputError(f'"{folder}" cannot be written: {error.strerror or error}', path=str(folder)) from error
    software = ", ".join(f"{name} {made[name]}" for name in ("grasptrack", "python", "numpy", "opencv"))
    facts = [
        ("Machine", describe_machine()),
        ("Software", software),
        ("Kernels", kernels.BACKEND),
        ("Again", f"`{command}`"),
    ]
    return paper_report(folder, run.tables, run.series, run.pictures, lead=LEAD, facts=facts)
