# SPDX-License-Identifier: Apache-2.0
"""Contacts carried by a homography and moved onto the outline (Fig. 11)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_lines import nearest_crossings
from grasptrack.typing import Floats


def refine_contacts(
    H: Floats, contacts: Floats, normals: Floats | None, points: Floats, offsets: NDArray[np.int64]
) -> tuple[Floats, float, float, float]:
    """Eq. (2) and Fig. 11: each contact goes to the crossing of the outline that is nearest to where H puts it.

    Args:
        H: (3, 3) reference to current.
        contacts: (k, 2) px in the reference.
        normals: (k, 2) unit normals in the reference: each contact moves along its own, carried by H. None for two
            contacts, which move along the line through both.
        points: (N, 2) px of the current outline.
        offsets: (C + 1,).

    Returns:
        (k, 2) px; the largest distance moved, NaN where there was no crossing and infinite where two contacts share
        one; the root of the magnification of areas at the first contact; lambda of eq. (2), least, after the first
        one's sign: above 0 when all contacts lie on one side of the line that H sends to infinity.

    Raises:
        ValueError: without normals, other than two contacts.
    """
    if normals is None and len(contacts) != 2:
        raise ValueError("contacts without normals are two")
    with np.errstate(all="ignore"):
        depth = contacts @ H[2, :2] + H[2, 2]
        carried = (contacts @ H[:2, :2].T + H[:2, 2]) / depth[:, None]
        # d(x', y') / d(x, y), (k, 2, 2)
        local = (H[:2, :2] - carried[:, :, None] * H[2, :2]) / depth[:, None, None]
        (a, b), (c, d) = local[0]
        growth = math.sqrt(abs(float(a * d - b * c)))
        in_front = float((depth * (-1.0 if depth[0] < 0 else 1.0)).min())
        if normals is None:
            (x1, y1), (x2, y2) = carried.tolist()
            opening = np.hypot(x2 - x1, y2 - y1)
            line = x1, y1, (x2 - x1) / opening, (y2 - y1) / opening
            out = np.array(nearest_crossings(points, offsets, *line, 0.0, float(opening))).reshape(2, 2)
            if (out[0] == out[1]).all():
                return out, math.inf, growth, in_front
        else:
            out = np.empty_like(carried)
            for i, ((x, y), (nx, ny)) in enumerate(zip(carried.tolist(), normals.tolist(), strict=True)):
                (a, b), (c, d) = local[i]
                ux, uy = d * nx - c * ny, a * ny - b * nx  # normals go by the inverse transpose, up to scale
                size = np.hypot(ux, uy)
                out[i] = nearest_crossings(points, offsets, x, y, float(ux / size), float(uy / size), 0.0, 0.0)[:2]
        moved = np.hypot(*(out - carried).T)
    return out, float(moved.max()), growth, in_front
