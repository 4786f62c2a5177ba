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
from grasptrack.segmentation.closed_edges import ClosedEdgeSegmenter, lab_planes
from grasptrack.segmentation.live_wire import SNAP
from grasptrack.segmentation.quadrangles import find_quadrangles, join_segments
from grasptrack.segmentation.snapping import INSIDE_DEPTH, OutlineSnapper, SnapNumbers, _smoothest_paths

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


@settings(max_examples=15, deadline=None)
@given(places=st.lists(inside, min_size=1, max_size=5), closes=st.booleans())
def test_what_is_taken_back_is_as_if_it_had_not_been(places: list[tuple[int, int]], closes: bool) -> None:
    wire, before = wire_of(0), list[tuple[Any, Any]]()
    wire.start(*places[0])
    for x, y in places[1:]:
        before.append((wire.points, wire.path.tolist()))
        wire.add(x, y)
    if closes and len(places) > 2:
        before.append((wire.points, wire.path.tolist()))
        wire.close()
    while before:
        wire.take_back()
        assert (wire.points, wire.path.tolist()) == before.pop() and not wire.is_closed
    with pytest.raises(InputError, match="nothing to take back"):
        wire.take_back()


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


QUAD = np.array([[200.0, 140.0], [430.0, 170.0], [410.0, 330.0], [180.0, 300.0]])


def photo_of(shape: np.ndarray, times: int = 1, seed: int = 0) -> np.ndarray:
    """A dark shape on a lighter ground, with grain."""
    image = np.full((480 * times, 640 * times, 3), (150, 160, 170), np.float64)
    cv2.fillPoly(image, [np.rint(shape * times).astype(np.int32)], (70.0, 60.0, 90.0), cv2.LINE_AA)
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    return np.clip(image + np.random.default_rng(seed).normal(0.0, 2.0, image.shape), 0, 255).astype(np.uint8)


def snapper_of(image: np.ndarray, numbers: SnapNumbers | None = None) -> OutlineSnapper:
    return OutlineSnapper(ClosedEdgeSegmenter(lab_planes(image)), None, numbers)


def distances_to(shape: np.ndarray, points: np.ndarray) -> np.ndarray:
    chain = shape.astype(np.float32).reshape(-1, 1, 2)
    return np.array([abs(cv2.pointPolygonTest(chain, (float(x), float(y)), True)) for x, y in points])


@given(st.floats(0.0, 6.28), st.floats(0.0, INSIDE_DEPTH), st.booleans(), st.integers(0, 3))  # farther, sides mix
def test_a_moved_outline_comes_back(angle: float, off: float, backwards: bool, first: int) -> None:
    drawn = np.roll(QUAD + off * np.array([np.cos(angle), np.sin(angle)]), first, axis=0)
    moved = snapper_of(photo_of(QUAD)).snap(drawn[::-1] if backwards else drawn)
    away = distances_to(QUAD, moved)
    assert np.median(away) < 0.8 and np.quantile(away, 0.9) < 2.0


def test_in_a_large_image_the_reach_is_larger() -> None:
    moved = snapper_of(photo_of(QUAD, 3)).snap(3.0 * QUAD + 14.0)
    assert np.median(distances_to(3.0 * QUAD, moved)) < 2.5


def test_colours_tell_an_edge_from_a_brighter_line_inside() -> None:
    middle = QUAD.mean(axis=0)
    inner = middle + (QUAD - middle) * (1.0 - 7.0 / 80.0)
    image = photo_of(QUAD)
    cv2.polylines(image, [np.rint(inner).astype(np.int32)], True, (255, 255, 255), 1, cv2.LINE_AA)
    numbers = SnapNumbers(8, 0.5, 40.0, 1.5, 0.05, 6.0, 0.2, 12, 0.0)  # an edge draws by all its strength
    blind, seeing = (
        np.median(distances_to(QUAD, snapper_of(image, numbers._replace(colour=c)).snap(inner))) for c in (0.0, 2.0)
    )
    assert seeing < 1.0 and seeing < 0.5 * blind


def test_where_nothing_is_it_stays() -> None:
    flat = np.full((480, 640, 3), 120, np.uint8)
    snapper = snapper_of(flat)
    assert distances_to(QUAD, snapper.snap(QUAD)).max() < 1.5


@given(st.integers(0, 1000))
def test_an_edge_returns_and_a_line_through_nothing_does_not(seed: int) -> None:
    snapper = snapper_of(photo_of(QUAD, seed=seed))
    around = np.array([[60.0, 40.0], [150.0, 40.0], [150.0, 110.0], [60.0, 110.0]])
    assert snapper.return_share(QUAD) > 0.9
    assert snapper.return_share(around) < 0.75
    assert 0.0 <= snapper.return_share(0.5 * (QUAD + around)) <= 1.0


@given(st.integers(0, 10_000), st.integers(3, 7), st.integers(2, 5), st.floats(0.0, 2.0))
def test_no_straight_path_is_better_than_the_smoothest(seed: int, rows: int, columns: int, bend: float) -> None:
    """It is a piece of the best path twice round: a straight one in its place would be joined at both ends, and what is
    counted here has a seam where that piece has none."""
    gain = np.random.default_rng(seed).normal(size=(2, rows, columns))
    (first, second) = _smoothest_paths(gain, bend)
    for each, path in zip(gain, (first, second), strict=True):
        assert path.shape == (rows,) and ((path >= 0) & (path < columns)).all()
        straight = each.sum(axis=0).max()
        steps = np.abs(np.diff(path)).sum()
        assert each[np.arange(rows), path].sum() - bend * steps >= straight - 3 * bend * (columns - 1) - 1e-9


@given(st.integers(0, 10_000))
def test_a_quadrangle_is_found_behind_fingers(seed: int) -> None:
    """Two of its sides are broken by something of its own grey."""
    rng = np.random.default_rng(seed)
    shape = QUAD + rng.uniform(-25.0, 25.0, QUAD.shape)
    image = photo_of(shape, seed=seed)
    for k in (0, 2):
        middle = 0.5 * (shape[k] + shape[(k + 1) % 4])
        cv2.circle(image, tuple(np.rint(middle).astype(int).tolist()), 22, (70, 60, 90), cv2.FILLED)
    x, y = shape.mean(axis=0).tolist()
    found = find_quadrangles(lab_planes(image), (x, y))
    assert found
    gaps = [max(np.hypot(*(corner - each).T).min() for corner in shape) for each in found]
    assert min(gaps) < 4.0


def test_a_quadrangle_elsewhere_is_not_meant_and_noise_has_none() -> None:
    planes = lab_planes(photo_of(QUAD))
    assert find_quadrangles(planes) and not find_quadrangles(planes, (20.0, 20.0))
    noise = np.random.default_rng(0).normal(120.0, 20.0, (240, 320, 3)).clip(0, 255).astype(np.uint8)
    assert find_quadrangles(lab_planes(noise)) == []


def test_segments_of_one_line_are_joined() -> None:
    along = np.array([0.8, 0.6])
    pieces = [(10.0, 40.0), (60.0, 100.0), (90.0, 130.0)]
    segments = np.array([[*(a * along), *(b * along)] for a, b in pieces] + [[0.0, 90.0, 50.0, 90.0]])
    first, second = join_segments(segments)
    assert np.diff(first.spans, axis=1).ravel() == pytest.approx([30.0, 70.0])
    assert abs(float(first.direction @ along)) == pytest.approx(1.0)
    assert np.diff(second.spans, axis=1).sum() == pytest.approx(50.0)
