# SPDX-License-Identifier: Apache-2.0
"""Convex pieces of a polygon: convex, inside it, as large together as it is, and never over each other."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from grasptrack.errors import ContourError
from grasptrack.typing import Floats
from grasptrack_bench.physics.part import convex_pieces, extrude_body
from grasptrack_bench.simulation import SHAPES
from grasptrack_bench.simulation.outlines import polygon_moments


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
