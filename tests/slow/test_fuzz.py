# SPDX-License-Identifier: Apache-2.0
"""The fuzzer for some minutes: nothing dies, hangs, comes out raw or answers wrongly."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

RUN = Path(__file__).parents[1] / "fuzz" / "run.py"
NONE = "0 crash, 0 hang, 0 internal, 0 bad stability, 0 bad contact"


def test_a_seeded_run_finds_nothing(tmp_path: Path) -> None:
    command = [sys.executable, "-W", "ignore", str(RUN), "--seed", "11", "--calls", "40000", "--contours", "10000"]
    ran = subprocess.run([*command, "--keep", str(tmp_path)], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    told = ran.stdout.splitlines()
    assert [line.partition(";")[0] for line in told] == [f"kernel calls: 40000: {NONE}", f"contours: 10000: {NONE}"]
