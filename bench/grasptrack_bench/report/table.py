# SPDX-License-Identifier: Apache-2.0
"""A table of results, and its plain forms: text, CSV, Markdown, and values for JSON."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

Cell = str | float | int | None


@dataclass(frozen=True, slots=True)
class Table:
    """One table.

    Attributes:
        number: "I" to "VII" for the paper's tables, or another short name.
        title: what it shows.
        head: one name for each column, with its unit.
        rows: cells by row; None where there is nothing to say, and a note then says why.
        notes: sentences to be read with it.
    """

    number: str
    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.head):
                raise ValueError(f"table {self.number}: a row of {len(row)} cells under {len(self.head)} heads: {row}")


def format_cell(cell: Cell) -> str:
    """A cell for people: three digits of a number that is not whole, "-" for None."""
    if cell is None:
        return "-"
    return f"{cell:.3g}" if isinstance(cell, float) else str(cell)


def to_text(table: Table) -> str:
    """Columns aligned by spaces, numbers to the right, notes below."""
    cells = [[format_cell(c) for c in row] for row in table.rows]
    widths = [max(len(row[i]) for row in [list(table.head), *cells]) for i in range(len(table.head))]
    right = [is_number(table, i) for i in range(len(table.head))]

    def format_row(row: list[str]) -> str:
        padded = (c.rjust(w) if r else c.ljust(w) for c, w, r in zip(row, widths, right, strict=True))
        return "  ".join(padded).rstrip()

    ruled = "  ".join("-" * w for w in widths)
    body = [f"Table {table.number}. {table.title}", "", format_row(list(table.head)), ruled, *map(format_row, cells)]
    return "\n".join([*body, *([""] if table.notes else []), *table.notes]) + "\n"


def to_markdown(table: Table) -> str:
    """A Markdown table, numbers to the right, notes below."""

    def format_row(row: list[str]) -> str:
        return "| " + " | ".join(c.replace("|", "\\|") for c in row) + " |"

    rule = "|" + "|".join("---:" if is_number(table, i) else "---" for i in range(len(table.head))) + "|"
    body = [format_row([format_cell(c) for c in row]) for row in table.rows]
    notes = [part for note in table.notes for part in ("", note)]
    return (
        "\n".join([f"**Table {table.number}.** {table.title}", "", format_row(list(table.head)), rule, *body, *notes])
        + "\n"
    )


def to_csv(table: Table, path: Path) -> None:
    """Write head and rows as `write_rows` does; the notes are not written."""
    write_rows(path, table.head, table.rows)


def write_rows(path: Path, head: Sequence[str], rows: Iterable[Sequence[Cell]]) -> None:
    """Write a CSV file, numbers in full, empty for None."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(head)
        writer.writerows(["" if c is None else c for c in row] for row in rows)


def to_json(table: Table) -> dict[str, object]:
    """Values that `json.dumps` takes, numbers in full."""
    return {
        "number": table.number,
        "title": table.title,
        "head": list(table.head),
        "rows": [list(row) for row in table.rows],
        "notes": list(table.notes),
    }


def is_number(table: Table, column: int) -> bool:
    """Whether a column has numbers."""
    return any(isinstance(row[column], int | float) for row in table.rows)
