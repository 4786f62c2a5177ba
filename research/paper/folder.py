# SPDX-License-Identifier: Apache-2.0
"""The folder of a run of the paper's tables: tables, every transfer behind them, a page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any

from grasptrack import kernels
from grasptrack.errors import InputError
from grasptrack.files import write_json
from grasptrack.io.results import software_versions
from grasptrack.typing import Floats
from grasptrack.view.drawing import png_bytes
from grasptrack_bench.report.table import Cell, to_csv, to_json, to_markdown, to_text, write_rows
from grasptrack_bench.run_folder import describe_machine
from research.paper.page import paper_report
from research.paper.run import PaperRun
from research.paper.runs import StrategyRun
from research.paper.transfers import Answer, Course

LEAD = (
    "Tables I to VII of Recatalá et al. (2008), rerun with three other objects, on ideal contours and on rendered images, by "
    "our transfers and by the paper's to the letter; and both on every built-in shape with several seeds. The printed values "
    "stand beside ours where there are any: **sizes compare, digits do not**, because the paper's objects are not at hand."
)
_SETTING = ("object", "contours", "motion", "strategy")
_CONTACTS = ("x1", "y1", "x2", "y2")
FRAME_HEAD = (*_SETTING, "way", "frame", *_CONTACTS, *(f"true_{c}" for c in _CONTACTS), "area_px2", "reason")
"""Columns of `frames.csv`: px; the area is the object's in that frame; a reason stands where the contacts are empty."""
RETURN_HEAD = (*_SETTING, "frame", *_CONTACTS, *(f"given_{c}" for c in _CONTACTS), "area_px2", "reason")
"""Columns of `returns.csv`: where the contacts came back to, and where they had been; the area is that of the first frame."""


def write_paper(folder: Path, run: PaperRun, *, options: Mapping[str, Any], command: str = "") -> Path:
    """Write `tables/*.csv`, `tables.txt`, `tables.md`, the rows behind them, `evaluation.json`, figures and `report.html`.

    The rows behind the tables are `frames.csv` (Table VII), `returns.csv` (Table VI) and `runs.csv` (Tables P, W, B, T, K, A,
    R and S). These files and the tables repeat to the last digit on one machine, to 1e-9 on another, but where rounding decides
    which of two pixels is nearer, or what ours makes of clipped outlines and of tilts near 60 degrees; times, versions and
    machine, in `times.csv`, `claims-times.csv` and `evaluation.json`, do not. Figures are SVG, the paper's `paper-*.png`.

    Returns:
        The path of the page.
    """
    made = software_versions()
    head = {"format": 1, "kind": "paper", "options": dict(options), "versions": made, "backend": kernels.BACKEND}
    series = [
        {
            **dict(zip(("object", "strategy", "kind", "motion", "way"), c.setting, strict=True)),
            "average_px": c.errors_px("average_px"),
            "maximum_px": c.errors_px("maximum_px"),
        }
        for c in run.courses
    ]
    try:
        for part in ("tables", "figures"):
            (folder / part).mkdir(exist_ok=True)
        for name, (_, picture) in run.figures:
            (folder / "figures" / f"{name}.png").write_bytes(png_bytes(picture))
        for table in run.tables:
            to_csv(table, folder / "tables" / f"{table.number}.csv")
        for table in (run.times, run.time_claims):
            to_csv(table, folder / f"{table.number}.csv")
        write_rows(folder / "frames.csv", FRAME_HEAD, frame_rows(run.courses))
        write_rows(folder / "returns.csv", RETURN_HEAD, _return_rows(run))
        write_rows(folder / "runs.csv", [f.name for f in fields(StrategyRun)], map(astuple, run.runs))
        shown = (*run.tables, run.times, run.time_claims)
        (folder / "tables.txt").write_text("\n".join(map(to_text, shown)), encoding="utf-8")
        (folder / "tables.md").write_text("\n".join(map(to_markdown, shown)), encoding="utf-8")
        tables = [to_json(table) for table in run.tables]
        told = {**head, "machine": describe_machine(), "command": command, "tables": tables, "series": series}
        write_json(folder / "evaluation.json", {**told, "times": to_json(run.times)})
    except OSError as error:
        raise InputError(f'"{folder}" cannot be written: {error.strerror or error}', path=str(folder)) from error
    software = ", ".join(f"{name} {made[name]}" for name in ("grasptrack", "python", "numpy", "opencv"))
    facts = [
        ("Machine", describe_machine()),
        ("Software", software),
        ("Kernels", kernels.BACKEND),
        ("Again", f"`{command}`"),
    ]
    pictures = (*(picture for _, picture in run.figures), *run.pictures)
    return paper_report(folder, shown, run.courses, pictures, lead=LEAD, facts=facts)


def frame_rows(courses: Iterable[Course]) -> Iterable[list[Cell]]:
    """Rows under `FRAME_HEAD`."""
    for c in courses:
        f = c.footage
        for k, answer in enumerate(c.answers, start=1):
            yield [
                *(f.part.name, f.kind, f.motion, c.strategy, c.way, k),
                *contacts_or_reason(answer, f.truth(c.strategy, k), float(f.areas[k])),
            ]


def _return_rows(run: PaperRun) -> Iterable[list[Cell]]:
    for r in run.returns:
        f = r.footage
        yield [
            *(f.part.name, f.kind, f.motion, r.strategy, r.frame),
            *contacts_or_reason(r.answer, f.contacts(r.strategy), float(f.areas[0])),
        ]


def contacts_or_reason(answer: Answer, wanted: Floats, area: float) -> list[Cell]:
    """Contacts found and wanted, the area, and why there are none."""
    truth = wanted.ravel().tolist()
    if isinstance(answer, str):
        return [*[None] * len(truth), *truth, area, answer]
    return [*answer.ravel().tolist(), *truth, area, ""]
