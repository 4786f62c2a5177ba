# SPDX-License-Identifier: Apache-2.0
"""The table of claims: what the paper says works, fails, is better or faster, each decided by numbers of a run."""

from __future__ import annotations

from collections.abc import Sequence

from grasptrack_bench.report.table import Table
from research.paper.claims_of_methods import CLAIMS_OF_METHODS
from research.paper.claims_of_results import CLAIMS_OF_RESULTS, CLAIMS_OF_TIME
from research.paper.evidence import VERDICTS, Claim, Evidence, Finding, MissingEvidenceError

CLAIMS = (*CLAIMS_OF_METHODS, *CLAIMS_OF_RESULTS)
HEAD = ("section", "claim", "experiment", "verdict", "found", "command")
TOO_SHORT = "the run is too short, or has too few shapes, to decide it"


def table_of_claims(evidence: Evidence) -> Table:
    """Every claim but those about time, which change from run to run."""
    notes = (
        "The sentences are ours, not the paper's. A verdict is a rule over the cells of the tables named; figures are of the "
        "paper's transfers to the letter where nothing else is said, medians over shapes and seeds where there are several.",
        f"{'; '.join(f'{name}: {meaning}' for name, meaning in VERDICTS.items())}.",
    )
    return Table("claims", "What the paper claims, and what came of it", HEAD, _rows(CLAIMS, evidence), notes)


def table_of_verdicts(claims: Table) -> Table:
    """How many claims came to which verdict."""
    given = [row[HEAD.index("verdict")] for row in claims.rows]
    rows = tuple((name, meaning, given.count(name)) for name, meaning in VERDICTS.items())
    head = ("verdict", "meaning", "claims")
    return Table("claims-counted", "Verdicts on the claims", head, rows, ("Without those of time.",))


def table_of_time_claims(times: Table) -> Table:
    """The claims about time, of this machine and this moment."""
    notes = ("Machines of today against a 2.5 GHz Celeron: orders and shares compare, microseconds do not.",)
    rows = _rows(CLAIMS_OF_TIME, Evidence.of([times]))
    return Table("claims-times", "What the paper claims of time, and what came of it", HEAD, rows, notes)


def _rows(claims: Sequence[Claim], evidence: Evidence) -> tuple[tuple[str, ...], ...]:
    rows = []
    for c in claims:
        try:
            finding = c.rule(evidence)
        except MissingEvidenceError:
            finding = Finding("not tried", TOO_SHORT)
        rows.append((c.section, c.says, c.experiment, finding.verdict, finding.found, c.command))
    return tuple(rows)
