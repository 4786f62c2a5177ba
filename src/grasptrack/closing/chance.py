# SPDX-License-Identifier: Apache-2.0
"""Whether a grasp closes where its contacts are, and the chance that it does although they may be off."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.analysis import Analyzer, GraspAnalysis
from grasptrack.closing.regions import Regions, regions_of
from grasptrack.contour import View
from grasptrack.errors import InputError
from grasptrack.grasp import Grasp
from grasptrack.projective import HORIZON, behind

Floats = NDArray[np.float64]

CHANCE = 0.9
"""A grasp that closes with less than this probability, its contacts being as uncertain as they are, is not stable."""
SURE = 1e-6
"""Where the chances to leave a region add up to no more than this, a joint covariance is not looked at more closely."""


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)
_FAR = 7.0
"""Standard deviations beyond which nothing is left."""


class ClosureCheck:
    """Judges a grasp in the view of its choice, image after image: perspective bends friction cones.

    Args:
        grasp, view: contacts and outline in the view of its choice.
        friction: Coulomb coefficient.
        width: px, of a finger's pad in that view.
    """

    def __init__(self, grasp: Grasp, view: View, friction: float, width: float) -> None:
        # once for a grasp: for three fingers it takes some tens of ms
        self._regions = regions_of(grasp, view, friction, width)
        self._analyzer = Analyzer(view, width, "reference")

    def judge(
        self, contacts: Floats, friction: float, carried: Floats, homography: Floats, covariance: Floats
    ) -> tuple[GraspAnalysis, float]:
        """Analysis of contacts in a current view, and the chance that they close.

        Args:
            contacts: (k, 2) px in the current view.
            friction: Coulomb coefficient.
            carried: (3, 3) H_current_reference by which they were carried there.
            homography: (3, 3) H_current_reference as the tracker knows it.
            covariance: (k, 2, 2) px^2 of the contacts.

        Raises:
            GraspError: a contact is not on the outline.
            ConditioningError: the view is of no plane that lies in front of the camera.
        """
        inverse = np.ascontiguousarray(np.linalg.inv(carried), dtype=np.float64)
        back, in_front = kernels.carry_points(inverse, np.ascontiguousarray(contacts))
        if not in_front > HORIZON:
            raise behind(carried)
        analysis = self._analyzer.analyze(back, friction)
        return analysis, chance_of_closing(self._regions, covariance, homography, contacts)


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


# --- how much of a Gaussian lies between bounds ----------------------------------------------


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
