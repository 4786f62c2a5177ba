# SPDX-License-Identifier: Apache-2.0
"""The examples run as they stand, and the demonstration gives what it promises."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from grasptrack_bench.demo import STRATEGIES, run_demo
from grasptrack_bench.records import read_homographies
from grasptrack_bench.simulation import demo_scene

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("example", sorted((ROOT / "examples").glob("[0-9]*.py")), ids=lambda p: p.stem)
def test_examples_run_without_arguments(example: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(
        [sys.executable, str(example)], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) >= 4


@pytest.mark.slow
def test_the_demonstration_writes_truth_and_a_folder_for_each_strategy(tmp_path: Path) -> None:
    steps: list[tuple[str, int, int]] = []
    rows = run_demo(tmp_path, frames=6, video=True, progress=lambda *step: steps.append(step))
    assert [row["strategy"] for row in rows] == list(STRATEGIES)
    assert all(row["frames"] == 6 for row in rows)
    assert (tmp_path / "scene.mp4").stat().st_size > 1000
    assert all((tmp_path / name / "grasps.csv").exists() for name in STRATEGIES)
    truth, scene = read_homographies(tmp_path / "truth.csv"), demo_scene(6)
    assert all(np.allclose(truth[i], scene.homography(i), rtol=0, atol=0) for i in range(6))
    assert ("render", 6, 6) in steps
    assert ("homography", 6, 6) in steps


def test_auto_follows_the_demonstration() -> None:
    from grasptrack.tracking.tracker import GraspTracker
    from grasptrack_bench.metrics.score import Score, Truth

    tracker, score = GraspTracker(), Score("auto")
    for frame in demo_scene(60):
        score.add(
            tracker.update(frame.image, time=frame.time), Truth.of_homography(frame.H_current_reference, frame.area)
        )
    assert score.status_share("tracked") >= 0.98
    assert score.error_percentile(50) < 0.5
    assert score.error_percentile(95) < 1.5
    assert score.false_accepts == 0
