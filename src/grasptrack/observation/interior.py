# SPDX-License-Identifier: Apache-2.0
"""Places well inside an object: what they show tells whether it is still there, gone, or covered."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.contour import Bools, View
from grasptrack.observation.images import Grey

Floats = NDArray[np.float64]

PLACES = 100
"""About so many places."""
DEPTH = 4.0
"""px that they lie from the outline at least, where the object is thick enough."""


class Interior:
    """The material of a reference view.

    Args:
        view: its outline.
        grey: (H, W) the image of it.

    Attributes:
        places: (m, 2) px, pixels well inside the material.
        levels: (m,) grey levels there.
    """

    def __init__(self, view: View, grey: Grey) -> None:
        self._outer = view.outer.points.astype(np.float32)
        low = np.floor(view.outer.points.min(axis=0)) - 2.0
        width, height = (np.ceil(view.outer.points.max(axis=0)) + 3.0 - low).astype(int).tolist()
        mask = np.zeros((height, width), np.uint8)
        cv2.fillPoly(mask, [np.rint(c.points - low).astype(np.int32) for c in view.contours], (255,))
        depth = cv2.distanceTransform(mask, cv2.DIST_L2, 3)
        rows, columns = np.nonzero(depth >= min(DEPTH, 0.5 * float(depth.max())))
        step = max(1, len(rows) // PLACES)
        self.places: Floats = np.column_stack([columns[::step], rows[::step]]).astype(np.float64) + low
        column, row = np.rint(self.places).astype(np.intp).T
        seen = grey[row.clip(0, grey.shape[0] - 1), column.clip(0, grey.shape[1] - 1)]
        self.levels: Floats = seen.astype(np.float64)

    def covers(self, points: Floats) -> Bools:
        """(n,) which points (n, 2) px lie within the outer contour."""
        return np.array([cv2.pointPolygonTest(self._outer, (x, y), False) >= 0 for x, y in points.tolist()], np.bool_)
