# SPDX-License-Identifier: Apache-2.0
"""Shapes, their prisms and cameras: units, directions, exact motion, bodies of the same area."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from grasptrack.errors import ContourError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.typing import Floats
from grasptrack_bench.physics.part import convex_pieces, extrude_body
from grasptrack_bench.simulation import SHAPES, Path, Pinhole, similarity_path, tilting_path
from grasptrack_bench.simulation.outlines import Shape, circle_polygon, polygon_moments, round_corners


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_have_area_one_and_their_centroid_at_the_origin(name: str) -> None:
    shape = SHAPES[name]()
    moments = np.sum([polygon_moments(p) for p in shape.polygons], axis=0)
    assert moments == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)
    assert polygon_moments(shape.outer)[0] > 0.0
    assert all(polygon_moments(hole)[0] < 0.0 for hole in shape.holes)
    sides = np.hypot(*(np.roll(shape.outer, -1, axis=0) - shape.outer).T)
    assert sides.min() > 1e-6


@pytest.mark.parametrize("name", SHAPES)
def test_outlines_do_not_cross_themselves(name: str) -> None:
    polygon = SHAPES[name]().outer
    a, b = polygon, np.roll(polygon, -1, axis=0)
    side = b - a

    def left_of(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        return (q[:, None, 0] - p[:, None, 0]) * (r[None, :, 1] - p[:, None, 1]) - (q[:, None, 1] - p[:, None, 1]) * (
            r[None, :, 0] - p[:, None, 0]
        )

    apart = left_of(a, b, a) * left_of(a, b, b) < -1e-15
    assert not (apart & apart.T).any()
    turns = np.cross(
        np.column_stack([side, np.zeros(len(side))]), np.roll(np.column_stack([side, np.zeros(len(side))]), -1, 0)
    )
    angles = np.arctan2(turns[:, 2], (side * np.roll(side, -1, axis=0)).sum(axis=1))
    assert angles.sum() == pytest.approx(2.0 * math.pi)


def test_a_circle_has_the_area_of_a_circle() -> None:
    assert polygon_moments(circle_polygon(3.0, -2.0, 0.7, 12))[0] == pytest.approx(math.pi * 0.49)


def test_rounding_takes_the_corners_area_away() -> None:
    square = np.array([(0, 0), (2, 0), (2, 2), (0, 2)], dtype=float)
    assert polygon_moments(round_corners(square, 0.5))[0] == pytest.approx(4.0 - (4.0 - math.pi) * 0.25, abs=1e-3)
    assert (round_corners(square, 0.0) == square).all()


def test_a_shape_without_material_is_refused() -> None:
    with pytest.raises(ValueError, match="no material"):
        Shape.of("ring", circle_polygon(0, 0, 1), [circle_polygon(0, 0, 2)])


def test_a_frontal_camera_sees_the_table_to_scale() -> None:
    still = np.zeros(1)
    H = Path(np.array([[0.5, -0.2]]), np.array([4.0]), still, still, still).table_to_image(Pinhole(640, 480, 800.0))[0]
    assert apply_homography(H, [[0.5, -0.2], [1.5, -0.2]]) == pytest.approx(np.array([[319.5, 239.5], [519.5, 239.5]]))


def test_a_camera_without_tilt_moves_the_image_by_similarities() -> None:
    homographies = similarity_path(20, seed=4).table_to_image(Pinhole())
    for H in homographies:
        a, b = H[:2, 0], H[:2, 1]
        assert H[2] == pytest.approx([0.0, 0.0, 1.0])
        assert a @ b == pytest.approx(0.0, abs=1e-6)
        assert a @ a == pytest.approx(b @ b)


def test_a_tilted_camera_keeps_its_target_and_shortens_one_axis() -> None:
    tilt = math.radians(30.0)
    path = Path(np.array([[0.3, 0.1]]), np.array([5.0]), np.array([0.4]), np.array([tilt]), np.array([1.1]))
    H = path.table_to_image(Pinhole())[0]
    assert apply_homography(H, [[0.3, 0.1]]) == pytest.approx(np.array([[319.5, 239.5]]))
    step = 1e-6
    around = apply_homography(H, np.array([[0.3, 0.1], [0.3 + step, 0.1], [0.3, 0.1 + step]]))
    stretch = np.linalg.svd((around[1:] - around[0]) / step)[1]
    assert stretch[1] / stretch[0] == pytest.approx(math.cos(tilt), abs=1e-4)


def test_paths_are_seeded_smooth_and_within_their_limits() -> None:
    one, same, other = tilting_path(60, seed=1), tilting_path(60, seed=1), tilting_path(60, seed=2)
    assert (one.target == same.target).all()
    assert not (one.target == other.target).all()
    assert one.tilt[0] == 0.0
    assert one.tilt.max() == pytest.approx(math.radians(25.0))
    assert np.abs(np.diff(one.distance)).max() < 0.15


def area(polygons: list[Floats] | tuple[Floats, ...]) -> float:
    return float(sum(polygon_moments(p)[0] for p in polygons))


def least_corner(piece: Floats) -> float:
    """The least turn to the left, as twice a triangle's area."""
    a, b = piece - np.roll(piece, 1, axis=0), np.roll(piece, -1, axis=0) - piece
    return float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).min())


def inside(polygons: list[Floats] | tuple[Floats, ...], points: Floats) -> NDArray[np.bool_]:
    """Whether points lie in a polygon with holes, by the number of sides that a ray meets."""
    crossings = np.zeros(len(points), np.int64)
    for ring in polygons:
        a, b = ring, np.roll(ring, -1, axis=0)
        spans = (a[None, :, 1] > points[:, None, 1]) != (b[None, :, 1] > points[:, None, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            at = a[:, 0] + (points[:, None, 1] - a[:, 1]) * (b - a)[:, 0] / (b - a)[:, 1]
        crossings += (spans & (at > points[:, None, 0])).sum(axis=1)
    return crossings % 2 == 1


@st.composite
def stars(draw: st.DrawFn) -> list[Floats]:
    """A polygon round the origin, of any number of corners at any distances, with a hole or without."""
    count = draw(st.integers(3, 40))
    radii = np.array(draw(st.lists(st.floats(1.0, 4.0), min_size=count, max_size=count)))
    angles = np.arange(count) * (2.0 * math.pi / count)
    outer = radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    if not draw(st.booleans()) or count < 5:
        return [outer]
    hole = 0.3 * np.column_stack([np.cos(-angles), np.sin(-angles)])
    return [outer, hole]


@given(polygons=stars())
def test_the_pieces_are_convex_and_as_large_together_as_the_polygon(polygons: list[Floats]) -> None:
    pieces = convex_pieces(polygons)
    assert area(pieces) == pytest.approx(area(polygons), rel=1e-6)
    assert min(least_corner(p) for p in pieces) > -1e-6


@given(polygons=stars(), seed=st.integers(0, 1000))
def test_a_point_lies_in_one_piece_if_it_lies_in_the_polygon_and_else_in_none(
    polygons: list[Floats], seed: int
) -> None:
    points = np.random.default_rng(seed).uniform(-4.0, 4.0, (200, 2))
    counts = sum(inside([piece], points).astype(int) for piece in convex_pieces(polygons))
    assert (counts == inside(polygons, points)).mean() > 0.995  # those on a side may count either way


@pytest.mark.parametrize("name", sorted(SHAPES))
def test_every_built_in_outline_becomes_a_body_of_its_own_area(name: str) -> None:
    made = extrude_body(SHAPES[name](), 0.06, 0.004, 2000.0)
    assert area(made.pieces) == pytest.approx(0.06**2, rel=0.02)
    assert made.mass == pytest.approx(2000.0 * 0.004 * 0.06**2)


def test_the_moments_of_a_plate_are_those_of_the_text_book() -> None:
    w, h, t, density = 2.0, 0.5, 0.01, 1000.0
    made = extrude_body(SHAPES["rectangle"](), 0.1, t, density)
    ring = made.shape.outer
    w, h = np.ptp(ring, axis=0).tolist()
    if abs(area([ring]) - w * h) > 1e-3 * w * h:
        pytest.skip("the built-in rectangle has round corners")
    m = made.mass
    expected = sorted([m * (h * h + t * t) / 12, m * (w * w + t * t) / 12, m * (w * w + h * h) / 12])
    assert sorted(made.inertia) == pytest.approx(expected, rel=1e-3)


def test_the_points_on_which_a_part_stands_are_corners_of_its_hull() -> None:
    made = extrude_body(SHAPES["bracket"](), 0.06, 0.004, 2000.0)
    hull = cv2.convexHull((made.shape.outer * [1.0, -1.0]).astype(np.float32))[:, 0]
    for foot in made.feet:
        assert np.hypot(*(hull - foot).T).min() < 1e-6


def test_a_polygon_that_crosses_itself_is_an_error() -> None:
    bow = np.array([[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 3.0]])
    with pytest.raises(ContourError, match="crosses itself"):
        convex_pieces([bow])
