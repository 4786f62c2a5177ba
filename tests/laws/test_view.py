# SPDX-License-Identifier: Apache-2.0
"""Pictures: the right size, the right things in the right place, and never an exception for an odd frame."""

import csv
import math
import pickle
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.io.results import GraspsCsv, Tally
from grasptrack.tracking.result import TrackResult
from grasptrack.view import pair
from grasptrack.view.draw import MAX_SIDE, draw_overlay, friction_cones, jacobian_at
from grasptrack.view.pair import write_pair
from grasptrack.view.style import STATUS_RGB, add_legend, create_figure, ellipsise_text, rgb_to_bgr, text_width
from grasptrack.view.summary import BinnedCurves, Filmstrip, write_summary
from test_io_run import SQUARE, analysis, answer

H = np.array([[0.9, -0.2, 30.0], [0.25, 1.1, 12.0], [4e-4, -3e-4, 1.0]])


@pytest.mark.sampled(6)
@pytest.mark.parametrize("status", ["tracked", "unstable", "lost", "searching"])
@pytest.mark.parametrize("shape", [(480, 640), (480, 640, 3), (480, 640, 4), (33, 41), (3000, 4000, 3), (2000, 90)])
def test_any_frame_can_be_drawn_and_keeps_its_proportions(status: str, shape: tuple[int, ...]) -> None:
    image = np.full(shape, 128, np.uint8)
    drawn = draw_overlay(image, answer(0, status, "a reason that is long enough to need more room than there is" * 3))
    height, width = drawn.shape[:2]
    assert drawn.dtype == np.uint8 and drawn.shape[2] == 3 and max(width, height * 0.8) <= MAX_SIDE
    assert height > round(width * shape[0] / shape[1]) and (image == 128).all()
    colour = np.array(rgb_to_bgr(STATUS_RGB[status]))
    assert (drawn == colour).all(axis=2).sum() > 50


def test_contacts_are_drawn_where_they_are() -> None:
    result = replace(answer(0), contacts=np.array([[150.0, 200.0], [500.0, 300.0]]), seen=np.array([1.0, 0.0]))
    drawn = draw_overlay(np.full((480, 640), 90, np.uint8), result)
    colour = rgb_to_bgr(STATUS_RGB["tracked"])
    assert tuple(drawn[197, 150]) == colour  # filled: its edge was observed
    assert tuple(drawn[294, 500]) != colour  # hollow: it was not


@pytest.mark.parametrize("far", [1e3, 1e9, -1e9])
def test_contacts_outside_the_image_do_no_harm(far: float) -> None:
    result = replace(answer(0), contacts=np.array([[far, 20.0], [30.0, far]]))
    draw_overlay(np.zeros((480, 640, 3), np.uint8), result)


def test_a_cone_that_was_judged_in_the_reference_is_bent_by_the_homography() -> None:
    contacts = apply_homography(H, [[50.0, 60.0], [90.0, 60.0]])
    judged = analysis(0.1)._replace(judged_in="reference")
    result = replace(answer(0), contacts=contacts, analysis=judged, homography=H)
    first = friction_cones(result, 10.0)[0]
    np.testing.assert_allclose(np.linalg.norm(first[1:] - first[0], axis=1), 10.0)
    # The cone's middle is where a step along the normal goes, its edges where steps along its edges go.
    for row, angle in ((7, 0.0), (1, -np.arctan(0.5)), (13, np.arctan(0.5))):
        step = np.array([50.0, 60.0]) + 1e-4 * np.array([np.cos(angle), np.sin(angle)])
        expected = apply_homography(H, [step])[0] - contacts[0]
        got = first[row] - first[0]
        np.testing.assert_allclose(got / np.linalg.norm(got), expected / np.linalg.norm(expected), atol=1e-4)
    in_image = friction_cones(replace(result, analysis=analysis(0.1)), 10.0)[0]
    np.testing.assert_allclose(in_image[7] - in_image[0], [10.0, 0.0], atol=1e-12)


def test_the_derivative_of_a_homography() -> None:
    at = np.array([40.0, 70.0])
    J = jacobian_at(H, apply_homography(H, [at])[0])
    for axis in (0, 1):
        step = np.zeros(2)
        step[axis] = 1e-5
        difference = (apply_homography(H, [at + step]) - apply_homography(H, [at - step]))[0] / 2e-5
        np.testing.assert_allclose(J[:, axis], difference, rtol=1e-6)


def test_text_is_cut_to_its_room() -> None:
    text = "the grasp line leaves a friction cone"
    assert ellipsise_text(text, 10_000, 14) == text
    for room in (0, 10, 60, 150):
        assert text_width(ellipsise_text(text, room, 14), 14) <= max(room, 5)


def test_the_film_strip_is_bounded_and_evenly_spread() -> None:
    strip = Filmstrip()
    picture = np.zeros((48, 64, 3), np.uint8)
    for i in range(1000):
        if strip.wants_frame(i):
            strip.add_frame(i, picture)
    assert len(pickle.dumps(strip)) < 13 * 480 * 360 * 3  # small copies of 12 pictures at most
    numbers = [i for i, _ in strip.pick_frames()]
    assert len(numbers) == 6 and numbers[0] == 0 and numbers[-1] > 800
    assert max(np.diff(numbers)) < 2.5 * min(np.diff(numbers))


def run_of(path: Path, count: int) -> Tally:
    tally = Tally()
    sheet = GraspsCsv(path, 2)
    for i in range(count):
        status = "lost" if i % 10 == 7 else "tracked"
        result = answer(i, status, latency=1.0 + i % 3)
        sheet.write(result, i, None)
        tally.add(result)
    sheet.close()
    return tally


def test_curves_keep_every_extreme_in_bounded_memory(tmp_path: Path) -> None:
    run_of(tmp_path / "g.csv", 5000)
    curves = BinnedCurves(tmp_path / "g.csv", 5000)
    assert curves.bins == 1600
    with (tmp_path / "g.csv").open() as file:
        latencies = [float(r["latency_ms"]) for r in csv.DictReader(file)]
    assert np.nanmax(curves.high["latency_ms"]) == max(latencies) and np.nanmin(curves.low["latency_ms"]) == 1.0
    assert curves.bin_centres[0] < curves.bin_centres[-1] < 5000


@pytest.mark.sampled(1)
@pytest.mark.parametrize("count", [1, 2000])
def test_a_summary_of_a_run_of_any_length(tmp_path: Path, count: int) -> None:
    tally, strip = run_of(tmp_path / "g.csv", count), Filmstrip()
    for i in range(count):
        if strip.wants_frame(i):
            strip.add_frame(i, np.full((54, 64, 3), i % 255, np.uint8))
    write_summary(tmp_path / "s.png", tmp_path / "g.csv", strip, tally.summary(1.0, "finished", {}), "x")
    image = cv2.imread(str(tmp_path / "s.png"))
    assert image is not None and image.shape[1] > 1000


def test_a_picture_of_two_views(tmp_path: Path) -> None:
    grey, colour = np.full((60, 80), 120, np.uint8), np.full((50, 70, 3), 120, np.uint8)
    contacts = np.array([[10.0, 25.0], [40.0, 25.0]])
    write_pair(
        tmp_path / "p.png",
        (grey, View(SQUARE), contacts),
        (colour, View(SQUARE)),
        {"rrp": contacts, "homography": contacts + 400},
        {"grasp-line": "the silhouette has no distinct inertia axes"},
    )
    image = cv2.imread(str(tmp_path / "p.png"))
    assert image is not None and 1000 < image.shape[1] < 2500 and image.shape[0] < 1500


@pytest.mark.parametrize("count", [2, 3])
def test_marks_leave_what_lies_below_a_contact_visible(count: int) -> None:
    figure = create_figure(6.4, 4.8, dpi=100)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(-0.5, 639.5)
    axes.set_ylim(479.5, -0.5)
    axes.set_axis_off()
    angles = 0.3 + np.arange(count) * 2.0 * math.pi / count
    contacts = 0.5 * np.round(
        2.0 * (np.array([320.0, 240.0]) + 90.0 * np.column_stack([np.cos(angles), np.sin(angles)]))
    )
    figure.canvas.draw()
    before = np.asarray(figure.canvas.buffer_rgba()).copy()
    for mark, size in [*pair._MARKS.values(), pair._OTHER[0], ("o", pair._REFERENCE)]:
        pair._draw_open_marks(axes, contacts, "#ff0000", mark, size)
    figure.canvas.draw()
    after = np.asarray(figure.canvas.buffer_rgba())
    assert (after != before).any(axis=2).sum() > 1000
    for x, y in np.round(contacts).astype(int):
        assert np.array_equal(after[y - 1 : y + 2, x - 1 : x + 2], before[y - 1 : y + 2, x - 1 : x + 2])


@pytest.mark.parametrize("count", [1, 4, 9])
def test_a_legend_stays_below_its_panel(count: int) -> None:
    from matplotlib.lines import Line2D

    figure = create_figure(16.0, 9.0, dpi=100)
    axes = figure.add_axes((0.0125, 0.07, 0.575, 0.85))
    add_legend(axes, [Line2D([], [], lw=2, label=f"ways it fits {i}") for i in range(count)])
    place = axes.get_legend().get_window_extent(figure.canvas.get_renderer())
    assert place.x1 <= axes.get_window_extent().x1 and place.y0 >= 0.0
    assert place.y1 <= axes.get_window_extent().y0


def test_the_confidence_of_a_lost_frame_is_told_as_that_of_a_guess(monkeypatch: pytest.MonkeyPatch) -> None:
    from grasptrack.view import draw

    told: list[str] = []
    put = draw.put_text
    monkeypatch.setattr(
        draw, "put_text", lambda canvas, text, *at, **how: [told.append(text), put(canvas, text, *at, **how)]
    )
    image = np.zeros((480, 640, 3), np.uint8)
    draw_overlay(image, replace(answer(58), confidence=0.99608))
    assert "confidence" in told and "0.9961" in told
    told.clear()
    draw_overlay(image, TrackResult(58, None, "lost", "another shape", confidence=0.99608))
    assert "best guess" in told and "0.9961" in told
    assert "confidence" not in told and "1.00" not in told
