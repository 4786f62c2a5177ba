# SPDX-License-Identifier: Apache-2.0
"""A disk that gets full, or a limit on files: one line, status 2, and what was computed can be read."""

import json
import os
import shlex
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from grasptrack import open_source
from grasptrack_bench.records import read_records
from recordings import plates, rows

resource = pytest.importorskip("resource", reason="limits of this kind are Unix's")

LIMITED = """
import resource, sys
from grasptrack.cli.main import main
limit = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))  # what goes beyond ends in an error, as on a full disk
sys.exit(main())
"""


def refused(limit: int, *given: str) -> str:
    whole = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}  # else Python leaves modules behind that are cut off
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(limit), *given], capture_output=True, text=True, env=whole
    )
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1 and done.stderr.startswith("grasptrack: "), done.stderr
    return done.stderr


def parts(folder: Path) -> list[str]:
    return [str(path) for path in folder.rglob("*.part")]


@pytest.mark.parametrize(
    ("limit", "more", "name"),
    [(4000, ["--no-video"], "grasps.csv"), pytest.param(20000, [], "overlay.mp4", marks=pytest.mark.slow)],
)
def test_track_keeps_whole_rows(tmp_path: Path, limit: int, more: list[str], name: str) -> None:
    folder, out = plates(tmp_path / "in", 40), tmp_path / "out"
    told = refused(limit, "track", str(folder), "--output", str(out), "-q", *more)
    assert "cannot be written: File too large; what was computed before is in" in told
    assert name in told
    found = rows(out)
    assert 0 < len(found) <= 40 and all(row["status"] == "tracked" and row["notice"] is not None for row in found)
    assert (out / "grasps.csv").read_bytes().endswith(b"\n")
    assert json.loads((out / "run.json").read_text())["ended"] == "failed"
    assert not parts(out) and not (out / "overlay.mp4").exists()


@pytest.mark.slow
def test_a_recording_that_finds_no_room_keeps_its_whole_images(tmp_path: Path) -> None:
    pytest.importorskip("foxglove", reason="the extra foxglove is not installed")
    folder, out, path = plates(tmp_path / "in", 40), tmp_path / "out", tmp_path / "run.mcap"
    told = refused(150_000, "track", str(folder), "--output", str(out), "-q", "--no-video", "--record", str(path))
    assert f'"{path}" cannot be written: File too large' in told
    assert json.loads((out / "run.json").read_text())["ended"] == "failed"
    with open_source(path) as source:
        count = sum(1 for _ in source)
        assert 5 < count <= len(rows(out)) and "was not closed" in source.shortfall


@pytest.mark.parametrize("verb", ["synthesize", pytest.param("inspect", marks=pytest.mark.slow)])
def test_a_picture_that_finds_no_room_is_one_line(tmp_path: Path, verb: str) -> None:
    image = str(plates(tmp_path / "in", 1) / "000.png")
    assert '" cannot be written: File too large' in refused(6000, verb, image, "--output", str(tmp_path / "out"))
    assert not parts(tmp_path / "out")


@pytest.fixture(scope="module")
def small_disk() -> list[str]:
    """The beginning of a command that runs in a namespace of its own, where it may mount."""
    command = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c"]
    with suppress(OSError):
        if subprocess.run([*command, "mount -t tmpfs none /mnt"], capture_output=True).returncode == 0:
            return command
    pytest.skip("this user may not mount a small disk (unshare --user --mount)")


@pytest.mark.slow
def test_a_disk_that_is_full(tmp_path: Path, small_disk: list[str]) -> None:
    folder, disk, kept = plates(tmp_path / "in", 40), tmp_path / "disk", tmp_path / "kept"
    disk.mkdir()
    run = shlex.join(
        [sys.executable, "-m", "grasptrack.cli.main", "track", str(folder), "-q", "--output", f"{disk}/out"]
    )
    script = f"mount -t tmpfs -o size=24k none {disk} && {run}; status=$?; cp -r {disk}/out {kept}; exit $status"
    done = subprocess.run([*small_disk, script], capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert "cannot be written: No space left on device" in done.stderr
    found = rows(kept)
    assert found and all(row["status"] == "tracked" and row["notice"] is not None for row in found)
    assert json.loads((kept / "run.json").read_text())["ended"] in ("running", "failed")
    assert not parts(kept)


@pytest.mark.slow
@pytest.mark.parametrize("limit", [3000, 12000, 60000])
def test_an_evaluation_keeps_the_cases_that_were_written(tmp_path: Path, limit: int) -> None:
    out = tmp_path / "out"
    asked = ["evaluate", "scenes", "--methods", "auto", "--shapes", "bracket", "--frames", "8", "--workers", "1"]
    asked += ["--disturbances", "clean-4dof,noise", "--output", str(out)]
    told = refused(limit, *asked)
    assert "cannot be written: File too large" in told
    for path in (out / "cases").glob("*"):
        assert len(read_records(path)["auto"]) == 8
    assert not parts(out)
    done = subprocess.run([sys.executable, "-m", "grasptrack.cli.main", *asked], capture_output=True, text=True)
    assert done.returncode == 0 and done.stderr == "" and len(list((out / "cases").glob("*.csv"))) == 2
    assert (limit == 3000) or "gone on with an interrupted run, in which" in done.stdout


@pytest.mark.slow
def test_trials_keep_the_table_and_go_on(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="the physical world needs MuJoCo")
    out = tmp_path / "out"
    asked = ["servo", "--trials", "3", "--seed", "3", "--workers", "1", "--output", str(out)]
    assert "cannot be written: File too large" in refused(700, *asked)
    assert not parts(out)
    done = subprocess.run([sys.executable, "-m", "grasptrack.cli.main", *asked], capture_output=True, text=True)
    assert done.returncode == 0 and done.stderr == "" and (out / "trials.csv").read_text().count("\n") == 4
