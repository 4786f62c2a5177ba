# SPDX-License-Identifier: Apache-2.0
"""Eq. (3): curvature compared between two outlines (Section IV-C.1)."""

from __future__ import annotations

import numpy as np

from grasptrack.typing import Floats


def match_curvature(
    v1: Floats,
    arc1: Floats,
    indices: list[int],
    v2: Floats,
    arc2: Floats,
    centres: list[float],
    kappa: float,
    reach: float,
    radius: int,
    step: float,
    tolerance: float,
) -> tuple[list[int], list[float]]:
    """Eq. (3): the sample j of the second contour whose neighbourhood is most like that of sample i of the first.

    Args:
        v1, v2: (N,), (N',) scale-free curvature vectors.
        arc1, arc2: (N + 1,), (N' + 1,) arc length, px.
        indices: samples i of the first contour.
        centres: px: the arc length in the second contour about which each search is centred.
        kappa: the second contour's length over the first's.
        reach: xi in px of the first contour: the search runs over centre +- kappa xi.
        radius: n: neighbourhoods have 2 n + 1 values.
        step: px of the first contour between two of them (kappa step in the second).
        tolerance: largest matching error of a match, as a share of |v1| at the sample or of a circle's 2 pi, whichever
            is more.

    Returns:
        Of each i the sample j, or -1 where none is a match, and the least matching error divided by 2 n + 1, infinite
        where no sample was comparable.
    """
    closed1, closed2 = np.append(v1, v1[0]), np.append(v2, v2[0])
    length1, length2 = arc1[-1], arc2[-1]
    k = np.arange(-radius, radius + 1)
    samples, errors = [], []
    for i, centre in zip(indices, centres, strict=True):
        wanted = np.interp(np.mod(arc1[i] + k * step, length1), arc1, closed1)
        gap = np.mod(arc2[:-1] - centre + 0.5 * length2, length2) - 0.5 * length2
        window = np.flatnonzero(np.abs(gap) <= kappa * reach)
        found = np.interp(np.mod(arc2[window][:, None] + kappa * step * k, length2), arc2, closed2)
        error = np.abs(wanted - found).mean(axis=1)
        error[np.isnan(error)] = np.inf
        best = int(np.argmin(error)) if len(window) else -1
        least = float(error[best]) if best >= 0 else np.inf
        good = np.isfinite(least) and least <= tolerance * max(abs(v1[i]), 2.0 * np.pi)
        samples.append(int(window[best]) if good else -1)
        errors.append(least)
    return samples, errors
