# SPDX-License-Identifier: Apache-2.0
"""Damaged images, videos, calibrations and masks through the command line: status 0, or 2 and one line."""

import sys
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

import damaged_files


@pytest.mark.filterwarnings("ignore")
def test_a_damaged_file_is_told_in_a_line(tmp_path: Path) -> None:
    found = [finding for _, finding in islice(damaged_files.fuzz(tmp_path, 1), 150)]
    assert [f for f in found if f is not None] == []


def test_the_same_seed_damages_alike() -> None:
    data = [bytes(range(200)), b"x" * 90]
    one, other, third = (damaged_files.damaged(data[0], np.random.default_rng(s), data) for s in (5, 5, 6))
    assert one == other != third


def test_what_ends_badly_is_counted(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(damaged_files, "command_line", lambda arguments: 1)
    monkeypatch.setattr(sys, "argv", ["damaged_files", "--count", "7"])
    assert damaged_files.main() == 1
    assert "7 damaged files" in capsys.readouterr().out
