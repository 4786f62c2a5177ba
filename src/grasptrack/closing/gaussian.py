# SPDX-License-Identifier: Apache-2.0
"""How much of a Gaussian lies between bounds."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)
_FAR = 7.0
"""Standard deviations beyond which nothing is left."""


def within(low: float, high: float, variance: float) -> float:
    """The chance of a Gaussian of mean 0 to lie between two bounds."""
    if not math.isfinite(variance):
        return math.nan
    if variance <= 0.0:
        return 1.0 if low <= 0.0 <= high and low < high else 0.0
    scale = 1.0 / math.sqrt(2.0 * variance)
    return 0.5 * (math.erf(high * scale) - math.erf(low * scale))


def in_box(low: list[float], high: list[float], covariance: Floats) -> float:
    """The chance of a Gaussian vector of mean 0 to lie in a box."""
    if not np.isfinite(covariance).all():
        return math.nan
    if len(low) > 3:
        out = sum(1.0 - within(a, b, float(v)) for a, b, v in zip(low, high, np.diag(covariance), strict=True))
        return max(0.0, 1.0 - out)
    values, vectors = np.linalg.eigh(covariance)
    # Any square root serves; the lower triangular one lets the bounds of one follow from those before it.
    L = np.asarray(np.linalg.qr((vectors * np.sqrt(np.maximum(values, 0.0))).T)[1]).T
    found = float(_nested(np.array(low), np.array(high), L * np.where(np.diag(L) < 0.0, -1.0, 1.0)))
    return min(1.0, max(0.0, found))


def _nested(low: Floats, high: Floats, L: Floats) -> float:
    """The chance that low <= L z <= high for z of independent standard Gaussians, L lower triangular, one by one."""
    if len(low) == 1:
        return within(float(low[0]), float(high[0]), float(L[0, 0]) ** 2)
    if L[0, 0] <= 1e-12 * float(np.abs(L).max()):
        return _nested(low[1:], high[1:], L[1:, 1:]) if low[0] <= 0.0 <= high[0] and low[0] < high[0] else 0.0
    first, last = max(-_FAR, low[0] / L[0, 0]), min(_FAR, high[0] / L[0, 0])
    if not first < last:
        return 0.0
    with np.errstate(all="ignore"):
        corners = np.concatenate([low[1:] / L[1:, 0], high[1:] / L[1:, 0]])  # where the rest may change at once
    cuts = [first, *sorted(float(c) for c in corners if first < c < last), last]
    total = 0.0
    for a, b in itertools.pairwise(cuts):
        z = 0.5 * (a + b) + 0.5 * (b - a) * _NODES
        density = np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
        inner = [_nested(low[1:] - L[1:, 0] * t, high[1:] - L[1:, 0] * t, L[1:, 1:]) for t in z]
        total += 0.5 * (b - a) * float((_WEIGHTS * density) @ inner)
    return total
