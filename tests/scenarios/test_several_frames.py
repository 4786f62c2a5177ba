# SPDX-License-Identifier: Apache-2.0
"""A first look that is not sure asks the next images: reflections stay with the lamps, objects with the bench."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

import grasptrack as gt
from benches import PLATE, grained, laid, overlap, photographed
from grasptrack.cli.main import main
from grasptrack.segmentation.several_frames import MAX_FRAMES, place_likelihoods

BENCH = laid(grained(1, depth=12.0), PLATE, (75.0, 85.0, 95.0))


def lamp_on(bench: np.ndarray, x: float, y: float) -> np.ndarray:
    """The bench with the sharp reflection of a lamp's shade."""
    disc = np.zeros(bench.shape[:2], np.float32)
    cv2.ellipse(disc, (int(16 * x), int(16 * y)), (75 * 16, 45 * 16), 20, 0, 360, (1.0,), -1, cv2.LINE_AA, 4)
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
