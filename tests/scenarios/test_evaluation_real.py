# SPDX-License-Identifier: Apache-2.0
"""Real videos whose object is told by `scenes.csv`: which one is followed, from which frame, and what is counted."""

import csv
import math
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from grasptrack.cli.main import main
from grasptrack.errors import InputError
from grasptrack.geometry.homographies import apply_homography
from grasptrack_bench import real
from grasptrack_bench.baselines.direct import Ecc
from grasptrack_bench.method import Method, MethodStart
from grasptrack_bench.metrics.score import accept_limit
from grasptrack_bench.real import Given, another_object, read_scenes, share_in_view
from grasptrack_bench.records import read_records
from recordings import rows
from scores import write_homographies
from test_cli_bad_input import refused

SIZE = (320, 240)
CARD = np.array([[60.0, 60.0], [130.0, 66.0], [126.0, 112.0], [56.0, 106.0]])
PLATE = np.array([[170.0, 60.0], [290.0, 70.0], [280.0, 190.0], [160.0, 180.0]])
START, FRAMES, WITHOUT = 2, 9, 5
HEAD = ["name", "repo", "object", "quad"]


def motion(frame: int) -> np.ndarray:
    """H from frame 0 to a frame: it drifts upward, so that the card leaves the image by its upper side from frame 7 on."""
    c, s = math.cos(0.01 * frame), math.sin(0.01 * frame)
    return np.array([[c, -s, 2.0 * frame], [s, c, -8.5 * frame], [1e-5 * frame, 0.0, 1.0]])


@lru_cache
def table(plate: bool) -> np.ndarray:
    """Frame 0, four times as large: the card, dark on light, and a plate beside it that is larger and darker; both printed."""
    rng, big = np.random.default_rng(5), np.full((4 * SIZE[1], 4 * SIZE[0]), 190.0)
    for polygon, grey in ((CARD, 90.0), (PLATE, 30.0))[: 1 + plate]:
        within = cv2.fillPoly(np.zeros(big.shape, np.uint8), [np.rint(4 * polygon + 1.5).astype(np.int32)], 1) > 0
        inner = cv2.erode(within.astype(np.uint8), np.ones((41, 41))) > 0
        big[within] = grey
        big[inner] += 30.0 * cv2.GaussianBlur(rng.normal(0.0, 90.0, big.shape), (0, 0), 20.0)[inner]
    return np.asarray(cv2.GaussianBlur(np.clip(big, 0, 255).astype(np.uint8), (0, 0), 2.0))


def image(frame: int, plate: bool) -> np.ndarray:
    shrunk = np.array([[0.25, 0.0, -0.375], [0.0, 0.25, -0.375], [0.0, 0.0, 1.0]])
    shown = cv2.warpPerspective(table(plate), motion(frame) @ shrunk, SIZE, borderValue=190)
    return np.clip(shown + np.random.default_rng(frame).normal(0.0, 1.5, shown.shape), 0, 255).astype(np.uint8)


def text(points: np.ndarray) -> str:
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in np.atleast_2d(points))


def scenes(folder: Path, rows: list[list[str]]) -> Path:
    with (folder / "scenes.csv").open("w", newline="") as file:
        csv.writer(file).writerows([HEAD, *rows])
    return folder / "scenes.csv"


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`alone` shows the card, `pair` the plate too; the tables begin late and have a gap."""
    folder = tmp_path_factory.mktemp("films")
    pixel = text(apply_homography(motion(START), CARD.mean(axis=0, keepdims=True)))
    for name in ("alone", "pair"):
        (folder / name).mkdir()
        for i in range(FRAMES):
            cv2.imwrite(str(folder / name / f"{i:03d}.png"), image(i, name == "pair"))
        listed = {i: motion(i) for i in range(START, FRAMES) if i != WITHOUT}
        write_homographies(folder / f"{name}.homographies.csv", listed)
    scenes(folder, [[name, "someone/something", pixel, text(CARD)] for name in ("alone", "pair")])
    return folder


def evaluated(films: Path, out: Path, *more: str) -> int:
    return main(["evaluate", "real", str(films), "--workers", "1", "--output", str(out), *more])


@pytest.mark.slow
def test_the_pixel_chooses_the_object_and_the_table_says_what_was_whole(
    films: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert evaluated(films, tmp_path, "--methods", "auto,ecc") == 0
    shown = capsys.readouterr().out
    assert "left out" not in shown and [line.split()[:3] for line in shown.splitlines() if " all " in line] == [
        ["all", "auto", "8"],
        ["all", "ecc", "8"],
    ]
    quads = {i: apply_homography(motion(i), CARD) for i in range(START, FRAMES)}
    for name in ("alone", "pair"):
        frames = read_records(tmp_path / "cases" / f"{name}.csv")["auto"]
        assert [f.frame for f in frames] == list(range(START, FRAMES))
        assert frames[0].contacts is not None
        assert (
            cv2.pointPolygonTest(quads[START].astype(np.float32), frames[0].contacts.mean(axis=0).tolist(), False) > 0
        )
        answered = [f for f in frames[1:] if f.distances is not None]
        assert len(answered) >= 3 and max(f.error for f in answered) < 1.5
        for f in frames:
            if f.frame == WITHOUT:
                assert math.isnan(f.visible) and f.distances is None
                continue
            whole = bool((quads[f.frame] > 1.0).all())
            assert (f.visible == 1.0) is whole and (whole or 0.0 < f.visible < 0.995)
            area = cv2.contourArea(quads[f.frame].astype(np.float32))
            assert f.area == pytest.approx(area, rel=1e-3) and f.limit == pytest.approx(accept_limit(f.area))
    wholes = [i for i in range(START + 1, FRAMES) if i != WITHOUT and (quads[i] > 1.0).all()]
    assert 0 < len(wholes) < FRAMES - START - 2
    told = {(r["method"], r["video"]): r for r in rows(tmp_path, "summary.csv")}
    assert [int(told["auto", v]["frames_whole"]) for v in ("alone", "pair", "all")] == [len(wholes)] * 2 + [8]
    assert float(told["ecc", "all"]["located_whole"]) == 1.0 and told["ecc", "all"]["false_accepts"] == "0"


@pytest.mark.slow
def test_another_object_is_named_and_the_other_videos_are_measured(
    films: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert evaluated(films, tmp_path, "--methods", "ecc", "--given", "nothing") == 0
    shown = capsys.readouterr().out.splitlines()
    assert sum("pair left out" in line and "another object" in line and "shares 0 %" in line for line in shown) == 1
    assert not any("alone left out" in line for line in shown) and any("alone" in line for line in shown)
    assert [path.stem for path in (tmp_path / "cases").glob("*.csv")] == ["alone"]


def copied(films: Path, folder: Path, rows: list[list[str]]) -> Path:
    """The same videos, with another `scenes.csv`."""
    folder.mkdir()
    for path in films.iterdir():
        if path.name != "scenes.csv":
            (folder / path.name).symlink_to(path)
    scenes(folder, rows)
    return folder


@pytest.mark.slow
def test_a_pixel_of_another_object_and_a_video_that_is_not_there(
    films: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    card, plate = (text(apply_homography(motion(START), p.mean(axis=0, keepdims=True))) for p in (CARD, PLATE))
    rows = [["alone", "", card, text(CARD)], ["pair", "", plate, text(CARD)], ["gone", "", card, text(CARD)]]
    folder = copied(films, tmp_path / "in", rows)
    assert evaluated(folder, tmp_path / "out", "--methods", "ecc") == 0
    shown = capsys.readouterr().out.splitlines()
    assert sum("pair left out" in line and "another object" in line for line in shown) == 1
    assert sum("gone left out" in line and "no video of this name" in line for line in shown) == 1
    assert [path.stem for path in (tmp_path / "out" / "cases").glob("*.csv")] == ["alone"]


@pytest.mark.parametrize("given", ["pixel", "quad", "outline", "nothing"])
def test_what_methods_are_told(films: Path, monkeypatch: pytest.MonkeyPatch, given: Given) -> None:
    told: list[MethodStart] = []

    def make(start: MethodStart) -> Method:
        told.append(start)
        return Ecc(start)

    monkeypatch.setattr(real, "method_makers", lambda _, risk: {"mine": make})
    (case,) = [c for c in real.videos_of(films, given=given) if c.name == "alone"]
    frames = real.run_video((case, ("mine",)))["mine"]
    quad = apply_homography(motion(START), CARD)
    (start,) = told
    assert start.size == SIZE and another_object(start.outline, quad, SIZE) == ""
    told = given in ("pixel", "quad")
    assert start.object_at == (pytest.approx(tuple(quad.mean(axis=0)), abs=1.0) if told else None)
    assert start.by_hand is (given == "outline")
    if given in ("quad", "outline"):
        assert np.allclose(start.outline[0], quad, atol=1e-3) and len(start.outline) == 1
        assert np.allclose(start.contacts, [(quad[0] + quad[3]) / 2, (quad[1] + quad[2]) / 2], atol=1e-3)
    else:
        assert len(start.outline[0]) > 50
    moved = motion(4) @ np.linalg.inv(motion(START))
    assert frames[2].frame == 4 and frames[2].contacts is not None and frames[2].distances is not None
    away = np.hypot(*(frames[2].contacts - apply_homography(moved, start.contacts)).T)
    assert frames[2].distances == pytest.approx(away, abs=1e-6) and away.max() < 1.5


def test_the_share_in_view_is_of_the_sides() -> None:
    square = np.array([[10.0, 10.0], [60.0, 10.0], [60.0, 60.0], [10.0, 60.0]])
    assert share_in_view(square, SIZE) == 1.0
    assert share_in_view(square - 9.0, SIZE) < 0.995 and share_in_view(square - 8.9, SIZE) == 1.0
    # half of it is left of the image: half of two sides, and a whole one, are in view
    assert share_in_view(square - np.array([35.0, 0.0]), SIZE) == pytest.approx(0.5, abs=0.02)
    assert share_in_view(square - np.array([200.0, 0.0]), SIZE) == 0.0


def test_an_outline_is_the_objects_when_it_shares_half_with_it() -> None:
    square = np.array([[10.0, 10.0], [110.0, 10.0], [110.0, 110.0], [10.0, 110.0]])
    assert another_object([square + np.array([30.0, 0.0])], square, SIZE) == ""
    # a third, and the pixels on its border
    assert "shares 34 %" in another_object([square + np.array([50.0, 0.0])], square, SIZE)
    hook = np.array([[10.0, 10.0], [110.0, 10.0], [110.0, 20.0], [20.0, 20.0], [20.0, 110.0], [10.0, 110.0]])
    assert another_object([hook], square, SIZE) != ""


@pytest.mark.parametrize(
    "row",
    [
        ["alone", "", "90", text(CARD)],
        ["alone", "", "90,80 4,5", text(CARD)],
        ["alone", "", "90,80", text(CARD[:3])],
        ["alone", "", "90,80", text(CARD[[0, 2, 1, 3]])],
        ["", "", "90,80", text(CARD)],
        ["alone", "", "nan,80", text(CARD)],
        ["alone"],
    ],
)
def test_a_broken_row_is_named_by_its_line(tmp_path: Path, row: list[str]) -> None:
    path = scenes(tmp_path, [["first", "", "90,80", text(CARD)], row])
    with pytest.raises(InputError, match="line 3: a row needs"):
        read_scenes(path)


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (["--given", "pixel"], "which is not there"),
        (["--given", "quad"], "which is not there"),
        (["--given", "quad", "--fingers", "3"], "2 contacts, not 3"),
        (["--given", "mask"], "--given is pixel, quad, outline or nothing"),
    ],
)
def test_what_cannot_be_given_is_one_line(
    films: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], told: str
) -> None:
    folder = copied(films, tmp_path / "in", [])
    (folder / "scenes.csv").unlink()
    assert told in refused(["evaluate", "real", str(folder), "--output", str(tmp_path / "out"), *more], capsys)
