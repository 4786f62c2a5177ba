# SPDX-License-Identifier: Apache-2.0
"""Grey levels that may separate objects from the background."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats


def candidate_thresholds(values: NDArray[np.uint8]) -> list[float]:
    """Otsu's threshold of all grey levels, and of those on either side of it, where these differ."""
    # OpenCV needs a contiguous channel, and is ten times as fast as bincount
    grey = np.ascontiguousarray(values)
    histogram = cv2.calcHist([grey], [0], None, [256], [0.0, 256.0]).ravel().astype(np.float64)
    middle = otsu_threshold(histogram)
    if middle is None:
        return []
    levels = [middle]
    below, above = histogram.copy(), histogram.copy()
    below[int(middle) + 1 :] = 0.0
    above[: int(middle) + 1] = 0.0
    for part in (below, above):
        level = otsu_threshold(part)
        if level is not None and all(abs(level - other) >= 6.0 for other in levels):
            levels.append(level)
    return levels


def otsu_threshold(histogram: Floats) -> float | None:
    """The level k + 0.5 that best separates a histogram (256,) into up to k and above; None for a single level."""
    total = histogram.sum()
    below = np.cumsum(histogram)[:-1]
    above = total - below
    usable = (below > 0) & (above > 0)
    if not usable.any():
        return None
    moment = np.cumsum(histogram * np.arange(256))
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = below * above * (moment[:-1] / below - (moment[-1] - moment[:-1]) / above) ** 2
    spread[~usable] = -1.0
    top = np.flatnonzero(spread >= spread.max() * (1 - 1e-12))
    return float(0.5 * (top[0] + top[-1]) + 0.5)
