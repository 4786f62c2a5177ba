# SPDX-License-Identifier: Apache-2.0
"""The chance that all contacts lie where the grasp closes, from the covariance of the tracker."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.closing.gaussian import in_box, within
from grasptrack.closing.regions import Regions
from grasptrack.errors import InputError
from grasptrack.projective import jacobian

Floats = NDArray[np.float64]


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
        NaN where the covariance or the homography is not finite. With a joint covariance of more than 3 contacts, one
        less the sum of the chances to leave a region, which is never too much.

    Raises:
        InputError: a covariance of another shape.
    """
    k = len(regions.contacts)
    if covariance.shape not in ((k, 2, 2), (2 * k, 2 * k)):
        raise InputError(f"a covariance of {k} contacts is ({k}, 2, 2) or ({2 * k}, {2 * k}), not {covariance.shape}")
    rows = _slip_rows(regions, homography)
    if rows is None:
        return math.nan
    low, high = [-b for b in regions.back.tolist()], regions.ahead.tolist()
    if contacts is not None:
        for i, off in enumerate(_offsets(regions, homography, contacts)):
            low[i], high[i] = low[i] - off, high[i] - off
    if covariance.ndim == 2:
        project = np.zeros((k, 2 * k))
        for i, (u, v) in enumerate(rows):
            project[i, 2 * i : 2 * i + 2] = u, v
        return in_box(low, high, project @ covariance @ project.T)
    chance = 1.0
    for (u, v), ((xx, xy), (yx, yy)), a, b in zip(rows, covariance.tolist(), low, high, strict=True):
        chance *= within(a, b, u * (u * xx + v * (xy + yx)) + v * v * yy)
    return chance


def _slip_rows(regions: Regions, homography: Floats | None) -> list[tuple[float, float]] | None:
    """For each contact the slip along its tangent in the reference by a shift in the current view; None: not finite."""
    rows = []
    for (x, y), (tx, ty) in zip(regions.contacts.tolist(), regions.tangents.tolist(), strict=True):
        if homography is None:
            rows.append((tx, ty))
            continue
        a, b, c, d = jacobian(homography, x, y)
        determinant = a * d - b * c
        if determinant == 0.0 or not math.isfinite(determinant):
            return None
        rows.append(((tx * d - ty * c) / determinant, (ty * a - tx * b) / determinant))
    return rows


def _offsets(regions: Regions, homography: Floats | None, contacts: Floats) -> list[float]:
    """px by which contacts of the current view lie along the tangents from those of the regions."""
    back = contacts
    if homography is not None:
        p = np.column_stack([contacts, np.ones(len(contacts))]) @ np.linalg.inv(homography).T
        back = p[:, :2] / p[:, 2:]
    return [float(v) for v in ((back - regions.contacts) * regions.tangents).sum(axis=1)]
