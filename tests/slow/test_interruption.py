# SPDX-License-Identifier: Apache-2.0
"""Runs that are interrupted at random moments: what was computed is kept, files can be read, one line is said."""

from __future__ import annotations

import csv
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from recordings import plates, rows

FRAMES = 400


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return plates(tmp_path_factory.mktemp("images"), FRAMES)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL], ids=lambda s: s.name)
@pytest.mark.parametrize("seed", range(4))
def test_a_run_that_is_interrupted_keeps_what_it_computed(images: Path, tmp_path: Path, how: int, seed: int) -> None:
    out, moment = tmp_path / "out", random.Random(f"{how} {seed}").uniform(0.0, 0.7)
    given = [sys.executable, "-m", "grasptrack.cli.main", "track", str(images), "--output", str(out), "--no-video"]
    with subprocess.Popen(given, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not (out / "run.json").exists():
            time.sleep(0.005)
        time.sleep(moment)
        process.send_signal(how)
        said = process.communicate(timeout=60)[1]
    told = json.loads((out / "run.json").read_text())
    found = rows(out)
    assert all(row["status"] for row in found)
    if how == signal.SIGKILL:
        assert told["ended"] in ("running", "finished") and said == ""
    elif told["ended"] == "finished":  # it was quicker than the signal
        assert process.returncode == 0 and len(found) == FRAMES
    else:
        assert told["ended"] == "interrupted" and process.returncode == 130
        assert said.count("\n") == 1 and f"interrupted after {len(found)} frames" in said
        assert told["frames"] == len(found) < FRAMES


def evaluated(folder: Path) -> list[dict[str, str]]:
    """All frames that an evaluation scored, without what the clock says."""
    found: list[dict[str, str]] = []
    for path in sorted(folder.glob("*.csv")):
        with path.open(newline="", encoding="utf-8") as file:
            found += [
                {k: v for k, v in row.items() if "ms" not in k and k != "seconds"} for row in csv.DictReader(file)
            ]
    return found


def test_an_evaluation_that_is_killed_again_and_again_ends_as_one_that_is_not(tmp_path: Path) -> None:
    asked = ["evaluate", "scenes", "--methods", "auto", "--shapes", "bracket", "--frames", "12", "--seed", "3"]
    asked += ["--disturbances", "clean-4dof,noise,bar,hand", "--workers", "1"]
    command = [sys.executable, "-m", "grasptrack.cli.main", *asked, "--output"]
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    subprocess.run([*command, str(whole)], check=True, capture_output=True)
    moments = random.Random(5)
    for _ in range(4):
        with subprocess.Popen(
            [*command, str(killed)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        ) as process:
            time.sleep(moments.uniform(1.0, 3.0))
            os.killpg(process.pid, signal.SIGKILL)
    last = subprocess.run([*command, str(killed)], check=True, capture_output=True, text=True)
    assert not last.stderr
    assert evaluated(killed) == evaluated(whole) != []
