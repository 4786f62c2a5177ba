# SPDX-License-Identifier: Apache-2.0
"""Tables of the documentation, filled in from the files of a run, so that no figure in them is typed.

`python -m research.paper.documents RUN DOCS` copies the tables of a run of `python -m research.paper` to
`DOCS/tables/paper` and fills in every page of DOCS and of DOCS/tables anew. On a page a table stands between two comments:

    <!-- table P | motion; strategy; median px as px | way = last frame as prior; contours = resampled / pixel chain -->
    <!-- end of table -->

that is the table's number; the columns to show, each under its own head or another; and what rows must have in some columns,
alternatives between slashes. The last two may be left out. In a sentence a single cell stands in the same way:

    the error is <!-- cell P | median px | strategy = rrp; way = first view -->0.5<!-- end of cell --> px

which is the cell of the first such row. Pictures `paper-*.png` of the run go to `DOCS/images`.
"""

from __future__ import annotations

import argparse
import csv
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from grasptrack.errors import InputError
from grasptrack_bench.report.table import format_cell

KEPT = "tables/paper"
"""Folder of the documentation in which the tables of the whole run lie."""
IMAGES = "images"
ZERO = 1e-9
"""What is smaller, in whatever unit, is the rounding of the arithmetic, and shown as 0."""
_BLOCK = re.compile(
    r"^(<!-- table ([^|\n]+?)((?: ?\|[^\n]*)?) -->\n).*?^(<!-- end of table -->)$", re.MULTILINE | re.DOTALL
)
_CELL = re.compile(r"(<!-- cell ([^|\n]+?) \| ([^|\n]+?) \| ([^\n]*?) -->)[^\n]*?(<!-- end of cell -->)")

Row = Mapping[str, str]


def read_table(folder: Path, number: str) -> list[dict[str, str]]:
    """Rows of `NUMBER.csv` by head."""
    path = folder / f"{number}.csv"
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f'there is no table "{number}" in "{folder}": {error}', path=str(path)) from error


def fill_page(text: str, folder: Path) -> str:
    """The page with every table and every cell between its comments written anew."""

    def fill(found: re.Match[str]) -> str:
        number, asked = found[2].strip(), [part.strip() for part in found[3].split("|")[1:]]
        columns, where = (*asked, "", "")[:2]
        return found[1] + markdown_of(read_table(folder, number), columns, where, number) + found[4]

    def fill_cell(found: re.Match[str]) -> str:
        number, head, where = (found[k].strip() for k in (2, 3, 4))
        rows = read_table(folder, number)
        _check_head(rows, head, number)
        return found[1] + _format(_kept_rows(rows, where, number)[0][head]) + found[5]

    return _CELL.sub(fill_cell, _BLOCK.sub(fill, text))


def markdown_of(rows: Sequence[Row], columns: str = "", where: str = "", number: str = "") -> str:
    """Rows, by head, as a Markdown table of a number, which is for messages.

    `columns` are heads to show, between semicolons, each as itself or `as` another; `where` what rows must have,
    `head = value / value`, between semicolons. Where either is empty, all are meant.
    """
    pairs = [(head, name or head) for head, _, name in (c.partition(" as ") for c in _parts(columns) or rows[0])]
    kept = _kept_rows(rows, where, number)
    for head, _ in pairs:
        _check_head(rows, head, number)
    right = [any(_is_number(r[head]) for r in kept) for head, _ in pairs]
    lines = ["| " + " | ".join(name for _, name in pairs) + " |"]
    lines.append("|" + "|".join("---:" if r else "---" for r in right) + "|")
    lines += ["| " + " | ".join(_format(r[head]) for head, _ in pairs) + " |" for r in kept]
    return "\n".join(lines) + "\n"


def _kept_rows(rows: Sequence[Row], where: str, number: str) -> list[Row]:
    """The rows that have what is asked for, see `markdown_of`."""
    kept = list(rows)
    for condition in _parts(where):
        head, _, wanted = (part.strip() for part in condition.partition("="))
        _check_head(rows, head, number)
        values = [v.strip() for v in wanted.split("/")]
        kept = [r for r in kept if r[head] in values]
    if not kept:
        raise InputError(f'table {number} has no row with "{where}"')
    return kept


def _parts(text: str) -> list[str]:
    return [part.strip() for part in text.split(";") if part.strip()]


def _check_head(rows: Sequence[Row], head: str, number: str) -> None:
    if not rows or head not in rows[0]:
        heads = ", ".join(rows[0]) if rows else "none"
        raise InputError(f'table {number} has no column "{head}"; it has {heads}')


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _format(text: str) -> str:
    """A cell with three digits of what is no whole number."""
    if not text:
        return "-"
    if not _is_number(text):
        return text.replace("|", "\\|")
    value = float(text)
    if abs(value) < ZERO:
        return "0"
    return text if re.fullmatch(r"-?\d+", text) else format_cell(value)


def main() -> None:
    """Copy tables and figures of a run, fill in all pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of a run of python -m research.paper")
    parser.add_argument("docs", type=Path, help="folder of the documentation")
    args = parser.parse_args()
    kept = args.docs / KEPT
    kept.mkdir(parents=True, exist_ok=True)
    for path in (*sorted((args.run / "tables").glob("*.csv")), *sorted(args.run.glob("*times.csv"))):
        shutil.copyfile(path, kept / path.name)
    for path in sorted((args.run / "figures").glob("paper-*.png")):
        (args.docs / IMAGES).mkdir(exist_ok=True)
        shutil.copyfile(path, args.docs / IMAGES / path.name)
    for page in (*sorted(args.docs.glob("*.md")), *sorted(args.docs.glob("tables/*.md"))):
        text = page.read_text(encoding="utf-8")
        filled = fill_page(text, kept)
        if filled != text:
            page.write_text(filled, encoding="utf-8")
            print(page)


if __name__ == "__main__":
    main()
