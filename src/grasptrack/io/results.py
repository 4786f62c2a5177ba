# SPDX-License-Identifier: Apache-2.0
"""grasps.csv, a row for every frame or instance in it; the counts of a run; and what it was made with, for run.json."""

from __future__ import annotations

import csv
import errno
import io
import math
import os
import platform
import re
from array import array
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from grasptrack.io.columns import csv_cells, csv_columns
from grasptrack.plugins import version_of
from grasptrack.tracking.result import TrackResult


class GraspsCsv:
    """Writes grasps.csv anew, for so many fingers, row by row; of a scene, with the columns of instances.

    Each row is on its way to the disk, whole, before the next frame is looked at.
    """

    def __init__(self, path: Path, fingers: int, *, scene: bool = False) -> None:
        self._fingers = fingers
        self._path = path
        self._file = path.open("wb", buffering=0)
        self._size = 0
        try:
            self._write_row(csv_columns(fingers, scene=scene))
        except OSError:
            self._file.close()
            raise

    def write(self, result: TrackResult, index: int, time: float | None) -> None:
        """Add the row of one frame, arguments as of `csv_cells`."""
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
    return {
        "grasptrack": version_of("grasptrack") or "unknown",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "opencv": cv2.__version__,
        "av": version_of("av") or "unknown",
        "platform": platform.platform(),
    }


STATUSES = ("tracked", "unstable", "lost", "searching")
_KEPT = 1 << 16
_OTHER = "other reasons"
_MAX_REASONS = 64


@dataclass(frozen=True)
class RunSummary:
    """What a run gave.

    Attributes:
        frames: number of frames answered.
        counts: frames for each status: tracked, unstable, lost, searching.
        reasons: for each status but tracked, frames for each reason; reasons that differ in numbers alone count as
            one, under the first that was met.
        strategies: frames for each strategy that located the grasp.
        switches: frames for each switch from one to another and its reason, counted as `reasons`, the most frequent first.
        grasps: number of different grasps that were located.
        object_seen: whether an object was made out in any frame.
        chance_least: the least chance of closing that was told; NaN where none was.
        chance_mean: the mean over the frames with one.
        codes: frames for each code of a reason, the most frequent first.
        latency_median_ms: median time of an update, ms; NaN without frames.
        latency_p99_ms: its 99th percentile, ms.
        seconds: s of the whole run: reading, tracking, drawing and writing.
        frames_per_s: frames over seconds.
        ended: "finished", "interrupted" or "failed".
        files: what was written, by name.
    """

    frames: int
    counts: dict[str, int]
    reasons: dict[str, dict[str, int]]
    strategies: dict[str, int]
    grasps: int
    object_seen: bool
    latency_median_ms: float
    latency_p99_ms: float
    seconds: float
    frames_per_s: float
    ended: str = "finished"
    files: dict[str, Path] = field(default_factory=dict)
    chance_least: float = math.nan
    chance_mean: float = math.nan
    codes: dict[str, int] = field(default_factory=dict)
    switches: dict[str, int] = field(default_factory=dict)

    def figures(self) -> dict[str, Any]:
        """The counts and figures for run.json."""
        return {
            "frames": self.frames,
            "counts": self.counts,
            "reasons": self.reasons,
            "reason_codes": self.codes,
            "strategies": self.strategies,
            "switches": self.switches,
            "grasps": self.grasps,
            "chance": {"least": self.chance_least, "mean": self.chance_mean},
            "latency_ms": {"median": self.latency_median_ms, "p99": self.latency_p99_ms},
            "seconds": round(self.seconds, 3),
            "frames_per_s": round(self.frames_per_s, 2),
        }


class Tally:
    """Counts results one by one."""

    def __init__(self) -> None:
        self.frames = 0
        self._counts = dict.fromkeys(STATUSES, 0)
        self._reasons: dict[str, dict[str, tuple[str, int]]] = {s: {} for s in STATUSES[1:]}
        self._codes: Counter[str] = Counter()
        self._strategies: Counter[str] = Counter()
        self._switches: dict[str, tuple[str, int]] = {}
        self._grasps = 0
        self._last_grasp: int | None = None
        self._object_seen = False
        self._least, self._chances, self._told = math.nan, 0.0, 0
        # Exact up to 65,536 frames; beyond, every second value is kept, then every fourth...
        self._latencies = array("d")
        self._stride = 1

    def add(self, result: TrackResult) -> None:
        """Count one frame."""
        self._counts[result.status] += 1
        if result.status != "tracked":
            self._count_reason(self._reasons[result.status], result.reason)
            self._codes[result.reason_code] += bool(result.reason_code)
        if result.contacts is not None:
            self._strategies[result.strategy] += 1
            if result.switch:
                self._count_reason(self._switches, result.switch)
            if result.grasp_id != self._last_grasp:
                self._grasps += 1
                self._last_grasp = result.grasp_id
        if math.isfinite(result.chance):
            self._least = min(result.chance, self._least) if self._told else result.chance
            self._chances, self._told = self._chances + result.chance, self._told + 1
        self._object_seen = self._object_seen or result.view is not None or result.contacts is not None
        if self.frames % self._stride == 0 and math.isfinite(result.latency_ms):
            self._latencies.append(result.latency_ms)
            if len(self._latencies) >= _KEPT:
                del self._latencies[1::2]
                self._stride *= 2
        self.frames += 1

    @staticmethod
    def _count_reason(known: dict[str, tuple[str, int]], reason: str) -> None:
        key = re.sub(r"[-+]?\d+(\.\d+)?", "#", reason)
        if key not in known and len(known) >= _MAX_REASONS:
            key = reason = _OTHER
        first, count = known.get(key, (reason, 0))
        known[key] = (first, count + 1)

    def summary(self, seconds: float, ended: str, files: dict[str, Path]) -> RunSummary:
        """Everything counted so far."""
        latencies = np.array(self._latencies) if self._latencies else np.array([math.nan])
        median, p99 = np.percentile(latencies, [50, 99]).tolist()
        reasons = {status: _most_frequent(known) for status, known in self._reasons.items()}
        return RunSummary(
            frames=self.frames,
            counts=dict(self._counts),
            reasons=reasons,
            strategies=dict(self._strategies),
            grasps=self._grasps,
            object_seen=self._object_seen,
            latency_median_ms=median,
            latency_p99_ms=p99,
            seconds=seconds,
            frames_per_s=self.frames / seconds if seconds > 0 else 0.0,
            ended=ended,
            files=files,
            chance_least=self._least,
            chance_mean=self._chances / self._told if self._told else math.nan,
            codes={code: count for code, count in self._codes.most_common() if count},
            switches=_most_frequent(self._switches),
        )


def _most_frequent(known: dict[str, tuple[str, int]]) -> dict[str, int]:
    """What was counted, the most frequent first."""
    return dict(sorted(known.values(), key=lambda pair: -pair[1]))
