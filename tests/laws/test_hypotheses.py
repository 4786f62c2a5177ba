# SPDX-License-Identifier: Apache-2.0
"""What the next image's pose is expected to be off by."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.tracking.hypotheses import add_alike
from grasptrack.tracking.state import FadingRatio
from grasptrack.typing import Floats

SEEDS = st.integers(0, 2**32 - 1)


def covariance(rng: np.random.Generator) -> Floats:
    root = rng.normal(size=(8, 8)) * np.exp(rng.uniform(-2.0, 2.0, 8))
    return root @ root.T


@given(SEEDS, st.floats(1e-3, 1e3))
def test_errors_that_go_the_same_way_add_up(seed: int, factor: float) -> None:
    P = covariance(np.random.default_rng(seed))
    assert add_alike(P, factor**2 * P) == pytest.approx((1.0 + factor) ** 2 * P, rel=1e-6, abs=1e-6 * np.trace(P))


@given(SEEDS)
def test_they_are_never_less_than_independent_ones_nor_more_than_twice_as_much(seed: int) -> None:
    rng = np.random.default_rng(seed)
    P, step = covariance(rng), covariance(rng)
    both, apart = add_alike(P, step), P + step
    least = -1e-9 * np.trace(apart)
    assert np.linalg.eigvalsh(both - apart).min() > least and np.linalg.eigvalsh(2.0 * apart - both).min() > least
    assert both == pytest.approx(add_alike(step, P), rel=1e-6, abs=1e-6 * np.trace(apart))


@given(SEEDS)
def test_they_add_up_alike_in_any_unit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    P, step = covariance(rng), covariance(rng)
    D = np.diag(np.exp(rng.uniform(-1.0, 1.0, 8)))
    seen = D @ add_alike(P, step) @ D
    assert add_alike(D @ P @ D, D @ step @ D) == pytest.approx(seen, rel=1e-5, abs=1e-6 * np.trace(seen))


@given(st.floats(0.0, 50.0), st.floats(0.1, 8.0))
def test_a_motion_is_as_unsure_as_it_proves_to_be(times: float, freedoms: float) -> None:
    misfit = FadingRatio(2.0, 2.0)
    assert misfit.value == 1.0
    for _ in range(200):
        misfit.add(times * freedoms, freedoms)
        assert min(1.0, times) - 1e-9 <= misfit.value <= max(1.0, times) + 1e-9
    late = 2.0 / (2.0 + 10.0 * freedoms)  # what the first view's share is once ten images' worth are kept
    assert misfit.value == pytest.approx(late + (1.0 - late) * times, rel=1e-6, abs=1e-6)
