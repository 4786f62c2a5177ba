# SPDX-License-Identifier: Apache-2.0
"""Sources that cannot be read, not to their end, or are larger than allowed: one line that names them."""

import json
import re
import resource
import struct
import zlib
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from grasptrack import SourceError, open_source
from grasptrack.cli.main import main
from grasptrack.io.headers import image_size_in_header
from grasptrack.io.images import read_image
from grasptrack.io.limits import limit_megapixels
from recordings import movie, picture, plate, plates, recording, write
from test_cli_bad_input import refused


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


SUFFIXES = (".png", ".jpg", ".bmp", ".tif", ".pgm", ".ppm", ".webp")


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a verb writes without being told where stays out of the folder of the sources."""
    monkeypatch.chdir(tmp_path)


def huge_png(path: Path, side: int = 20_000) -> Path:
    """A small file of side x side px, all of one level."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    packer = zlib.compressobj(1)
    rows = b"".join([*(packer.compress(bytes(side + 1)) for _ in range(side)), packer.flush()])
    head = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b""))
    return path


# --- size ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("size", [(33, 57), (64, 48), (1, 300)])
def test_the_header_tells_the_size(tmp_path: Path, suffix: str, size: tuple[int, int]) -> None:
    image = picture(2, size, 1 if suffix == ".pgm" else 3)
    data = write(tmp_path / f"a{suffix}", image).read_bytes()
    assert image_size_in_header(data) == (size[1], size[0])
    for end in range(min(len(data), 200)):  # cut anywhere: the same, or nothing
        assert image_size_in_header(data[:end]) in (None, (size[1], size[0]))


def test_an_image_above_the_limit_costs_no_memory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = huge_png(tmp_path / "a.png")
    assert path.stat().st_size < 3_000_000
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for verb in (["track"], ["synthesize"], ["inspect"], ["transfer", str(path)]):
        said = refused([*verb, str(path)], capsys)
        assert "20000x20000" in said and "400 megapixels" in said and "--max-megapixels" in said
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000  # KiB; the image alone has 390,000


def test_the_limit_is_the_users(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "a.png", plate())
    assert "0.05" in refused(["synthesize", str(path), "--max-megapixels", "0.05"], capsys)
    assert main(["synthesize", str(path), "--quiet"]) == 0  # the limit was that command's alone
    for wrong in ("0", "-1", "nan"):
        assert "--max-megapixels" in refused(["synthesize", str(path), "--max-megapixels", wrong], capsys)


def test_the_limit_holds_for_masks_and_videos(tmp_path: Path) -> None:
    video, mask = movie(tmp_path / "a.mp4"), write(tmp_path / "m.png", picture()[:, :, 0])
    limit_megapixels(0.002)
    try:
        with pytest.raises(SourceError, match="64x48 px"):
            open_source(video)
        with pytest.raises(SourceError, match="64x48 px"):
            read_image(mask)
    finally:
        limit_megapixels(None)
    assert len(list(open_source(video))) == 12


# --- metadata and times --------------------------------------------------------------------------


def titled(path: Path, title: bytes) -> Path:
    """A video whose title is the given bytes."""
    place = b"TITLETITLE"
    with av.open(str(path), "w") as container:
        container.metadata["title"] = place.decode()
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for i in range(4):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture(i), format="bgr24")))
        container.mux(stream.encode(None))
    data = path.read_bytes()
    assert place in data
    path.write_bytes(data.replace(place, title.ljust(len(place))))
    return path


@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".avi"])
def test_a_title_in_latin_1_is_no_reason_not_to_read(tmp_path: Path, suffix: str) -> None:
    assert len(list(open_source(titled(tmp_path / f"a{suffix}", "Käse".encode("latin-1"))))) == 4


def timed(path: Path, times: list[int]) -> Path:
    """A video whose frames have these presentation times, 1/25 s, in the order of the file."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        stream.time_base = stream.codec_context.time_base = Fraction(1, 25)
        for i, at in enumerate(times):
            frame = av.VideoFrame.from_ndarray(picture(i), format="bgr24")
            frame.pts, frame.time_base = i, Fraction(1, 25)
            for packet in stream.encode(frame):
                packet.pts = packet.dts = at
                container.mux(packet)
    return path


def test_times_that_do_not_go_on_are_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    images = plates(tmp_path / "images", 6)
    source = open_source(images)
    given = iter([0.0, 0.1, 0.1, float("nan"), 0.05, 0.2])
    read = source._read_images
    monkeypatch.setattr(source, "_read_images", lambda: ((image, next(given), name) for image, _, name in read()))
    with pytest.warns(UserWarning, match=r"002.png, 0.1 s, is not after 0.1 s") as said:
        times = [frame.time for frame in source]
    assert times == [0.0, 0.1, None, None, None, 0.2]
    assert len(said) == 1


def test_after_a_clock_was_set_back_times_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = open_source(plates(tmp_path / "images", 7))
    given = iter([0.0, 0.25, 0.5, -3600.0, -3599.75, -3599.25, 7200.0])
    read = source._read_images
    monkeypatch.setattr(source, "_read_images", lambda: ((image, next(given), name) for image, _, name in read()))
    with pytest.warns(UserWarning, match="after a clock that was set back times go on") as said:
        times = [frame.time for frame in source]
    assert times == [0.0, 0.25, 0.5, None, 1.0, 1.5, 10800.75]
    assert len(said) == 1


# --- files that end early ------------------------------------------------------------------------


def cut_live(path: Path, seconds: float, whole: float) -> Path:
    """A WebM as a recorder leaves it that died: its header tells of more than there is."""
    with av.open(str(path), "w", options={"live": "1"} if not whole else {}) as container:
        stream = container.add_stream("libvpx", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for i in range(round(25 * seconds)):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture(i % 5), format="bgr24")))
        container.mux(stream.encode(None))
    data = path.read_bytes()
    at = data.index(b"\x44\x89\x88") + 3  # Duration, a double of ms
    path.write_bytes(data[:at] + struct.pack(">d", 1000.0 * whole) + data[at + 8 :])
    return path


def test_a_whole_webm_ends_where_it_says(tmp_path: Path) -> None:
    source = open_source(cut_live(tmp_path / "a.webm", 1.0, 1.0))
    assert len(list(source)) == 25 and source.shortfall == ""


def test_a_webm_that_ends_early_says_so(tmp_path: Path) -> None:
    source = open_source(cut_live(tmp_path / "a.webm", 1.0, 2.0))
    assert len(list(source)) == 25
    assert source.shortfall == "it ends early: its header tells of 2.00 s, its last frame is at 0.96 s"


def test_a_run_tells_of_a_source_that_ended_early(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from grasptrack.io.images import ImageSource

    images = plates(tmp_path / "images", 5)
    monkeypatch.setattr(ImageSource, "shortfall", property(lambda _: "it ends early", lambda *_: None), raising=False)
    assert main(["track", str(images), "--output", str(tmp_path / "out"), "--no-video"]) == 0
    assert json.loads((tmp_path / "out" / "run.json").read_text())["shortfall"] == "it ends early"
    assert "it ends early" in capsys.readouterr().out


# --- names ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["camera:99999999999999999999", "camera:1000", "camera:", "a\0b", "x" * 5000, "camera:-1"]
)
def test_names_of_sources_that_cannot_be(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    refused(["track", name], capsys)


def test_evaluate_into_a_folder_whose_cases_are_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cases").write_text("mine")
    given = ["evaluate", "scenes", "--shapes", "bracket", "--disturbances", "noise", "--methods", "auto"]
    said = refused([*given, "--frames", "3", "--output", str(tmp_path)], capsys)
    assert "cases" in said and (tmp_path / "cases").read_text() == "mine"


def test_all_suffixes_are_decoded(tmp_path: Path) -> None:
    for suffix in SUFFIXES:
        image = read_image(write(tmp_path / f"b{suffix}", picture(2, (40, 50), 1 if suffix == ".pgm" else 3)))
        assert image.shape[:2] == (40, 50)
    assert np.array_equal(read_image(tmp_path / "b.png"), picture(2, (40, 50)))
