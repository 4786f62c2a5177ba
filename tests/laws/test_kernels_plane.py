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
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import Floats
from grasptrack_bench.simulation import DISTURBANCES, SHAPES
from posed import HEIGHT, SEEDS, WIDTH, A, definition, native, outline, same, target
from reference.registration.camera import pinhole_rows
from reference.registration.objective import beyond_noise
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


N = 300
ANGLES = np.linspace(0.0, 2.0 * np.pi, N, endpoint=False)


def jacobian(points: Floats) -> Floats:
    """(N, 2, 8), as `Target.jacobian` about the origin with a radius of 1."""
    (u, v), one, zero = points.T, np.ones(len(points)), np.zeros(len(points))
    x = np.stack([one, zero, u, v, zero, zero, u * u, u * v], axis=1)
    y = np.stack([zero, one, zero, zero, u, v, u * v, v * v], axis=1)
    return np.stack([x, y], axis=1)


def information(points: Floats, normals: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """(9, 9) of edges with these normals, and (8, 8) of motions along them."""
    J = jacobian(points)
    across = np.einsum("ni,nij->nj", normals, J)
    along = np.einsum("ni,nij->nj", np.column_stack([-normals[:, 1], normals[:, 0]]), J)
    own = np.zeros((9, 9))
    own[:8, :8] = (across * weights[:, None]).T @ across
    own[8, 8] = 1.0
    return own, (along * weights[:, None]).T @ along


def left(own: Floats, along: Floats, noise: float) -> Floats:
    telling = beyond_noise(own, along, noise)
    return np.asarray(telling @ own @ telling.T)


def disc(rng: np.random.Generator, noise: float) -> tuple[Floats, Floats, Floats]:
    points = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
    turned = ANGLES + rng.normal(0.0, noise, N)
    normals = np.column_stack([np.cos(turned), np.sin(turned)])
    return points, *information(points, normals, rng.uniform(0.5, 1.5, N))


TURN = np.array([0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0])


def of_turn(E: Floats) -> float:
    """What an information (9, 9) tells of a disc's turn, in rad, whatever else the pose may be."""
    covariance = np.linalg.inv(E[:8, :8] + 1e-9 * np.eye(8))
    return 4.0 / float(TURN @ covariance @ TURN)


@given(SEEDS, st.floats(0.005, 0.05))
def test_of_noise_alone_a_disc_does_not_tell_how_far_it_turned(seed: int, noise: float) -> None:
    _, own, along = disc(np.random.default_rng(seed), noise)
    seemed, is_told = (of_turn(E) for E in (own, left(own, along, (2.0 * noise) ** 2)))
    assert seemed > 0.5 * N * noise**2  # there is something to remove
    assert is_told < 1e-4 * seemed


@given(SEEDS, st.floats(0.005, 0.05))
def test_what_a_shape_tells_remains(seed: int, noise: float) -> None:
    """A gear's normals go to and fro: its turn is told, and so is the place of the disc."""
    rng = np.random.default_rng(seed)
    points, own, along = disc(rng, noise)
    for k in (0, 1):
        assert left(own, along, (2.0 * noise) ** 2)[k, k] > 0.9 * own[k, k]
    tilted = ANGLES + 0.7 * np.sin(12.0 * ANGLES) + rng.normal(0.0, noise, N)
    own, along = information(points, np.column_stack([np.cos(tilted), np.sin(tilted)]), np.ones(N))
    told = TURN @ left(own, along, (2.0 * noise) ** 2)[:8, :8] @ TURN
    assert told > 0.9 * (TURN @ own[:8, :8] @ TURN)


@given(SEEDS, st.floats(0.001, 0.5))
def test_nothing_is_told_that_was_not(seed: int, noise: float) -> None:
    _, own, along = disc(np.random.default_rng(seed), 0.02)
    after = left(own, along, noise**2)
    assert np.allclose(after, after.T) and np.linalg.eigvalsh(after).min() > -1e-9
    # in units in which noise is one, every direction tells less
    L = np.linalg.inv(np.linalg.cholesky(along))
    assert np.linalg.eigvalsh(L @ (own - after)[:8, :8] @ L.T).min() > -1e-9
    assert np.array_equal(beyond_noise(own, along, 0.0), np.eye(9))
    assert np.array_equal(beyond_noise(own, np.zeros((8, 8)), noise**2), np.eye(9))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", [1, 2, 7])
def test_a_half_disc_that_slides_along_itself_is_not_followed_astray(seed: int) -> None:
    """A homography carries circle and chord onto themselves: in noise each image seemed to say that nothing had slid."""
    scene = DISTURBANCES["noise"].scene(SHAPES["half-disc"](), 25, seed)
    first, tracker = None, GraspTracker()
    for frame in scene:
        result = tracker.update(frame.image, time=frame.time)
        if result.contacts is None:
            continue
        first = result.contacts if first is None else first
        off = np.hypot(*(result.contacts - frame.carry(first)).T).max()
        assert off < max(3.0, 0.04 * np.sqrt(frame.area))
