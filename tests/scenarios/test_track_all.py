# SPDX-License-Identifier: Apache-2.0
"""`grasptrack track SOURCE --part FILE --all`: a row for each instance, all of them in the picture, and what does not fit."""

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import grasptrack as gt
from grasptrack.cli.main import main
from grasptrack.view.instances import draw_scene
from scenery import L_PLATE, drawn


def image(shift: float, seed: int) -> np.ndarray:
    centres = ((120.0 + shift, 90.0), (330.0 + shift, 200.0))
    return drawn(L_PLATE, L_PLATE, centres=centres, angle=0.4, size=(300, 480), seed=seed)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("scene")
    alone = drawn(L_PLATE, angle=0.0, seed=9)
    view = gt.first_look(alone)[0].view
    gt.Part.of(alone, view, gt.synthesize(view, 2, top=1), name="plate").save(home / "plate.part")
    (home / "images").mkdir()
    for k in range(5):
        cv2.imwrite(str(home / "images" / f"{k}.png"), image(3.0 * k, k))
    return home


def test_every_instance_has_a_row_in_every_frame(folder: Path, tmp_path: Path) -> None:
    out, lines = tmp_path / "out", tmp_path / "lines.jsonl"
    asked = ["track", str(folder / "images"), "--part", str(folder / "plate.part"), "--all", "--output", str(out)]
    assert main([*asked, "--fps", "30", "--jsonl", str(lines)]) == 0
    with (out / "grasps.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(int(r["frame"]), r["instance_id"], r["part_id"]) for r in rows] == [
        (k, number, "plate") for k in range(5) for number in "12"
    ]
    assert all(r["status"] == "tracked" for r in rows)
    told = json.loads((out / "run.json").read_text())
    assert [each["instance_id"] for each in told["instances"]] == [1, 2] and "summary.png" not in told["files"]
    assert (out / "overlay.mp4").exists()
    assert [json.loads(line)["instance_id"] for line in lines.read_text().splitlines()] == [1, 2] * 5


def test_of_one_object_nothing_changes(folder: Path, tmp_path: Path) -> None:
    assert main(["track", str(folder / "images"), "--no-video", "--quiet", "--output", str(tmp_path)]) == 0
    assert "instance_id" not in (tmp_path / "grasps.csv").read_text()


@pytest.mark.parametrize(
    "wrong",
    [
        ["--all"],
        ["--part", "plate.part"],
        ["--part", "none.part", "--all"],
        ["--part", "plate.part", "--all", "--strategy", "rrp"],
        ["--part", "plate.part", "--all", "--object", "3,4"],
        ["--part", "plate.part", "--all", "--record", "run.mcap"],
        ["--part", "plate.part", "--all", "--look-every", "0"],
        ["--part", "plate.part", "--all", "--belt", "3"],
    ],
)
def test_what_does_not_fit_ends_in_one_line(
    wrong: list[str],
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(folder)
    assert main(["track", "images", *wrong, "--output", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1 and not (tmp_path / "out").exists()


def test_where_nothing_lies_that_is_told(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cv2.imwrite(str(tmp_path / "bare.png"), np.full((240, 320), 180, np.uint8))
    asked = ["track", str(tmp_path / "bare.png"), "--part", str(folder / "plate.part"), "--all"]
    assert main([*asked, "--output", str(tmp_path / "out")]) == 2
    assert "no instance of" in capsys.readouterr().err


def test_the_picture_shows_each_in_the_colour_of_its_status(folder: Path) -> None:
    part = gt.Part.load(folder / "plate.part")
    tracker = gt.SceneTracker(part)
    seen = image(0.0, 0)
    told = tracker.update(seen)
    drawn_on = draw_scene(seen, told)
    assert drawn_on.ndim == 3 and drawn_on.shape[1] >= 480
    lost = tracker.update(np.full_like(seen, 180))
    views = {number: result.view for number, result in told.results.items() if result.view is not None}
    assert not np.array_equal(draw_scene(seen, lost, views), draw_scene(seen, lost))
