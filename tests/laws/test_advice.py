# SPDX-License-Identifier: Apache-2.0
"""Every reason has its remedy, in the program and on the page; advice is given where many frames were lost."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.cli.advice import MANY, MOST, advice_for
from grasptrack.live.state import OPTIONS
from grasptrack.presentation import REMEDIES
from grasptrack.tracking.messages import SENTENCES
from research.studies.reason_pictures import SHOWN, STAGED, first_frame_with

PAGE = Path(__file__).resolve().parents[2] / "docs" / "troubleshooting.md"


def test_every_code_has_a_remedy_here_and_on_the_page() -> None:
    assert REMEDIES.keys() == SENTENCES.keys()
    plain = [re.sub(OPTIONS, "", remedy) for remedy in REMEDIES.values()]
    assert [remedy for remedy in plain if "--" in remedy or "FILE" in remedy or ".mp4" in remedy] == []
    rows = [
        [c.strip() for c in line.strip("|").split("|")]
        for line in PAGE.read_text().splitlines()
        if line.startswith("| `")
    ]
    told = {row[0].strip("`"): row for row in rows if row[0].strip("`") in SENTENCES}
    assert told.keys() == SENTENCES.keys()
    for code, (_, meaning, remedy, picture) in told.items():
        assert remedy == REMEDIES[code] and meaning in (SENTENCES[code], meaning if not SENTENCES[code] else "")
        assert picture == (f"![{code}](images/reasons/{code}.webp)" if code in STAGED else "")


def test_every_reason_that_can_be_staged_has_a_small_picture() -> None:
    kept = {path.stem: path.stat().st_size for path in (PAGE.parent / "images" / "reasons").glob("*.webp")}
    assert kept.keys() == STAGED.keys() <= SENTENCES.keys()
    assert sum(kept.values()) < 600_000


@pytest.mark.sampled(1)
@pytest.mark.parametrize("code", ["no-grasp", "no-description", "object-gone"])
def test_a_staged_scene_gives_its_reason(code: str) -> None:
    found = first_frame_with(code)
    assert found is not None
    picture, result = found
    assert result.reason_code == code and picture.shape == (SHOWN[1], SHOWN[0], 3) and picture.std() > 5.0


@given(codes=st.dictionaries(st.sampled_from(sorted(SENTENCES)), st.integers(0, 50)), more=st.integers(0, 500))
def test_advice_names_the_most_frequent_reasons(codes: dict[str, int], more: int) -> None:
    frames = sum(codes.values()) + more
    told = advice_for(codes, frames)
    if sum(codes.values()) <= MANY * frames:
        assert told == []
        return
    assert 0 < len(told) <= MOST or max(codes.values()) <= 0.05 * frames
    if told:
        assert told[0].startswith(f"{max(codes.values())} of {frames} frames")
