# SPDX-License-Identifier: Apache-2.0
"""Closed curves along which a field on pixels has one value."""

from __future__ import annotations

import contourpy
import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats


def trace_isolines(field: NDArray[np.float32] | Floats, level: float) -> list[Floats]:
    """All closed curves (N, 2) px at `level`, by marching squares.

    Args:
        field: (H, W), below `level` all along its border, so that every curve closes.
        level: between two values of the field.

    Returns:
        Outer curves have positive signed area, x right and y down; curves around lower values have negative. The lowest
        curve comes first, and each ends in its lowest cell: where a curve begins decides which points a simplification keeps.
    """
    found = []
    tracer = contourpy.contour_generator(z=np.asarray(field, dtype=np.float64), line_type=contourpy.LineType.Separate)
    for closed in tracer.lines(level):
        ring = np.asarray(closed, dtype=np.float64)[:-1]
        column, row = np.floor(0.5 * (ring + np.roll(ring, -1, axis=0))).T
        lowest = int(np.lexsort((column, row))[-1])
        found.append((row[lowest], column[lowest], np.roll(ring, -(lowest + 2), axis=0)))
    return [ring for _, _, ring in sorted(found, key=lambda each: each[:2], reverse=True)]
