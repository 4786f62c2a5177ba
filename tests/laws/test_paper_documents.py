# SPDX-License-Identifier: Apache-2.0
"""Tables of the pages are those of the run that is kept beside them, cell by cell."""

import csv
import re
from pathlib import Path

import pytest

from grasptrack.errors import InputError
from grasptrack.transfer import homography
from research.paper.ablation import CONSTANTS, FACTORS, VARIANTS, changed
from research.paper.documents import KEPT, fill_page, main, markdown_of, read_table
from research.paper.error_tables import table_seven
from research.paper.footage import FRAMES, OBJECTS, ideal_footage, make_part, middle_frame
from research.paper.transfers import COMPARED, transfer_and_measure, ways_of

DOCS = Path(__file__).resolve().parents[2] / "docs"
HEAD = ("way", "who", "a, px", "n")
ROWS = [("one", "x|y", "0.123456", "7"), ("two", "z", "1e-12", ""), ("one", "z", "12345.6", "-3")]


@pytest.fixture
def folder(tmp_path):
    with (tmp_path / "T.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([HEAD, *ROWS])
    return tmp_path


def test_columns_and_rows_are_those_asked_for(folder):
    rows = read_table(folder, "T")
    assert markdown_of(rows).splitlines()[2:] == [
        "| one | x\\|y | 0.123 | 7 |",
        "| two | z | 0 | - |",
        "| one | z | 1.23e+04 | -3 |",
    ]
    shown = markdown_of(rows, "who; a, px as off by, px", "way = one; who = z / q")
    assert shown == "| who | off by, px |\n|---|---:|\n| z | 1.23e+04 |\n"


def test_a_page_is_filled_and_filled_again_the_same(folder):
    page = "Text.\n\n<!-- table T | who; n | way = two -->\nold\n<!-- end of table -->\n\nMore.\n"
    filled = fill_page(page, folder)
    assert filled == page.replace("old\n", "| who | n |\n|---|---|\n| z | - |\n")
    assert fill_page(filled, folder) == filled
    assert fill_page("<!-- table T -->\n<!-- end of table -->\n", folder).count("\n") == 7


def test_a_cell_stands_in_a_sentence(folder):
    page = (
        "It is <!-- cell T | a, px | way = one; who = z -->?<!-- end of cell --> px, "
        "<!-- cell T | n | way = one -->8<!-- end of cell -->.\n"
    )
    filled = fill_page(page, folder)
    assert filled == page.replace("?", "1.23e+04").replace(">8<", ">7<")
    assert fill_page(filled, folder) == filled
    for wrong, told in (("when | way = one", 'no column "when"'), ("n | way = three", 'no row with "way = three"')):
        with pytest.raises(InputError, match=told):
            fill_page(f"<!-- cell T | {wrong} --><!-- end of cell -->", folder)


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ("U", 'no table "U"'),
        ("T | when", 'no column "when"; it has way, who, a, px, n'),
        ("T | who | where = 1", 'no column "where"'),
        ("T | who | way = three", 'no row with "way = three"'),
    ],
)
def test_what_a_table_does_not_have_is_told(folder, asked, told):
    with pytest.raises(InputError, match=told):
        fill_page(f"<!-- table {asked} -->\n<!-- end of table -->\n", folder)


def test_every_page_is_filled_with_the_kept_run():
    pages = [page for page in DOCS.rglob("*.md") if "<!-- table " in page.read_text(encoding="utf-8")]
    assert {"paper.md", "tables/claims.md", "tables/paper.md"} <= {str(page.relative_to(DOCS)) for page in pages}
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert text.count("<!-- table ") == text.count("<!-- end of table -->")
        assert text.count("<!-- cell ") == text.count("<!-- end of cell -->")
        assert fill_page(text, DOCS / KEPT) == text, f"{page.name}: not what python -m research.paper.documents writes"


def test_the_script_keeps_the_tables_and_fills_the_pages(folder, tmp_path, monkeypatch, capsys):
    run, docs = tmp_path / "run", tmp_path / "docs"
    (run / "tables").mkdir(parents=True)
    docs.mkdir()
    (run / "tables" / "T.csv").write_bytes((folder / "T.csv").read_bytes())
    for name in ("times", "claims-times"):
        (run / f"{name}.csv").write_text("step\nall\n", encoding="utf-8")
    (run / "figures").mkdir()
    for name in ("paper-fig-4.png", "other.svg"):
        (run / "figures" / name).write_bytes(name.encode())
    for name, number in (("a.md", "T"), ("b.md", "times")):
        (docs / name).write_text(f"<!-- table {number} -->\n<!-- end of table -->\n", encoding="utf-8")
    (docs / "c.md").write_text("nothing\n", encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["documents", str(run), str(docs)])
    main()
    assert sorted(p.name for p in (docs / KEPT).iterdir()) == ["T.csv", "claims-times.csv", "times.csv"]
    assert [(p.name, p.read_bytes()) for p in (docs / "images").iterdir()] == [("paper-fig-4.png", b"paper-fig-4.png")]
    assert "| all |" in (docs / "b.md").read_text(encoding="utf-8")
    assert re.findall(r"(\w)\.md", capsys.readouterr().out) == ["a", "b"]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("number", "motion", "kind"),
    [(2, "4 DoF", "resampled"), (7, "6 DoF", "pixel chain"), (10, "approach", "resampled")],
)
def test_the_kept_tables_are_what_this_code_gives(number, motion, kind):
    """Part of Table VII worked out anew; a change of the transfers asks for another whole run."""
    courses = []
    for name in OBJECTS:
        footage = ideal_footage(make_part(name, 0), kind, motion, FRAMES, 0)
        courses += [transfer_and_measure(footage, s, way) for s in COMPARED for way in ways_of(s)]
    table = table_seven(number, courses, middle_frame(FRAMES))
    rows = [dict(zip(table.head, map(str, row), strict=True)) for row in table.rows]
    kept = read_table(DOCS / KEPT, table.number)
    assert len(rows) == len(kept)
    for row, told in zip(rows, kept, strict=True):
        for head, cell in told.items():
            if re.match(r"^-?\d", cell) and head not in ("error", "grasp"):
                assert float(row[head]) == pytest.approx(float(cell), rel=1e-5, abs=1e-8), (number, row["error"], head)
            else:
                assert row[head] in (cell, "None")


def test_the_kept_run_is_a_whole_one():
    figures = [
        DOCS / "images" / f"paper-{name}.png" for name in (*(f"fig-{n}" for n in range(4, 12)), "tilt", "sensitivity")
    ]
    assert all(path.stat().st_size < 150_000 for path in figures)
    assert len(read_table(DOCS / KEPT, "S")) == len(FACTORS) * len(CONSTANTS)
    assert {r["constant"] for r in read_table(DOCS / KEPT, "S")} == set(CONSTANTS)
    assert {r["strategy"] for r in read_table(DOCS / KEPT, "P")} == set(COMPARED)
    assert {r["transfer"] for r in read_table(DOCS / KEPT, "A")} == set(VARIANTS)


@pytest.mark.parametrize("constant", CONSTANTS)
def test_a_constant_is_as_it_was_after_it_was_varied(constant):
    before = vars(homography)[constant]
    with pytest.raises(ZeroDivisionError), changed(constant, 2.0):
        assert vars(homography)[constant] == 2 * before and type(vars(homography)[constant]) is type(before)
        raise ZeroDivisionError
    assert vars(homography)[constant] == before
