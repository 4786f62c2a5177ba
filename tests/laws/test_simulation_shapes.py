# SPDX-License-Identifier: Apache-2.0
"""Shapes and cameras: units, directions, exact motion."""

import math

import numpy as np
import pytest

from grasptrack.geometry.homographies import apply_homography
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
