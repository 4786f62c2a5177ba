# SPDX-License-Identifier: Apache-2.0
"""The tables of a run as what decides a claim: cells found by what stands beside them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
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
Where = Mapping[str, str | float]
"""What must stand beside a cell, by head."""
REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class Finding:
    """What became of a claim, and the numbers that say so."""

    verdict: Verdict
    found: str


class MissingEvidenceError(LookupError):
    """The run has no such cell: it was too short, or of other shapes."""


class Evidence:
    """Cells of a run's tables: rows by head, by the table's number."""

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

    def rows(self, table: str, where: Where) -> Rows:
        """The rows that have these values under these heads.

        Raises:
            MissingEvidenceError: there is none.
        """
        wanted = {head: str(value) for head, value in where.items()}
        found = [r for r in self._tables.get(table, ()) if all(r.get(head) == v for head, v in wanted.items())]
        if not found:
            raise MissingEvidenceError(f"table {table} has no row with {wanted}")
        return found

    def text(self, table: str, column: str, where: Where) -> str:
        """The cell of the first such row.

        Raises:
            MissingEvidenceError: see `rows`.
        """
        return self.rows(table, where)[0][column]

    def number(self, table: str, column: str, where: Where) -> float:
        """The same as a number, without its unit; infinite where everything was refused or nothing answered."""
        return number_of(self.text(table, column, where))

    def population(
        self, strategy: str, motion: str, contours: str = "resampled", way: str = "first view", cell: str = "median px"
    ) -> float:
        """A cell of Table P."""
        where: Where = {"motion": motion, "contours": contours, "strategy": strategy, "way": way}
        return self.number("P", cell, where)

    def ablation(self, transfer: str, motion: str, contours: str = "resampled", cell: str = "median px") -> float:
        """A cell of Table A, from the first view."""
        where: Where = {"motion": motion, "contours": contours, "transfer": transfer, "way": "first view"}
        return self.number("A", cell, where)

    def glance(self, cell: str, motion: str, contours: str, transfer: str = "to the letter") -> float:
        """A cell of Table VII at a glance, from the first view."""
        where: Where = {"motion": motion, "contours": contours, "transfer": transfer, "way": "first view"}
        return self.number("VII", cell, where)

    def tilted(self, strategy: str, degrees: float) -> float:
        """px of Table T, from the first view."""
        return self.number("T", "median px", {"tilt, degrees": degrees, "strategy": strategy, "way": "first view"})

    def hidden(self, strategy: str, share: float, way: str, cell: str = "median px") -> float:
        """A cell of Table K."""
        return self.number("K", cell, {"hidden, %": share, "strategy": strategy, "way": way})

    def context(self, experiment: str, strategy: str) -> float:
        """px of Table C; infinite where it was refused."""
        return self.number("C", strategy, {"experiment": experiment})

    def numbers(self, table: str, column: str, where: Where) -> list[float]:
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


COMMAND = "python -m research.paper"
FEW = 5.0
"""Per cent of the answers that may be off, or of the frames without one, for a claim that something works."""
SMALL = 1.0
"""px, median error of what counts as exact in practice: about a pixel."""


@dataclass(frozen=True)
class Claim:
    """One thing that the paper says.

    Attributes:
        section: where.
        says: what, in our words.
        experiment: tables and what is looked at in them.
        rule: from the cells of a run to a verdict.
        command: that makes them.
    """

    section: str
    says: str
    experiment: str
    rule: Callable[[Evidence], Finding]
    command: str = COMMAND


def claim(
    claims: list[Claim], section: str, says: str, experiment: str, command: str = COMMAND
) -> Callable[[Callable[[Evidence], Finding]], Callable[[Evidence], Finding]]:
    """Appends the claim that a rule decides to a list; see `Claim`."""

    def append_claim(rule: Callable[[Evidence], Finding]) -> Callable[[Evidence], Finding]:
        claims.append(Claim(section, says, experiment, rule, command))
        return rule

    return append_claim
