# SPDX-License-Identifier: Apache-2.0
"""Tables as CSV: scored frames of a sequence, and homographies from the first frame to each; read back to the last digit."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from grasptrack.errors import InputError
from grasptrack.files import whole_file
from grasptrack.typing import Floats
from grasptrack_bench.metrics.score import FrameScore

FIXED = (
    "method", "frame", "status", "strategy", "reason", "present", "visible", "seen", "defining", "limit_px",
    "opening_px", "area_px2", "confidence", "alignment_px",
)  # fmt: skip
"""Columns before those of the contacts."""
EACH = ("x", "y", "error_px", "spread")
"""Columns of each contact, numbered from 1."""
LAST = "latency_ms"
"""Last, because it alone differs from run to run."""


def write_records(path: Path, scores: Mapping[str, Sequence[FrameScore]]) -> None:
    """Write the frames of all methods, or nothing: an interrupted write leaves no file under this name."""
    contacts = max((len(f.contacts) for s in scores.values() for f in s if f.contacts is not None), default=0)
    numbered = [f"{name}{i + 1}" for i in range(contacts) for name in EACH]
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*FIXED, *numbered, LAST])
        for method, frames in scores.items():
            writer.writerows(_format_row(method, frame, contacts) for frame in frames)


def read_records(path: Path) -> dict[str, list[FrameScore]]:
    """The inverse of `write_records`, digits and all."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.reader(file)
            head = next(reader, [])
            rows = [row for row in reader if row]
            if FIXED[-1] not in head:  # of an earlier version
                head, rows = [*head, FIXED[-1]], [[*row, ""] for row in rows]
            scores = _parse_frames(head, rows)
    except (OSError, UnicodeDecodeError, csv.Error, IndexError, ValueError) as error:
        raise InputError(f'cannot read the scored frames "{path}": {error}', path=str(path)) from error
    if not scores:
        raise InputError(f'"{path}" holds no scored frames', path=str(path))
    return scores


def _format_row(method: str, f: FrameScore, contacts: int) -> list[str | int]:
    row: list[str | int] = [method, f.frame, f.status, f.strategy, f.reason, int(f.present), _format_number(f.visible)]
    row += [int(f.seen), int(f.defining), *map(_format_number, (f.limit, f.opening, f.area, f.confidence, f.alignment))]
    for i in range(contacts):
        row += [_format_number(float(f.contacts[i, j])) if f.contacts is not None else "" for j in (0, 1)]
        row += [_format_number(float(v[i])) if v is not None else "" for v in (f.distances, f.spread)]
    return [*row, _format_number(f.latency_ms)]


def _format_number(value: float) -> str:
    return "" if math.isnan(value) else repr(float(value))


def _parse_frames(head: list[str], rows: list[list[str]]) -> dict[str, list[FrameScore]]:
    """Frames by method; the numbers of the whole file become one array, of which the frames hold parts."""
    contacts = sum(name.startswith("error_px") for name in head)
    method, frame, status, strategy, reason, present, seen, defining = map(
        head.index, ("method", "frame", "status", "strategy", "reason", "present", "seen", "defining")
    )
    names = ["visible", "limit_px", "opening_px", "area_px2", *FIXED[-2:], LAST]
    names += [f"{axis}{i + 1}" for i in range(contacts) for axis in "xy"]
    names += [f"{each}{i + 1}" for each in EACH[2:] for i in range(contacts)]
    columns = [head.index(name) for name in names]
    numbers = np.array([[float(row[c] or "nan") for c in columns] for row in rows]).reshape(len(rows), len(columns))
    parts = np.split(numbers, 7 + contacts * np.array([0, 2, 3]), axis=1)[1:]
    known = np.column_stack([~np.isnan(part).any(axis=1) & (contacts > 0) for part in parts])
    places, distances, spreads = parts[0].reshape(len(rows), contacts, 2), parts[1], parts[2]
    scores: dict[str, list[FrameScore]] = {}
    for i, (row, has, values) in enumerate(zip(rows, known.tolist(), numbers[:, :7].tolist(), strict=True)):
        visible, limit, opening, area, confidence, alignment, latency = values
        scores.setdefault(row[method], []).append(
            FrameScore(
                frame=int(row[frame]),
                status=row[status],
                reason=row[reason],
                distances=distances[i] if has[1] else None,
                limit=limit,
                latency_ms=latency,
                defining=row[defining] == "1",
                strategy=row[strategy],
                contacts=places[i] if has[0] else None,
                spread=spreads[i] if has[2] else None,
                opening=opening,
                area=area,
                present=row[present] == "1",
                visible=visible,
                seen=row[seen] == "1",
                confidence=confidence,
                alignment=alignment,
            )
        )
    return scores


_ENTRIES = [f"h{row}{column}" for row in "123" for column in "123"]


def read_rows(path: Path, what: str) -> list[dict[str, str]]:
    """The rows of a table by its columns."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f'cannot read the {what} "{path}": {error}', path=str(path)) from error


def read_homographies(path: Path) -> dict[int, Floats]:
    """H_current_reference (3, 3) by frame, from a table with the columns frame, h11 ... h33; others are passed over."""
    table: dict[int, Floats] = {}
    for number, row in enumerate(read_rows(path, "homographies"), start=2):
        try:
            H = np.array([float(row[name]) for name in _ENTRIES]).reshape(3, 3)
            table[int(row["frame"])] = H
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f'"{path}", line {number}: a row needs frame and h11 to h33 as numbers', path=str(path), line=number
            ) from error
        if not np.isfinite(H).all() or abs(np.linalg.det(H)) < 1e-12:
            raise InputError(f'"{path}", line {number}: not an invertible homography', path=str(path), line=number)
    if not table:
        raise InputError(f'"{path}" holds no homographies', path=str(path))
    return table
