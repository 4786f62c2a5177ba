# SPDX-License-Identifier: Apache-2.0
"""Sources that cannot be read, or not to their end: one line that names them, after the frames that could be read."""

import re
from pathlib import Path

import cv2
import pytest

from grasptrack import SourceError, open_source
from recordings import movie, picture, recording, write


def says(pattern: str) -> object:
    """SourceError with one line that matches."""
    return pytest.raises(SourceError, match=rf"(?s)^[^\n]*{pattern}[^\n]*$")


def test_missing_empty_and_unsuitable(tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    with says("does not exist"):
        open_source(tmp_path / "nope")
    with says("holds no image"):
        open_source(empty)
    with says("no image matches"):
        open_source(str(tmp_path / "*.png"))
    with says("fps must be a positive number"):
        open_source("camera:0", fps=-1)
    with says("camera:0"):
        open_source("camera:front")
    with says("has no name"):
        open_source("")
    (tmp_path / "a.txt").write_text("not a video\n" * 50)
    with says("is no video that can be read"):
        open_source(tmp_path / "a.txt")
    (tmp_path / "a.mp4").write_text("not a video\n" * 50)
    with says("is no video that can be read"):
        open_source(tmp_path / "a.mp4")
    (tmp_path / "b.mp4").write_bytes(b"")
    with says("is empty"):
        open_source(tmp_path / "b.mp4")


def test_a_camera_that_is_not_there() -> None:
    with says("camera 97 cannot be opened"):
        next(iter(open_source("camera:97")))


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif", ".bmp", ".pgm"])
@pytest.mark.parametrize("share", [0.02, 0.5, 0.97])
def test_a_truncated_image(tmp_path: Path, suffix: str, share: float) -> None:
    path = write(tmp_path / f"a{suffix}", picture()[:, :, 0])
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    with says(re.escape(path.name)):
        list(open_source(path))


def test_a_text_file_named_as_image_and_an_empty_one(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("hello")
    with says("damaged, or no image"):
        list(open_source(tmp_path / "a.png"))
    (tmp_path / "b.jpg").write_bytes(b"")
    with says("is empty"):
        list(open_source(tmp_path / "b.jpg"))


def test_a_jpeg_with_a_thumbnail_is_truncated_all_the_same(tmp_path: Path) -> None:
    whole = cv2.imencode(".jpg", picture())[1].tobytes()
    thumbnail = cv2.imencode(".jpg", picture()[::4, ::4])[1].tobytes()
    segment = b"\xff\xe1" + (len(thumbnail) + 2).to_bytes(2, "big") + thumbnail
    (tmp_path / "a.jpg").write_bytes(whole[:2] + segment + whole[2:])
    assert next(iter(open_source(tmp_path / "a.jpg"))).image.shape == (48, 64, 3)
    (tmp_path / "a.jpg").write_bytes((whole[:2] + segment + whole[2:])[:-20])
    with says("is truncated"):
        list(open_source(tmp_path / "a.jpg"))


def test_frames_that_change_size_are_named(tmp_path: Path) -> None:
    write(tmp_path / "0.png", picture())
    write(tmp_path / "1.png", picture())
    write(tmp_path / "2.png", picture(size=(40, 60)))
    frames = []
    with says(r"frame 2 \(2.png\) is 60x40 px, but those before it are 64x48"):
        for frame in open_source(tmp_path):
            frames.append(frame.index)
    assert frames == [0, 1]


@pytest.mark.parametrize(("suffix", "codec"), [(".mkv", "libx264"), (".avi", "mpeg4"), (".mp4", "")])
def test_a_truncated_video_gives_its_readable_frames_first(tmp_path: Path, suffix: str, codec: str) -> None:
    path = tmp_path / f"m{suffix}"
    path = recording(path, codec) if codec else movie(path, count=60, size=(120, 160))  # with its index in front
    assert len(list(open_source(path))) == 60
    data = path.read_bytes()
    path.write_bytes(data[: int(0.8 * len(data))])
    seen = []
    with says("truncated"):
        for frame in open_source(path):
            seen.append(frame.index)
    assert 20 < len(seen) < 60 and seen == list(range(len(seen)))


def test_a_truncated_mp4_with_its_index_behind_shows_nothing(tmp_path: Path) -> None:
    behind = recording(tmp_path / "b.mp4", "libx264")
    data = behind.read_bytes()
    behind.write_bytes(data[: int(0.8 * len(data))])
    with says("is truncated"):
        open_source(behind)
