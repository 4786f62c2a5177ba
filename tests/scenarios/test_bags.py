# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1 and 2 and MCAP files as sources: the images and times they hold, and one line where they hold none."""

import re
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from bags import KINDS, write_bag, write_text_bag
from grasptrack import SourceError, open_source
from grasptrack.cli.main import main
from grasptrack.errors import InputError, install_hint
from grasptrack.io.run import run_track
from grasptrack.tracking.tracker import GraspTracker
from recordings import picture, plate, rows
from test_cli_bad_input import refused

pytest.importorskip("rosbags", reason="the extra bags is not installed")

COLOUR = [picture(i) for i in range(4)]
GREY = [image[:, :, 0] for image in COLOUR]
DEEP = [(image.astype(np.uint16) * 16) for image in GREY]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("encoding", "stored", "expected"),
    [
        ("bgr8", COLOUR, COLOUR),
        ("rgb8", [image[:, :, ::-1] for image in COLOUR], COLOUR),
        ("mono8", GREY, GREY),
        ("png", COLOUR, COLOUR),
    ],
)
def test_images_come_as_they_were_recorded(
    tmp_path: Path, kind: str, encoding: str, stored: list[np.ndarray], expected: list[np.ndarray]
) -> None:
    path = write_bag(tmp_path, kind, {"/camera/image": (encoding, stored)})
    source = open_source(path)
    assert (source.kind, source.count, source.exact, source.live) == ("bag", 4, True, False)
    frames = list(source)
    for frame, image in zip(frames, expected, strict=True):
        np.testing.assert_array_equal(frame.image, image)
    np.testing.assert_allclose([f.time for f in frames], np.arange(4) * 0.033333333, atol=1e-12)
    assert [f.time for f in open_source(f"bag:{path}#/camera/image", fps=10)] == [i * (1 / 10) for i in range(4)]


def test_times_without_stamps_are_those_of_the_recording(tmp_path: Path) -> None:
    path = write_bag(tmp_path, "ros2", {"/i": ("mono8", GREY)}, period=50_000_000, stamped=False)
    np.testing.assert_allclose([f.time for f in open_source(path)], [0.0, 0.05, 0.1, 0.15], atol=1e-12)


def test_a_mosaic_and_a_jpeg(tmp_path: Path) -> None:
    flat = np.empty((48, 64), np.uint8)
    flat[::2, ::2], flat[1::2, 1::2], flat[::2, 1::2], flat[1::2, ::2] = 200, 40, 90, 90  # red, blue, green
    path = write_bag(tmp_path, "ros1.bag", {"/raw": ("bayer_rggb8", [flat]), "/jpg": ("jpeg", COLOUR[:1])})
    mosaic = next(iter(open_source(f"bag:{path}#/raw"))).image
    assert np.abs(mosaic[2:-2, 2:-2].astype(int) - [40, 90, 200]).max() <= 1
    shown = next(iter(open_source(f"bag:{path}#/jpg"))).image
    assert np.abs(shown.astype(int) - COLOUR[0]).mean() < 6.0


def test_sixteen_bits_are_scaled_by_one_factor_or_by_what_is_said(tmp_path: Path) -> None:
    dark = [DEEP[0] // 8, DEEP[1] // 4]
    path = write_bag(tmp_path, "ros2-mcap", {"/deep": ("mono16", dark)})
    guessed = [f.image.astype(float) for f in open_source(path)]
    told = [f.image.astype(float) for f in open_source(path, settings={"bits": "12"})]
    for image, loose, fixed in zip([d.astype(float) for d in dark], guessed, told, strict=True):
        assert np.abs(fixed - image * 255 / 4095).max() <= 0.5
        assert np.abs(loose - np.minimum(image * 255 / 1023, 255)).max() <= 0.5


def test_a_bag_of_compressed_images_is_tracked(tmp_path: Path) -> None:
    images = [plate((150.0 + 1.5 * i, 118.0 + i), 0.2 + 0.01 * i) for i in range(3)]
    path = write_bag(tmp_path, "ros2-mcap", {"/camera/image/compressed": ("jpeg", images)})
    assert main(["track", str(path), "--output", str(tmp_path / "out"), "--no-video", "--quiet"]) == 0
    assert [r["status"] for r in rows(tmp_path / "out")] == ["tracked"] * 3


def said(spec: object, settings: dict[str, str] | None = None) -> str:
    with pytest.raises(SourceError) as caught:
        list(open_source(spec, settings=settings))  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_an_absent_topic_is_told_with_those_there_are(tmp_path: Path) -> None:
    path = write_bag(tmp_path, "ros1.bag", {"/left": ("mono8", GREY), "/right": ("mono8", GREY[:2])})
    assert "say which (bag:FILE#/topic): /left (4), /right (2)" in said(path)
    assert "topic /middle is not in it; images are in /left (4), /right (2)" in said(f"bag:{path}#/middle")
    assert open_source(f"bag:{path}#right").count == 2


def test_a_bag_without_images(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_text_bag(tmp_path / "text.bag")
    assert said(path).endswith("holds no images; its topics: /chatter")
    refused(["track", str(path), "--output", str(tmp_path / "o")], capsys)


def test_what_is_no_bag(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("x")
    (tmp_path / "a.db3").write_bytes(b"SQLite format 3\0")
    assert "is no bag" in said(f"bag:{tmp_path / 'a.txt'}")
    assert "does not exist" in said(f"bag:{tmp_path / 'none.bag'}#/x")
    assert "metadata.yaml" in said(tmp_path / "a.db3")
    path = write_bag(tmp_path, "ros1.bag", {"/i": ("mono8", GREY)})
    assert "bits is 9 to 16" in said(path, {"bits": "40"})
    assert "no setting exposure" in said(path, {"exposure": "4"})
    odd = write_bag(tmp_path, "ros2", {"/i": ("64FC1", [np.zeros((4, 6), np.float64)])})
    assert 'encoding "64FC1" are not read' in said(odd)


@pytest.mark.parametrize("kind", ["ros1.bag", "plain.mcap"])
@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.7, 0.999])
def test_a_file_that_was_cut_off_gives_what_it_holds_or_one_line(tmp_path: Path, kind: str, share: float) -> None:
    images = [picture(i, (240, 320)) for i in range(8)]
    path = write_bag(tmp_path, kind, {"/i": ("bgr8", images)})
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    found = []
    try:
        source = open_source(path)
        for frame in source:
            found.append(frame.image)
        assert source.shortfall
    except SourceError as error:
        assert path.name in str(error) and "\n" not in str(error)
    for image, expected in zip(found, images, strict=False):
        np.testing.assert_array_equal(image, expected)
    if kind == "plain.mcap" and share == 0.999:
        assert len(found) >= 4  # all but what was in the last piece


def test_without_the_package_one_line_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_bag(tmp_path, "ros1.bag", {"/i": ("mono8", GREY)})
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    monkeypatch.setattr("grasptrack.plugins.find_spec", lambda name: None)
    with pytest.raises(InputError, match=re.escape(install_hint("bags"))):
        open_source(path)
    refused(["track", str(path), "--output", str(tmp_path / "o")], capsys)


def test_a_frame_of_another_size_ends_a_run_with_its_rows_kept(tmp_path: Path) -> None:
    images = [plate(), plate(), cv2.resize(plate(), (160, 120))]
    path = write_bag(tmp_path, "ros2", {"/i": ("mono8", images)})
    with pytest.raises(SourceError, match="image 2 of /i"):
        run_track(open_source(path), GraspTracker(), tmp_path / "o", video=False)
    assert len(rows(tmp_path / "o")) == 2


@pytest.mark.parametrize("kind", ["ros2-mcap", "mcap"])
def test_a_bag_is_not_recorded_over(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_bag(tmp_path, kind, {"/i": ("mono8", [plate((150.0, 118.0), 0.2)] * 2)})
    stored = next(path.glob("*.mcap")) if path.is_dir() else path
    before = stored.read_bytes()
    assert main(["track", str(path), "--output", str(tmp_path / "out"), "--record", str(stored)]) == 2
    assert "is to be read, and would be written over" in capsys.readouterr().err
    assert stored.read_bytes() == before
