# SPDX-License-Identifier: Apache-2.0
"""`grasptrack evaluate` and `grasptrack compare`: what they write, what they say, and that nothing is lost."""

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from grasptrack.cli.main import main
from grasptrack_bench.methods import OURS
from grasptrack_bench.records import EACH, FIXED, LAST, read_records
from grasptrack_bench.simulation import SHAPES, Scene, similarity_path
from grasptrack_bench.simulation.disturbances import DISTURBANCES
from scores import write_homographies
from test_cli_bad_input import refused

SMALL = ["--shapes", "bracket", "--frames", "6", "--workers", "1"]


def scored(folder: Path) -> dict[str, list[list[str]]]:
    """Every cell of every case, without the latencies."""
    found = {}
    for path in sorted((folder / "cases").glob("*.csv")):
        with path.open(newline="") as file:
            found[path.stem] = [row[:-1] for row in csv.reader(file)]
    return found


def test_scenes_are_scored_summed_up_and_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    given = ["evaluate", "scenes", *SMALL, "--disturbances", "noise,exchange", "--methods", "auto,otsu"]
    assert main([*given, "--output", str(out)]) == 0
    shown = capsys.readouterr()
    assert "2 sequences" in shown.out and "auto" in shown.out and "otsu" in shown.out
    assert shown.err == ""
    index = json.loads((out / "evaluation.json").read_text())
    assert index["ended"] == "finished" and index["options"]["methods"] == ["auto", "otsu"]
    assert [case["name"] for case in index["cases"]] == ["bracket.noise", "bracket.exchange"]
    frames = read_records(out / "cases" / "bracket.noise.csv")
    assert list(frames) == ["auto", "otsu"] and [len(f) for f in frames.values()] == [6, 6]
    assert frames["auto"][0].defining and frames["auto"][3].error < frames["auto"][3].limit
    assert not all(f.present for f in read_records(out / "cases" / "bracket.exchange.csv")["auto"])
    for name in ("report.html", "summary.csv", "summary.json"):
        assert (out / name).stat().st_size > 500
    with (out / "cases" / "bracket.noise.csv").open() as file:
        head = file.readline().strip().split(",")
    assert head == [*FIXED, *(f"{name}{i}" for i in (1, 2) for name in EACH), LAST]


@pytest.mark.slow
def test_the_same_run_gives_the_same_to_the_last_digit(tmp_path: Path) -> None:
    given = ["evaluate", "scenes", *SMALL, "--disturbances", "light", "--methods", "auto,klt,sift", "-q"]
    assert main([*given, "--output", str(tmp_path / "a")]) == 0
    assert main([*given, "--output", str(tmp_path / "b")]) == 0
    assert scored(tmp_path / "a") == scored(tmp_path / "b")
    assert main([*given, "--seed", "5", "--output", str(tmp_path / "c")]) == 0
    assert scored(tmp_path / "a") != scored(tmp_path / "c")


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("more", "told"),
    [
        (["--shapes", "bracke"], 'unknown shape "bracke"; choose from bracket'),
        (["--disturbances", "storm"], 'unknown disturbance "storm"; choose from clean-4dof'),
        (["--methods", "auto,magic"], 'unknown method "magic"; choose from auto'),
        (["--fingers", "4"], "2 or 3 fingers, not 4"),
        (["--friction", "0"], "--friction must be a positive number"),
        (["--photos", "x"], "--photos and --masks go together"),
        (["--silhouettes", "nowhere"], "no such folder of images"),
        (["--workers", "0"], "at least 1 worker"),
        (["--scheduler", "tcp://h:1", "--workers", "2"], "leave out one"),
        (["--frames", "1"], "--frames"),
    ],
)
def test_bad_input_is_one_line_and_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], told: str
) -> None:
    assert told in refused(["evaluate", "scenes", *more, "--output", str(tmp_path / "out")], capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_three_fingers_and_a_strategy_that_carries_two(tmp_path: Path) -> None:
    given = ["evaluate", "scenes", *SMALL, "--disturbances", "clean-4dof", "--fingers", "3", "-q"]
    assert main([*given, "--methods", "auto,grasp-line", "--output", str(tmp_path / "out")]) == 0
    frames = read_records(tmp_path / "out" / "cases" / "bracket.clean-4dof.csv")
    assert all(f.contacts is not None and f.contacts.shape == (3, 2) for f in frames["auto"])
    assert {(f.status, f.reason) for f in frames["grasp-line"]} == {
        ("searching", "grasp-line carries 2 fingers, not 3; use rrp or homography")
    }


def test_a_verb_without_its_second_word_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate"]) == 2
    assert capsys.readouterr().err == "grasptrack: Missing command (see grasptrack evaluate --help)\n"


def test_a_part_without_a_grasp_is_left_out_and_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["evaluate", "scenes", *SMALL, "--disturbances", "noise", "--methods", "auto", "--friction", "0.0001"]
    assert main([*given, "--output", str(tmp_path / "out")]) == 2
    assert "no stable grasp" in capsys.readouterr().err


@pytest.mark.slow
def test_silhouettes_and_photos_are_parts(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    for name in ("shapes", "photos", "masks"):
        (tmp_path / name).mkdir()
    mask = np.zeros((200, 260), np.uint8)
    cv2.fillPoly(mask, [np.array([[40, 40], [220, 60], [210, 110], [120, 120], [110, 170], [50, 160]])], 255)
    photo = np.where(mask > 0, rng.integers(60, 90, mask.shape), rng.integers(190, 220, mask.shape)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "shapes" / "ell.png"), mask)
    cv2.imwrite(str(tmp_path / "photos" / "angle.png"), cv2.merge([photo] * 3))
    cv2.imwrite(str(tmp_path / "masks" / "angle.png"), mask)
    given = ["evaluate", "scenes", "--silhouettes", str(tmp_path / "shapes"), "--photos", str(tmp_path / "photos")]
    given += ["--masks", str(tmp_path / "masks"), "--disturbances", "clean-4dof", "--methods", "auto", "--frames", "5"]
    assert main([*given, "--output", str(tmp_path / "out"), "--quiet"]) == 0
    for name in ("ell", "angle"):
        frames = read_records(tmp_path / "out" / "cases" / f"{name}.clean-4dof.csv")["auto"]
        assert [f.status for f in frames[1:]] == ["tracked"] * 4  # five frames of a whole path: it jumps
        assert not any(f.is_false_accept for f in frames)


def film(folder: Path, frames: int = 5) -> Path:
    """A folder of images and its table, as a recording would be."""
    scene = Scene(SHAPES["bracket"](), similarity_path(40))
    (folder / "film").mkdir(parents=True)
    for i in range(frames):
        cv2.imwrite(str(folder / "film" / f"{i:03d}.png"), scene[i].image)
    write_homographies(folder / "film.homographies.csv", {i: scene.homography(i) for i in range(frames) if i != 2})
    return folder


@pytest.mark.slow
def test_a_recording_with_its_table_is_scored(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    given = ["evaluate", "real", str(film(tmp_path / "in")), "--methods", "auto,ecc", "--workers", "1"]
    assert main([*given, "--output", str(out)]) == 0
    assert "1 sequence in" in capsys.readouterr().out
    frames = read_records(out / "cases" / "film.csv")["auto"]
    assert [f.status for f in frames] == ["tracked"] * 5
    assert frames[2].distances is None and frames[4].error < 1.0 and frames[4].limit > 3.0
    assert (out / "report.html").exists()


@pytest.mark.parametrize(
    ("name", "told"), [("nowhere", "is no folder"), (".", "has a table of homographies beside it")]
)
def test_a_folder_without_recordings_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, told: str
) -> None:
    assert told in refused(["evaluate", "real", str(tmp_path / name), "--output", str(tmp_path / "out")], capsys)


def test_defaults_are_all_disturbances_and_our_strategies() -> None:
    assert OURS == ("auto", "rrp", "grasp-line", "homography")
    assert len(DISTURBANCES) >= 10 and len(SHAPES) >= 20
