# SPDX-License-Identifier: Apache-2.0
"""Images and videos that are piped in."""

import io
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from grasptrack import SourceError, open_source
from recordings import movie, picture, plate, recording, rows


def piped(data: bytes, monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(data)))
    source = open_source("-")
    assert (source.kind, source.live, source.count) == ("stdin", False, None)
    return [f.image for f in source]


def coded(image: np.ndarray, suffix: str) -> bytes:
    return cv2.imencode(suffix, image)[1].tobytes()


def test_png_and_jpeg_images_one_after_another(monkeypatch: pytest.MonkeyPatch) -> None:
    images = [picture(i) for i in range(5)]
    exact = piped(b"".join(coded(image, ".png") for image in images), monkeypatch)
    np.testing.assert_array_equal(exact, images)
    mixed = piped(coded(images[0], ".jpg") + coded(images[1], ".png") + coded(images[2], ".jpg"), monkeypatch)
    assert len(mixed) == 3 and np.abs(mixed[2].astype(int) - images[2]).mean() < 6.0


def test_a_thumbnail_within_a_jpeg_is_not_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    thumbnail, whole = coded(picture(1, (8, 8)), ".jpg"), coded(picture(2), ".jpg")
    segment = b"\xff\xe1" + (len(thumbnail) + 2).to_bytes(2, "big") + thumbnail
    found = piped((whole[:2] + segment + whole[2:]) * 2, monkeypatch)
    assert [image.shape for image in found] == [(48, 64, 3)] * 2


@pytest.mark.parametrize("suffix", ["mkv", "mpg"])
def test_a_video(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str) -> None:
    codec = {"mkv": "libx264", "mpg": "mpeg2video"}[suffix]
    path = recording(tmp_path / f"v.{suffix}", codec)
    found = piped(path.read_bytes(), monkeypatch)
    np.testing.assert_array_equal(found, [f.image for f in open_source(path)])


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "is empty"),
        (b"not an image " * 50, "holds neither JPEG or PNG images nor a video"),
        (coded(picture(), ".png")[:-9], "image 0 of the standard input is truncated"),
        (coded(picture(), ".jpg")[:300], "image 0 of the standard input is truncated"),
        (coded(picture(), ".jpg") + b"noise", "image 1 of the standard input is no JPEG or PNG image"),
    ],
)
def test_what_cannot_be_read_is_one_line(monkeypatch: pytest.MonkeyPatch, data: bytes, reason: str) -> None:
    with pytest.raises(SourceError, match=reason):
        piped(data, monkeypatch)


@pytest.mark.slow
def test_images_are_taken_as_they_come_and_lines_given_at_once(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "grasptrack.cli.main", "track", "-", "--output", str(tmp_path), "--no-video"]
    given = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([*command, "--jsonl", "-"], **given, env=dict(os.environ)) as process:  # type: ignore[call-overload]
        for i in range(3):
            process.stdin.write(coded(plate((150.0 + i, 118.0)), ".png"))
            process.stdin.flush()
            assert f'"frame":{i},' in process.stdout.readline().decode()  # before the next image is sent
        process.stdin.close()
        assert process.stdout.read() == b"" and process.wait(20) == 0
    assert len(rows(tmp_path)) == 3


@pytest.mark.parametrize("share", [0.5, 0.7, 0.8, 0.9, 0.99, 1.0])
def test_a_video_that_was_cut_off_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, share: float) -> None:
    whole = movie(tmp_path / "m.mp4", count=60).read_bytes()
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(whole[: int(len(whole) * share)])))
    source, count, told = open_source("-"), 0, ""
    try:
        for _ in source:
            count += 1
    except SourceError as error:
        told = str(error)
    assert bool(told or source.shortfall) == (share < 1.0) and (count == 60) == (share == 1.0)
    assert not source.shortfall or f"tells of 60 frames, {count} could" in source.shortfall
