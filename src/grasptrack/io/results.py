# SPDX-License-Identifier: Apache-2.0
"""grasps.csv, one row for every frame; and what a run was made with: versions and machine, for run.json."""

from __future__ import annotations

import contextlib
import csv
import errno
import io
import os
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

from grasptrack.io.columns import csv_cells, csv_columns

if TYPE_CHECKING:
    from grasptrack.tracking.result import TrackResult


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
        self._write_row(csv_cells(result, index, time, self._fingers))

    def _write_row(self, cells: Sequence[str]) -> None:
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
