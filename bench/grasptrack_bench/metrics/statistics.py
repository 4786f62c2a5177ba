# SPDX-License-Identifier: Apache-2.0
"""Intervals of rates, and tests of paired runs."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np

from grasptrack.typing import Floats

RULE_OF_THREE = 3.0
"""No event in n trials puts its rate below 3/n with 95 % confidence."""
ONE_SIDED_95, TWO_SIDED_95 = 1.6449, 1.959964
"""Quantiles of the normal distribution."""
EXACT_UP_TO = 1000
"""Tosses up to which the probability is summed; beyond, the normal distribution serves."""
LEVEL = 0.05
"""Of tests: the probability that noise passes for a difference."""


def wilson_interval(events: int, trials: int, z: float = TWO_SIDED_95) -> tuple[float, float]:
    """Lower and upper bound of a rate (E. B. Wilson 1927) of events of independent trials; NaN without trials.

    z is a quantile of the normal distribution: `TWO_SIDED_95` for an interval, `ONE_SIDED_95` for one bound.
    """
    if trials <= 0:
        return math.nan, math.nan
    p, n = events / trials, trials
    middle, half = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return (middle - half) / (1 + z * z / n), (middle + half) / (1 + z * z / n)


def upper_bound(events: int, trials: int) -> float:
    """Upper 95 % bound of a rate: 3/n for no event in n (rule of three), else Wilson's, one-sided; NaN without trials."""
    if trials <= 0:
        return math.nan
    if events == 0:
        return min(1.0, RULE_OF_THREE / trials)
    return min(1.0, max(events / trials, wilson_interval(events, trials, ONE_SIDED_95)[1]))


def mcnemar_probability(many: int, few: int) -> float:
    """Probability of `many` heads or more in many + few tosses of a fair coin: McNemar's exact test, one-sided."""
    n = many + few
    if n <= EXACT_UP_TO:
        return math.fsum(math.comb(n, k) for k in range(many, n + 1)) / 2.0**n
    return 1.0 - NormalDist(0.5 * n, 0.5 * math.sqrt(n)).cdf(many - 0.5)


def student_quantile(probability: float, degrees: int) -> float:
    """Quantile of Student's distribution by its expansion in 1 / degrees of freedom."""
    z, n = NormalDist().inv_cdf(probability), max(1, degrees)
    return z + (z**3 + z) / (4.0 * n) + (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / (96.0 * n * n)


def critical_value(comparisons: int, units: int) -> float:
    """Standard errors beyond which one of so many differences is no noise, at `LEVEL` for all together (Bonferroni)."""
    return student_quantile(1.0 - LEVEL / (2.0 * max(1, comparisons)), units - 1)


def bootstrap_counts(units: int, draws: int, seed: int) -> Floats:
    """(draws, units) how often each unit is taken as so many are drawn with replacement."""
    return np.random.default_rng(seed).multinomial(units, np.full(units, 1.0 / max(1, units)), draws).astype(np.float64)
