# SPDX-License-Identifier: Apache-2.0
"""Bad input: one clear line on stderr, exit status 2, and nothing lost."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from grasptrack.cli.main import main
from grasptrack.io.run import prepare_output
from grasptrack.io.video import VideoWriter
from recordings import movie, plate, plates, rows, write


def refused(given: list[str], capsys: pytest.CaptureFixture[str], status: int = 2) -> str:
    """Run and return the one line on stderr; nothing is on stdout."""
    assert main(given) == status
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1 and said.err.startswith("grasptrack: ")
    return said.err


def tracking(source: Path | str, tmp_path: Path, *more: str) -> list[str]:
    return ["track", str(source), "--output", str(tmp_path / "out"), *more]


def count(tmp_path: Path) -> int:
    return len(rows(tmp_path / "out"))


OPTIONS = [
    ("track inspect", ["--strategy", "magic"], ["magic", "auto", "rrp", "grasp-line", "homography"]),
    ("track inspect", ["--friction", "0"], ["--friction", "positive"]),
    ("track", ["--friction", "nan"], ["friction", "positive"]),
    ("track", ["--friction", "much"], ["--friction"]),
    ("synthesize", ["--friction", "-1"], ["--friction", "positive"]),
    ("track inspect", ["--fingers", "1"], ["at least 2"]),
    ("inspect synthesize", ["--fingers", "4"], ["2 or 3", "4"]),
    ("track", ["--fingers", "7"], ["7"]),
    ("track", ["--fingers", "3", "--strategy", "grasp-line"], ["grasp-line", "2 fingers"]),
    ("track", ["--fingers", "3", "--grasp", "1,2 3,4"], ["2 contacts", "3"]),
    ("track", ["--grasp", "here and there"], ["x1,y1 x2,y2"]),
    ("track inspect", ["--grasp", "10,10"], ["x1,y1 x2,y2"]),
    ("track inspect", ["--grasp", "300,10 10,230"], ["outline"]),
    ("track inspect synthesize", ["--object", "middle"], ["--object", "x,y"]),
    ("track", ["--object", "1,2,3"], ["--object", "x,y"]),
    ("track", ["--object", "5,5"], ["no object"]),
    ("inspect synthesize", ["--object", "5,5"], ["000.png", "no object"]),
    ("inspect synthesize", ["--object", "900,5"], ["--object 900,5", "outside", "320x240"]),
    ("synthesize", ["--box", "1,2,3"], ["--box", "left,top,width,height"]),
    ("synthesize", ["--box", "10,10,-5,20"], ["--box", "left,top,width,height"]),
    ("synthesize", ["--box", "400,10,50,50"], ["--box 400,10,50,50", "outside", "320x240"]),
    ("synthesize", ["--box", "2,2,20,20"], ["000.png", "no object"]),
    ("inspect synthesize", ["--box", "10,10,50,50", "--object", "160,120"], ["--object", "--box", "one of them"]),
    ("synthesize", ["--all", "--object", "160,120"], ["--all", "--object"]),
    ("synthesize", ["--top", "0"], ["--top", "at least 1"]),
    ("track", ["--fps", "0"], ["fps", "positive"]),
    ("track inspect", ["--max-opening", "30mm"], ["--max-opening", "--scale"]),
    ("track synthesize", ["--max-opening", "wide"], ["--max-opening", "120px, 40mm or 30%", "wide"]),
    ("track synthesize", ["--min-opening", "90", "--max-opening", "50"], ["90 px", "50 px"]),
    ("track", ["--max-opening", "9"], ["no frame has a grasp", "too wide for the opening of 9 px", "needs"]),
    ("track", ["--fingers", "3", "--max-opening", "9"], ["too wide for the opening of 9 px", "needs"]),
    ("synthesize", ["--finger-width", "0"], ["--finger-width", "120px, 40mm or 30%"]),
    ("track inspect", ["--finger-width", "9", "--grasp", "1,2 3,4"], ["--finger-width", "--grasp"]),
    ("synthesize", ["--finger-thickness", "4mm"], ["--finger-thickness 4mm", "--scale"]),
    ("synthesize", ["--clearance", "3cm"], ["--clearance", "3cm"]),
    ("track", ["--scale", "4", "--grasp", "1,2 3,4"], ["--scale", "--grasp"]),
    ("track inspect", ["--tolerance", "0"], ["--tolerance", "120px, 40mm or 30%"]),
    ("track inspect", ["--tolerance", "5mm"], ["--tolerance 5mm", "--scale"]),
    ("track inspect", ["--tolerance", "5mm", "--scale", "-1"], ["--scale", "positive"]),
    ("track", ["--start", "-1"], ["--start", "0"]),
    ("track", ["--start", "later"], ["--start", "integer"]),
    ("track", ["--start", "2"], ["has 2 images", "no frame 2"]),
    ("track", ["--next", "--grasp", "1,2 3,4 5,6 7,8"], ["4", "give 2 or 3 contacts"]),
    ("synthesize", ["--scale", "0"], ["--scale", "positive"]),
    ("synthesize", ["--scale", "nan"], ["--scale", "positive"]),
    ("track", ["--masks", "nowhere"], ["masks", "nowhere"]),
    ("inspect synthesize", ["--mask", "nowhere.png"], ["nowhere.png"]),
    ("track synthesize", ["--ignore", "nowhere.png"], ["nowhere.png"]),
    ("track", ["--frobnicate"], ["--frobnicate", "--help"]),
]


@pytest.mark.sampled(20)
@pytest.mark.parametrize(("verb", "more", "words"), [(v, *case) for verbs, *case in OPTIONS for v in verbs.split()])
def test_options(
    verb: str, more: list[str], words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = plates(tmp_path / "in", 2)
    given = [verb, str(folder if verb == "track" else folder / "000.png"), "--output", str(tmp_path / "out"), *more]
    error = refused([*given, "--no-video"] if verb == "track" else given, capsys)
    assert all(word in error for word in words), error
    assert not (tmp_path / "out" / "inspect.json").exists()


@pytest.mark.parametrize("given", [["track"], ["trak", "x"], ["transfer", "a.png"], ["--strategy", "rrp"]])
def test_usage(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert "--help" in refused(given, capsys)


def test_a_source_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "does not exist" in refused(tracking(tmp_path / "nope", tmp_path), capsys)
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
        ["synthesize", str(folder / "000.png"), "--output", blocked],
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


@pytest.mark.parametrize(
    ("verb", "name", "more"),
    [
        ("track", "overlay.mp4", []),
        ("track", "summary.png", []),
        ("track", "own.mp4", ["--jsonl", "OUT/own.mp4"]),
        ("live", "overlay.mp4", ["--start"]),
        ("synthesize", "grasps.png", []),
        ("inspect", "inspect.png", []),
        ("inspect", "candidates.png", []),
        ("transfer", "transfer.png", []),
        ("synthesize", "photo.png", ["--ignore", "OUT/grasps.png"]),
        ("live", "own.mp4", ["--start", "--background", "OUT/summary.png"]),
        ("track", "own.png", ["--masks", "OUT/candidates.png"]),
    ],
)
def test_what_is_read_is_never_written_over(
    verb: str, name: str, more: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    read = [out / name, *(Path(each.replace("OUT", str(out))) for each in more if each.endswith(".png"))]
    for path in read:
        movie(path) if path.suffix == ".mp4" else write(path, plate((150.0, 118.0), 0.2))
    before = [path.read_bytes() for path in read]
    sources = [str(out / name), *([str(out / name)] if verb == "transfer" else [])]
    told = refused([verb, *sources, "--output", str(out), *(e.replace("OUT", str(out)) for e in more)], capsys)
    assert "is to be read, and would be written over: name another folder or file" in told
    assert [path.read_bytes() for path in read] == before
    assert sorted(out.iterdir()) == sorted(set(read))


@pytest.mark.parametrize(
    ("verb", "names"),
    [
        ("track", ["grasps.csv", "run.json", "overlay.mp4", "summary.png", "candidates.png"]),
        ("live", ["grasps.csv", "run.json"]),
        ("synthesize", ["grasps.json", "grasps.png", "candidates.png"]),
        ("inspect", ["inspect.json", "inspect.png"]),
        ("transfer", ["transfer.json", "transfer.png"]),
    ],
)
def test_what_others_have_written_is_never_written_over(
    verb: str, names: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, photo = tmp_path / "out", str(write(tmp_path / "photo.png", plate((150.0, 118.0), 0.2)))
    given = [verb, photo, *([photo] if verb == "transfer" else []), *(["--start"] if verb == "live" else [])]
    out.mkdir()
    for name in names:
        (out / name).write_text("{}")
        told = refused([*given, "--output", str(out)], capsys)
        assert f'{name}" is not of an earlier run, and would be written over: move it, or name another folder' in told
        assert (out / name).read_text() == "{}" and [path.name for path in out.iterdir()] == [name]
        (out / name).unlink()


def test_what_a_run_has_written_is_replaced_and_no_other_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, photo = tmp_path / "out", str(write(tmp_path / "photo.png", plate((150.0, 118.0), 0.2)))
    for verb in ("track", "synthesize", "inspect"):
        for _ in range(2):
            assert (
                main([verb, photo, "--output", str(out), "--quiet", *(["--no-video"] if verb == "track" else [])]) == 0
            )
    named = json.loads((out / "run.json").read_text())["files"]
    assert named == ["grasps.csv", "run.json", "summary.png"]
    assert json.loads((out / "grasps.json").read_text())["files"] == ["grasps.json", "grasps.png"]
    told = json.loads((out / "run.json").read_text())
    (out / "run.json").write_text(json.dumps({**told, "files": [*named, "candidates.png"]}))
    (out / "candidates.png").write_text("of a run whose choice was not sure")
    prepare_output(out)  # as of a run that is broken off
    assert not (out / "candidates.png").exists() and not (out / "summary.png").exists()
    (out / "overlay.mp4").write_text("mine")
    refused(["track", photo, "--output", str(out)], capsys)
    assert (out / "overlay.mp4").read_text() == "mine" and (out / "grasps.json").exists()


def test_brackets_that_are_meant_as_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = plates(tmp_path / "run[1]", 2)
    monkeypatch.chdir(tmp_path)
    assert main(["track", "run[1]/[0]*.png", "--output", "out", "-q"]) == 2
    said = capsys.readouterr().err
    assert 'where a bracket is meant write "run[[]1]/[0]*.png"' in said and said.count("\n") == 1
    (folder / "000.png").rename(folder / "a[0].png")
    assert main(["inspect", str(folder / "a[0].png"), "--output", str(tmp_path / "out"), "-q", "--runs", "1"]) == 0
    assert 'write "a[[]0].png"' in refused(["inspect", "a[0].png"], capsys)


def test_a_pattern_of_videos_gives_each_a_folder_and_one_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        writer = VideoWriter(tmp_path / name / "x.mp4")
        for k in range(4):
            writer.write(np.dstack([plate((150.0 + k, 118.0), 0.2)] * 3))
        writer.close()
    (tmp_path / "b" / "y.mp4").write_text("no video")
    pattern, out = str(tmp_path / "*" / "x.mp4"), tmp_path / "out"
    assert main(["track", pattern, "--output", str(out), "--no-video"]) == 0
    told = capsys.readouterr().out
    assert told.count("x.mp4") > 2 and sorted(len(rows(folder)) for folder in out.iterdir()) == [4, 4]
    assert "1 of 2 videos could not be tracked" in refused(
        ["track", str(tmp_path / "b" / "*.mp4"), "--output", str(out), "--no-video", "-q"], capsys
    )
    assert len(rows(out / "x")) == 4
    assert "--record" in refused(["track", pattern, "--jsonl", "-"], capsys)
    assert "videos are opened one at a time" in refused(["inspect", pattern], capsys)
