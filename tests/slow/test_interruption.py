# SPDX-License-Identifier: Apache-2.0
"""Runs that are interrupted at random moments: what was computed is kept, files can be read, one line is said."""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from interruptions import INTERRUPTED, SIGNALS, VERBS, Harness
from recordings import plates, rows

FRAMES = 400


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return plates(tmp_path_factory.mktemp("images"), FRAMES)


@pytest.mark.parametrize("how", SIGNALS, ids=lambda s: s.name)
def test_a_run_that_is_interrupted_keeps_what_it_computed(images: Path, tmp_path: Path, how: int) -> None:
    out, moment = tmp_path / "out", random.Random(f"{how} 0").uniform(0.0, 0.7)
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
        assert told["ended"] == "interrupted" and process.returncode == INTERRUPTED
        assert said.count("\n") == 1 and f"interrupted after {len(found)} frames" in said
        assert told["frames"] == len(found) < FRAMES


@pytest.mark.parametrize("verb", VERBS)
def test_whatever_strikes_files_can_be_read_and_what_goes_on_ends_alike(tmp_path: Path, verb: str) -> None:
    if verb.startswith("servo"):
        pytest.importorskip("mujoco", reason="the physical world needs MuJoCo")
    harness, draw = Harness(tmp_path, (verb,)), random.Random(verb)
    seen: list[str] = []
    while not {"interrupted", "killed"} <= set(seen) and len(seen) < 30:  # on a busy machine moments are hard to hit
        seen += [harness.interrupt(verb, how, draw.uniform(0.2, 0.9)) for how in SIGNALS]
    seen.append(harness.interrupt(verb, signal.SIGKILL, 60.0))  # it ends before that
    assert not [outcome for outcome in seen if outcome.startswith("bad")], seen
    assert {"interrupted", "killed"} <= set(seen) and seen[-1] == "finished", seen
