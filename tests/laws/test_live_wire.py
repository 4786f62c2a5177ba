# SPDX-License-Identifier: Apache-2.0
"""A live wire runs along edges, ends at its clicks, and forgets what was dragged away."""

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import grasptrack as gt
from grasptrack.errors import InputError
from grasptrack.segmentation.live_wire import SNAP

CORNERS = np.array([[180, 110], [450, 140], [420, 360], [320, 290], [220, 340]])
LEVELS = ((60, 190), (170, 120))


def scene(size: tuple[int, int] = (640, 480), seed: int = 0, levels: tuple[int, int] = LEVELS[0]) -> Any:
    """A polygon on a ground of another grey, with noise; its corners lie at the same shares of each size."""
    grey = np.full(size[::-1], levels[0], np.uint8)
    cv2.fillPoly(grey, [corners_of(size)], (levels[1],), cv2.LINE_AA)
    soft = cv2.GaussianBlur(grey, (0, 0), 0.8)
    return np.clip(soft + np.random.default_rng(seed).normal(0.0, 3.0, grey.shape), 0, 255).astype(np.uint8)


def corners_of(size: tuple[int, int]) -> Any:
    return np.rint(CORNERS * np.array(size) / (640, 480)).astype(np.int32)


@lru_cache(maxsize=2)
def wire_of(seed: int) -> gt.LiveWire:
    return gt.LiveWire(scene(seed=seed))


def clicks(off: float, seed: int, size: tuple[int, int] = (640, 480)) -> Any:
    angle = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(CORNERS))
    return corners_of(size) + off * np.column_stack([np.cos(angle), np.sin(angle)])


def drawn(wire: gt.LiveWire, places: Any) -> Any:
    wire.start(*places[0])
    for x, y in places[1:]:
        wire.add(x, y)
    return wire.close()


def farthest(one: Any, other: Any) -> float:
    """px from points to the closed polygon through others, at most."""
    ring = np.asarray(other, dtype=np.float32)
    return max(abs(cv2.pointPolygonTest(ring, (float(x), float(y)), True)) for x, y in np.asarray(one, float).tolist())


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(off=st.floats(2.0, 4.0), seed=st.integers(0, 10**6))
def test_clicks_beside_the_corners_give_the_outline(off: float, seed: int) -> None:
    outline = drawn(wire_of(0), clicks(off, seed))
    assert farthest(outline, CORNERS) <= 2.0
    assert farthest(CORNERS, outline) <= 2.5  # the pixel grid cuts a corner that is blurred


@pytest.mark.sampled(1)
@pytest.mark.parametrize("size", [(1280, 720), (1920, 1080)])
def test_a_large_image_gives_the_outline_to_two_px_of_the_reduced_one(size: tuple[int, int]) -> None:
    shrink = -(-size[0] // 800)
    outline = drawn(gt.LiveWire(scene(size)), clicks(4.0, 5, size))
    assert farthest(outline, corners_of(size)) <= 2.0 * shrink


@pytest.mark.sampled(1)
@pytest.mark.parametrize("levels", LEVELS)
def test_any_kind_of_image_will_do_and_the_outline_is_taken_by_the_first_look(levels: tuple[int, int]) -> None:
    grey = scene(levels=levels)
    colours = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    clear = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGRA)
    found = [
        drawn(gt.LiveWire(image), clicks(3.0, 7)) for image in (grey, colours, clear, grey.astype(np.uint16) * 257)
    ]
    for outline in found:
        assert farthest(outline, CORNERS) <= 2.0
    ring = CORNERS.astype(np.float32)
    area = cv2.contourArea(ring) + 0.5 * cv2.arcLength(ring, True)  # border pixels are painted whole
    assert gt.first_look(grey, outline=found[0])[0].view.outer.area == pytest.approx(area, rel=0.01)


def test_colour_alone_guides_it() -> None:
    """Both colours have the same grey."""
    image = np.full((480, 640, 3), (90, 120, 150), np.uint8)
    cv2.fillPoly(image, [CORNERS], (150, 127, 106), cv2.LINE_AA)
    assert np.ptp(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)) <= 3
    assert farthest(drawn(gt.LiveWire(cv2.GaussianBlur(image, (0, 0), 0.8)), clicks(3.0, 2)), CORNERS) <= 2.0


inside = st.tuples(st.integers(0, 639), st.integers(0, 479))


@pytest.mark.slow
@given(places=st.lists(inside, min_size=2, max_size=4), snap=st.booleans())
def test_a_path_ends_at_its_clicks_and_makes_no_leap(places: list[tuple[int, int]], snap: bool) -> None:
    wire = wire_of(1) if snap else gt.LiveWire(scene(seed=1), snap=0.0)
    first = wire.start(*places[0])
    assert np.hypot(*np.subtract(first, places[0])) <= SNAP * snap
    for at in places[1:]:
        before = wire.points[-1]
        shown = wire.path_to(*at)
        kept = wire.add(*at)
        assert np.array_equal(shown, kept)
        assert tuple(kept[0]) == before and tuple(kept[-1]) == wire.points[-1]
        assert np.hypot(*np.subtract(wire.points[-1], at)) <= SNAP * snap
        assert np.abs(np.diff(kept, axis=0)).max(initial=0.0) <= 1.0
    assert np.abs(np.diff(wire.path, axis=0)).max(initial=0.0) <= 1.0
    assert tuple(wire.path[0]) == first and tuple(wire.path[-1]) == wire.points[-1]


@pytest.mark.slow
@settings(max_examples=5, deadline=None)
@given(k=st.integers(0, 4), to=inside, seed=st.integers(0, 10**6))
def test_a_click_that_is_dragged_changes_two_pieces_and_back_none(k: int, to: tuple[int, int], seed: int) -> None:
    wire, places = wire_of(0), clicks(3.0, seed)
    outline = drawn(wire, places)
    points = wire.points
    pieces = [piece.copy() for piece in wire._pieces]
    moved = wire.move(k, *to)
    for i, piece in enumerate(wire._pieces):
        if i not in (k, (k - 1) % 5):
            assert np.array_equal(piece, pieces[i])
    ring = np.vstack([moved, moved[:1]])
    assert np.abs(np.diff(ring, axis=0)).max() <= 1.0
    assert np.array_equal(wire.move(k, *points[k]), outline) and wire.points == points  # by its handle
    wire.move(k, *to)
    assert np.array_equal(wire.move(k, *places[k]), outline)  # to where the click was
    assert np.array_equal(drawn(gt.LiveWire(scene()), places), outline)  # whatever was drawn before


def test_an_open_path_can_be_dragged_too() -> None:
    wire, places = wire_of(0), clicks(3.0, 4)
    wire.start(*places[0])
    for x, y in places[1:3]:
        wire.add(x, y)
    path = wire.path
    for k in range(3):
        wire.move(k, 20 + k, 20)
        assert np.array_equal(wire.move(k, *places[k]), path)
    assert not wire.is_closed


def test_what_cannot_be_done_is_told() -> None:
    wire = gt.LiveWire(scene())
    for call, said in (
        (lambda: wire.path_to(3, 3), "begins with start"),
        (lambda: wire.start(640, 3), "outside the image, which is 640x480"),
        (lambda: wire.move(0, 3, 3), "there is no click 0"),
        (lambda: gt.LiveWire(scene(), snap=-1.0), "snap is 0 or more px"),
        (lambda: (wire.start(100, 100), wire.add(200, 200), wire.close()), "at least three clicks, not 2"),
        (lambda: drawn(wire, clicks(3.0, 1)) is not None and wire.add(3, 3), "the outline is closed"),
        (lambda: wire.start(float("nan"), 3), "outside the image"),
    ):
        with pytest.raises(InputError, match=said):
            call()
