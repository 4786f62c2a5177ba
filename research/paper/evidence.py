# SPDX-License-Identifier: Apache-2.0
"""The tables of a run as what decides a claim: cells found by what stands beside them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from grasptrack_bench.report.table import Table

Verdict = Literal["reproduced", "partly", "not", "not tried"]
VERDICTS: dict[Verdict, str] = {
    "reproduced": "holds where it was tried",
    "partly": "holds in part of what was tried, or only with a change that the text does not have",
    "not": "does not hold where it was tried",
    "not tried": "nothing in this run decides it, and it is said where something does",
}
Rows = Sequence[Mapping[str, str]]
REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class Finding:
    """What became of a claim, and the numbers that say so."""

    verdict: Verdict
    found: str


class MissingEvidenceError(LookupError):
    """The run has no such cell: it was too short, or of other shapes."""


class Evidence:
    """Cells of a run's tables.

    Args:
        tables: rows by head, by the table's number.
    """

    def __init__(self, tables: Mapping[str, Rows]) -> None:
        self._tables = tables

    @classmethod
    def of(cls, tables: Iterable[Table]) -> Evidence:
        """Of tables that were just made; the same as of their files."""
        return cls(
            {
                t.number: [dict(zip(t.head, ("" if c is None else str(c) for c in row), strict=True)) for row in t.rows]
                for t in tables
            }
        )

    def rows(self, table: str, where: Mapping[str, str | float]) -> Rows:
        """The rows that have these values under these heads.

        Raises:
            MissingEvidenceError: there is none.
        """
        wanted = {head: str(value) for head, value in where.items()}
        found = [r for r in self._tables.get(table, ()) if all(r.get(head) == v for head, v in wanted.items())]
        if not found:
            raise MissingEvidenceError(f"table {table} has no row with {wanted}")
        return found

    def text(self, table: str, column: str, where: Mapping[str, str | float]) -> str:
        """The cell of the first such row.

        Raises:
            MissingEvidenceError: see `rows`.
        """
        return self.rows(table, where)[0][column]

    def number(self, table: str, column: str, where: Mapping[str, str | float]) -> float:
        """The same as a number, without its unit; infinite where everything was refused or nothing answered."""
        return number_of(self.text(table, column, where))

    def numbers(self, table: str, column: str, where: Mapping[str, str | float]) -> list[float]:
        """Of all such rows."""
        return [number_of(r[column]) for r in self.rows(table, where)]


def number_of(cell: str) -> float:
    """The number at the beginning of a cell; infinite where there is none."""
    found = re.match(r"-?\d+(\.\d+)?(e[-+]?\d+)?", cell)
    return float(found[0]) if found else math.inf


def grade(whole: bool, part: bool) -> Verdict:
    """Reproduced if the whole claim holds, partly if part of it does."""
    return "reproduced" if whole else "partly" if part else "not"


def px(value: float) -> str:
    """A length, or that there was no answer."""
    return f"{plain(value)} px" if math.isfinite(value) else REFUSED


def percent(value: float) -> str:
    """A share in per cent, or that there was no answer."""
    return f"{plain(value)} %" if math.isfinite(value) else REFUSED


ROUNDING = 1e-6
"""What is smaller, in px or per cent, is the rounding of the arithmetic."""


def plain(value: float) -> str:
    """Three digits, never with an exponent; what is only rounding is 0, what is not finite was refused."""
    if not math.isfinite(value):
        return REFUSED
    if abs(value) < ROUNDING:
        return "0"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}" if digits < 2 or value >= 1.0 else f"{value:.{min(digits, 4)}f}"
