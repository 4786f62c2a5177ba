# SPDX-License-Identifier: Apache-2.0
"""The planar benchmark POT: its folders are read as they are published, and its score is the one that it defines."""

import math
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from grasptrack.cli.main import main
from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.result import TrackResult
from grasptrack_bench import real
from grasptrack_bench.pot import sequences_of
from grasptrack_bench.records import read_records
from recordings import rows
from test_cli_bad_input import refused
from test_evaluation_real import CARD, image, motion

ANNOTATED, SCORED, IMAGES = (0, 1, 3, 5, 7), (0, 1, 3, 7), 8


def corners(frame: int) -> np.ndarray:
    return apply_homography(motion(frame), CARD)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The folder of one sequence, its annotation in a folder beside it."""
    found = tmp_path / "POT" / "V24_7"
    (found / "img").mkdir(parents=True)
    (found.parent / "annotation").mkdir()
    for i in range(IMAGES):
        cv2.imwrite(str(found / "img" / f"{i + 1:04d}.png"), image(i, False))
    told = [corners(i) if i in ANNOTATED else np.zeros((4, 2)) for i in range(IMAGES)]
    np.savetxt(found.parent / "annotation" / "V24_7_gt_points.txt", np.reshape(told, (IMAGES, 8)), "%.6f")
    flags = [2 * (i in ANNOTATED and i not in SCORED) for i in range(IMAGES)]
    (found.parent / "annotation" / "V24_7_flag.txt").write_text("".join(f"{flag}\r\n" for flag in flags))
    return found


@pytest.mark.parametrize(("every", "shown"), [(1, [0, 1, 3, 7]), (2, [1, 3, 7]), (4, [3, 7]), (50, [0])])
def test_a_sequence_begins_where_most_of_what_is_scored_is_shown(folder: Path, every: int, shown: list[int]) -> None:
    (case,) = sequences_of(folder.parent, every)
    found = case.homographies()
    assert case.name == "V24_7" and list(found) == shown
    truths = case.truths((320, 240))
    for i, H in found.items():
        assert apply_homography(H, corners(shown[0])) == pytest.approx(corners(i), abs=1e-3)
        assert truths.outline(i)[0] == pytest.approx(corners(i), abs=1e-3)
    assert np.array_equal(truths.outline(shown[0])[0], case.known.quad) and truths.of(5) is None


def test_it_may_lie_below_its_object_or_be_named_itself_and_hold_all_its_files(folder: Path) -> None:
    def images(where: Path) -> int:
        (case,) = sequences_of(where)
        return len(list(case.video.iterdir()))

    assert images(folder) == IMAGES
    below = folder.parent / "V24" / "V24_7"
    shutil.move(folder / "img", below)
    folder.rmdir()
    assert images(folder.parent) == IMAGES  # images without a folder of their own
    for file in (folder.parent / "annotation").iterdir():
        shutil.move(file, below)
    assert images(below) == images(below.parent) == IMAGES + 2


def test_the_alignment_error_is_that_of_the_corners(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Shifted:
        """Off by (3, 4) px in every image but the last, where it gives nothing."""

        frame = -1

        def __init__(self, start: object) -> None:
            self.contacts = start.contacts  # type: ignore[attr-defined]

        def update(self, image: object, time: object) -> TrackResult:
            self.frame += 1
            if self.frame == IMAGES - 1:
                return TrackResult(self.frame, None, "lost", "no more")
            off = np.array([[1.0, 0.0, 3.0], [0.0, 1.0, 4.0], [0.0, 0.0, 1.0]]) if self.frame else np.eye(3)
            H = off @ motion(self.frame)
            return TrackResult(self.frame, None, "tracked", "", "", 1, apply_homography(H, self.contacts), homography=H)

    monkeypatch.setattr(real, "method_makers", lambda _, risk: {"mine": Shifted})
    (case,) = sequences_of(folder)
    frames = real.run_video((case, ("mine",)))["mine"]
    assert [f.frame for f in frames] == list(range(IMAGES))
    assert frames[0].alignment == pytest.approx(0.0, abs=1e-4) and frames[7].alignment == math.inf
    for f in frames[1:7]:
        assert f.alignment == pytest.approx(5.0, abs=1e-4) if f.frame in SCORED else math.isnan(f.alignment)
        assert f.distances is None if f.frame not in SCORED else f.error == pytest.approx(5.0, abs=1e-4)


@pytest.mark.slow
def test_methods_are_scored_at_a_lower_frame_rate(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["evaluate", "pot", str(folder.parent), "--every", "2", "--methods", "auto,klt", "--workers", "1"]
    assert main([*given, "--output", str(tmp_path / "out")]) == 0
    assert "p@5" in capsys.readouterr().out
    frames = read_records(tmp_path / "out" / "cases" / "V24_7.csv")["auto"]
    assert [f.frame for f in frames] == [0, 1, 2, 3] and math.isnan(frames[2].visible)  # images 1, 3, 5 and 7
    told = {(r["method"], r["video"]): r for r in rows(tmp_path / "out", "summary.csv")}
    # 17 px from image to image are too many for KLT: what is lost counts as missed
    assert [float(told[method, "all"]["aligned_5"]) for method in ("auto", "klt")] == [1.0, 0.0]
    assert told["auto", "all"]["false_accepts"] == "0" and told["klt", "all"]["lost_median"] == "inf"
    assert "p@5" in (tmp_path / "out" / "report.html").read_text()


def changed(name: str, change: Callable[[list[str]], list[str]]) -> Callable[[Path], object]:
    def rewrite(folder: Path) -> object:
        file = folder.parent / "annotation" / name
        return file.write_text("\n".join(change(file.read_text().splitlines())))

    return rewrite


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (shutil.rmtree, "holds no sequence: a folder V24_7 of images"),
        (lambda folder: shutil.rmtree(folder / "img"), "holds no image"),
        (lambda folder: shutil.rmtree(folder.parent / "annotation"), "sequence V24_7 has no annotation"),
        (changed("V24_7_gt_points.txt", lambda lines: [*lines[:2], "1 2 3", *lines[3:]]), "line 3: a row is 8 numbers"),
        (changed("V24_7_gt_points.txt", lambda lines: ["x " + lines[0][2:], *lines[1:]]), "line 1: a row is 8 numbers"),
        (changed("V24_7_gt_points.txt", lambda lines: []), "is empty"),
        (changed("V24_7_flag.txt", lambda lines: lines[:-1]), "has 7 rows"),
        (changed("V24_7_flag.txt", lambda lines: ["1"] * 8), "tells no corners in its first 1 rows"),
        (
            lambda folder: shutil.copy(folder / "img" / "0001.png", folder / "img" / "0009.png"),
            "has 8 rows for 9 images",
        ),
    ],
)
def test_what_is_no_sequence_is_one_line(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], spoil: Callable[[Path], object], told: str
) -> None:
    spoil(folder)
    assert told in refused(["evaluate", "pot", str(folder.parent), "--output", str(tmp_path / "out")], capsys)
