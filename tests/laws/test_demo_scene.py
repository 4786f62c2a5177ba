# SPDX-License-Identifier: Apache-2.0
"""The demonstration's images show what their truth says, and the same ones each time."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from grasptrack.demo import DemoFrame, DemoScene, demo_scene, still_life
from grasptrack.demo import scene as rendering
from grasptrack.demo.run import contact_errors
from grasptrack.demo.scene import LIE
from grasptrack.geometry.homographies import apply_homography
from grasptrack.segmentation.first_look import find_objects
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats

BLUR = 0.75
"""px, of an edge in an image 640 px wide."""


@cache
def scene() -> DemoScene:
    return demo_scene(120, colour=False)


def edge_offsets(frame: DemoFrame) -> Floats:
    """(n,) px by which each long straight side in the image lies outside that of `outline`: fitted levels, Phi between."""
    y, x = np.mgrid[: frame.image.shape[0], : frame.image.shape[1]]
    offsets = []
    for ring in frame.outline:
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            length = float(np.hypot(*(b - a)))
            if length < 40.0:
                continue
            along, out = (b - a) / length, np.array([b[1] - a[1], a[0] - b[0]]) / length
            place = (x - a[0]) * along[0] + (y - a[1]) * along[1]
            beyond = (x - a[0]) * out[0] + (y - a[1]) * out[1]
            near = (np.abs(beyond) < 4.0) & (place > 5.0) & (place < length - 5.0)
            d, level = beyond[near] / BLUR, frame.image[near].astype(np.float64)
            step = 0.5 * (1.0 + np.vectorize(math.erf)(d / math.sqrt(2.0)))
            slope = -np.exp(-0.5 * d**2) / (BLUR * math.sqrt(2.0 * math.pi))
            (_, contrast, moved), *_ = np.linalg.lstsq(
                np.column_stack([np.ones(len(d)), step, slope]), level, rcond=None
            )
            offsets.append(moved / contrast)
    return np.array(offsets)


@cache
def plain_scene() -> DemoScene:
    """The same without wood and brush strokes, so that a frame shows every edge without a bias of its own."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(rendering, "_smooth_noise", lambda rng, size, sx, sy: np.zeros((size, size), np.float32))
        table = np.full((rendering.SIDE, rendering.SIDE, 3), rendering.WOOD, np.uint8)
        part = rendering._make_bracket()
        drawing = rendering._draw_parts(table, [part], np.random.default_rng(0))
    seen = scene()._table_to_image
    return DemoScene(part, drawing, seen, width=640, height=480, colour=False, seed=1)


@given(st.integers(0, 119))
@example(0)  # there, sides run along rows and columns, where a picture of too few samples would be off the most
def test_edges_lie_where_the_truth_says(index: int) -> None:
    found = edge_offsets(plain_scene()[index])
    assert len(found) >= 4
    assert np.abs(found).max() < 0.02


@given(st.integers(0, 119))
def test_the_truth_is_one_homography(index: int) -> None:
    frame, first = scene()[index], scene()[0]
    for ring, moved in zip(first.outline, frame.outline, strict=True):
        np.testing.assert_allclose(apply_homography(frame.H_current_reference, ring), moved, rtol=0, atol=1e-9)
        np.testing.assert_allclose(frame.true_contacts(ring), moved, rtol=0, atol=1e-9)
    assert frame.outline_visible == 1.0
    assert frame.index == index and frame.time == index / 30.0
    assert 25_000.0 < frame.area < 40_000.0


def test_a_frame_is_the_same_whenever_it_is_asked_for() -> None:
    once, again = list(demo_scene(4)), demo_scene(4)
    for i in (2, 0, 3, 1):
        assert (again[i].image == once[i].image).all()
    assert (demo_scene(4, seed=4)[1].image != once[1].image).any()
    assert len(again) == again.count == 4
    assert once[0].image.shape == (480, 640, 3)
    assert demo_scene(2, width=320, height=240, colour=False)[1].image.shape == (240, 320)
    for index in (-1, 4):
        with pytest.raises(IndexError):
            again[index]


def test_larger_images_show_the_same() -> None:
    small, large = demo_scene(3)[1], demo_scene(3, width=1280, height=960)[1]
    np.testing.assert_allclose(
        (np.concatenate(large.outline) - 0.5) / 2.0, np.concatenate(small.outline), rtol=0, atol=1e-9
    )
    reduced = large.image.reshape(480, 2, 640, 2, 3).mean(axis=(1, 3))
    assert np.abs(reduced - small.image).mean() < 2.5  # some of it is noise


def test_the_parts_of_a_still_life_lie_apart_and_are_found() -> None:
    image = still_life()
    assert (image == still_life()).all() and image.shape == (480, 640, 3)
    found = find_objects(image)
    assert len(found) == len(LIE)
    areas = sorted(f.view.outer.area - sum(h.area for h in f.view.contours[1:]) for f in found)
    np.testing.assert_allclose(areas, sorted((size * 130.0) ** 2 for _, size, *_ in LIE), rtol=0.02)


@cache
def three_frames() -> list[DemoFrame]:
    return [scene()[i] for i in (0, 30, 60)]


@given(st.floats(0.0, 30.0), st.floats(0.0, 6.28))
def test_contacts_are_measured_from_where_the_first_ones_went(off: float, direction: float) -> None:
    frames = three_frames()
    first = np.array([[280.0, 180.0], [300.0, 255.0]])
    moved = off * np.array([math.cos(direction), math.sin(direction)])
    told = [first, frames[1].true_contacts(first), frames[2].true_contacts(first) + moved]
    results = [TrackResult(i, None, "tracked", "", contacts=contacts, grasp_id=1) for i, contacts in enumerate(told)]
    distances, wrong = contact_errors(results, frames)
    np.testing.assert_allclose(distances, [0.0, 0.0, off, off], rtol=0, atol=1e-9)
    assert wrong == (off > max(3.0, 0.04 * math.sqrt(frames[2].area)))
