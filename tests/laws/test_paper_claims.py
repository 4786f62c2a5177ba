# SPDX-License-Identifier: Apache-2.0
"""The table of claims: its verdicts follow from cells of the run, and change with them."""

import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack_bench.report.table import Table
from research.paper.claims import CLAIMS, CLAIMS_OF_TIME, HEAD, TOO_SHORT, table_of_claims, table_of_verdicts
from research.paper.documents import KEPT, read_table
from research.paper.evidence import VERDICTS, Evidence, MissingEvidenceError, grade, percent, plain, px
from research.paper.printed import TABLE_VII

DOCS = Path(__file__).resolve().parents[2] / "docs"
BY_CONSTRUCTION = {"Transferred contacts are sure to lie on the outline"}
IN_PRINT = {"The reference error is that of one frame, the sequence error's maximum that of all (Table VII as printed)"}
ELSEWHERE = {
    "Tracked contacts can steer a hand by visual servoing",
    "The same serves grasps of objects in 3-D",
    "RRP and homography carry more kinds of grasps than other methods that track grasps ([22])",
}


@pytest.fixture(scope="module")
def kept():
    """Tables of the kept run, without the claims."""
    numbers = {p.stem for p in (DOCS / KEPT).glob("*.csv")}
    return {n: read_table(DOCS / KEPT, n) for n in numbers if not n.startswith("claims")}


@pytest.fixture(scope="module")
def others(kept):
    """The kept tables, and such with other cells."""
    changes = (
        lambda old, k: "0.0",
        lambda old, k: "1000.0",
        lambda old, k: f"{1.0 + k % 7}",
        lambda old, k: f"{1000.0 - old}",
        lambda old, k: f"{0.9 / (1.0 + k)}",
        lambda old, k: "refused",
    )
    return [kept, *(_changed(kept, change) for change in changes)]


def test_the_kept_claims_are_what_this_code_makes_of_the_kept_tables(kept):
    made = table_of_claims(Evidence(kept))
    assert [dict(zip(made.head, row, strict=True)) for row in made.rows] == read_table(DOCS / KEPT, "claims")
    counted = {row[0]: row[2] for row in table_of_verdicts(made).rows}
    assert sum(counted.values()) == len(CLAIMS) and set(counted) == set(VERDICTS)
    assert not any(row[HEAD.index("found")] == TOO_SHORT for row in made.rows)


def test_claims_of_time_are_decided_by_the_table_of_times(kept):
    told = read_table(DOCS / KEPT, "claims-times")
    assert [(c.says, *_told(c.rule(Evidence(kept)))) for c in CLAIMS_OF_TIME] == [
        (row["claim"], row["verdict"], row["found"]) for row in told
    ]
    for claim in CLAIMS_OF_TIME:
        assert claim.rule(Evidence(kept)).verdict in VERDICTS
        slow = [{**row, "ours, median us": f"{1e6 * (k + 1)}"} for k, row in enumerate(kept["times"])]
        quick = [{**row, "ours, median us": f"{1e-6 / (k + 1)}"} for k, row in enumerate(kept["times"])]
        assert len({claim.rule(Evidence({"times": rows})).verdict for rows in (slow, quick, kept["times"])}) > 1, (
            claim.says
        )


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda c: c.says[:50])
def test_a_verdict_changes_with_the_numbers(others, claim):
    """With other cells it is another one: no verdict is written down."""
    verdicts = {claim.rule(Evidence(tables)).verdict for tables in others}
    assert verdicts <= set(VERDICTS)
    if claim.says in BY_CONSTRUCTION:
        assert verdicts == {"reproduced"}
    elif claim.says in ELSEWHERE:
        assert verdicts == {"not tried"}
    elif claim.says in IN_PRINT:
        assert verdicts == {"not"} and TABLE_VII[2][1][1] > TABLE_VII[2][3][1]
    else:
        assert len(verdicts) > 1


def _told(finding):
    return finding.verdict, finding.found


def _changed(tables, change):
    """The same tables with other numbers, also within cells as "(0, 4, 3)" and "2.00 px"; change gets the row's number."""

    def cell(head, text, k):
        if head in ("tilt, degrees", "hidden, %", "contact", "object"):
            return text
        if text == "refused" or re.match(r"^(-?[\d.e+-]+$|\(|\d+\.\d+ px|refused: )", text):
            numbers = "1.0" if text.startswith("refused") else text
            new = re.sub(r"-?\d+(\.\d+)?(e[-+]?\d+)?", lambda found: change(float(found[0]), k), numbers)
            return text if "refused" in new and text.startswith("(") else new
        return text

    return {
        number: [{h: cell(h, c, k) for h, c in row.items()} for k, row in enumerate(rows)]
        for number, rows in tables.items()
    }


def test_without_tables_nothing_is_claimed():
    for row in table_of_claims(Evidence({})).rows:
        assert row[HEAD.index("verdict")] == "not tried"


def test_claims_are_told_once_and_say_where_they_come_from():
    every = (*CLAIMS, *CLAIMS_OF_TIME)
    assert len({c.says for c in every}) == len(every) >= 35
    for claim in every:
        assert re.match(r"^(I|II|III|IV|V|VI)\b", claim.section)
        assert claim.command == "-" or claim.command.startswith(("grasptrack ", "python -m research."))


def test_cells_are_found_by_what_stands_beside_them():
    table = Table("X", "", ("a", "tilt", "px"), (("one", 20.0, 0.25), ("one", 40.0, None), ("two", 20.0, "refused")))
    evidence = Evidence.of([table])
    assert evidence.number("X", "px", {"a": "one", "tilt": 20.0}) == 0.25
    assert evidence.number("X", "px", {"a": "two"}) == math.inf == evidence.number("X", "px", {"tilt": 40.0})
    assert evidence.numbers("X", "px", {"tilt": 20.0}) == [0.25, math.inf]
    with pytest.raises(MissingEvidenceError, match="table X has no row"):
        evidence.number("X", "px", {"a": "three"})
    with pytest.raises(MissingEvidenceError, match="table Y"):
        evidence.rows("Y", {})


@given(st.floats(1e-6, 1e6))
def test_numbers_are_told_to_three_digits_without_an_exponent(value):
    told = plain(value)
    assert "e" not in told
    assert float(told) == pytest.approx(value, rel=0.006, abs=6e-5)
    assert px(value) == f"{told} px" and percent(math.inf) == "refused" and plain(1e-12) == "0"


def test_a_part_that_holds_is_not_the_whole():
    assert [grade(True, True), grade(True, False), grade(False, True), grade(False, False)] == [
        "reproduced",
        "reproduced",
        "partly",
        "not",
    ]
