# SPDX-License-Identifier: Apache-2.0
"""Streams on loopback and from a pipe: MJPEG, H.264 over RTSP and UDP, cut and picked up again; addresses of nothing."""

import io
import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from grasptrack import GraspTracker, SourceError, open_source
from grasptrack.io import live
from grasptrack.io.base import Frame
from grasptrack.io.run import run_track
from grasptrack.tracking.result import TrackResult
from recordings import movie, picture, plate, recording, rows
from rtsp import rtsp_server
from streaming import RATE, free_port, mjpeg_server, pushed_video, shown
from test_cli_bad_input import refused


def nearest_step(image: np.ndarray, last: int = 400) -> float:
    """Mean difference in grey levels from the most similar image that was sent."""
    grey = image if image.ndim == 2 else image[:, :, 1]
    return min(float(np.abs(grey.astype(int) - shown(step)).mean()) for step in range(last))


def test_mjpeg_over_http_is_a_live_source() -> None:
    port = free_port()
    with mjpeg_server(port):
        source = open_source(f"http://127.0.0.1:{port}/stream")
        frames = list(itertools.islice(source, 6))
    assert (source.kind, source.live, source.count) == ("stream", True, None)
    assert nearest_step(frames[-1].image, 40) < 1.5
    steps = np.diff([f.time for f in frames])
    assert (steps > 0).all() and steps.mean() == pytest.approx(1 / RATE, abs=0.03)


def test_rtsp_keeps_the_cameras_own_times() -> None:
    port = free_port()
    with rtsp_server(port):
        frames = list(itertools.islice(open_source(f"rtsp://user:secret@127.0.0.1:{port}/live"), 8))
    times = np.array([f.time for f in frames]) * RATE
    np.testing.assert_allclose(times, np.rint(times), atol=1e-3)
    assert "secret" not in frames[0].name and nearest_step(frames[0].image, 60) < 2.0


def test_udp() -> None:
    port = free_port(socket.SOCK_DGRAM)
    with pushed_video(f"udp://127.0.0.1:{port}?pkt_size=1316", "mpegts"):
        frames = list(itertools.islice(open_source(f"udp://127.0.0.1:{port}"), 4))
    assert nearest_step(frames[0].image, 90) < 2.0


def track_through_a_cut(folder: Path, pause: float) -> tuple[list[dict[str, str]], dict[str, int]]:
    """Rows of a run whose server goes away after 20 frames for so many s, and its entry of the source in run.json."""
    port = free_port()
    source = open_source(f"http://127.0.0.1:{port}/stream", settings={"wait": str(pause + 4.0)})
    began = time.monotonic()
    first = mjpeg_server(port)
    ended = first.__enter__()
    second: list[object] = []
    count = 0

    def cut_off(frame: Frame, result: TrackResult) -> None:
        nonlocal count
        count += 1
        if count == 8:
            ended.set()
            threading.Thread(target=restart, daemon=True).start()
        if source.reconnected and count >= 20:
            raise KeyboardInterrupt

    def restart() -> None:
        first.__exit__(None, None, None)
        time.sleep(pause)
        again = mjpeg_server(port, int((time.monotonic() - began) * RATE))
        again.__enter__()
        second.append(again)

    try:
        with pytest.raises(KeyboardInterrupt):
            run_track(source, GraspTracker(), folder, video=False, on_frame=cut_off)
    finally:
        for server in second:
            server.__exit__(None, None, None)  # type: ignore[attr-defined]
    return rows(folder), json.loads((folder / "run.json").read_text())["source"]


@pytest.mark.parametrize("pause", [0.4, pytest.param(3.0, marks=pytest.mark.slow)])
def test_a_stream_that_was_cut_is_picked_up_again_with_the_same_grasp(tmp_path: Path, pause: float) -> None:
    found, told = track_through_a_cut(tmp_path, pause)
    times = np.array([float(r["time_s"]) for r in found])
    assert (np.diff(times) > 0).all() and np.diff(times).max() > pause
    after = [r for r in found if float(r["time_s"]) > times[np.argmax(np.diff(times))]]
    located = [r for r in after if r["status"] in ("tracked", "unstable")]
    assert len(located) >= len(after) / 2 and {r["grasp_id"] for r in located} == {"1"}
    assert told["reconnected"] == 1


def test_only_the_newest_image_is_worked_on() -> None:
    port = free_port()
    with mjpeg_server(port):
        source = open_source(f"http://127.0.0.1:{port}/stream")
        for frame in source:
            if frame.index == 2:
                break
            time.sleep(0.25)  # who works for longer than an image lasts
    assert source.dropped >= 2 * 0.25 * RATE / 2


@pytest.mark.parametrize(
    ("spec", "reason"),
    [
        ("rtsp://127.0.0.1:1/x", "cannot be opened: Connection refused"),
        ("http://127.0.0.1:1/x", "cannot be opened: Connection refused"),
        ("rtsp:camera", "names no host"),
        ("udp://", "names no port"),
        ("udp://127.0.0.1:99999", "names no port"),
        ("rstp://127.0.0.1/x", '"rstp:" is no kind of source; there are bag, camera'),
    ],
)
def test_wrong_addresses_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], spec: str, reason: str
) -> None:
    assert reason in refused(["track", spec, "--output", str(tmp_path)], capsys)


def test_a_server_that_never_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "_OPENING", 0.4)
    with socket.socket() as deaf:
        deaf.bind(("127.0.0.1", 0))
        deaf.listen()
        with pytest.raises(SourceError, match="no answer in time"):
            next(iter(open_source(f"http://127.0.0.1:{deaf.getsockname()[1]}/x")))


def test_a_stream_that_goes_for_good_ends_the_run_with_its_rows_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "RETRY", 0.05)
    port = free_port()
    with mjpeg_server(port) as ended:
        threading.Timer(0.8, ended.set).start()
        given = ["track", f"http://127.0.0.1:{port}/stream", "--set", "wait=0.3", "--output", str(tmp_path)]
        said = refused([*given, "-q", "--no-video", "--jsonl", str(tmp_path / "run.jsonl")], capsys)
    assert "gave no image for 0.3 s after" in said
    kept = rows(tmp_path)
    assert len(kept) >= 2 and len((tmp_path / "run.jsonl").read_text().splitlines()) == len(kept)


@pytest.mark.slow
def test_ctrl_c_is_seen_while_no_image_comes(tmp_path: Path) -> None:
    port = free_port()
    with mjpeg_server(port) as ended:
        command = [sys.executable, "-m", "grasptrack.cli.main", "track", f"http://127.0.0.1:{port}/stream"]
        given = ["--set", "wait=60", "--output", str(tmp_path), "--no-video", "--jsonl", "-"]
        with subprocess.Popen([*command, *given], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            assert process.stdout is not None and process.stderr is not None
            assert process.stdout.readline().startswith(b"{")
            ended.set()
            time.sleep(0.5)
            process.send_signal(signal.SIGINT)
            assert process.wait(10) == 130
            assert process.stderr.read().count(b"\n") == 1
    assert json.loads((tmp_path / "run.json").read_text())["ended"] == "interrupted"


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


@pytest.mark.parametrize("suffix", ["mp4", "mov"])
def test_an_mp4_whose_index_comes_last_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    path = recording(tmp_path / f"m.{suffix}", "libx264")
    with pytest.raises(SourceError, match=r"index \(moov\) comes last, .* -movflags \+faststart OUT$"):
        piped(path.read_bytes(), monkeypatch)
    assert len(piped(movie(tmp_path / "front.mp4", count=3).read_bytes(), monkeypatch)) == 3


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
