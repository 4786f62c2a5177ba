# SPDX-License-Identifier: Apache-2.0
"""Sheets that nearly fill the image or that its border cuts, a first look with little work, or at several images."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import grasptrack as gt
from benches import PLATE, grained, laid, overlap, photographed
from grasptrack.cli.main import main
from grasptrack.errors import InputError, ObservationError
from grasptrack.first_image import FirstImage
from grasptrack.segmentation.candidate import describe_candidate
from grasptrack.segmentation.closed_edges import RECIPES
from grasptrack.segmentation.proposals import PreparedImage, propose_closed_edges
from grasptrack.segmentation.several_frames import MAX_FRAMES, place_likelihoods

WHOLE = {
    "70 %": np.array([[60.0, 40], [590, 30], [580, 440], [50, 450]]),
    "86 %": np.array([[22.0, 18], [610, 12], [622, 462], [15, 468]]),
}
CUT = {
    "on the left": np.array([[-60.0, 60], [400, 40], [420, 400], [-60, 420]]),
    "on the right": np.array([[300.0, 100], [720, 60], [720, 420], [310, 400]]),
    "at a corner": np.array([[-60.0, -60], [580, -60], [590, 430], [-60, 440]]),
}


def sheet(quad: np.ndarray, printed: bool, seed: int = 3) -> np.ndarray:
    """A sheet on a grained bench, with lines of words."""
    scene, rng = laid(grained(seed, depth=20.0), quad, (225.0,) * 3), np.random.default_rng(seed)
    for y in np.arange(40.0, 440.0, 22.0) if printed else ():
        for x in np.arange(30.0, 600.0, 30.0):
            if rng.random() < 0.8 and cv2.pointPolygonTest(quad.astype(np.float32), (x, y), True) > 35:
                word = np.array([[x, y], [x + rng.uniform(8, 26), y], [x + rng.uniform(8, 26), y + 8], [x, y + 9]])
                scene = laid(scene, word, (60.0, 50.0, 50.0))
    return photographed(scene, seed + 1)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("printed", [False, True])
@pytest.mark.parametrize("name", WHOLE)
def test_a_sheet_that_nearly_fills_the_image_comes_first(name: str, printed: bool) -> None:
    first = gt.first_look(sheet(WHOLE[name], printed))[0]
    assert overlap(first.view.outer.points, WHOLE[name]) > 0.97
    assert not first.view.is_clipped


@pytest.mark.sampled(1)
@pytest.mark.parametrize("printed", [False, True])
@pytest.mark.parametrize("name", CUT)
def test_a_sheet_that_the_border_cuts_is_offered_and_said_to_be_cut(name: str, printed: bool) -> None:
    """On its blank margin a pixel brings it among three."""
    quad, image = CUT[name], sheet(CUT[name], printed)
    inside = np.clip(quad, 0, (639, 479))
    corner = inside[np.argmin(np.hypot(*(inside - (320, 240)).T))]
    pixel = corner + 14.0 * np.sign(inside.mean(axis=0) - corner)
    found = [c for c in gt.first_look(image, pixel)[:3] if overlap(c.view.outer.points, quad) > 0.9]
    assert found and found[0].view.is_clipped
    assert describe_candidate(found[0], found[0]).endswith("cut by the image's border")


def test_print_on_a_cut_sheet_does_not_hide_it() -> None:
    quad = CUT["on the right"]
    assert any(overlap(c.view.outer.points, quad) > 0.9 for c in gt.first_look(sheet(quad, True)))


def test_more_than_nine_tenths_are_no_object_and_a_rest_of_the_ground_is_none_instead() -> None:
    with pytest.raises(ObservationError):
        gt.first_look(sheet(np.array([[12.0, 10], [626, 9], [630, 468], [10, 470]]), False))


@pytest.mark.slow
def test_track_says_that_it_is_cut(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photo = tmp_path / "sheet.png"
    cv2.imwrite(str(photo), sheet(CUT["on the left"], False))
    assert main(["track", str(photo), "--object", "100,200", "--no-video", "--output", str(tmp_path / "out")]) == 0
    assert "is cut by the border of its first image" in capsys.readouterr().out.replace("\n", " ")
    cv2.imwrite(str(photo), sheet(WHOLE["70 %"], False))
    assert main(["track", str(photo), "--no-video", "--output", str(tmp_path / "out")]) == 0
    assert "is cut by" not in capsys.readouterr().out.replace("\n", " ")


IMAGE = photographed(laid(laid(grained(2), PLATE, (60.0, 70.0, 200.0)), PLATE * 0.4 + 20, (230.0, 70.0, 60.0)), 3)


def outlines(ms: float | None) -> list[tuple[float, ...]]:
    return [(c.probability, *c.view.outer.points.ravel().tolist()) for c in gt.first_look(IMAGE, first_look_ms=ms)]


def test_the_least_work_still_finds_an_object_and_much_work_finds_all() -> None:
    assert len(outlines(1e-3)) == 1
    assert outlines(1e6) == outlines(None) and len(outlines(None)) == 2
    assert overlap(gt.first_look(IMAGE, first_look_ms=1e6)[0].view.outer.points, PLATE) > 0.95


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(st.floats(1.0, 150.0))
def test_the_same_bound_finds_the_same(ms: float) -> None:
    assert outlines(ms) == outlines(ms)


@pytest.mark.parametrize("ms", [100.0, 1e6])
def test_a_cut_at_given_contacts_is_within_the_bound_too(ms: float) -> None:
    scene = PreparedImage(IMAGE, FirstImage(grasp=gt.Grasp(0.5 * (PLATE[::2] + PLATE[1::2])), first_look_ms=ms))
    before = scene.work.spent_ms
    assert (scene.contact_region is None) is (ms == 100.0)
    assert scene.work.spent_ms <= ms and (scene.work.spent_ms > before) is (ms > 100.0)


@given(st.floats(0.0, 200.0), st.floats(0.0, 200.0))
def test_closings_are_cut_short_at_the_end_and_never_beyond_the_bound(one: float, other: float) -> None:
    few, many = sorted((one, other))
    found = []
    for ms in (few, many):
        scene = PreparedImage(IMAGE, FirstImage(first_look_ms=ms))
        found.append([(p.recipe, p.silhouette.box) for p in propose_closed_edges(scene)])
        assert scene.work.spent_ms <= ms or not found[-1] or scene.work.spent_ms < 1.2 * ms
    assert found[1][: len(found[0])] == found[0]
    assert {r for r, _ in found[0]} <= set(range(len(RECIPES)))


@pytest.mark.parametrize("ms", [0.0, -3.0, float("nan"), float("inf")])
def test_a_bound_that_is_none_is_told(ms: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for refused in (lambda: gt.first_look(IMAGE, first_look_ms=ms), lambda: gt.GraspTracker(first_look_ms=ms)):
        with pytest.raises(InputError, match="first_look_ms is a number of ms above 0"):
            refused()
    photo = tmp_path / "photo.png"
    cv2.imwrite(str(photo), IMAGE)
    for verb in ("track", "inspect", "synthesize"):
        assert main([verb, str(photo), "--first-look-ms", str(ms), "--output", str(tmp_path / "out")]) == 2
        assert "--first-look-ms is a number of ms above 0" in capsys.readouterr().err


@pytest.mark.slow
def test_tracker_and_verbs_keep_to_it(tmp_path: Path) -> None:
    tracker = gt.GraspTracker(first_look_ms=1e-3)
    tracker.update(IMAGE)
    assert len(tracker.candidates) == 1
    photo = tmp_path / "photo.png"
    cv2.imwrite(str(photo), IMAGE)
    for verb, more in (("track", ["--no-video"]), ("inspect", ["--runs", "1"]), ("synthesize", [])):
        out = tmp_path / verb
        words = [verb, str(photo), "--first-look-ms", "0.001", "--sure", "0.9999", "--output", str(out), *more]
        assert main([*words, "--quiet", "--choose", "2"]) == 2
        assert main([*words, "--quiet"]) == 0


BENCH = laid(grained(1, depth=12.0), PLATE, (75.0, 85.0, 95.0))


def lamp_on(bench: np.ndarray, x: float, y: float) -> np.ndarray:
    """The bench with the sharp reflection of a lamp's shade."""
    disc = np.zeros(bench.shape[:2], np.float32)
    cv2.ellipse(disc, (int(16 * x), int(16 * y)), (120 * 16, 72 * 16), 20, 0, 360, (1.0,), -1, cv2.LINE_AA, 4)
    return bench + 60.0 * cv2.GaussianBlur(disc, (0, 0), 1.2)[..., None]


def filmed(step: float, count: int = MAX_FRAMES + 1, lamp: float = 0.25) -> list[np.ndarray]:
    """Images of a camera that goes on by `step` px; the reflection goes along by a share of that."""
    frames = []
    for k in range(count):
        motion = np.array([[1.0, 0.0, step * k], [0.0, 1.0, -0.5 * step * k]])
        moved = cv2.warpAffine(BENCH, motion, (640, 480), borderMode=cv2.BORDER_REFLECT)
        frames.append(photographed(lamp_on(moved, 500.0 + lamp * step * k, 380.0 - 0.5 * lamp * step * k), k + 11))
    return frames


def shows_plate(candidate_view: gt.View) -> bool:
    return overlap(candidate_view.outer.points, PLATE) > 0.85


def test_a_reflection_that_wins_in_the_first_image_loses_by_the_next() -> None:
    frames = filmed(4.0)
    alone, told = gt.first_look(frames[0]), gt.first_look(frames[0], more=frames[1:])
    assert not shows_plate(alone[0].view) and shows_plate(told[0].view)
    reflected = next(c for c in told if np.abs(c.view.outer.points.mean(axis=0) - (500, 380)).max() < 5)
    assert reflected.probability < 0.1 * alone[0].probability
    assert told[0].probability > alone[1].probability
    assert sum(c.probability for c in told) <= 1.0 + 1e-9
    assert told == sorted(told, key=lambda c: -c.probability)


def test_a_camera_that_stands_still_tells_nothing() -> None:
    frames = filmed(0.0)
    alone, told = gt.first_look(frames[0]), gt.first_look(frames[0], more=frames[1:])
    for one, other in zip(alone, told, strict=True):
        assert other.probability == pytest.approx(one.probability, rel=0.1)


def test_a_lamp_that_moves_with_the_bench_is_an_object_for_all_that_is_seen() -> None:
    """A stain does the same: to lie still on the bench makes nothing sure that had half the probability."""
    frames = filmed(4.0, lamp=1.0)
    alone, told = gt.first_look(frames[0]), gt.first_look(frames[0], more=frames[1:])
    assert not shows_plate(told[0].view)
    assert alone[0].probability <= told[0].probability < 0.9


def test_no_more_is_asked_than_needed() -> None:
    frames, asked = filmed(4.0, 7), list[int]()

    def later() -> Iterator[np.ndarray]:
        for k, frame in enumerate(frames[1:]):
            asked.append(k)
            yield frame

    gt.first_look(frames[0], (250, 200), more=later())
    gt.first_look(frames[0], sure=0.0, more=later())
    gt.first_look(frames[0], segmenter=lambda seen: seen[..., 1] < 100, more=later())
    assert asked == []
    gt.first_look(frames[0], sure=0.999, more=later())
    assert asked == list(range(MAX_FRAMES))


def test_images_of_another_size_or_without_objects_tell_nothing() -> None:
    frames = filmed(4.0, 2)
    empty = np.full((480, 640, 3), 90, np.uint8)
    alone, told = gt.first_look(frames[0]), gt.first_look(frames[0], more=[frames[1][:300], empty])
    assert [c.probability for c in alone] == [c.probability for c in told]


def test_the_farther_the_camera_moved_the_more_a_place_tells() -> None:
    found = gt.first_look(filmed(0.0, 1)[0])[:2]
    gains = []
    for step in (0.0, 2.0, 8.0, 30.0):
        motion = np.array([[1.0, 0.0, step], [0.0, 1.0, 0.0]])
        seen = [c._replace(view=c.view.transformed(np.vstack([motion, [0, 0, 1.0]]))) for c in found]
        still, lamps = place_likelihoods(found, seen, motion)
        gains.append(float((still - lamps)[0]))
    assert gains == sorted(gains) and gains[0] == 0.0 and gains[-1] > 4.0


@pytest.mark.slow
def test_the_tracker_and_the_command_line_ask_them_too(tmp_path: Path) -> None:
    frames = filmed(1.0, 4 * MAX_FRAMES + 1)
    tracker = gt.GraspTracker(more=frames[4::4])
    first = tracker.update(frames[0])
    assert first.frame == 0 and first.view is not None and shows_plate(first.view)
    assert tracker.update(frames[1]).frame == 1
    folder = tmp_path / "frames"
    folder.mkdir()
    for k, frame in enumerate(frames):
        cv2.imwrite(str(folder / f"{k:02d}.png"), frame)
    out = tmp_path / "out"
    assert main(["track", str(folder), "--no-video", "--quiet", "--output", str(out)]) == 0
    row = (out / "grasps.csv").read_text().splitlines()[1].split(",")
    for k in (5, 7):
        assert abs(cv2.pointPolygonTest(PLATE.astype(np.float32), (float(row[k]), float(row[k + 1])), True)) < 12.0
