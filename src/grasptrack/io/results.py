# SPDX-License-Identifier: Apache-2.0
"""grasps.csv and run.json: one row for every frame, and what the run was and gave.

Units in both files, for people: px for contacts (4 decimals), **degrees** for margins and tilt, s for times, ms for latency,
0 to 1 for seen, chance and confidence (9 decimals, for small risks), the user's own unit for distances (6 figures), px and px^2
for homographies and covariances (9 and 6 figures). A cell is empty where there is no value. run.json
repeats them under "units".
"""

from __future__ import annotations

import contextlib
import csv
import errno
import io
import math
import os
import platform
from collections.abc import Iterable, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from grasptrack.tracking.result import TrackResult

UNITS = {
    "time_s": "s",
    "contacts": "px, the centre of the top-left pixel at (0, 0), x right, y down",
    "seen": "0 to 1",
    "margin": "degrees",
    "confidence": "0 to 1, the complement of the probability that a contact is off or on another object",
    "chance": "probability",
    "latency_ms": "ms",
    "tilt": "degrees",
    "tilt_sd": "degrees",
    "margin_sd": "degrees",
    "margin_image": "degrees",
    "distance": "that of the length that was told",
    "distance_sd": "that of the length that was told",
    "mended": "share of the first outline",
    "homography": "H_current_reference, px of the grasp's first view to px of the frame, h33 being 1",
    "covariances": "px^2, of each contact's x and y",
}


def csv_columns(fingers: int) -> list[str]:
    """Names of the columns of grasps.csv for a number of contacts."""
    numbers = range(1, fingers + 1)
    return [
        *("frame", "time_s", "status", "strategy", "grasp_id"),
        *(f"{axis}{i}" for i in numbers for axis in "xy"),
        *(f"seen{i}" for i in numbers),
        *("margin", "confidence", "chance", "latency_ms", "reason", "reason_code"),
        *("tilt", "tilt_sd", "margin_sd", "margin_image"),
        *("distance", "distance_sd", "mended", "notice"),
        *(f"h{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)),
        *(f"cov_{pair}{i}" for i in numbers for pair in ("xx", "xy", "yy")),
    ]


class GraspsCsv:
    """Writes grasps.csv row by row; each row is on its way to the disk, whole, before the next frame is looked at.

    Args:
        path: the file, written over.
        fingers: number of contacts, k.

    Raises:
        OSError: it cannot be written.
    """

    def __init__(self, path: Path, fingers: int) -> None:
        self._fingers = fingers
        self._path = path
        self._file = path.open("wb", buffering=0)
        self._size = 0
        try:
            self._write_row(csv_columns(fingers))
        except OSError:
            self._file.close()
            raise

    def write(self, result: TrackResult, index: int, time: float | None) -> None:
        """Add the row of one frame.

        Args:
            result: the tracker's answer.
            index: the frame's number in its source.
            time: the frame's time, s.

        Raises:
            OSError: it cannot be written; the file ends with the row before.
        """
        contacts: list[float] = [] if result.contacts is None else result.contacts.ravel().tolist()
        seen: list[float] = [] if result.seen is None else result.seen.tolist()
        margin = None if result.analysis is None else math.degrees(result.analysis.margin)
        self._write_row(
            [
                index,
                _format_cell(time, 6),
                result.status,
                result.strategy,
                "" if result.grasp_id is None else result.grasp_id,
                *_format_cells(contacts, 2 * self._fingers, 4),
                *_format_cells(seen, self._fingers, 3),
                _format_cell(margin, 4),
                _format_cell(result.confidence, 9),
                _format_cell(result.chance, 4),
                _format_cell(result.latency_ms, 4),
                " ".join(result.reason.split()),
                result.reason_code,
                *(_format_cell(math.degrees(v), 4) for v in (result.tilt, result.tilt_sd)),
                *(_format_cell(math.degrees(v), 4) for v in (result.margin_sd, result.margin_image)),
                *_format_figures((result.distance, result.distance_sd), 2, 6),
                _format_cell(result.mended or None, 4),
                result.notice,
                *_format_figures([] if result.homography is None else result.homography.ravel(), 9, 9),
                *_format_figures(_upper_triangles(result.covariance), 3 * self._fingers, 6),
            ]
        )

    def _write_row(self, cells: Sequence[object]) -> None:
        line = io.StringIO()
        csv.writer(line, lineterminator="\n").writerow(cells)
        data = line.getvalue().encode("utf-8")
        try:
            if (self._file.write(data) or 0) < len(data):  # the disk had room for a part of it
                self._file.write(data)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._path))
        except OSError as error:
            self._file.truncate(self._size)
            self._file.seek(self._size)
            raise OSError(error.errno, error.strerror, str(self._path)) from None
        self._size += len(data)

    def close(self) -> None:
        """Close the file; may be called again."""
        self._file.close()


def _format_cell(value: float | None, decimals: int) -> str:
    return "" if value is None or not math.isfinite(value) else f"{value:.{decimals}f}"


def _format_cells(values: list[float], count: int, decimals: int) -> list[str]:
    cells = [_format_cell(v, decimals) for v in values[:count]]
    return cells + [""] * (count - len(cells))


def _format_figures(values: Iterable[float], count: int, figures: int) -> list[str]:
    """Cells of numbers of any size; as many as columns, empty where there is no value."""
    cells = [f"{value:.{figures}g}" if math.isfinite(value) else "" for value in values][:count]
    return cells + [""] * (count - len(cells))


def _upper_triangles(covariance: NDArray[np.float64] | None) -> list[float]:
    """xx, xy and yy of each of (k, 2, 2)."""
    return [] if covariance is None else [float(c[at]) for c in covariance for at in ((0, 0), (0, 1), (1, 1))]


def software_versions() -> dict[str, str]:
    """Versions of this package and of what computes, decodes and encodes for it."""
    found = {
        "grasptrack": _package_version("grasptrack"),
        "python": platform.python_version(),
        "numpy": _package_version("numpy"),
    }
    import cv2

    return {**found, "opencv": cv2.__version__, "av": _package_version("av"), "platform": platform.platform()}


def describe_machine() -> str:
    """Processor, its cores and the operating system, in one line."""
    name = platform.processor() or platform.machine()
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), name)
    return f"{name}, {os.cpu_count() or 1} cores, {platform.system()}"


def _package_version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"
