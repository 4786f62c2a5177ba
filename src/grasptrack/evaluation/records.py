# SPDX-License-Identifier: Apache-2.0
"""Scored frames as CSV, one file for each sequence with all methods in it: written whole, read back to the last digit."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError
from grasptrack.evaluation.score import FrameScore

Floats = NDArray[np.float64]

FIXED = (
    "method",
    "frame",
    "status",
    "strategy",
    "reason",
    "present",
    "visible",
    "seen",
    "defining",
    "limit_px",
    "opening_px",
    "area_px2",
    "confidence",
)
"""Columns before those of the contacts."""
EACH = ("x", "y", "error_px", "spread")
"""Columns of each contact, numbered from 1."""
LAST = "latency_ms"
"""Last, because it alone differs from run to run."""


def write_records(path: Path, scores: Mapping[str, Sequence[FrameScore]]) -> None:
    """Write the frames of all methods, or nothing: an interrupted write leaves no file under this name.

    Args:
        path: of the CSV file.
        scores: frames by method.
    """
    contacts = max((len(f.contacts) for s in scores.values() for f in s if f.contacts is not None), default=0)
    numbered = [f"{name}{i + 1}" for i in range(contacts) for name in EACH]
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    with part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*FIXED, *numbered, LAST])
        for method, frames in scores.items():
            writer.writerows(_row(method, frame, contacts) for frame in frames)
    part.replace(path)


def read_records(path: Path) -> dict[str, list[FrameScore]]:
    """The inverse of `write_records`, digits and all.

    Raises:
        InputError: missing or unreadable file, or one that is no such table.
    """
    scores: dict[str, list[FrameScore]] = {}
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            contacts = sum(name.startswith("error_px") for name in reader.fieldnames or ())
            for row in reader:
                scores.setdefault(row["method"], []).append(_frame(row, contacts))
    except (OSError, UnicodeDecodeError, csv.Error, KeyError, ValueError, TypeError) as error:
        raise InputError(f'cannot read the scored frames "{path}": {error}', path=str(path)) from error
    if not scores:
        raise InputError(f'"{path}" holds no scored frames', path=str(path))
    return scores


def _row(method: str, f: FrameScore, contacts: int) -> list[str | int]:
    row: list[str | int] = [method, f.frame, f.status, f.strategy, f.reason, int(f.present), _text(f.visible)]
    row += [int(f.seen), int(f.defining), *map(_text, (f.limit, f.opening, f.area, f.confidence))]
    for i in range(contacts):
        row += [_text(float(f.contacts[i, j])) if f.contacts is not None else "" for j in (0, 1)]
        row += [_text(float(v[i])) if v is not None else "" for v in (f.distances, f.spread)]
    return [*row, _text(f.latency_ms)]


def _text(value: float) -> str:
    return "" if math.isnan(value) else repr(float(value))


def _frame(row: Mapping[str, str], contacts: int) -> FrameScore:
    def number(name: str) -> float:
        return float(row[name]) if row[name] else math.nan

    def column(names: Iterable[str]) -> Floats | None:
        values = np.array([number(name) for name in names])
        return None if np.isnan(values).any() or not len(values) else values

    places = column(f"{axis}{i + 1}" for i in range(contacts) for axis in "xy")
    return FrameScore(
        frame=int(row["frame"]),
        status=row["status"],
        reason=row["reason"],
        distances=column(f"error_px{i + 1}" for i in range(contacts)),
        limit=number("limit_px"),
        latency_ms=number(LAST),
        defining=row["defining"] == "1",
        strategy=row["strategy"],
        contacts=None if places is None else places.reshape(-1, 2),
        spread=column(f"spread{i + 1}" for i in range(contacts)),
        opening=number("opening_px"),
        area=number("area_px2"),
        present=row["present"] == "1",
        visible=number("visible"),
        seen=row["seen"] == "1",
        confidence=number("confidence"),
    )
