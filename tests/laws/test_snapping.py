# SPDX-License-Identifier: Apache-2.0
"""Rough outlines drawn to edges, whether outlines come back, and quadrangles of straight edges."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.segmentation.closed_edges import ClosedEdgeSegmenter, lab_planes
from grasptrack.segmentation.quadrangles import find_quadrangles, join_segments
from grasptrack.segmentation.snapping import OutlineSnapper, SnapNumbers, _smoothest_paths

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


@given(st.floats(0.0, 6.28), st.floats(0.0, 6.0), st.booleans(), st.integers(0, 3))
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


# --- quadrangles ---------------------------------------------------------------------------------


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
