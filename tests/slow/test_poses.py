# SPDX-License-Identifier: Apache-2.0
"""A thousand questions to the pose estimator, each answered where its objective in NumPy is least."""

import numpy as np

from posed import what_is_left


def test_a_thousand_answers_make_their_objective_least() -> None:
    left = [what_is_left(seed) for seed in range(1000)]
    px, deviations, narrow = np.array(left).T
    assert np.mean([one.agrees for one in left]) > 0.88
    assert np.median(px) < 0.015 and np.quantile(px, 0.95) < 0.5
    assert np.quantile(deviations, 0.98) < 3.5
    assert 0.9 < np.median(narrow) < 1.05 and np.quantile(narrow, 0.01) > 0.4
