# SPDX-License-Identifier: Apache-2.0
"""Robust statistics: the spread of what has outliers, and its middle."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from grasptrack.typing import Floats, Floats32

MAD_TO_SD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


def robust_sd(deviations: Floats | Floats32, median: Callable[[Any], float | np.floating] = np.median) -> float:
    """Standard deviation by the median of the absolute deviations (n,), n > 0, from the middle, which outliers hardly touch.

    `median` is `np.median`, or one that takes the lower or upper of two middle values, or leaves out NaN.
    """
    return MAD_TO_SD * float(median(np.abs(deviations)))


def median_of_few(values: Floats) -> float:
    """What `np.median` gives of (n,) values, n > 0; of a few hundred in a fraction of its time."""
    ordered, middle = np.sort(values), len(values) // 2
    if np.isnan(ordered[-1]):
        return math.nan
    return float(ordered[middle] if len(values) % 2 else (ordered[middle - 1] + ordered[middle]) / 2.0)


def lower_median(values: Floats) -> float:
    """The middle value, of two the lower one; 0 of none."""
    return float(np.sort(values)[(len(values) - 1) // 2]) if len(values) else 0.0
