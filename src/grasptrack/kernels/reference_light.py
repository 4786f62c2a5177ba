# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of grey levels compared under another light: read between pixels, weighed, and what is left of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_evidence import carry_normals, lower_median

Floats = NDArray[np.float64]

TUKEY = 4.685
"""A residual of so many times the noise and more counts nothing (Tukey's biweight)."""
QUIET, QUIET_SIGMA = 1 / 3, 0.430727
"""The noise is read off the smallest third of the residuals, so that two thirds may be of something else."""
FEWEST = 24
"""Places of a surface in the image, below which it says nothing."""
WEIGHINGS = 4
"""Rounds in which a surface's light and noise are found."""
EDGE = 2.0
"""Pixels from the border within which there are no differences."""
DISTINCT = 5.0
"""Grey levels between a lighter and a darker half from which on they tell a gain."""


def grey_differences(
    coarse: NDArray[np.uint8], shrink: float, H: Floats, places: Floats, values: Floats, least_noise: float
) -> tuple[Floats, float]:
    """By how much an image differs from a reference at some places, light allowed for.

    Light may differ by a gain and by levels that change linearly over the image. What covers the places must not bend it:
    the gain is first read off the medians of the lighter and of the darker half.

    Args:
        coarse, shrink, H: as for `motion_equations`.
        places, values: (p, 2) px and (p,) grey levels of the reference, NaN where they are not known.
        least_noise: grey levels.

    Returns:
        (p,) grey levels, NaN where nothing can be compared, and their noise; all NaN with fewer than FEWEST places.

    Raises:
        ValueError: values of another number.
    """
    if len(values) != len(places):
        raise ValueError("each place needs its value")
    out = np.full(len(places), np.nan)
    at = carry_normals(H, places, np.ones_like(places))[:, :2]
    v = (at + 0.5) / shrink - 0.5
    height, width = coarse.shape
    with np.errstate(invalid="ignore"):
        told = np.isfinite(values) & (v >= EDGE).all(axis=1)
        told &= (v[:, 0] < width - 1 - EDGE) & (v[:, 1] < height - 1 - EDGE)
    if np.count_nonzero(told) < FEWEST:
        return out, math.nan
    seen, wanted, place = bilinear(coarse, v[told]), values[told], at[told]
    middle = lower_median(wanted)
    low, high = wanted <= middle, wanted >= middle
    before = lower_median(wanted[high]) - lower_median(wanted[low])
    gain = (lower_median(seen[high]) - lower_median(seen[low])) / before if before > DISTINCT else 1.0
    rest = seen - gain * wanted
    rest = rest - lower_median(rest)
    centre = place.mean(axis=0)
    spread = math.sqrt(float(np.mean(np.square(place - centre)))) + 1e-9
    R = np.column_stack([wanted - wanted.mean(), np.ones(len(seen)), (place - centre) / spread])
    noise = least_noise
    for _ in range(WEIGHINGS):
        noise = max(quiet(np.abs(rest)), least_noise)
        weight = tukey(rest / noise)
        Q = R.T @ (weight[:, None] * R)
        if not independent(Q):
            break  # of one grey level: there is no gain to find
        rest = seen - R @ np.linalg.solve(Q, R.T @ (weight * seen))
    out[told] = rest
    return out, noise


def independent(Q: Floats) -> bool:
    """Whether normal equations (n, n) have one solution."""
    size = np.sqrt(np.diag(Q))
    return bool((size > 0.0).all() and np.linalg.det(Q / np.outer(size, size)) > 1e-9)


def bilinear(image: NDArray[np.uint8], at: Floats) -> Floats:
    """(n,) grey levels between the pixels, at (n, 2) px of which the last column and row are excluded."""
    low = np.floor(at).astype(np.intp)
    x, y = (at - low).T
    column, row = low.T
    a, b = image[row, column].astype(np.float64), image[row, column + 1].astype(np.float64)
    c, d = image[row + 1, column].astype(np.float64), image[row + 1, column + 1].astype(np.float64)
    return np.asarray((a + x * (b - a)) * (1.0 - y) + (c + x * (d - c)) * y)


def quiet(size: Floats) -> float:
    """The standard deviation that the smallest third of some residuals' sizes shows."""
    return float(np.sort(size)[(len(size) - 1) // 3]) / QUIET_SIGMA


def tukey(u: Floats) -> Floats:
    """Weights of residuals in units of their noise."""
    u = u / TUKEY
    return np.where(np.abs(u) < 1.0, (1.0 - u * u) ** 2, 0.0)
