# SPDX-License-Identifier: Apache-2.0
"""What the studies share: the clock, the machine, tables, the file of results."""

from __future__ import annotations

import argparse
import csv
import gc
import json
import os
import platform
import re
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np

from grasptrack import kernels
from grasptrack.segmentation.silhouettes import trace_silhouettes
from grasptrack.typing import Bools, Floats, Pixels
from grasptrack_bench.method import Maker, MethodStart, chosen_grasp
from grasptrack_bench.metrics.mask_agreement import ENOUGH_F, ENOUGH_IOU, boundary_f, intersection_over_union, mask_of
from grasptrack_bench.metrics.score import Score, Truth
from grasptrack_bench.run_folder import describe_machine
from grasptrack_bench.simulation import SceneFrame

cv2.setNumThreads(1)

COMMAND = "python -m research.studies"
PREFACE = f"""# Results of the studies

Written by the studies themselves, each its own section with the command above it: `{COMMAND}.NAME --output
docs/tables/studies.md`. What they answer is in [evaluation.md](../evaluation.md#studies)."""

Case = TypeVar("Case")
Outcome = TypeVar("Outcome")

_sections: list[tuple[str, list[str]]] = []  # title and paragraphs of what was shown so far


# --- options, data, work -------------------------------------------------------------------------


def create_parser(description: str | None, **defaults: int | str) -> argparse.ArgumentParser:
    """Options of a study: the one that they all have, and those that their default alone describes."""
    made = argparse.ArgumentParser(description=description)
    made.add_argument("--output", type=Path, help="Markdown file in which the sections of this study are written anew")
    for name, default in defaults.items():
        made.add_argument(f"--{name}", type=type(default), default=default)
    return made


def data_folder() -> Path:
    """Where photos, videos and silhouettes lie: GRASPTRACK_DATA, or ../shared/data beside the repository."""
    given = os.environ.get("GRASPTRACK_DATA")
    return Path(given) if given else Path(__file__).resolve().parents[3] / "shared" / "data"


@dataclass(frozen=True)
class Photo:
    """A photo of one tool, of a kind and in a scene, its true mask, and the outline of all of it where that is known."""

    name: str
    kind: str
    scene: str
    image: Pixels
    truth: Bools
    outline: Sequence[Floats] = ()

    def contacts(self) -> Floats:
        """(k, 2) px, a grasp on it."""
        shape = trace_silhouettes(self.truth.astype(np.uint8))[0]
        return chosen_grasp(self.outline or [chain.astype(np.float64) for chain in (shape.outer, *shape.holes)])

    def deepest(self) -> tuple[float, float]:
        """(x, y) px of the mask's pixel that is farthest from all that is not of it: where a user would point."""
        padded = np.pad(self.truth, 1).astype(np.uint8)
        depth = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
        y, x = np.unravel_index(int(np.argmax(depth)), self.truth.shape)
        return float(x), float(y)


def parse_with_photos(parser: argparse.ArgumentParser) -> tuple[argparse.Namespace, list[Photo]]:
    """The options, and the photos that `tools/index.csv` lists, in its order."""
    parser.add_argument("--data", type=Path, default=data_folder(), help="folder with tools/")
    args, photos = parser.parse_args(), []
    folder = args.data / "tools"
    if not (folder / "index.csv").is_file():
        raise SystemExit(f"no tools/index.csv in {args.data}: give --data or set GRASPTRACK_DATA")
    with (folder / "index.csv").open(newline="", encoding="utf-8") as file:
        listed = list(csv.DictReader(file))
    for row in listed:
        name = row["name"]
        image = cv2.imread(str(folder / "images" / f"{name}.jpg"), cv2.IMREAD_COLOR)
        mask = cv2.imread(str(folder / "masks" / f"{name}.png"), cv2.IMREAD_GRAYSCALE)
        if image is None or mask is None:
            raise SystemExit(f"cannot read the photo or the mask of {name} in {folder}")
        kind = row.get("classes", name)
        photos.append(Photo(name, kind, row["scene"], np.asarray(image, np.uint8), np.asarray(mask) > 0))
    if not photos:
        raise SystemExit(f"tools/index.csv in {args.data} lists no photo")
    return args, photos


def is_found(truth: Bools, view: Any) -> bool:
    """Whether an outline counts as the object: boundary and area agree with its mask (H, W)."""
    return is_mask_found(truth, mask_of(view, (truth.shape[0], truth.shape[1])))


def is_mask_found(truth: Bools, mask: Bools) -> bool:
    """The same of a mask (H, W)."""
    return boundary_f(truth, mask) >= ENOUGH_F and intersection_over_union(truth, mask) >= ENOUGH_IOU


def run_all(function: Callable[[Case], Outcome], cases: Sequence[Case], workers: int) -> list[Outcome]:
    """What a function makes of each case, in so many processes; one needs none."""
    if workers <= 1:
        return [function(case) for case in cases]
    with ProcessPoolExecutor(workers) as pool:
        return list(pool.map(function, cases))


# --- the clock -----------------------------------------------------------------------------------


def time_calls(call: Callable[..., object], pool: Iterable[tuple[object, ...]]) -> Floats:
    """(n,) s of a call over a pool of arguments, each used once, the collector at rest."""
    clock = time.perf_counter_ns
    taken = []
    gc.collect()
    gc.disable()
    try:
        for arguments in pool:
            start = clock()
            call(*arguments)
            taken.append(clock() - start)
    finally:
        gc.enable()
    return 1e-9 * np.array(taken, dtype=np.float64)


def score_alone(make: Maker, start: MethodStart, frames: Sequence[SceneFrame]) -> Score:
    """The score of one method that runs by itself, with the latency of each update."""
    method, score = make(start), Score("")
    for frame in frames:
        began = time.perf_counter()
        result = method.update(frame.image, frame.time)
        taken = 1e3 * (time.perf_counter() - began)
        score.add(replace(result, latency_ms=taken), Truth.of_scene(frame))
    return score


def update_latencies(score: Score) -> Floats:
    """(n,) ms of the updates after the first, which also chooses a grasp."""
    return np.array([frame.latency_ms for frame in score.frames[1:]])


# --- what is shown -------------------------------------------------------------------------------


def describe_setup() -> str:
    """One line that says what the figures were measured on."""
    return (
        f"{describe_machine()}, one thread; Python {platform.python_version()}, "
        f"NumPy {np.__version__}, OpenCV {cv2.__version__}, kernels: {kernels.BACKEND}"
    )


def begin_section(title: str) -> None:
    """Title, machine, and the command that repeats the run: a section begins."""
    command = " ".join([f"{COMMAND}.{Path(sys.argv[0]).stem}", *sys.argv[1:]])
    print(f"\n{title}\n{describe_setup()}\n$ {command}\n")
    _sections.append((title, [f"`{command}`", f"{describe_setup()}."]))


def add_paragraph(text: str) -> None:
    """A sentence above or below a table."""
    print(text)
    _record_paragraph(text)


def add_table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """A plain table; figures to the right, words to the left."""
    listed = [[_format_cell(c) for c in row] for row in rows]
    widths = [max(len(r[i]) for r in [list(head), *listed]) for i in range(len(head))]
    number = [all(not r[i] or r[i][0] in "-+.0123456789" for r in listed) for i in range(len(head))]
    for k, row in enumerate([list(head), *listed]):
        print("  ".join(c.rjust(w) if n else c.ljust(w) for c, w, n in zip(row, widths, number, strict=True)).rstrip())
        if k == 0:
            print("  ".join("-" * w for w in widths))
    print()
    rule = ["---:" if n else "---" for n in number]
    _record_paragraph("\n".join(f"| {' | '.join(row)} |" for row in [list(head), rule, *listed]))


def write_sections(path: Path | None) -> None:
    """Write all sections of this run to a file of results, in the place of those with the same titles."""
    if path is not None:
        for title, paragraphs in _sections:
            replace_section(path, title, "\n\n".join(paragraphs))


def replace_section(path: Path, title: str, text: str) -> None:
    """Put a section into a Markdown file, made when missing: where the one with this title is, else at the end."""
    whole = path.read_text(encoding="utf-8") if path.exists() else PREFACE
    before, *parts = re.split(r"^## ", whole, flags=re.MULTILINE)
    sections = {part.partition("\n")[0]: part.partition("\n")[2].strip() for part in parts}
    sections[title] = text.strip()
    body = "".join(f"\n\n## {name}\n\n{content}" for name, content in sections.items())
    path.write_text(f"{before.strip()}{body}\n", encoding="utf-8")


def _record_paragraph(paragraph: str) -> None:
    if _sections:
        _sections[-1][1].append(paragraph)


def _format_cell(value: object) -> str:
    """Three digits, and no powers of ten in a range where a person would write none."""
    if not isinstance(value, float):
        return str(value)
    if np.isnan(value):
        return ""
    return f"{value:,.0f}" if 100.0 <= abs(value) < 1e7 else f"{value:.3g}"


def write_numbers(path: Path, entries: Mapping[str, object]) -> None:
    """A JSON file with an entry a line, as those of the package's numbers."""
    lines = [f"  {json.dumps(name)}: {json.dumps(entry)}" for name, entry in entries.items()]
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
