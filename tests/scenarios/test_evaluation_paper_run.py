# SPDX-License-Identifier: Apache-2.0
"""A short run of all tables, and a table's plain forms."""

import csv
import json
import math

import numpy as np
import pytest

from grasptrack.bench.paper import error_tables, run_paper
from grasptrack.bench.paper.footage import KINDS, MOTIONS, OBJECTS
from grasptrack.bench.report.table import Table, to_csv, to_json, to_markdown, to_text
from grasptrack.errors import InputError
from grasptrack.transfer import STRATEGIES

FRAMES = 5


@pytest.fixture(scope="module", autouse=True)
def quick():
    """Shorter experiments on images."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(error_tables, "CONTEXT_FRAMES", 16)
        yield


@pytest.fixture(scope="module")
def run(quick):
    told = []
    done = run_paper(frames=FRAMES, progress=lambda *step: told.append(step))
    return done, told


def test_every_table_is_there_and_every_cell_is_filled_or_explained(run):
    tables = {t.number: t for t in run[0].tables}
    sevens = [f"VII-{k}" for k in range(1, 9)]
    assert list(tables) == ["I", "II", "III", "IV", "V", "VI-1", "VI-2", "VII", *sevens, "C"]
    for table in tables.values():
        assert table.rows and table.notes and len(set(table.head)) == len(table.head)
        notes = " ".join(table.notes)
        cells = [c for row in table.rows for c in row]
        assert all(math.isfinite(c) for c in cells if isinstance(c, float))
        assert None not in cells or "-: " in notes
        assert "" not in cells or "first one's row" in notes or table.number == "V"
        if "refused" in cells:
            assert "efused " in notes
        if table.number not in ("VII", "C"):
            assert {str(c) for row in table.rows for c in row[:2]} >= set(OBJECTS)
    for number in ("I", "III", "IV", "VI-1", "VI-2", *sevens):
        assert "paper" in [row[0] for row in tables[number].rows]


def test_the_coordinates_of_tables_three_and_four_are_those_that_a_transfer_keeps(run):
    tables = {t.number: t for t in run[0].tables}
    for number, column in (("III", 4), ("IV", 5)):
        rows = tables[number].rows
        for kind, name in {row[:2] for row in rows if row[0] != "paper"}:
            before, _, after, _ = (row[column] for row in rows if row[:2] == (kind, name))
            if number == "III":
                assert before == after
            else:  # over the area, under a change of scale of a few per cent
                d, e = (np.array([float(v.strip("()°")) for v in text.split(", ")]) for text in (before, after))
                assert abs(d[1] - e[1]) < 0.1
                np.testing.assert_allclose(d[[0, 2, 3]], e[[0, 2, 3]], atol=2e-4)
            assert all(row[6] < 0.3 for row in rows if row[:2] == (kind, name) and row[6] is not None)


def test_each_strategy_refuses_or_fails_where_what_it_needs_is_missing(run):
    rows = {row[2]: row[3:] for row in next(t for t in run[0].tables if t.number == "C").rows}
    assert all(cell.endswith(" px") for cell in rows["resampled contours, all objects"])
    rrp, line, peaks = rows["RRP given a contour with another start"]
    assert float(rrp.removesuffix(" px")) > 20.0 > 0.1 > max(float(c.removesuffix(" px")) for c in (line, peaks))
    refused = {
        "a grasp of three contacts": (False, True, False),
        "a disc": (False, True, True),
        "a rectangle": (False, True, True),  # one pair of views cannot tell it from itself turned
        "an egg": (False, False, True),
    }
    for what, expected in refused.items():
        assert tuple(cell.startswith("refused: ") for cell in rows[what]) == expected
    assert "whole" in rows["images: the border cuts the object"][1]


def test_series_hold_every_frame_and_agree_with_the_tables(run):
    done, _ = run
    assert len(done.series) == len(OBJECTS) * len(KINDS) * len(MOTIONS) * len(STRATEGIES) * 2
    glance = next(t for t in done.tables if t.number == "VII")
    for s in done.series:
        assert len(s.average_px) == len(s.maximum_px) == len(s.reasons) == FRAMES - 1
        for average, largest, reason in zip(s.average_px, s.maximum_px, s.reasons, strict=True):
            assert (average is None) == (largest is None) == bool(reason)
            assert average is None or 0.0 <= average <= largest
    row = next(r for r in glance.rows if r[:2] == ("4 DoF", "rendered"))
    worst = [
        max(e for s in done.series if _of(s, strategy) for e in s.maximum_px if e is not None)
        for strategy in STRATEGIES
    ]
    assert [row[3], row[7], row[11]] == worst
    assert max(row[3], row[7]) < 0.3 and row[11] < 3.0


def _of(s, strategy):
    return (s.strategy, s.motion, s.kind, s.carried_on) == (strategy, "4 DoF", "rendered", False)


def test_pictures_are_of_the_rendered_pairs(run):
    captions = [c for c, _ in run[0].pictures]
    assert len(set(captions)) == len(captions) == 4 * len(OBJECTS)
    for number in ("II", "III", "IV", "V"):
        assert sum(c.startswith(f"Table {number},") for c in captions) == len(OBJECTS)
    for _, picture in run[0].pictures:
        assert picture.dtype == np.uint8 and picture.shape[1:] == (1288, 3) and picture.std() > 20.0


def test_progress_reaches_the_end_of_each_step(run):
    steps = {}
    for step, done, total in run[1]:
        assert done == steps.get(step, 0) + 1 <= total
        steps[step] = done
    assert {(step, total) for step, _, total in run[1]} == set(steps.items())
    assert list(steps) == ["images", "transfers", "contexts"]


def test_the_same_run_twice(run):
    again = run_paper(frames=FRAMES)
    assert again.tables == run[0].tables
    assert again.series == run[0].series
    for (_, one), (_, other) in zip(again.pictures, run[0].pictures, strict=True):
        np.testing.assert_array_equal(one, other)


def test_too_few_frames_are_refused():
    with pytest.raises(InputError, match="at least 4 frames, not 3"):
        run_paper(frames=3)


# --- a table's forms -------------------------------------------------------------------------------

TABLE = Table(
    "X", "Numbers", ("name", "a | b", "n"), (("one", 0.00026, 3), ("two", None, "-1, not known")), ("A note.",)
)


def test_text_and_markdown_show_the_same_cells():
    text, markdown = to_text(TABLE), to_markdown(TABLE)
    for shown in (text, markdown):
        assert "Table X" in shown and "0.00026" in shown and "A note." in shown and "-1, not known" in shown
    head, rule, *body = markdown.splitlines()[2:6]
    assert head == "| name | a \\| b | n |" and rule == "|---|---:|---:|" and body[1] == "| two | - | -1, not known |"
    lines = text.splitlines()[2:6]
    assert len({line.index("0.00026") + len("0.00026") for line in lines if "0.00026" in line}) == 1
    assert lines[0].index("a | b") + len("a | b") == lines[2].index("0.00026") + len("0.00026")


def test_csv_and_json_keep_every_digit(tmp_path):
    path = tmp_path / "x.csv"
    table = Table("X", "t", ("a", "b"), ((1.0 / 3.0, None), ("é, ü", 7)))
    to_csv(table, path)
    rows = list(csv.reader(path.open(encoding="utf-8", newline="")))
    assert rows == [["a", "b"], [repr(1.0 / 3.0), ""], ["é, ü", "7"]]
    told = json.loads(json.dumps(to_json(TABLE)))
    assert told["rows"] == [["one", 0.00026, 3], ["two", None, "-1, not known"]] and told["notes"] == ["A note."]


def test_rows_fit_the_head():
    with pytest.raises(ValueError, match="a row of 1 cells under 2 heads"):
        Table("X", "t", ("a", "b"), (("one",),))
