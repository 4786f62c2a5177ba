# SPDX-License-Identifier: Apache-2.0
"""Segmentation of photos of tools against their masks, beside what OpenCV gives; and what is found in stills."""

from __future__ import annotations

import common

# isort: split
import csv
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from baselines import BASELINES
from grasptrack.bench.metrics.mask_agreement import (
    ENOUGH_F,
    ENOUGH_IOU,
    band_iou,
    boundary_f,
    intersection_over_union,
    mask_of,
)
from grasptrack.errors import ObservationError
from grasptrack.segmentation.candidate import Candidate
from grasptrack.segmentation.objects import find_objects
from photos import Photo, deepest, read_photos
from real_videos import data_folder
from sheets import found_tile, judged_tile, sheet

PARTS = "pca_test1"  # six equal parts
STILLS = (PARTS, "stuff", "choriginal", "shape")
ALIKE = 1.3  # ratio of the areas up to which two objects look like the same part

Array = np.ndarray
Hint = tuple[float, float] | None


@dataclass(frozen=True)
class Row:
    """What one method made of one photo."""

    name: str
    scene: str
    method: str
    hint: bool
    f: float
    iou: float
    ms: float
    mask: Array

    @property
    def enough(self) -> bool:
        """Whether the object counts as found."""
        return self.f >= ENOUGH_F and self.iou >= ENOUGH_IOU


def found_in(image: Array, object_at: Hint = None) -> list[Candidate]:
    """Our objects in a BGR image, the best first; none where it refuses."""
    try:
        return find_objects(image, object_at)
    except ObservationError:
        return []


def first_of(found: Array | list[Candidate], shape: tuple[int, int]) -> Array:
    """(H, W) the mask of what a method gave: a mask as it is, of our objects the first, empty where there is none."""
    if not isinstance(found, list):
        return found
    return mask_of(found[0].view, shape) if found else np.zeros(shape, dtype=bool)


METHODS: dict[str, Callable[[Array, Hint], Array | list[Candidate]]] = {"ours": found_in, **BASELINES}


def judge(photo: Photo, method: str, hint: bool) -> Row:
    """One method on one photo; its time includes neither the drawing of our outline as a mask nor the scoring."""
    object_at = deepest(photo.truth) if hint else None
    start = time.perf_counter()
    found = METHODS[method](photo.image, object_at)
    ms = (time.perf_counter() - start) * 1e3
    mask = first_of(found, photo.truth.shape)
    f, overlap = boundary_f(photo.truth, mask), intersection_over_union(photo.truth, mask)
    return Row(photo.name, photo.scene, method, hint, f, overlap, ms, mask)


def summary(label: str, scene: str, rows: Sequence[Row]) -> list[object]:
    """A line of the table."""
    found = sum(row.enough for row in rows)
    middle = [float(np.median([getattr(row, key) for row in rows])) for key in ("f", "iou", "ms")]
    return [label, scene, len(rows), 100.0 * found / len(rows), *middle]


def print_table(listed: Sequence[Photo], rows: Sequence[Row]) -> None:
    """Every method with and without a hint, by scene; then what the masks allow at best."""
    scenes = sorted({photo.scene for photo in listed})
    lines = []
    for method in dict.fromkeys(row.method for row in rows):
        for hint in (False, True):
            mine = [row for row in rows if (row.method, row.hint) == (method, hint)]
            label = f"{method}, {'one pixel' if hint else 'no hint'}"
            lines += [summary(label, scene, [row for row in mine if row.scene == scene]) for scene in scenes]
            lines.append(summary(label, "all", mine))
    common.table(["method", "scene", "photos", "found %", "median F", "median IoU", "median ms"], lines)
    common.say(
        f"Found: F >= {ENOUGH_F} within 4 px and IoU >= {ENOUGH_IOU}; without a hint only the first object counts."
    )
    for scene in [*scenes, "all"]:
        bands = [band_iou(photo.truth) for photo in listed if scene in (photo.scene, "all")]
        eroded, dilated = np.median(bands, axis=0)
        common.say(
            f"{scene}: masks 2 px smaller have a median IoU of {eroded:.3f} with themselves, 2 px larger {dilated:.3f}."
        )
    first = [row.ms for row in rows if row.method == "ours" and not row.hint]
    if first:
        common.say(
            "First look of ours at 640x480: median {:.1f} ms, 99 % {:.1f} ms.".format(*np.percentile(first, [50, 99]))
        )


def write_photos(listed: Sequence[Photo], rows: Sequence[Row], output: Path) -> None:
    """A CSV with a line for each photo and method, and ours as pictures: those that failed, and all."""
    with (output / "segmentation.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["name", "scene", "method", "hint", "found", "f", "iou", "ms"])
        for r in rows:
            figures = [int(r.hint), int(r.enough), f"{r.f:.4f}", f"{r.iou:.4f}", f"{r.ms:.2f}"]
            writer.writerow([r.name, r.scene, r.method, *figures])
    pairs, failed = [], []
    for photo in listed:
        pair = [row for row in rows if row.name == photo.name and row.method == "ours"]
        tiles = [judged_tile(photo.image, photo.truth, row, deepest(photo.truth) if row.hint else None) for row in pair]
        pairs += tiles
        failed += [] if all(row.enough for row in pair) else tiles
    for name, tiles in (("all", pairs), ("failures", failed)):
        if tiles:
            cv2.imwrite(str(output / f"{name}.png"), sheet(tiles, columns=4))


def stills(folder: Path, output: Path | None) -> None:
    """How many objects are found in each still; pictures of them, numbered by rank."""
    rows = []
    for name in STILLS:
        image = cv2.imread(str(folder / f"{name}.jpg"))
        found = find_objects(image)
        areas = np.array([candidate.view.outer.area for candidate in found])
        alike = max((int(np.sum((areas >= a) & (areas <= ALIKE * a))) for a in areas), default=0)
        holes = sum(len(candidate.view.contours) - 1 for candidate in found)
        rows.append([name, len(found), holes, f"{alike} of 6" if name == PARTS else ""])
        if output is not None:
            cv2.imwrite(str(output / f"{name}.png"), found_tile(image, [candidate.view for candidate in found]))
    common.table(["still", "objects", "holes", f"parts (areas within {ALIKE:g})"], rows)


def main() -> None:
    parser = common.parser(__doc__)
    parser.add_argument("--data", type=Path, default=data_folder(), help="folder with tools/ and stills/")
    parser.add_argument("--pictures", type=Path, help="folder for the CSV and the pictures")
    parser.add_argument("--method", choices=list(METHODS), help="this one alone")
    parser.add_argument("--only", metavar="NAME", help="photos whose names contain this, and no stills")
    args = parser.parse_args()
    if not (args.data / "tools" / "index.csv").is_file():
        raise SystemExit(f"no tools/index.csv in {args.data}: give --data or set GRASPTRACK_DATA")
    listed = read_photos(args.data / "tools", args.only)
    if not listed:
        raise SystemExit(f'no photo has "{args.only}" in its name')
    common.heading("Segmentation: photos of one tool each against their masks")
    methods = [args.method] if args.method else list(METHODS)
    for method in methods:
        METHODS[method](listed[0].image, None)  # what is loaded on first use is no part of what is timed
    rows = [judge(photo, method, hint) for method in methods for hint in (False, True) for photo in listed]
    print_table(listed, rows)
    if args.pictures is not None:
        args.pictures.mkdir(parents=True, exist_ok=True)
        write_photos(listed, rows, args.pictures)
    if args.only is None and "ours" in methods:
        stills(args.data / "stills", args.pictures)
    common.finish(args.output)


if __name__ == "__main__":
    main()
