# SPDX-License-Identifier: Apache-2.0
"""Runs that are interrupted at random moments: what was computed is kept, files can be read, one line is said."""

import random
import signal
from pathlib import Path

import pytest

from interruptions import SIGNALS, VERBS, Harness


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
