# SPDX-License-Identifier: Apache-2.0
"""`grasptrack synthesize`: its table, its files, and one clear line for everything that is no input."""

import math
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from grasptrack import GraspTracker
from grasptrack.cli.main import main
from recordings import movie, plate, strict_json, write
from test_cli_bad_input import refused

OTHER = (250.0, 60.0)


def scene(path: Path) -> Path:
    """The plate and a disc beside it."""
    image = plate((130.0, 130.0))
    cv2.circle(image, (round(OTHER[0]), round(OTHER[1])), 30, 60, -1, cv2.LINE_AA)
    return write(path, cv2.GaussianBlur(image, (0, 0), 0.8))


def given(source: Path | str, tmp_path: Path, *more: str) -> list[str]:
    return ["synthesize", str(source), "--output", str(tmp_path / "out"), *more]


def data(tmp_path: Path) -> dict[str, Any]:
    return strict_json(tmp_path / "out" / "grasps.json")


def centroid(found: dict[str, Any]) -> tuple[float, float]:
    x, y = found["centroid"]
    return x, y


def near(found: dict[str, Any], x: float, y: float) -> bool:
    return math.dist(centroid(found), (x, y)) < 3.0


@pytest.mark.whole
def test_the_table_and_both_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = write(tmp_path / "a.png", plate())
    assert main(given(source, tmp_path, "--top", "4")) == 0
    said = capsys.readouterr()
    assert said.err == "" and "grasps.json" in said.out and "grasps.png" in said.out
    for head in (
        "contacts", "kind", "opening", "quality", "closure", "centre", "flat", "room", "span", "margin", "slip",
    ):  # fmt: skip
        assert head in said.out
    assert "squeeze" in said.out and "…" not in said.out and " mm" not in said.out
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["grasps.json", "grasps.png"]
    assert cv2.imread(str(tmp_path / "out" / "grasps.png")).shape == (900, 1600, 3)


def test_a_narrow_terminal_leaves_the_terms_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    source = write(tmp_path / "a.png", plate())
    monkeypatch.setenv("FORCE_COLOR", "1")  # as if it were a terminal
    for columns, shown in ((80, False), (120, True)):
        monkeypatch.setenv("COLUMNS", str(columns))
        assert main(given(source, tmp_path)) == 0
        said = capsys.readouterr().out
        assert "quality" in said and ("closure" in said) is shown and "…" not in said


def test_a_point_is_one_line_of_the_json(tmp_path: Path) -> None:
    assert main(given(write(tmp_path / "a.png", plate()), tmp_path, "-q", "--top", "1")) == 0
    assert data(tmp_path)["objects"][0]["grasps"][0]["opening_mm"] is None  # without a scale
    text = (tmp_path / "out" / "grasps.json").read_text()
    assert re.search(r'"centroid": \[[\d.]+, [\d.]+\]', text) and re.search(
        r"^ +\[[\d.]+, [\d.]+\],$", text, re.MULTILINE
    )


def test_the_json_says_all_of_every_grasp(tmp_path: Path) -> None:
    source = write(tmp_path / "a.png", plate())
    assert main(given(source, tmp_path, "-q", "--top", "3", "--scale", "4", "--min-opening", "5mm")) == 0
    found = data(tmp_path)
    assert found["format"] == 1 and found["image"] == {"name": str(source), "width": 320, "height": 240}
    assert found["options"]["top"] == 3 and found["options"]["min_opening"] == "5mm"
    (one,) = found["objects"]
    assert one["hand_px"]["min_opening"] == 20.0 and one["hand_px"]["max_opening"] is None
    assert one["reason"] == "" and 1 <= len(one["grasps"]) <= 3
    outline = np.array(one["outline"][0])
    assert one["area_px2"] == pytest.approx(cv2.contourArea(outline.astype(np.float32)), rel=0.01)
    qualities = [g["quality"] for g in one["grasps"]]
    assert (
        qualities == sorted(qualities, reverse=True)
        and [g["rank"] for g in one["grasps"]] == [1, 2, 3][: len(qualities)]
    )
    for grasp in one["grasps"]:
        contacts = np.array(grasp["contacts"])
        assert grasp["opening_px"] == pytest.approx(math.dist(*contacts), abs=0.01)
        assert grasp["opening_mm"] == pytest.approx(grasp["opening_px"] / 4, abs=0.01)
        assert np.array(grasp["fingers"]).shape == np.array(grasp["swept"]).shape == (2, 4, 2)
        np.testing.assert_allclose(np.linalg.norm(grasp["directions"], axis=1), 1.0, atol=1e-5)
        assert set(grasp["terms"]) == {"closure", "centre", "flatness", "room", "span"}
        assert 0.0 < grasp["margin_deg"] < 27.0 and len(grasp["regions_px"]) == 2 and grasp["spread"] is False
        nearest = np.linalg.norm(outline[:, None] - contacts, axis=2).min(axis=0)
        assert (nearest < 1.5).all()


def test_three_fingers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = cv2.circle(np.full((240, 320), 200, np.uint8), (160, 120), 70, 60, -1, cv2.LINE_AA)
    assert main(given(write(tmp_path / "a.png", image), tmp_path, "--fingers", "3", "--scale", "2.5")) == 0
    assert len(data(tmp_path)["objects"][0]["grasps"][0]["contacts"]) == 3
    assert "mm" in capsys.readouterr().out


@pytest.mark.parametrize(
    "more",
    [["--object", "250,60"], ["--box", "215,25,70,70"], ["--box", "210,20,200,80"]],
    ids=["pixel", "box", "wide"],
)
def test_the_object_that_is_meant(more: list[str], tmp_path: Path) -> None:
    assert main(given(scene(tmp_path / "a.png"), tmp_path, "-q", *more)) == 0
    found = data(tmp_path)
    assert len(found["objects"]) == 1 and near(found["objects"][0], *OTHER)
    assert len(found["neighbours"]) == 1


def test_all_objects_get_grasps_of_their_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(given(scene(tmp_path / "a.png"), tmp_path, "--all", "--top", "2")) == 0
    found = data(tmp_path)
    assert len(found["objects"]) == 2 and found["neighbours"] == []
    assert sorted(near(o, *OTHER) for o in found["objects"]) == [False, True]
    assert all(o["grasps"][0]["rank"] == 1 for o in found["objects"])
    assert "object" in capsys.readouterr().out


def test_a_mask_takes_the_image_s_place(tmp_path: Path) -> None:
    source = write(tmp_path / "a.png", np.full((240, 320, 3), 128, np.uint8))
    mask = write(tmp_path / "m.png", np.where(plate() < 130, np.uint8(1), np.uint8(0)))
    assert main(given(source, tmp_path, "-q", "--mask", str(mask))) == 0
    assert data(tmp_path)["objects"][0]["area_px2"] > 5000


def test_what_is_to_be_ignored_is_no_object(tmp_path: Path) -> None:
    hidden = cv2.circle(np.zeros((240, 320), np.uint8), (250, 60), 36, 255, -1)
    ignore = write(tmp_path / "i.png", hidden)
    assert main(given(scene(tmp_path / "a.png"), tmp_path, "-q", "--all", "--ignore", str(ignore))) == 0
    assert [near(o, *OTHER) for o in data(tmp_path)["objects"]] == [False]


def test_sixteen_bits(tmp_path: Path) -> None:
    source = write(tmp_path / "a.png", plate().astype(np.uint16) * 257)
    assert main(given(source, tmp_path, "-q")) == 0


def test_no_grasp_is_one_line_and_files_that_say_why(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = write(tmp_path / "a.png", plate())
    error = refused(given(source, tmp_path, "--max-opening", "8px"), capsys)
    assert str(source) in error and "no grasp: " in error
    (one,) = data(tmp_path)["objects"]
    assert one["grasps"] == [] and one["reason"] and one["reason"] in error and len(one["outline"][0]) > 50
    assert (tmp_path / "out" / "grasps.png").exists()


def test_sources_that_are_no_image(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "text.png").write_text("this is no image\n" * 30)
    (tmp_path / "text").write_text("this is no image\n" * 30)
    blank = write(tmp_path / "blank.png", np.full((240, 320), 200, np.uint8))
    film = movie(tmp_path / "m.mp4", 2, size=(120, 160))
    for source, words in {
        tmp_path / "nope.png": "does not exist",
        tmp_path / "text.png": "no image",
        tmp_path / "text": "",
        film: "is a video; synthesize takes one image",
        tmp_path: "is a folder; synthesize takes one image",
        blank: "no object",
    }.items():
        error = refused(given(source, tmp_path), capsys)
        assert words in error and str(source) in error


def test_masks_of_another_size_and_of_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, small = write(tmp_path / "a.png", plate()), write(tmp_path / "m.png", np.full((20, 30), 255, np.uint8))
    for option, name in (("--mask", "the mask"), ("--ignore", "the ignore mask")):
        error = refused(given(source, tmp_path, option, str(small)), capsys)
        assert name in error and "30x20" in error and "320x240" in error
    empty = write(tmp_path / "empty.png", np.zeros((240, 320), np.uint8))
    assert "no object" in refused(given(source, tmp_path, "--mask", str(empty)), capsys)


def test_an_object_that_the_border_cuts_is_said_to_be(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(given(write(tmp_path / "a.png", plate((40.0, 120.0))), tmp_path)) == 0
    assert "cut by the border: its centre is that of the part in view" in capsys.readouterr().out
    assert main(given(write(tmp_path / "b.png", plate()), tmp_path)) == 0
    assert "cut by" not in capsys.readouterr().out


def test_files_tell_how_sure_the_choice_of_the_object_is_as_a_tracker_does(tmp_path: Path) -> None:
    image = np.minimum(plate((100.0, 80.0), 0.2), plate((220.0, 170.0), 0.2))
    source, tracker = write(tmp_path / "a.png", image), GraspTracker()
    probability = tracker.update(image).object_probability
    assert not tracker.object_sure and probability < 0.9
    for more, sure in (([], False), (["--choose", "1"], True)):
        assert main(given(source, tmp_path, "-q", *more)) == 0
        inspected = ["inspect", str(source), "--output", str(tmp_path / "out"), "-q", "--runs", "1", *more]
        assert main(inspected) == 0
        for name in ("grasps.json", "inspect.json"):
            told = strict_json(tmp_path / "out" / name)
            assert told["object_sure"] is sure and told["object_probability"] == pytest.approx(probability, abs=1e-4)
            assert ("candidates.png" in told["files"]) is not sure
