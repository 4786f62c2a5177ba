# SPDX-License-Identifier: Apache-2.0
"""The planar tracking benchmark POT-210 and POT-280 (P. Liang et al., 2018 and 2021), as it is published.

A sequence is a folder of images or a video, named V24_7 by its object and challenge. `V24_7_gt_points.txt` has a row for each
image: the corners of the target in order round it in the first, the second and every other image after that, else zeros.
`V24_7_flag.txt` has a number for each, above 0 where the benchmark does not score the image.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from grasptrack.errors import InputError
from grasptrack.files import read_text
from grasptrack.io.sources import open_source
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack.typing import Floats
from grasptrack_bench.real import Given, Known, RealCase

NAME = re.compile(r"V\d+_\d+")
VIDEOS = (".avi", ".mp4")
POINTS, FLAG = "_gt_points.txt", "_flag.txt"
"""What follows the name of a sequence in the names of its files."""


@dataclass(frozen=True)
class PotCase(RealCase):
    """One sequence; its table is that of the corners."""

    @property
    def name(self) -> str:
        """As in tables and names of files."""
        return self.table.name.removesuffix(POINTS)

    def homographies(self) -> dict[int, Floats]:
        """H (3, 3) from the first image that is shown to each that is shown and scored, by frame."""
        corners = read_corners(self.table)
        begin, exact = first_shown(corners, self.every), corners.astype(np.float32)
        later = [i for i in range(begin, len(corners), self.every)[1:] if not np.isnan(corners[i]).any()]
        found: dict[int, Floats] = {begin: np.eye(3)}  # without rounding: methods are told the corners as annotated
        for i in later:
            found[i] = np.asarray(cv2.getPerspectiveTransform(exact[begin], exact[i]), dtype=np.float64)
        return found


def read_corners(path: Path) -> Floats:
    """(n, 4, 2) px of the target in each image; NaN where nobody annotated it, or the benchmark does not score it."""
    corners, flags = _read_numbers(path, 8), path.with_name(path.name.replace(POINTS, FLAG))
    scored = corners.any(axis=1)
    if flags.is_file():
        told = _read_numbers(flags, 1)
        if len(told) != len(corners):
            raise InputError(f'"{flags}" has {len(told)} rows, "{path.name}" {len(corners)}', path=str(flags))
        scored &= told[:, 0] == 0.0
    corners[~scored] = np.nan
    return corners.reshape(-1, 4, 2)


def first_shown(corners: Floats, every: int) -> int:
    """Number of the image to begin with so that every N-th meets most of the scored ones.

    By corners (n, 4, 2) px, as of `read_corners`, one of the first N being known.
    """
    scored = np.asarray(~np.isnan(corners).any(axis=(1, 2)))
    return int(max(np.flatnonzero(scored[:every]), key=lambda i: scored[i::every].sum()))


def sequences_of(folder: Path, every: int = 1, given: Given = "outline", risk: float = DEFAULT_RISK) -> list[RealCase]:
    """The sequences in a folder, or in folders of it named by their objects (V24), by name; or the one that the folder is.

    Args:
        folder: of the sequences. Annotations lie in that of a sequence, beside it, or in `annotation` beside it or in `folder`.
        every: so many-th images are shown.
        given: what is told of the object before the first image.
        risk: probability below which answers of the tracker may be wrong.
    """
    if not folder.is_dir():
        raise InputError(f'"{folder}" is no folder', path=str(folder))
    listed = sorted([folder, *folder.glob("V*_*"), *folder.glob("V*/V*_*")])
    found = {p.stem: p for p in listed if NAME.fullmatch(p.stem) and (p.is_dir() or p.suffix in VIDEOS)}
    if not found:
        raise InputError(f'"{folder}" holds no sequence: a folder V24_7 of images, or V24_7.avi', path=str(folder))
    return [_case_of(name, path, folder, every, given, risk) for name, path in found.items()]


def _case_of(name: str, path: Path, folder: Path, every: int, given: Given, risk: float) -> PotCase:
    beside = path.parent
    places = [p / (name + POINTS) for p in (path, beside, beside / "annotation", folder / "annotation")]
    table = next((place for place in places if place.is_file()), None)
    if table is None:
        raise InputError(f'sequence {name} has no annotation: "{places[2]}" is not there', path=str(places[2]))
    corners = read_corners(table)
    video = path / "img" if (path / "img").is_dir() else path
    with open_source(video) as source:
        count = source.count if source.exact and source.count is not None else 0  # some videos' count is a guess
    if count > len(corners):
        raise InputError(f'"{table}" has {len(corners)} rows for {count} images of "{video}"', path=str(table))
    if np.isnan(corners[:every]).any(axis=(1, 2)).all():
        raise InputError(f'"{table}" tells no corners in its first {min(every, len(corners))} rows', path=str(table))
    quad = corners[first_shown(corners, every)]
    x, y = quad.mean(axis=0).tolist()
    return PotCase(video, table, known=Known((x, y), quad), given=given, risk=risk, every=every)


def _read_numbers(path: Path, columns: int) -> Floats:
    """(n, columns) numbers of a file, a row a line."""
    try:
        lines = read_text(path, "annotation").splitlines()
    except InputError as error:
        raise InputError(f'"{path}" {error}', path=str(path)) from None
    rows = np.empty((len(lines), columns))
    for i, line in enumerate(lines):
        try:
            numbers = [float(v) for v in line.split()]
            if len(numbers) != columns or not np.isfinite(numbers).all():
                raise ValueError
        except ValueError:
            needed = "1 number" if columns == 1 else f"{columns} numbers"
            raise InputError(f'"{path}", line {i + 1}: a row is {needed}, not "{line[:80]}"', path=str(path)) from None
        rows[i] = numbers
    return rows
