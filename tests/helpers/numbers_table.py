# SPDX-License-Identifier: Apache-2.0
"""The table of the core's numbers in docs/numbers.md, as `numbers.json` has them.

python tests/helpers/numbers_table.py    writes it anew
"""

from __future__ import annotations

import json
from pathlib import Path

from grasptrack.tracking.numbers import OWN

PAGE = Path(__file__).resolve().parents[2] / "docs" / "numbers.md"
BEGIN, END = "<!-- numbers.json -->\n", "<!-- end -->\n"


def numbers_table() -> str:
    """Name, value, unit, meaning and, where a script fitted it, the script and the interval that the data left."""
    rows = ["| number | value | unit | meaning | fitted |", "|---|---|---|---|---|"]
    for name, entry in json.loads(OWN.read_text(encoding="utf-8")).items():
        fitted = f"{entry['from']:g} to {entry['to']:g}, `{entry['by']}`" if "by" in entry else ""
        rows.append(f"| `{name}` | {entry['value']:g} | {entry['unit']} | {entry['meaning']} | {fitted} |")
    return "\n".join(rows) + "\n"


def with_table(page: str) -> str:
    """The text of the page with the table as it is now."""
    start, rest = page.split(BEGIN)
    return start + BEGIN + numbers_table() + END + rest.split(END)[1]


if __name__ == "__main__":
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
