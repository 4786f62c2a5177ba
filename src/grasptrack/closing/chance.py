# SPDX-License-Identifier: Apache-2.0
"""The chance that all contacts lie where the grasp closes, from the covariance of the tracker."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.closing.gaussian import in_box, within
from grasptrack.closing.regions import Regions
from grasptrack.errors import InputError

Floats = NDArray[np.float64]

CHANCE = 0.9
"""A grasp that closes with less than this probability, its contacts being as uncertain as they are, is not stable."""
SURE = 1e-6
"""Where the chances to leave a region add up to no more than this, a joint covariance is not looked at more closely."""


def chance_of_closing(
    regions: Regions, covariance: Floats, homography: Floats | None = None, contacts: Floats | None = None
) -> float:
    """The probability that all contacts lie within their regions, 0 to 1: at most that with which the grasp closes.

    Errors are Gaussian. Only what slips along the outline counts: across it the finger closes until it touches. It is
    carried back to the view of the regions by the derivative of the inverse homography.

    Args:
        regions: in the reference view.
        covariance: px^2 in the current view: (k, 2, 2), the contacts' errors then being independent, or joint
            (2k, 2k), ordered x1 y1 x2 y2.
        homography: (3, 3) H_current_reference; None where both views are one.
        contacts: (k, 2) px in the current view, where they are not the regions' own under the homography.

    Returns:
        NaN where the covariance or the homography is not finite. With a joint covariance, one less the sum of the chances
        to leave a region, which is never too much, where that sum is below SURE or there are more than 3 contacts.

    Raises:
        InputError: a covariance of another shape.
    """
    k = len(regions.contacts)
    if covariance.shape not in ((k, 2, 2), (2 * k, 2 * k)):
        raise InputError(f"a covariance of {k} contacts is ({k}, 2, 2) or ({2 * k}, {2 * k}), not {covariance.shape}")
    found = _slip_rows(regions, homography)
    if found is None:
        return math.nan
    rows, places = found
    low, high = [-b for b in regions.back.tolist()], regions.ahead.tolist()
    if contacts is not None:  # not far from where the homography puts them, so that its derivative will do
        for i, ((u, v), (px, py), (x, y)) in enumerate(zip(rows, places, contacts.tolist(), strict=True)):
            off = u * (x - px) + v * (y - py)
            low[i], high[i] = low[i] - off, high[i] - off
    if covariance.ndim == 2:
        project = np.zeros((k, 2 * k))
        for i, (u, v) in enumerate(rows):
            project[i, 2 * i : 2 * i + 2] = u, v
        slips = project @ covariance @ project.T
        leaving = sum(1.0 - within(a, b, v) for a, b, v in zip(low, high, np.diag(slips).tolist(), strict=True))
        return 1.0 - leaving if leaving <= SURE else in_box(low, high, slips)
    chance = 1.0
    for (u, v), ((xx, xy), (yx, yy)), a, b in zip(rows, covariance.tolist(), low, high, strict=True):
        chance *= within(a, b, u * (u * xx + v * (xy + yx)) + v * v * yy)
    return chance


_Pairs = list[tuple[float, float]]


def _slip_rows(regions: Regions, homography: Floats | None) -> tuple[_Pairs, _Pairs] | None:
    """For each contact the slip along its tangent in the reference by a shift in the current view, and its place there.

    None where the homography is not finite or cannot be inverted.
    """
    rows, places = [], []
    h = None if homography is None else homography.tolist()
    for (x, y), (tx, ty) in zip(regions.contacts.tolist(), regions.tangents.tolist(), strict=True):
        if h is None:
            rows.append((tx, ty))
            places.append((x, y))
            continue
        w = h[2][0] * x + h[2][1] * y + h[2][2]
        px, py = (h[0][0] * x + h[0][1] * y + h[0][2]) / w, (h[1][0] * x + h[1][1] * y + h[1][2]) / w
        a, b = (h[0][0] - h[2][0] * px) / w, (h[0][1] - h[2][1] * px) / w
        c, d = (h[1][0] - h[2][0] * py) / w, (h[1][1] - h[2][1] * py) / w
        determinant = a * d - b * c
        if determinant == 0.0 or not math.isfinite(determinant):
            return None
        rows.append(((tx * d - ty * c) / determinant, (ty * a - tx * b) / determinant))
        places.append((px, py))
    return rows, places
