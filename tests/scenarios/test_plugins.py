# SPDX-License-Identifier: Apache-2.0
"""A package from outside adds a strategy, a segmenter and a method without touching a file of this one."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from grasptrack.cli import bench_verbs
from grasptrack.cli.main import main
from grasptrack.errors import bench_hint
from recordings import plate, rows, write

OUTSIDER = '''
import numpy as np
from grasptrack.tracking.result import TrackResult
from grasptrack.transfer import strategy_named
from grasptrack.transfer.base import Transfer

CALLS = []


class Bounding:
    """A strategy: contacts keep their place in the outline's bounding box."""

    def describe(self, grasp, view):
        points = getattr(view, "outer", view).points
        low, high = points.min(axis=0), points.max(axis=0)
        return (grasp.contacts - low) / (high - low)

    def apply(self, description, view, prior=None):
        from grasptrack import Grasp
        points = getattr(view, "outer", view).points
        low, high = points.min(axis=0), points.max(axis=0)
        H = np.eye(3) if prior is None else prior
        return Transfer(Grasp(low + description * (high - low)), H, None, 0.0)


bounding = Bounding()


class Dark:
    """A segmenter: whatever is dark."""

    def segment(self, image):
        grey = image if image.ndim == 2 else image.mean(axis=2)
        return grey < 100


def open_there(spec, fps, settings):
    from grasptrack import open_source
    return open_source(spec.partition(":")[2], fps)


class Words:
    """A recorder: a word for each frame."""

    def __init__(self, path, quality, options):
        self.path, self.words = path, []

    def write(self, frame, result):
        self.words.append(result.status)

    def close(self):
        self.path.write_text(" ".join(self.words))


class Fixed:
    """A method: says where the contacts were, for ever."""

    def __init__(self, start):
        self.contacts, self.frame = start.contacts, -1

    def update(self, image, time):
        self.frame += 1
        return TrackResult(self.frame, time, "tracked", "", contacts=self.contacts, confidence=1.0)
'''
ENTRIES = """
[grasptrack.strategies]
bounding = outsider:bounding
broken = outsider:missing

[grasptrack.segmenters]
dark = outsider:Dark

[grasptrack.sources]
there = outsider:open_there

[grasptrack.recorders]
txt = outsider:Words

[grasptrack.methods]
fixed = outsider:Fixed
"""


@pytest.fixture
def outside(tmp_path: Path) -> Path:
    """A folder as pip would fill it for another package, and three images that shift."""
    site = tmp_path / "site"
    info = site / "outsider-1.0.dist-info"
    info.mkdir(parents=True)
    (site / "outsider.py").write_text(OUTSIDER)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: outsider\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ENTRIES)
    (tmp_path / "frames").mkdir()
    for i in range(3):
        write(tmp_path / "frames" / f"frame{i}.png", plate((150.0 + 4 * i, 118.0 + 4 * i)))
    return tmp_path


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "grasptrack.cli.main", *words]
    environment = {**os.environ, "PYTHONPATH": str(folder / "site")}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_a_strategy_from_outside_tracks_and_transfers(outside: Path) -> None:
    done = run(outside, "track", "frames", "--strategy", "bounding", "--output", "out", "--no-video", "--quiet")
    assert done.returncode == 0, done.stderr
    found = rows(outside / "out")
    assert [row["status"] for row in found] == ["tracked"] * 3
    assert {row["strategy"] for row in found} == {"bounding"}
    assert float(found[2]["x1"]) - float(found[0]["x1"]) == pytest.approx(8.0, abs=0.3)

    done = run(outside, "transfer", "frames/frame0.png", "frames/frame2.png", "--output", "pair")
    assert done.returncode == 0, done.stderr
    assert "bounding" in done.stdout
    assert '"bounding"' in next((outside / "pair").glob("*.json")).read_text()


def test_a_segmenter_a_source_and_a_recorder_from_outside(outside: Path) -> None:
    more = ("--segmenter", "dark", "--record", "words.txt", "--output", "out", "--no-video", "--quiet")
    done = run(outside, "track", "there:frames", *more)
    assert done.returncode == 0, done.stderr
    assert [row["status"] for row in rows(outside / "out")] == ["tracked"] * 3
    assert json.loads((outside / "out" / "run.json").read_text())["options"]["segmenter"] == "dark"
    assert (outside / "words.txt").read_text() == "tracked tracked tracked"


@pytest.mark.slow
def test_a_method_from_outside_is_measured_beside_ours(outside: Path) -> None:
    words = "--methods auto,fixed --shapes bracket --disturbances noise --frames 4 --workers 1 --output out"
    done = run(outside, "evaluate", "scenes", *words.split())
    assert done.returncode == 0, done.stderr
    assert "fixed" in done.stdout


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("track", "frames", "--strategy", "bouncing"), "bounding"),
        (("track", "frames", "--strategy", "broken"), "cannot be loaded"),
        (("track", "frames", "--segmenter", "bright"), "dark"),
        (("track", "here:frames"), "there"),
        (("track", "frames", "--record", "a.bin"), ".mcap or .rrd or .txt"),
        (("evaluate", "scenes", "--methods", "floating"), "fixed"),
    ],
)
def test_what_is_not_registered_is_told_in_one_line(outside: Path, words: tuple[str, ...], said: str) -> None:
    done = run(outside, *words)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize("verb", list(bench_verbs.SHORT_HELP))
def test_a_verb_whose_distribution_is_not_installed_is_named(
    verb: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench_verbs, "load_plugin", lambda group, name: None)
    assert main([verb, "--help"]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and f'"{verb}" is a verb of grasptrack-bench' in told and bench_hint() in told
    assert main(["--help"]) == 0 and f"\n  {verb} " in capsys.readouterr().out
