# SPDX-License-Identifier: Apache-2.0
"""Statistics are SciPy's, where SciPy has them."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import stats

from grasptrack.statistics import median_of_few, robust_sd
from grasptrack_bench.metrics.statistics import (
    bootstrap_counts,
    critical_value,
    mcnemar_probability,
    student_quantile,
    upper_bound,
    wilson_interval,
)
from research.paper.runs import median_interval


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40))
def test_the_robust_spread_is_scipys(values: list[float]) -> None:
    off = np.array(values) - np.median(values)
    assert robust_sd(off) == pytest.approx(stats.median_abs_deviation(values, scale="normal"), rel=1e-4, abs=1e-9)


@given(st.lists(st.floats(allow_infinity=False), min_size=1, max_size=40))
def test_the_median_of_few_is_numpys(values: list[float]) -> None:
    with np.errstate(over="ignore"):
        assert median_of_few(np.array(values)) == pytest.approx(float(np.median(values)), rel=0.0, abs=0.0, nan_ok=True)


def test_the_robust_spread_takes_a_median_of_the_callers() -> None:
    assert robust_sd(np.array([-1.0, 2.0, np.nan, 9.0]), np.nanmedian) == pytest.approx(2.0 * 1.4826)


@given(st.integers(0, 500), st.integers(1, 500))
def test_intervals_of_rates_are_wilsons(events: int, trials: int) -> None:
    assume(events <= trials)
    both = stats.binomtest(events, trials).proportion_ci(0.95, "wilson")
    assert wilson_interval(events, trials) == pytest.approx((both.low, both.high), abs=1e-6)
    above = stats.binomtest(events, trials, alternative="less").proportion_ci(0.95, "wilson").high
    if events:
        assert upper_bound(events, trials) == pytest.approx(min(1.0, max(events / trials, above)), abs=1e-4)
    else:
        assert upper_bound(0, trials) == min(1.0, 3.0 / trials) >= 1.0 - 0.05 ** (1.0 / trials)


def test_no_trials_tell_nothing() -> None:
    assert math.isnan(upper_bound(0, 0)) and all(map(math.isnan, wilson_interval(0, 0)))


@given(st.integers(0, 400), st.integers(0, 400))
def test_mcnemars_test_is_exact(many: int, few: int) -> None:
    expected = stats.binomtest(many, many + few, alternative="greater").pvalue if many + few else 1.0
    assert mcnemar_probability(many, few) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("many", "few"), [(520, 481), (700, 600), (1500, 1400)])
def test_mcnemars_test_goes_on_for_large_numbers(many: int, few: int) -> None:
    expected = stats.binomtest(many, many + few, alternative="greater").pvalue
    assert mcnemar_probability(many, few) == pytest.approx(expected, rel=0.05)


@given(st.floats(0.9, 0.9999), st.integers(7, 1000))
def test_quantiles_are_students(probability: float, degrees: int) -> None:
    assert student_quantile(probability, degrees) == pytest.approx(stats.t.ppf(probability, degrees), rel=0.07)
    if degrees >= 30:
        assert student_quantile(probability, degrees) == pytest.approx(stats.t.ppf(probability, degrees), rel=2e-3)


def test_critical_values_are_bonferronis() -> None:
    assert critical_value(1, 10_000) == pytest.approx(1.960, abs=2e-3)
    assert critical_value(100, 31) == pytest.approx(stats.t.ppf(1.0 - 0.0005 / 2.0, 30), rel=2e-3)
    assert critical_value(2, 20) > critical_value(1, 20) > critical_value(1, 21)


def test_draws_with_replacement_take_as_many_as_there_are() -> None:
    taken = bootstrap_counts(20, 4000, 1)
    assert taken.shape == (4000, 20) and (taken.sum(axis=1) == 20.0).all()
    assert taken.mean(axis=0) == pytest.approx(np.ones(20), abs=0.08)
    assert taken.var() == pytest.approx(0.95, rel=0.05)


def test_the_interval_of_a_median_draws_whole_units() -> None:
    rng = np.random.default_rng(1)
    units = np.repeat(np.arange(20), 10)
    values = rng.normal(size=20)[units] + 0.01 * rng.normal(size=200)
    middle, low, high = median_interval(values, units.tolist())
    assert middle == np.median(values) and low < middle < high
    # as wide as that of 20 values, not of 200
    alone = median_interval(values[::10], list(range(20)))
    assert 0.5 < (high - low) / (alone[2] - alone[1]) < 2.0
    independent = median_interval(values, list(range(200)))
    assert high - low > 1.5 * (independent[2] - independent[1])
    assert median_interval(np.array([3.0, 3.0]), ["a", "b"]) == (3.0, 3.0, 3.0)
    assert median_interval(values, units.tolist()) == (middle, low, high)


def test_the_interval_holds_the_true_median_as_often_as_it_says() -> None:
    rng = np.random.default_rng(2)
    held = 0
    for _ in range(200):
        _, low, high = median_interval(rng.normal(size=41), list(range(41)), draws=200)
        held += low <= 0.0 <= high
    assert 0.88 < held / 200 <= 1.0
