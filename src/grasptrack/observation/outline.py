# SPDX-License-Identifier: Apache-2.0
"""From the chain of pixels round a silhouette to a sub-pixel contour, each point localised along its normal."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.contour import Bools, Contour
from grasptrack.observation.images import Grey

Floats = NDArray[np.float64]

SPACING = 1.0
"""px between contour points."""
MAX_POINTS = 1600
SMOOTHING = 4.0
"""px of outline over which the chain's stairs are averaged before the edge is searched."""
REACH = 4.0
"""px on either side of the silhouette's boundary in which the edge is searched: thresholds sit that far off at most."""
OUTLIER = 1.0
"""px from the median of its neighbours at which an edge is some other edge."""
BORDER = 1.5
"""px from the image border within which a point is cut off rather than seen."""


class Localised(NamedTuple):
    """A contour with the median grey levels on its material side and on the other."""

    contour: Contour
    inside: float
    outside: float


def localise(grey: Grey, chain: NDArray[np.int32], *, hole: bool, polarity: int, hidden: Grey | None = None) -> Localised:
    """Sub-pixel contour from the chain (N, 2) of a silhouette's boundary pixels.

    Args:
        grey: (H, W) image.
        chain: as cv2.findContours gives it: pixel centres just inside the material.
        hole: the chain runs round a hole.
        polarity: +1 for an object darker than what surrounds it, -1 for a lighter one.
        hidden: (H, W) nonzero where nothing was looked at; points beside it count as cut off.

    Raises:
        ContourError: fewer than 8 points or no area.
    """
    rough = _direct(chain.astype(np.float64), hole)
    count = int(np.clip(round(cv2.arcLength(chain, True) / SPACING), 16, MAX_POINTS))
    points = kernels.resample(rough, count, SMOOTHING)
    normals = kernels.blend_normals(points)
    cut = cut_off(points, grey.shape, hidden)
    edges = kernels.edge_search(grey, points, normals, REACH, polarity)
    # where no edge is found the silhouette's own boundary, half a pixel outside the pixels' centres, is the best guess
    points, strength = kernels.settle_edges(points, normals, edges, cut, 0.5, OUTLIER)
    used = edges[:: max(1, count // 100), 2:][strength[:: max(1, count // 100)] > 0.0]
    inside, outside = np.median(used, axis=0).tolist() if len(used) else (math.nan, math.nan)
    return Localised(Contour(points, hole=hole, strength=strength, clipped=cut), inside, outside)


def cut_off(points: Floats, shape: tuple[int, ...], hidden: Grey | None) -> Bools:
    """(N,) True for points at the image border or beside what is hidden."""
    x, y = points[:, 0], points[:, 1]
    cut: Bools = (x < BORDER) | (y < BORDER) | (x > shape[1] - 1 - BORDER) | (y > shape[0] - 1 - BORDER)
    if hidden is not None:
        column = np.clip(np.rint(x).astype(np.intp), 0, shape[1] - 1)
        row = np.clip(np.rint(y).astype(np.intp), 0, shape[0] - 1)
        cut |= hidden[row, column] != 0
    return cut


def _direct(chain: Floats, hole: bool) -> Floats:
    """The chain with the direction of an outer contour, or of a hole."""
    area = float(cv2.contourArea(chain.astype(np.float32), oriented=True))
    return np.ascontiguousarray(chain[::-1]) if (area > 0) is hole else chain
