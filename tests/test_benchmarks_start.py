# SPDX-License-Identifier: Apache-2.0
"""Every script of the benchmarks imports what it names: its help is shown."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = sorted(
    path
    for path in (Path(__file__).resolve().parents[1] / "benchmarks").glob("*.py")
    if "common.parser(" in path.read_text(encoding="utf-8") and path.stem != "common"
)


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_starts(script: Path) -> None:
    shown = subprocess.run([sys.executable, str(script), "--help"], capture_output=True, text=True, check=False)
    assert shown.returncode == 0, shown.stderr[-500:]
    assert "usage:" in shown.stdout


def test_all_scripts_are_tried() -> None:
    assert len(SCRIPTS) >= 18
