# SPDX-License-Identifier: Apache-2.0
"""A run: one row for every frame, files that can be read however it ends, and figures that are those of its rows."""

import json
import math
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from grasptrack import InputError, TrackResult, open_source
from grasptrack.cli.main import main
from grasptrack.geometry.contours import Contour, View
from grasptrack.grasp.force_closure import GraspAnalysis
from grasptrack.io.columns import UNITS, csv_columns
from grasptrack.io.results import Tally
from grasptrack.io.run import FILES, run_track
from recordings import movie, plate, rows, write

SQUARE = Contour([[10, 10], [25, 10], [40, 10], [40, 25], [40, 40], [25, 40], [10, 40], [10, 25]])


def analysis(margin: float) -> GraspAnalysis:
    normals = np.array([[1.0, 0.0], [-1.0, 0.0]])
    return GraspAnalysis(margin > 0, margin, 0.1, 15.0, 0.0, np.zeros(2), normals, 0.5, "image", "")


def answer(frame: int, status: str = "tracked", reason: str = "", latency: float = 1.5) -> TrackResult:
    given = status in ("tracked", "unstable")
    return TrackResult(
        frame,
        None,
        status,  # type: ignore[arg-type]
        reason,
        strategy="rrp" if given else "",
        grasp_id=1 if given else None,
        contacts=np.array([[10.0, 25.0], [40.0, 25.123456]]) if given else None,
        seen=np.array([1.0, 0.25]) if given else None,
        analysis=analysis(0.1 if status == "tracked" else -0.1) if given else None,
        confidence=0.9 if given else 0.0,
        view=View(SQUARE) if given else None,
        latency_ms=latency,
    )


class Scripted:
    """A tracker that answers from a list."""

    fingers = 2

    def __init__(self, *answers: TrackResult | BaseException) -> None:
        self._answers = list(answers)
        self.masks: list[Any] = []

    def update(self, image: Any, time: float | None = None, mask: Any = None) -> TrackResult:
        self.masks.append(mask)
        given = self._answers.pop(0) if self._answers else answer(0)
        if isinstance(given, BaseException):
            raise given
        return given


def log(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "run.json").read_text())
    return found


def length(path: Path) -> int:
    with av.open(str(path)) as container:
        return sum(1 for _ in container.decode(video=0))


def test_a_third_finger_has_columns_beside_those_of_the_others() -> None:
    """Those of two fingers are told by docs/files.md."""
    third, two = ["x3", "y3", "seen3", "cov_xx3", "cov_xy3", "cov_yy3", "last_seen3"], csv_columns(2)
    assert [name for name in csv_columns(3) if name not in third] == two
    before = {name: csv_columns(3)[csv_columns(3).index(name) - 1] for name in third}
    assert [before[name] for name in ("x3", "seen3", "cov_xx3", "last_seen3")] == [
        "y2",
        "seen2",
        "cov_yy2",
        "last_seen2",
    ]


def test_files_tell_since_when_a_contact_has_not_been_seen_and_angles_by_names_with_their_unit(tmp_path: Path) -> None:
    images = tmp_path / "images"
    images.mkdir()
    for k in range(12):
        image = plate((160.0 + 1.5 * k, 120.0 + k), 0.2)
        if 5 <= k < 9:
            cv2.circle(image, (round(230.9 + 1.5 * k), round(126.5 + k)), 14, 120, -1, cv2.LINE_AA)
        write(images / f"{k:02d}.png", image)
    out = tmp_path / "out"
    given = ["--start", "2", "--no-video", "-q", "--jsonl", str(tmp_path / "lines.jsonl")]
    assert main(["track", str(images), "--output", str(out), *given]) == 0
    told = rows(out)
    assert [int(row["last_seen1"]) for row in told] == [2, 3, 4, 4, 4, 4, 4, 9, 10, 11]
    assert [int(row["last_seen2"]) for row in told] == list(range(2, 12))
    lines = [json.loads(line) for line in (tmp_path / "lines.jsonl").read_text().splitlines()]
    assert lines[5]["last_seen"] == [4, 7]
    for name in ("margin", "margin_sd", "margin_image", "tilt", "tilt_sd"):
        assert [row[name] for row in told] == [row[f"{name}_deg"] for row in told]
        assert lines[5][name] == lines[5][f"{name}_deg"] and UNITS[f"{name}_deg"] == "degrees"


def test_a_row_for_every_frame_with_empty_cells_where_there_is_no_value(tmp_path: Path) -> None:
    tracker = Scripted(answer(0), answer(1, "unstable", "slips, by 3\nor so"), answer(2, "lost", "gone"), answer(3))
    run_track(open_source(movie(tmp_path / "m.mp4", count=4)), tracker, tmp_path / "out", video=False)
    first, second, third, fourth = rows(tmp_path / "out")
    assert [r["frame"] for r in (first, second, third, fourth)] == ["0", "1", "2", "3"]
    assert (float(first["x1"]), float(first["y2"]), float(first["seen2"])) == (10.0, 25.1235, 0.25)
    assert float(first["margin"]) == pytest.approx(math.degrees(0.1), abs=1e-3) and UNITS["margin"] == "degrees"
    assert float(second["time_s"]) == pytest.approx(0.04) and second["reason"] == "slips, by 3 or so"
    assert [third[c] for c in ("strategy", "grasp_id", "x1", "y2", "seen1", "margin")] == [""] * 6
    assert third["reason"] == "gone" and fourth["status"] == "tracked"


def test_all_files_are_written_and_those_of_an_earlier_run_replaced(tmp_path: Path) -> None:
    source, out = movie(tmp_path / "m.mp4", count=9, size=(47, 63)), tmp_path / "a" / "out"
    summary = run_track(open_source(source), Scripted(), out, options={"strategy": "rrp", "friction": math.inf})
    assert sorted(p.name for p in out.iterdir()) == sorted(FILES) == sorted(summary.files)
    with av.open(str(out / "overlay.mp4")) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264" and stream.codec_context.pix_fmt == "yuv420p"
        assert float(stream.average_rate) == 25 and sum(1 for _ in container.decode(stream)) == 9
    data = (out / "overlay.mp4").read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")
    found = log(out)
    assert found["ended"] == "finished" and found["frames"] == 9 and found["counts"]["tracked"] == 9
    assert found["options"] == {"strategy": "rrp", "friction": None}
    assert found["backend"] == "native" and {"grasptrack", "numpy", "opencv", "av"} <= set(found["versions"])
    assert found["source"]["kind"] == "video" and found["latency_ms"]["median"] == 1.5
    run_track(open_source(source), Scripted(), out, video=False)
    assert not (out / "overlay.mp4").exists()


@pytest.mark.parametrize("error", [KeyboardInterrupt(), InputError("bad"), RuntimeError("broken")])
def test_however_it_ends_the_files_can_be_read(tmp_path: Path, error: BaseException) -> None:
    tracker, out = Scripted(answer(0), answer(1), answer(2), error), tmp_path / "out"
    with pytest.raises(type(error)):
        run_track(open_source(movie(tmp_path / "m.mp4")), tracker, out)
    assert len(rows(out)) == 3 and length(out / "overlay.mp4") == 3
    assert log(out)["ended"] == ("interrupted" if isinstance(error, KeyboardInterrupt) else "failed")


def test_rows_are_on_the_disk_while_the_run_goes_on(tmp_path: Path) -> None:
    seen: list[int] = []
    run_track(
        open_source(movie(tmp_path / "m.mp4", count=3)),
        Scripted(),
        tmp_path / "out",
        video=False,
        on_frame=lambda frame, _: seen.append(len(rows(tmp_path / "out"))),
    )
    assert seen == [1, 2, 3]


def test_an_output_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    tracker = Scripted()
    with pytest.raises(InputError, match="cannot be written"):
        run_track(open_source(movie(tmp_path / "m.mp4")), tracker, tmp_path / "file" / "out")
    assert not tracker.masks


def test_figures_count_reasons_that_differ_in_numbers_as_one() -> None:
    tally = Tally()
    for i in range(100):
        tally.add(answer(i, "lost", f"off by {i}.5 px", latency=float(i)))
    tally.add(answer(100, latency=1000.0))
    summary = tally.summary(2.0, "finished", {})
    assert summary.reasons["lost"] == {"off by 0.5 px": 100}
    assert summary.counts == {"tracked": 1, "unstable": 0, "lost": 100, "searching": 0}
    assert summary.latency_median_ms == 50.0 and summary.frames_per_s == 50.5


def test_the_least_chance_and_the_mean_one_are_kept() -> None:
    tally, chances = Tally(), [1.0, math.nan, 0.7, 0.95]
    assert math.isnan(tally.summary(1.0, "finished", {}).chance_least)
    for i, chance in enumerate(chances):
        tally.add(replace(answer(i), chance=chance))
    figures = tally.summary(1.0, "finished", {}).figures()["chance"]
    assert figures["least"] == 0.7 and figures["mean"] == pytest.approx(np.nanmean(chances))


def test_memory_does_not_grow_with_the_run() -> None:
    tally = Tally()
    result = answer(0, latency=2.0)
    for _ in range(200_000):
        tally.add(result)
    assert len(pickle.dumps(tally)) < 1 << 20 and tally.summary(1.0, "finished", {}).latency_median_ms == 2.0
