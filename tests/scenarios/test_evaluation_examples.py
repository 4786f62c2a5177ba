# SPDX-License-Identifier: Apache-2.0
"""The examples run as they stand, and the demonstration gives what it promises."""

import csv
import os
import signal
import subprocess
import sys
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from grasptrack.demo import STRATEGIES, DemoFrame, demo_scene, run_demo
from grasptrack.demo.run import contact_errors
from grasptrack.io.video import VideoWriter
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


def started_example(name: str, *arguments: str) -> "subprocess.Popen[str]":
    """An example at work, whose lines can be read as they come."""
    command = [sys.executable, str(next((ROOT / "examples").glob(f"{name}*.py"))), *arguments]
    listen = partial(
        signal.signal, signal.SIGINT, signal.SIG_DFL
    )  # what a shell starts in the background ignores Ctrl-C
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=listen)


def short_video(path: Path, frames: int = 8, *, scene: bool = True) -> str:
    """A video of the demonstration, or without a scene one of a blank wall."""
    wall = np.full((480, 640, 3), 190, np.uint8)
    with closing(VideoWriter(path, 30.0)) as writer:
        for image in (frame.image for frame in demo_scene(frames)) if scene else [wall] * frames:
            writer.write(image)
    return str(path)


@pytest.mark.slow
def test_two_cameras_stop_on_ctrl_c_and_one_goes_on_without_the_other(tmp_path: Path) -> None:
    # longer than any load lasts
    walls = [short_video(tmp_path / f"{name}.mp4", 600, scene=False) for name in ("left", "right")]
    with started_example("08", *walls) as both:
        assert both.stdout is not None and both.stdout.readline().startswith("camera ")
        both.send_signal(signal.SIGINT)
        said, errors = both.communicate(timeout=60)
    assert (both.returncode, errors) == (0, "")
    assert sorted(line for line in said.splitlines() if line.endswith("stopped")) == [
        "camera 1: stopped",
        "camera 2: stopped",
    ]
    with started_example("08", short_video(tmp_path / "one.mp4"), str(tmp_path / "none.mp4")) as one:
        said, errors = one.communicate(timeout=60)
    assert (one.returncode, errors) == (1, "")
    assert "camera 1: ended" in said and "camera 2: failed" in said and said.count("tracked") == 8


@pytest.mark.slow
def test_each_video_of_a_folder_has_a_row(tmp_path: Path) -> None:
    short_video(tmp_path / "a.mp4")
    short_video(tmp_path / "b.mp4", scene=False)
    (tmp_path / "c.mp4").write_bytes((tmp_path / "a.mp4").read_bytes()[:2000])
    (tmp_path / "notes.txt").write_text("no video")
    corner = demo_scene(8)[0].outline[0].mean(axis=0)
    (tmp_path / "objects.csv").write_text(f"a.mp4,{corner[0] - 60:.1f},{corner[1]:.1f}\n")
    with started_example("09", str(tmp_path)) as batch:
        said, errors = batch.communicate(timeout=60)
    assert (batch.returncode, errors) == (0, "")
    a, b, c = csv.DictReader(said.splitlines())
    assert (a["video"], a["frames"], a["tracked"], a["lost"], a["error"]) == ("a.mp4", "8", "8", "0", "")
    assert 0.0 < float(a["worst_margin_deg"]) < 90.0
    assert (b["video"], b["frames"], b["searching"], b["worst_margin_deg"]) == ("b.mp4", "8", "8", "nan")
    assert (c["video"], c["frames"]) == ("c.mp4", "0") and "truncated" in c["error"]


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
