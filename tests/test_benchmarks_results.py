# SPDX-License-Identifier: Apache-2.0
"""The file of results: sections are replaced where they stand, and nothing else is touched."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import common

TITLES = st.lists(st.text("abc xyz", min_size=1).map(str.strip).filter(bool), unique=True, min_size=1, max_size=5)
TEXTS = st.text("ab|\n- 12", min_size=1).map(str.strip).filter(bool)


@given(titles=TITLES, texts=st.lists(TEXTS, min_size=6, max_size=6), data=st.data())
def test_a_section_takes_the_place_of_its_old_self(
    tmp_path_factory: pytest.TempPathFactory, titles: list[str], texts: list[str], data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("results") / "R.md"
    for title, text in zip(titles, texts, strict=False):
        common.section(path, title, text)
    before = path.read_text(encoding="utf-8")
    again = data.draw(st.integers(0, len(titles) - 1))
    common.section(path, titles[again], texts[again])
    assert path.read_text(encoding="utf-8") == before
    common.section(path, titles[again], texts[5])
    expected = [texts[5] if i == again else texts[i] for i in range(len(titles))]
    parts = "".join(f"\n\n## {title}\n\n{text}" for title, text in zip(titles, expected, strict=True))
    assert path.read_text(encoding="utf-8") == f"{common.PREFACE.strip()}{parts}\n"


def test_a_run_is_written_with_its_command_and_its_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(common, "_sections", [])
    monkeypatch.setattr(sys, "argv", ["benchmarks/x.py", "--calls", "3"])
    common.heading("Title")
    common.say("A sentence.")
    common.table(["call", "us"], [["a", 1234.5], ["b", float("nan")]])
    common.finish(None)
    assert list(tmp_path.iterdir()) == []
    common.finish(tmp_path / "R.md")
    text = (tmp_path / "R.md").read_text(encoding="utf-8")
    assert "## Title\n\n`python benchmarks/x.py --calls 3`\n\n" in text
    assert text.endswith("A sentence.\n\n| call | us |\n| --- | ---: |\n| a | 1,234 |\n| b |  |\n")
