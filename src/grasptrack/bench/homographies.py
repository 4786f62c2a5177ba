# SPDX-License-Identifier: Apache-2.0
"""Tables of homographies from the first frame to each frame, as CSV."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from grasptrack.errors import InputError
from grasptrack.typing import Floats

_ENTRIES = [f"h{row}{column}" for row in "123" for column in "123"]


def read_homographies(path: Path) -> dict[int, Floats]:
    """H_current_reference (3, 3) by frame, from a table with the columns frame, h11 ... h33; others are passed over.

    Raises:
        InputError: missing or unreadable file, missing columns, or an entry that is no number.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f'cannot read the homographies "{path}": {error}', path=str(path)) from error
    table: dict[int, Floats] = {}
    for number, row in enumerate(rows, start=2):
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


def write_homographies(
    path: Path, table: Mapping[int, Floats], extra: Mapping[str, Mapping[int, str]] | None = None
) -> None:
    """The inverse of `read_homographies`, digits and all.

    Args:
        path: of the CSV file.
        table: H_current_reference (3, 3) by frame.
        extra: further columns, by name, with their text by frame.
    """
    columns = dict(extra or {})
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["frame", *_ENTRIES, *columns])
        for frame, H in sorted(table.items()):
            more = [column.get(frame, "") for column in columns.values()]
            writer.writerow([frame, *(repr(float(h)) for h in H.ravel()), *more])
