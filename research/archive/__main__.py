# SPDX-License-Identifier: Apache-2.0
"""`python -m research.archive`: all that Tables I to VII are made of, in a folder that can be deposited."""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

from grasptrack.geometry.contours import View
from grasptrack.io.results import software_versions
from grasptrack.typing import Floats
from grasptrack_bench.baselines.paper import Seen
from grasptrack_bench.report.table import Cell, to_csv, write_rows
from research.archive import score
from research.paper import printed
from research.paper.correspondences import Correspondences
from research.paper.folder import FRAME_HEAD, contacts_or_reason, frame_rows
from research.paper.footage import FRAMES, MOTIONS
from research.paper.objects import ObjectRuns, run_objects, tables_of_objects
from research.paper.run import LEAST_FRAMES

HERE = Path(__file__).parent
HOMOGRAPHY_HEAD = ("frame", *(f"h{i}{j}" for i in "123" for j in "123"))
OUTLINE_HEAD = ("frame", "contour", "x", "y")
_ENDS = ("x1", "y1", "x2", "y2")
DESCRIPTION_HEAD = (
    *("table", "object", "contours", "motion", "transfer", "frame", "outline"),
    *(*_ENDS, *(f"true_{c}" for c in _ENDS)),
)
CORRESPONDENCE_HEAD = (
    *("object", "contours", "motion", "transfer", "frame", "sample", "match", "x", "y"),
    *(*_ENDS, *(f"given_{c}" for c in _ENDS)),
)


def write_archive(folder: Path, told: ObjectRuns) -> None:
    """Write contours, homographies, transfers, tables, the scorer, and what a deposit needs; README.md says what is where."""
    contours, tables = folder / "contours", folder / "tables"
    for made in (contours, tables):
        made.mkdir(parents=True, exist_ok=True)
    for f in told.footage:
        name = "-".join((f.part.name, f.kind, f.motion)).replace(" ", "-")
        moves = ([k, *h] for k, h in enumerate(f.H.reshape(-1, 9).tolist()))
        write_rows(contours / f"{name}-homographies.csv", HOMOGRAPHY_HEAD, moves)
        for outline, seen in (("extracted", f.silhouettes), ("tracked", f.tracked)):
            write_rows(contours / f"{name}-{outline}.csv", OUTLINE_HEAD, _outline_rows(seen))
    for part in told.parts:
        write_rows(contours / f"{part.name}-exact.csv", OUTLINE_HEAD, _point_rows(0, part.curves))
    for table in (t for t in tables_of_objects(told) if t.number != "VII"):  # pooled, and none of the paper's
        to_csv(table, tables / f"{table.number}.csv")
    write_rows(folder / "transfers.csv", ("table", *FRAME_HEAD), _transfer_rows(told))
    write_rows(folder / "descriptions.csv", DESCRIPTION_HEAD, _description_rows(told))
    write_rows(folder / "correspondences.csv", CORRESPONDENCE_HEAD, _correspondence_rows(told))
    shutil.copyfile(score.__file__, folder / "score.py")
    shutil.copyfile(HERE / "README.md", folder / "README.md")
    deposit = json.loads((HERE / "zenodo.json").read_text(encoding="utf-8"))
    deposit["version"] = software_versions()["grasptrack"]
    (folder / ".zenodo.json").write_text(json.dumps(deposit, indent=2) + "\n", encoding="utf-8")


def _outline_rows(seen: Sequence[Seen]) -> Iterator[Sequence[Cell]]:
    """Frames without an outline have no rows."""
    for k, view in enumerate(seen):
        if isinstance(view, View):
            yield from _point_rows(k, [c.points for c in view.contours])


def _point_rows(frame: int, contours: Sequence[Floats]) -> Iterator[Sequence[Cell]]:
    for c, points in enumerate(contours):
        yield from ([frame, c, *p] for p in points.tolist())


def _transfer_rows(told: ObjectRuns) -> Iterator[list[Cell]]:
    """Transfers there and back (Table VI), then along the trajectories (Table VII), each with its table's number."""
    for r in told.returns:
        f = r.footage
        setting = (
            f"VI-{MOTIONS.index(f.motion) + 1}",
            f.part.name,
            f.kind,
            f.motion,
            r.strategy,
            "there and back",
            r.frame,
        )
        yield [*setting, *contacts_or_reason(r.answer, f.contacts(r.strategy), float(f.areas[0]))]
    groups = list(dict.fromkeys((f.motion, f.kind) for f in told.footage))
    for c in told.courses:
        number = f"VII-{groups.index((c.footage.motion, c.footage.kind)) + 1}"
        yield from ([number, *row] for row in frame_rows([c]))


def _description_rows(told: ObjectRuns) -> Iterator[list[Cell]]:
    """Grasps to be described in the views of Tables I, III and IV, in the order of their rows."""
    found = {c.setting: c.answers[told.frame - 1] for c in told.courses}
    for f in told.examples:
        if f.kind == "resampled":
            given = f.on_silhouette.ravel().tolist()
            yield ["I", f.part.name, f.kind, f.motion, "ours", 0, "extracted", *given, *given]
    for number, column, outline in (("III", 0, "tracked"), ("IV", 1, "extracted")):
        for f in told.examples:
            for transfer, strategies in printed.TRANSFERS.items():
                strategy = strategies[column]
                moved = found[f.part.name, strategy, f.kind, f.motion, "first view"]
                if isinstance(moved, str):
                    continue
                for frame, contacts in ((0, f.contacts(strategy)), (told.frame, moved)):
                    ends = contacts.ravel().tolist(), f.truth(strategy, frame).ravel().tolist()
                    yield [number, f.part.name, f.kind, f.motion, transfer, frame, outline, *ends[0], *ends[1]]


def _correspondence_rows(told: ObjectRuns) -> Iterator[list[Cell]]:
    """The four correspondences of each pair of Tables II and V, with the grasp that they carry."""
    for c in told.pairs:
        if isinstance(c, Correspondences):
            f, ends = c.footage, (*c.refined.ravel().tolist(), *c.footage.on_silhouette.ravel().tolist())
            for i, j, place in zip(*c.samples, c.points[1].tolist(), strict=True):
                yield [f.part.name, f.kind, f.motion, c.transfer, c.frame, i, j, *place, *ends]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the three objects, write the archive, and score it."""
    parser = argparse.ArgumentParser(prog="python -m research.archive", description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("grasptrack-out/archive"), help="folder of the archive")
    parser.add_argument("--frames", type=int, default=FRAMES, help=f"of each trajectory, at least {LEAST_FRAMES}")
    parser.add_argument("--seed", type=int, default=0, help="of trajectories, noise and starts of contours")
    args = parser.parse_args(arguments)
    if args.frames < LEAST_FRAMES:
        parser.error(f"at least {LEAST_FRAMES} frames are needed, not {args.frames}")
    write_archive(args.output, run_objects(args.frames, args.seed))
    worst = max(score.score(args.output).values())
    print(f"{args.output}: Tables I to VII worked out anew are equal to {worst:.0e}")


if __name__ == "__main__":
    main()
