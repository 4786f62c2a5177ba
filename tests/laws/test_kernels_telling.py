# SPDX-License-Identifier: Apache-2.0
"""What edges tell of the pose beyond noise in their normals: `beyond_noise`, and a half disc that slides along itself."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import Floats
from grasptrack_bench.simulation import DISTURBANCES, SHAPES
from posed import SEEDS
from reference.registration.objective import beyond_noise

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
