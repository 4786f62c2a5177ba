# SPDX-License-Identifier: Apache-2.0
"""A goal's file gives back the goal that was saved, and what is none is told in one line that names the file."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack import Goal, InputError

COORDINATES = st.floats(-5000.0, 5000.0, allow_nan=False)
GOOD: dict[str, Any] = {
    "format": 1,
    "kind": "fingertips",
    "points_px": [[100.25, 200.5], [300.0, 210.0]],
    "opening_m": 0.08,
    "beyond_m": 0.01,
    "symmetric": True,
}


@given(
    points=st.lists(st.tuples(COORDINATES, COORDINATES), min_size=2, max_size=4, unique=True).filter(
        lambda p: np.hypot(p[0][0] - p[1][0], p[0][1] - p[1][1]) > 1.0
    ),
    opening=st.one_of(st.none(), st.floats(0.001, 1.0)),
    beyond=st.floats(-0.05, 0.05),
    symmetric=st.booleans(),
)
def test_a_goal_comes_back_as_it_was_saved(
    tmp_path_factory: pytest.TempPathFactory,
    points: list[tuple[float, float]],
    opening: float | None,
    beyond: float,
    symmetric: bool,
) -> None:
    goal = (
        Goal.taught(points, symmetric=symmetric)
        if opening is None
        else Goal.fingertips(points, opening, beyond_m=beyond, symmetric=symmetric)
    )
    file = tmp_path_factory.mktemp("goal") / "goal.json"
    goal.save(file)
    assert Goal.load(file) == goal
    assert [p.name for p in file.parent.iterdir()] == ["goal.json"]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"format": 2}, "format 2, not 1"),
        ({"kind": "grip"}, '"fingertips" or "taught"'),
        ({"points_px": "here"}, "points_px"),
        ({"points_px": [[1.0, 2.0]]}, "two or more"),
        ({"points_px": [[1.0, 2.0], [1.0, 2.0]]}, "lie apart"),
        ({"opening_m": None}, "opening_m"),
        ({"opening_m": True}, "opening_m"),
        ({"opening_m": -0.1}, "positive"),
        ({"beyond_m": "1 cm"}, "beyond_m"),
        ({"symmetric": 1}, "symmetric"),
        ({"opening_mm": 80}, "opening_mm"),
    ],
)
def test_what_is_no_goal_is_told(tmp_path: Path, change: dict[str, Any], told: str) -> None:
    file = tmp_path / "goal.json"
    file.write_text(json.dumps(GOOD))
    assert Goal.load(file).opening == 0.08
    file.write_text(json.dumps({**GOOD, **change}))
    with pytest.raises(InputError, match=told) as error:
        Goal.load(file)
    assert str(file) in str(error.value)


@pytest.mark.parametrize("content", [b"", b"[]", b"\xff\xfe", b"[" * 50_000, b" " * 100_000, b'{"format": 1e999}'])
def test_files_that_hold_no_goal(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "goal.json"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"goal\.json"):
        Goal.load(file)


def test_a_file_that_is_not_there_and_one_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        Goal.load(tmp_path / "none.json")
    with pytest.raises(InputError, match="cannot be written"):
        Goal.taught([[0, 0], [9, 9]]).save(tmp_path / "no folder" / "goal.json")
