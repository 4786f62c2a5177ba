# SPDX-License-Identifier: Apache-2.0
"""What a run is recorded as: MCAP for Foxglove and RRD for rerun, read back by their own libraries; and lines of JSON."""

import json
import re
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from grasptrack import GraspTracker, open_source
from grasptrack.cli.main import main
from grasptrack.errors import InputError, install_hint
from grasptrack.io.columns import result_fields
from grasptrack.io.recording import HALF, covariance_ellipses, open_recording
from grasptrack.io.run import run_track
from grasptrack.tracking.result import TrackResult
from recordings import plates, rows
from test_cli_bad_input import refused


def track(source: object, out: Path, *more: str) -> list[dict[str, str]]:
    """Rows of a run without what no two runs share."""
    assert main(["track", str(source), "--output", str(out), "--no-video", "--quiet", *more]) == 0
    return [{k: v for k, v in row.items() if k != "latency_ms"} for row in rows(out)]


Recorded = tuple[Path, list[dict[str, str]], list[TrackResult]]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """A folder with run.mcap and run.jsonl, the rows of the run, and the results that were recorded."""
    pytest.importorskip("foxglove", reason="the extra foxglove is not installed")
    folder = tmp_path_factory.mktemp("recorded")
    plates(folder / "in", 6)
    record = ["--record", str(folder / "run.mcap"), "--jsonl", str(folder / "run.jsonl"), "--outline-in-jsonl"]
    found = track(folder / "in", folder / "out", "--fps", "30", *record)
    tracker = GraspTracker()
    return folder, found, [tracker.update(f.image, time=f.time) for f in open_source(folder / "in", fps=30)]


def decoded(path: Path) -> dict[str, list[Any]]:
    """Messages of an MCAP file by topic, by the libraries that Foxglove itself offers."""
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    found: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for schema, channel, message in reader.iter_messages():
            if channel.message_encoding == "json":
                content = json.loads(message.data)
            else:
                content = DecoderFactory().decoder_for(channel.message_encoding, schema)(message.data)
            found.setdefault(channel.topic, []).append((schema.name, message.log_time, content))
    return found


def test_an_mcap_file_holds_images_annotations_and_results(recorded: Recorded) -> None:
    folder, _, results = recorded
    found = decoded(folder / "run.mcap")
    images, drawn, told = (found[f"/grasptrack/{t}"] for t in ("image", "annotations", "result"))
    assert images[0][0] == "foxglove.CompressedImage" and drawn[0][0] == "foxglove.ImageAnnotations"
    times = np.array([entry[1] for entry in images])
    np.testing.assert_allclose(np.diff(times), 1e9 / 30, atol=1)
    for (_, at, image), (_, _, marks), (_, _, fields), result, frame in zip(
        images, drawn, told, results, open_source(folder / "in"), strict=True
    ):
        assert image.timestamp.seconds * 10**9 + image.timestamp.nanos == at and image.format == "png"
        shown = cv2.imdecode(np.frombuffer(image.data, np.uint8), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(shown, frame.image)
        assert fields["status"] == result.status and result.view is not None and result.contacts is not None
        assert fields["homography"] == result.homography.tolist()  # type: ignore[union-attr]
        # Foxglove counts from the corner of the first pixel: half a pixel more than we do.
        circles = [(c.position.x, c.position.y) for c in marks.circles]
        np.testing.assert_allclose(circles, result.contacts + 0.5, atol=1e-9)
        outline = [(p.x, p.y) for p in marks.points[0].points]
        np.testing.assert_allclose(outline, result.view.outer.points + 0.5, atol=1e-9)
        assert marks.texts[0].text == "tracked"


def test_half_a_pixel_is_what_the_viewers_ask_for() -> None:
    """An image of 1 px has its centre at (0, 0) for us, at (0.5, 0.5) where pixels are counted from the corner."""
    edge = cv2.resize(np.array([[0, 255]], np.uint8), (64, 32), interpolation=cv2.INTER_NEAREST)
    ours = float(np.flatnonzero(np.diff(edge[0].astype(int)))[0]) + 0.5  # between the centres of 31 and 32
    assert ours + HALF == 32.0  # the middle of 64 px, counted from the corner


@pytest.mark.sampled(1)
@pytest.mark.parametrize("fps", [pytest.param("30", marks=pytest.mark.slow), "29.97", ""])
def test_tracking_a_recording_again_gives_the_same_digits(tmp_path: Path, fps: str) -> None:
    pytest.importorskip("foxglove", reason="the extra foxglove is not installed")
    plates(tmp_path / "in", 5)
    rate = ["--fps", fps] if fps else []
    once = track(tmp_path / "in", tmp_path / "a", *rate, "--record", str(tmp_path / "run.mcap"))
    again = track(tmp_path / "run.mcap", tmp_path / "b", "--record", str(tmp_path / "again.mcap"))
    assert again == once and [r["status"] for r in once] == ["tracked"] * 5
    if fps == "30":
        assert track(f"bag:{tmp_path / 'again.mcap'}#/grasptrack/image", tmp_path / "c") == once


def test_a_quality_makes_jpeg_images(tmp_path: Path) -> None:
    pytest.importorskip("foxglove", reason="the extra foxglove is not installed")
    plates(tmp_path / "in", 2)
    track(tmp_path / "in", tmp_path / "a", "--record", str(tmp_path / "run.mcap"), "--record-quality", "90")
    images = decoded(tmp_path / "run.mcap")["/grasptrack/image"]
    assert {m.format for _, _, m in images} == {"jpeg"} and all(m.data[:2] == b"\xff\xd8" for _, _, m in images)


def test_what_was_recorded_up_to_an_error_can_be_read(tmp_path: Path) -> None:
    pytest.importorskip("foxglove", reason="the extra foxglove is not installed")
    plates(tmp_path / "in", 4)
    (tmp_path / "in" / "003.png").write_bytes(b"no image")
    with pytest.raises(InputError):
        recordings = [open_recording(tmp_path / "run.mcap")]
        run_track(open_source(tmp_path / "in"), GraspTracker(), tmp_path / "o", video=False, recordings=recordings)
    assert len(list(open_source(tmp_path / "run.mcap"))) == 3


def test_lines_of_json(recorded: Recorded) -> None:
    folder, table, results = recorded
    lines = [json.loads(line) for line in (folder / "run.jsonl").read_text().splitlines()]
    for line, row, result in zip(lines, table, results, strict=True):
        assert line["frame"] == int(row["frame"]) and line["status"] == row["status"]
        np.testing.assert_allclose(
            np.ravel(line["homography"]),
            [float(row[f"h{i}{j}"]) for i in (1, 2, 3) for j in (1, 2, 3)],
            rtol=1e-8,
            atol=1e-8,
        )
        np.testing.assert_array_equal(line["contacts"], result.contacts)
        np.testing.assert_array_equal(line["outline"][0], result.view.outer.points)  # type: ignore[union-attr]
        assert line["margin"] == pytest.approx(float(row["margin"]), abs=1e-4)
    covariances = np.array([line["covariances"] for line in lines[1:]])
    columns = [[float(row[f"cov_{pair}{k}"]) for pair in ("xx", "xy", "yy") for k in (1, 2)] for row in table[1:]]
    np.testing.assert_allclose(
        np.stack([covariances[:, :, 0, 0], covariances[:, :, 0, 1], covariances[:, :, 1, 1]], axis=1).reshape(5, 6),
        columns,
        rtol=1e-5,
    )
    assert table[0]["cov_xx1"] == "" and lines[0]["covariances"] is None


def test_the_columns_carry_the_first_contacts_to_those_of_each_row(recorded: Recorded) -> None:
    _, table, _ = recorded
    start = np.array([[float(table[0][f"x{k}"]), float(table[0][f"y{k}"]), 1.0] for k in (1, 2)])
    for row in table:
        H = np.array([float(row[f"h{i}{j}"]) for i in (1, 2, 3) for j in (1, 2, 3)]).reshape(3, 3)
        carried = start @ H.T
        expected = [[float(row[f"x{k}"]), float(row[f"y{k}"])] for k in (1, 2)]
        np.testing.assert_allclose(carried[:, :2] / carried[:, 2:], expected, atol=2e-4)


def test_lines_on_the_standard_output_stand_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plates(tmp_path / "in", 3)
    assert main(["track", str(tmp_path / "in"), "--output", str(tmp_path / "o"), "--no-video", "--jsonl", "-"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["frame"] for line in lines] == [0, 1, 2] and all("outline" not in line for line in lines)


def test_lost_frames_have_no_numbers_but_null(tmp_path: Path) -> None:
    from grasptrack.io.base import Frame

    frame = Frame(3, None, np.zeros((4, 4), np.uint8), "x")
    fields = result_fields(frame, TrackResult(3, None, "lost", "gone, \n since", reason_code="empty"), outline=True)
    assert json.loads(json.dumps(fields, allow_nan=False)) == fields and fields["reason"] == "gone, since"
    assert all(fields[key] is None for key in ("time_s", "contacts", "homography", "margin", "tilt", "outline"))


def test_ellipses_hold_ninety_five_percent() -> None:
    rng = np.random.default_rng(0)
    covariance = np.array([[[4.0, 1.5], [1.5, 1.0]]])
    centre = np.array([[30.0, 20.0]])
    result = TrackResult(0, None, "tracked", "", contacts=centre, covariance=covariance)
    (ring,) = covariance_ellipses(result, points=200)
    drawn = rng.multivariate_normal(centre[0], covariance[0], 4000)
    inside = [cv2.pointPolygonTest(ring.astype(np.float32), p, False) > 0 for p in drawn.astype(float)]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.012)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (["--record", "{}/run.bag"], "a recording is a file .mcap or .rrd"),
        (["--record", "{}/none/run.mcap"], "there is no folder"),
        (["--record", "{}/run.mcap", "--record-quality", "0"], "1 to 100, not 0"),
        (["--record-quality", "50"], "--record-quality is for --record"),
        (["--outline-in-jsonl"], "--outline-in-jsonl is for --jsonl"),
        (["--jsonl", "{}"], "cannot be written"),
    ],
)
def test_wrong_recordings_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], given: list[str], reason: str
) -> None:
    plates(tmp_path / "in", 2)
    more = [word.format(tmp_path) for word in given]
    assert reason in refused(["track", str(tmp_path / "in"), "--output", str(tmp_path / "o"), *more], capsys)


@pytest.mark.parametrize(
    ("words", "module", "extra"),
    [
        (["track", "IN", "--record", "OUT/run.rrd"], "rerun", "rerun"),
        (["track", "IN", "--record", "OUT/run.mcap"], "foxglove", "foxglove"),
        (["track", "MCAP", "--record", "OUT/run.mcap"], "mcap_protobuf.decoder", "foxglove"),
        (["live", "IN", "--record-as", "rrd", "--port", "0", "--start", "--until-end"], "rerun", "rerun"),
        (["live", "IN", "--port", "0", "--start", "--until-end"], "websockets", "live"),
        (["live", "IN", "--port", "0", "--start", "--until-end"], "starlette", "live"),
    ],
)
def test_what_is_missing_is_told_before_anything_is_written(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    module: str,
    extra: str,
) -> None:
    frames, mcap, out = plates(tmp_path / "in", 2), tmp_path / "run.mcap", tmp_path / "out"
    track(frames, tmp_path / "first", "--record", str(mcap))
    out.mkdir()
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr("grasptrack.plugins.find_spec", lambda name: None)
    there = {"IN": str(frames), "MCAP": str(mcap)}
    given = [there.get(word, word.replace("OUT", str(out))) for word in words]
    assert install_hint(extra) in refused([*given, "--output", str(out)], capsys)
    assert list(out.iterdir()) == []


@pytest.mark.parametrize(("suffix", "module", "extra"), [(".mcap", "foxglove", "foxglove"), (".rrd", "rerun", "rerun")])
def test_an_absent_package_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, module: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr("grasptrack.plugins.find_spec", lambda name: None)
    with pytest.raises(InputError, match=re.escape(install_hint(extra))):
        open_recording(tmp_path / f"run{suffix}")


def rerun_columns(path: Path) -> dict[str, dict[str, list[Any]]]:
    """Columns of an RRD file by entity, each sorted by the frame."""
    from rerun.chunk import RrdReader

    found: dict[str, dict[str, list[Any]]] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        if "frame" in batch.schema.names:
            for name in set(batch.schema.names) - {"log_time", "rerun.controls.RowId"}:
                column = batch.column(name)
                values = column.cast("int64").to_pylist() if name == "time" else column.to_pylist()
                found.setdefault(chunk.entity_path, {}).setdefault(name, []).extend(values)
    for columns in found.values():
        order = np.argsort(columns["frame"], kind="stable")
        columns.update({name: [values[i] for i in order] for name, values in columns.items()})
    return found


def test_an_rrd_file_is_read_back(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed: half a gigabyte, which no other test needs")
    plates(tmp_path / "in", 4)
    track(tmp_path / "in", tmp_path / "o", "--fps", "30", "--record", str(tmp_path / "run.rrd"))
    tracker = GraspTracker()
    frames = list(open_source(tmp_path / "in", fps=30))
    results = [tracker.update(f.image, time=f.time) for f in frames]
    found = rerun_columns(tmp_path / "run.rrd")
    assert found["/image"]["frame"] == [0, 1, 2, 3]
    np.testing.assert_allclose(found["/image"]["time"], np.arange(4) * 1e9 / 30, atol=1)
    for k, (frame, result) in enumerate(zip(frames, results, strict=True)):
        blob = np.array(found["/image"]["EncodedImage:blob"][k][0], np.uint8)
        np.testing.assert_array_equal(cv2.imdecode(blob, cv2.IMREAD_UNCHANGED), frame.image)
        # rerun has the centre of the first pixel at (0.5, 0.5).
        contacts = found["/image/contacts"]["Points2D:positions"][k]
        np.testing.assert_allclose(contacts, result.contacts + 0.5, atol=1e-4)  # type: ignore[operator]
        outline = np.array(found["/image/outline"]["LineStrips2D:strips"][k][0])
        np.testing.assert_allclose(outline[:-1], result.view.outer.points + 0.5, atol=1e-4)  # type: ignore[union-attr]
        np.testing.assert_array_equal(outline[0], outline[-1])
        assert found["/numbers/confidence"]["Scalars:scalars"][k][0] == result.confidence
        assert found["/status"]["StateChange:state"][k] == [result.status]
