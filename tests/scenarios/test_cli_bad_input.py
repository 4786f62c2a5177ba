# SPDX-License-Identifier: Apache-2.0
"""Bad input: one clear line on stderr, exit status 2, and nothing lost."""

import csv
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from grasptrack.cli.main import main
from recordings import movie, plate, plates, write


def refused(given: list[str], capsys: pytest.CaptureFixture[str], status: int = 2) -> str:
    """Run and return the one line on stderr; nothing is on stdout."""
    assert main(given) == status
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1 and said.err.startswith("grasptrack: ")
    return said.err


def tracking(source: Path | str, tmp_path: Path, *more: str) -> list[str]:
    return ["track", str(source), "--output", str(tmp_path / "out"), *more]


def count(tmp_path: Path) -> int:
    with (tmp_path / "out" / "grasps.csv").open(newline="") as file:
        return sum(1 for _ in csv.DictReader(file))


@pytest.mark.sampled(7)
@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--strategy", "magic"], ["magic", "auto", "rrp", "grasp-line", "homography"]),
        (["--friction", "0"], ["friction", "positive"]),
        (["--friction", "nan"], ["friction", "positive"]),
        (["--friction", "much"], ["--friction"]),
        (["--fingers", "1"], ["at least 2"]),
        (["--fingers", "7"], ["7"]),
        (["--fingers", "3", "--strategy", "grasp-line"], ["grasp-line", "2 fingers"]),
        (["--fingers", "3", "--grasp", "1,2 3,4"], ["2 contacts", "3"]),
        (["--grasp", "here and there"], ["x1,y1 x2,y2"]),
        (["--grasp", "10,10"], ["x1,y1 x2,y2"]),
        (["--grasp", "300,10 10,230"], ["outline"]),
        (["--object", "middle"], ["--object", "x,y"]),
        (["--object", "1,2,3"], ["--object", "x,y"]),
        (["--object", "5,5"], ["no object"]),
        (["--fps", "0"], ["fps", "positive"]),
        (["--max-opening", "30mm"], ["--max-opening", "--scale"]),
        (["--max-opening", "wide"], ["--max-opening", "30%"]),
        (["--min-opening", "90", "--max-opening", "50"], ["90 px", "50 px"]),
        (["--max-opening", "9"], ["no frame has a grasp", "too wide for the opening of 9 px", "needs"]),
        (["--fingers", "3", "--max-opening", "9"], ["too wide for the opening of 9 px", "needs"]),
        (["--finger-width", "9", "--grasp", "1,2 3,4"], ["--finger-width", "--grasp"]),
        (["--scale", "4", "--grasp", "1,2 3,4"], ["--scale", "--grasp"]),
        (["--masks", "nowhere"], ["masks", "nowhere"]),
        (["--ignore", "nowhere.png"], ["nowhere.png"]),
        (["--frobnicate"], ["--frobnicate", "--help"]),
    ],
)
def test_options(more: list[str], words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    error = refused(tracking(plates(tmp_path / "in", 2), tmp_path, "--no-video", *more), capsys)
    assert all(word in error for word in words), error


@pytest.mark.parametrize("given", [["track"], ["trak", "x"], ["transfer", "a.png"], ["--strategy", "rrp"]])
def test_usage(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert "--help" in refused(given, capsys)


def test_sources_that_are_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mp4").write_text("this is no video\n" * 30)
    for source, words in {
        tmp_path / "nope": "does not exist",
        tmp_path / "empty": "holds no image",
        tmp_path / "text.mp4": "is no video that can be read",
        tmp_path / "*.png": "no image matches",
    }.items():
        assert words in refused(tracking(source, tmp_path), capsys)
        assert not (tmp_path / "out").exists()


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.full((1, 1), 90, np.uint8), "1x1"),
        (np.zeros((240, 320), np.uint8), "no object"),
        (np.full((240, 320), 255, np.uint8), "no object"),
        (np.full((240, 320, 3), 255, np.uint8), "no object"),
        (np.random.default_rng(0).normal(120, 4, (240, 320)).astype(np.uint8), "no object"),
        (cv2.circle(np.full((240, 320), 200, np.uint8), (100, 100), 6, 50, -1, cv2.LINE_AA), "20"),
    ],
    ids=["1x1", "black", "white", "white colour", "sensor noise", "small"],
)
def test_images_without_object(
    image: np.ndarray, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "a.png", image)
    assert words in refused(tracking(tmp_path / "a.png", tmp_path), capsys)
    (tmp_path / "several").mkdir()
    for i in range(3):
        write(tmp_path / "several" / f"{i}.png", image)
    refused(tracking(tmp_path / "several", tmp_path, "--no-video"), capsys)
    assert count(tmp_path) in (0, 3)


def test_a_later_frame_that_is_unreadable_keeps_the_rows_so_far(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = plates(tmp_path / "in", 5)
    data = (folder / "003.png").read_bytes()
    (folder / "003.png").write_bytes(data[: len(data) // 2])
    error = refused(tracking(folder, tmp_path, "-q"), capsys)
    assert "003.png" in error and "truncated" in error
    assert count(tmp_path) == 3 and {p.name for p in (tmp_path / "out").iterdir()} >= {"overlay.mp4", "summary.png"}


def test_a_damaged_image_is_named_in_one_line_whatever_its_decoder_says(tmp_path: Path) -> None:
    folder = plates(tmp_path / "in", 3)
    data = bytearray((folder / "002.png").read_bytes())
    data[60:] = data[60:][::-1]
    (folder / "002.png").write_bytes(bytes(data) + b"IEND")
    command = [sys.executable, "-m", "grasptrack.cli.main", *tracking(folder, tmp_path, "--no-video", "-q")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "002.png" in done.stderr
    assert count(tmp_path) == 2


def test_frames_that_change_size(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = plates(tmp_path / "in", 2)
    write(folder / "002.png", plate(size=(200, 320)))
    error = refused(tracking(folder, tmp_path, "--no-video"), capsys)
    assert "002.png" in error and "320x200" in error and "320x240" in error and count(tmp_path) == 2


def test_a_truncated_video(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = movie(tmp_path / "m.mp4", 60, size=(120, 160))
    data = path.read_bytes()
    path.write_bytes(data[: int(0.8 * len(data))])
    assert "truncated" in refused(tracking(path, tmp_path, "--no-video"), capsys)
    assert count(tmp_path) > 20


def test_masks_that_do_not_match(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, masks = plates(tmp_path / "in", 3), plates(tmp_path / "masks", 2)
    assert "002.png" in refused(tracking(folder, tmp_path, "--masks", str(masks)), capsys)
    write(masks / "002.png", np.zeros((20, 30), np.uint8))
    error = refused(tracking(folder, tmp_path, "--masks", str(masks), "--no-video"), capsys)
    assert "30x20" in error and "320x240" in error and count(tmp_path) == 2
    write(tmp_path / "ignore.png", np.zeros((20, 30), np.uint8))
    assert "ignore mask" in refused(tracking(folder, tmp_path, "--ignore", str(tmp_path / "ignore.png")), capsys)


def test_an_output_folder_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    blocked = str(tmp_path / "file" / "out")
    folder = plates(tmp_path / "in", 2)
    for given in (
        ["track", str(folder), "--output", blocked],
        ["transfer", str(folder / "000.png"), str(folder / "001.png"), "--output", blocked],
        ["demo", "--frames", "2", "--output", blocked],
    ):
        assert "cannot be written" in refused(given, capsys)


def test_transfer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, blank = write(tmp_path / "a.png", plate()), write(tmp_path / "b.png", np.full((240, 320), 200, np.uint8))
    out = ["--output", str(tmp_path)]
    assert "b.png" in refused(["transfer", str(first), str(blank), *out], capsys)
    assert "b.png" in refused(["transfer", str(blank), str(first), *out], capsys)
    assert "two images" in refused(["transfer", str(first), str(tmp_path), *out], capsys)
    assert "--object-b" in refused(["transfer", str(first), str(first), "--object-b", "x", *out], capsys)
    assert "does not exist" in refused(["transfer", str(first), str(tmp_path / "c.png"), *out], capsys)


def test_what_is_nobodys_mistake_is_status_1_and_still_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("two\nlines")

    monkeypatch.setattr("grasptrack.tracking.tracker.GraspTracker.update", broken)
    given = tracking(plates(tmp_path / "in", 2), tmp_path)
    assert "RuntimeError: two lines" in refused(given, capsys, status=1)
    monkeypatch.setenv("GRASPTRACK_DEBUG", "1")
    with pytest.raises(RuntimeError):
        main(given)
