# SPDX-License-Identifier: Apache-2.0
"""The examples run as they stand, and the demonstration gives what it promises."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from grasptrack.demo import STRATEGIES, DemoFrame, demo_scene, run_demo
from grasptrack.demo.run import contact_errors
from grasptrack.tracking.tracker import GraspTracker
from recordings import rows as read_rows

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
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
    scene = demo_scene(6)
    for i, row in enumerate(read_rows(tmp_path, "truth.csv")):
        H = np.array([float(row[f"h{j}{k}"]) for j in "123" for k in "123"]).reshape(3, 3)
        assert int(row["frame"]) == i and (scene.homography(i) == H).all()
        assert float(row["area_px2"]) == pytest.approx(scene[i].area, abs=1e-3)
        assert row["outline_visible"] == "1.0000"
    assert ("render", 6, 6) in steps
    assert ("homography", 6, 6) in steps


def test_a_truth_that_cannot_be_written_whole_leaves_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "truth.csv").write_text("of the run before")
    area = iter([1.0])
    monkeypatch.setattr(DemoFrame, "area", property(lambda frame: next(area)))
    with pytest.raises(StopIteration):
        run_demo(tmp_path, frames=2, video=False)
    assert [path.read_text() for path in tmp_path.glob("truth*")] == ["of the run before"]


@pytest.mark.slow
def test_auto_follows_the_demonstration() -> None:
    tracker, frames = GraspTracker(), list(demo_scene(60))
    results = [tracker.update(frame.image, time=frame.time) for frame in frames]
    distances, wrong = contact_errors(results, frames)
    assert all(result.status == "tracked" for result in results)
    assert np.median(distances) < 0.05
    assert max(distances) < 0.2
    assert wrong == 0
