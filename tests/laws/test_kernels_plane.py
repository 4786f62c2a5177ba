# SPDX-License-Identifier: Apache-2.0
"""What views tell of their plane: a cost as defined, explanations that make it least, and what is open by its density."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.kernels.results import PlaneViews
from grasptrack.tracking.camera import FEW_AROUND, FEW_RINGS, _slope_nodes
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.typing import Floats
from posed import HEIGHT, SEEDS, WIDTH, A, definition, native, outline, same, target
from reference.registration.camera import pinhole_rows
from reference.registration.plane import plane_cost

NODES = _slope_nodes(math.inf, FEW_RINGS, FEW_AROUND)
FREEDOMS = st.floats(2.5, 50.0) | st.just(math.inf)


def seen_through(rng: np.random.Generator, theta: Floats, aspect: float, turn: float = 0.3) -> Floats:
    """(3, 3) work px to px of a camera that has turned and moved before the plane of theta."""
    f = WIDTH * np.exp(theta[0])
    K = np.array([[f, 0.0, WIDTH / 2], [0.0, aspect * f, HEIGHT / 2], [0.0, 0.0, 1.0]])
    R = cv2.Rodrigues(rng.uniform(-turn, turn, 3))[0]
    G = K @ (R + np.outer(rng.uniform(-0.1, 0.1, 3), [theta[1], theta[2], 1.0])) @ np.linalg.inv(K) @ A
    return np.asarray(G / G[2, 2])


def views_of(
    rng: np.random.Generator, theta: Floats, count: int, freedom: float = 4.0, aspect: float = 1.0, told: float = 1.0
) -> PlaneViews:
    """Of a plane, whose poses are known to some 0.01 work px; `told` is the aspect as it is told."""
    poses = np.array([seen_through(rng, theta, aspect) for _ in range(count)]).reshape(-1, 3, 3)
    spread = rng.normal(0.0, 0.01, (count, 8, 8))
    scale = np.array([[0.16, 0.02, 0.01], [0.02, 0.25, 0.05], [0.01, 0.05, 0.2]])
    hull = outline(60)[0] @ A[:2, :2] + A[:2, 2]
    return PlaneViews(
        poses,
        spread @ spread.transpose(0, 2, 1) + 1e-6 * np.eye(8),
        hull,
        WIDTH,
        HEIGHT,
        told,
        np.zeros(3),
        scale,
        freedom,
    )


@given(SEEDS, st.integers(0, 5), FREEDOMS)
def test_the_cost_is_that_of_its_definition(seed: int, count: int, freedom: float) -> None:
    rng = np.random.default_rng(seed)
    views = views_of(rng, rng.uniform(-0.5, 0.5, 3), count, freedom, told=float(rng.uniform(0.5, 2.0)))
    theta = rng.uniform(-1.5, 1.5, 3)
    wanted = plane_cost(definition(0, 30), views, theta, freedom=NUMBERS.prior_freedom, pinhole_sd=NUMBERS.pinhole_sd)
    found = target(native, 0, 30).plane_cost(views, theta)
    assert found[0] == pytest.approx(wanted[0], rel=1e-6)
    if math.isfinite(wanted[0]):
        same(found[1:], wanted[1:], rtol=1e-5, atol=1e-6 * np.abs(wanted[1]).max())


@given(SEEDS, FREEDOMS)
def test_what_is_known_beforehand_pulls_by_its_own_density(seed: int, freedom: float) -> None:
    """The right side is half the cost's gradient, and of a Gaussian the matrix half its second derivative."""
    rng = np.random.default_rng(seed)
    views, theta, made = views_of(rng, np.zeros(3), 0, freedom), rng.uniform(-0.8, 0.8, 3), target(native, 0, 30)
    cost, A_, b = made.plane_cost(views, theta)
    ahead = np.array([made.plane_cost(views, theta + d)[0] for d in 1e-5 * np.eye(3)])
    behind = np.array([made.plane_cost(views, theta - d)[0] for d in 1e-5 * np.eye(3)])
    assert b == pytest.approx((behind - ahead) / 4e-5, abs=1e-5)
    if math.isinf(freedom):
        assert cost == pytest.approx(theta @ np.linalg.inv(views.scale) @ theta)
        assert pytest.approx(A_) == np.linalg.inv(views.scale)


@given(SEEDS)
def test_a_pinholes_view_of_a_plane_has_no_misfit(seed: int) -> None:
    """Turn and shift a camera before a plane: cosine and ratio of its axes stay, so that only what was thought costs."""
    rng = np.random.default_rng(seed)
    theta, aspect, made = rng.uniform(-0.4, 0.4, 3), float(rng.uniform(0.5, 2.0)), target(native, 0, 30)
    G = seen_through(rng, theta, aspect)
    assert np.abs(pinhole_rows(definition(0, 30), G, theta, WIDTH, HEIGHT, aspect).misfit).max() < 1e-9
    views = views_of(rng, theta, 4, aspect=aspect, told=aspect)
    none = views._replace(poses=views.poses[:0], covariances=views.covariances[:0])
    assert made.plane_cost(views, theta)[0] == pytest.approx(made.plane_cost(none, theta)[0])


@given(SEEDS, st.integers(2, 8))
def test_explanations_make_the_cost_least(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    theta, made = rng.uniform(-0.3, 0.3, 3), target(native, 0, 30)
    views = views_of(rng, theta, count)
    starts = np.array([[0.0, i, j] for i in (-0.4, 0.0, 0.4) for j in (-0.4, 0.0, 0.4)])
    found = made.plane_modes(views, starts)
    assert sum(probability for *_, probability in found) == pytest.approx(1.0)
    costs = [made.plane_cost(views, mode)[0] for mode, *_ in found]
    merged = len(found) == 1  # what lies between two that explain the views nearly as well
    assert min(costs) <= made.plane_cost(views, theta)[0] + (4.1 if merged else 0.1)
    for (mode, covariance, _), cost in zip(found, costs, strict=True):
        values, axes = np.linalg.eigh(covariance)
        around = [mode + way * s * axis for s, axis in zip(np.sqrt(values), axes.T, strict=True) for way in (1.0, -1.0)]
        assert all(made.plane_cost(views, each)[0] > cost - (4.1 if merged else 0.1) for each in around)


@pytest.mark.parametrize("seed", range(6))
def test_what_is_open_has_the_density_of_its_cost(seed: int) -> None:
    """Their mean is that of all thetas on a grid, by their cost, up to a third of a standard deviation."""
    rng = np.random.default_rng(seed)
    theta, made = rng.uniform(-0.2, 0.2, 3), target(native, 0, 30)
    views = views_of(rng, theta, 2)._replace(covariances=np.array([0.01 * np.eye(8)] * 2))
    thetas, weights = made.open_tilts(views, np.zeros((1, 2)), NODES)
    assert weights.sum() == pytest.approx(1.0) and (np.diff(weights) <= 0.0).all()
    logs, side = np.linspace(-0.84, 0.84, 7), np.linspace(-2.5, 2.5, 81)
    grid = np.stack(np.meshgrid(logs, side, side, indexing="ij"), axis=-1).reshape(-1, 3)
    costs = np.array([made.plane_cost(views, each)[0] for each in grid])
    density = np.exp(-0.5 * (costs - costs.min()))
    mean, wanted = weights @ thetas, density @ grid / density.sum()
    spread = np.sqrt(density @ (grid - wanted) ** 2 / density.sum())
    assert (np.abs(mean - wanted) < spread / 3.0).all()


@pytest.mark.parametrize("aspect", [1.0, 0.8, 1.2])
def test_views_tell_how_wide_pixels_are(aspect: float) -> None:
    rng, theta, made = np.random.default_rng(3), np.array([0.1, 0.2, -0.3]), target(native, 0, 30)
    views, found = views_of(rng, theta, 8, aspect=aspect), 1.0
    for _ in range(4):
        views = views._replace(aspect=found)
        found = made.pixel_aspect(views, made.plane_modes(views, theta[None])[0][0])
    assert found == pytest.approx(aspect, rel=0.01)


def test_what_is_refused_of_views() -> None:
    made, views = target(native, 0, 30), views_of(np.random.default_rng(0), np.zeros(3), 2)
    for wrong in ({"aspect": 0.0}, {"covariances": views.covariances[1:]}, {"scale": np.zeros((3, 3))}):
        with pytest.raises(ValueError):
            made.plane_cost(views._replace(**wrong), np.zeros(3))
    behind = made.plane_cost(views, np.array([0.0, 1e3, 0.0]))
    assert math.isinf(behind[0])
