# SPDX-License-Identifier: Apache-2.0
"""Closed cubic B-splines and the shape spaces on their samples."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.errors import ConditioningError, ContourError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.snake.bspline import ClosedSpline, basis_matrix, fit_spline
from grasptrack.snake.shape_space import DOF, ShapeSpace

numbers = st.floats(-1.0, 1.0)


def ring(seed: int, spans: int) -> ClosedSpline:
    rng = np.random.default_rng(seed)
    t = np.arange(spans) * (2 * math.pi / spans)
    return ClosedSpline(np.column_stack([np.cos(t), np.sin(t)]) * rng.uniform(60, 90, (spans, 1)) + 200)


@given(st.integers(4, 40), st.lists(st.floats(-100, 100), min_size=1, max_size=20))
def test_basis_is_a_partition_of_one(spans: int, parameters: list[float]) -> None:
    assert np.allclose(basis_matrix(parameters, spans).sum(axis=1), 1.0)
    assert np.allclose(basis_matrix(parameters, spans, 1).sum(axis=1), 0.0)


def test_derivative_against_finite_differences() -> None:
    spline = ring(0, 9)
    t = np.linspace(0, 9, 50, endpoint=False) + 0.013
    h = 1e-6
    before, after, slope = (
        basis_matrix(t + step, 9, order) @ spline.control for step, order in ((-h, 0), (h, 0), (0, 1))
    )
    assert np.allclose((after - before) / (2 * h), slope, atol=1e-5)


def test_normals_point_out_of_an_outer_contour() -> None:
    spline = ring(1, 12)
    outward = spline.sample() - spline.sample().mean(axis=0)
    assert (np.einsum("ij,ij->i", spline.normals(), outward) > 0).all()
    assert np.allclose(np.hypot(*spline.normals().T), 1.0)


def test_samples_are_points_of_the_curve() -> None:
    spline = ring(2, 10)
    assert np.allclose(spline.sample(6), basis_matrix(np.arange(60) / 6, 10) @ spline.control)


def test_a_circle_is_fitted_closely_and_more_spans_fit_closer() -> None:
    t = np.arange(400) * (2 * math.pi / 400)
    circle = 100 * np.column_stack([np.cos(t), np.sin(t)])
    gaps = [fit_spline(circle, spans)[1] for spans in (8, 16, 32)]
    assert gaps[0] > gaps[1] > gaps[2] and gaps[1] < 0.01


@given(st.floats(-3, 3), st.floats(0.1, 5), numbers, numbers)
def test_fit_commutes_with_similarities(angle: float, scale: float, x: float, y: float) -> None:
    points = ring(3, 20).sample()
    c, s = scale * math.cos(angle), scale * math.sin(angle)
    turn = np.array(((c, s), (-s, c)))
    before, _ = fit_spline(points, 14)
    after, _ = fit_spline(points @ turn + (x, y), 14)
    assert np.allclose(before.control @ turn + (x, y), after.control, atol=1e-6 * scale)


def test_too_few_spans_are_refused() -> None:
    with pytest.raises(ContourError, match="at least 4 spans, not 3"):
        basis_matrix([0.0], 3)
    with pytest.raises(ContourError):
        fit_spline(ring(0, 8).sample(), 3)
    with pytest.raises(ContourError):
        ClosedSpline(np.zeros((3, 2)))


@given(st.lists(st.floats(-20, 20), min_size=DOF, max_size=DOF))
def test_state_and_homography_are_one_to_one(values: list[float]) -> None:
    space, state = ShapeSpace(ring(4, 12).sample()), np.array(values)
    H = space.homography(state)
    assert np.allclose(space.state_near(H), state, atol=1e-8)
    assert np.allclose(apply_homography(H, space.points), space.curve_points(state), atol=1e-8)
    moved = space.W @ state + space.points.T.ravel()  # Q = W X + Q0
    assert np.allclose(space.curve_points(state).T.ravel(), moved, atol=1e-8)


def test_jacobian_and_norm() -> None:
    space = ShapeSpace(ring(5, 12).sample())
    state = np.linspace(-3, 4, DOF)
    change = space.curve_points(state) - space.points
    assert np.allclose(space.point_jacobian(space.points) @ state, change)
    metric = space.metric_matrix()
    assert state @ metric @ state == pytest.approx((change**2).sum(axis=1).mean())
    assert metric[0, 0] == pytest.approx(1.0)


def test_nearest_state_to_a_perspective_view_is_least_squares() -> None:
    space = ShapeSpace(ring(6, 12).sample())
    H = np.array(((1.02, 0.03, 4.0), (-0.02, 0.97, -3.0), (1e-4, -5e-5, 1.0)))
    target = apply_homography(H, space.points)
    state = space.state_near(H)
    best = ((space.curve_points(state) - target) ** 2).sum()
    for i in range(DOF):
        for step in (-0.1, 0.1):
            assert ((space.curve_points(state + step * np.eye(DOF)[i]) - target) ** 2).sum() > best


def test_refusals() -> None:
    points = ring(7, 12).sample()
    with pytest.raises(ContourError):
        ShapeSpace(points[:2])
    with pytest.raises(ContourError):
        ShapeSpace(np.ones((9, 2)))
    with pytest.raises(ConditioningError):
        ShapeSpace(points).state_near(np.full((3, 3), np.nan))
    with pytest.raises(ConditioningError):
        ShapeSpace(points).state_near([[1, 0, 0], [0, 1, 0], [1, 0, -200]])
