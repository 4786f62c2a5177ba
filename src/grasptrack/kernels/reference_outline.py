# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of the step from the chain of pixels round a silhouette to sub-pixel points."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_curve import arc_length, blend_normals, resample
from grasptrack.kernels.reference_edges import edge_search
from grasptrack.kernels.reference_evidence import settle_edges
from grasptrack.typing import Bools, Floats


def trace_edges(
    image: NDArray[np.uint8],
    chain: NDArray[np.int32],
    hidden: NDArray[np.uint8] | None,
    hole: bool,
    polarity: int,
    spacing: float,
    most: int,
    smoothing: float,
    reach: float,
    border: float,
    outlier: float,
) -> tuple[Floats, Floats, Bools, float, float]:
    """Localise the edge along a chain of pixels.

    Args:
        image: (H, W).
        chain: (N, 2) pixel centres just inside the material, either way round.
        hidden: (H, W) nonzero where nothing was looked at, or None.
        hole: the chain runs round a hole.
        polarity: +1 for an object darker than what surrounds it, -1 for a lighter one.
        spacing: px between points, of which there are 16 to `most`.
        smoothing: px of outline over which the chain's stairs are averaged first.
        reach: px on either side in which the edge is searched.
        border: px from the image's border within which a point is cut off.
        outlier: px from the median of its neighbours at which an edge is some other edge.

    Returns:
        (n, 2) points in the direction of an outer contour or a hole, (n,) strength, (n,) whether cut off, and the
        median grey levels inside and outside of the material (NaN where no edge was found).
    """
    rough = chain.astype(np.float64)
    x, y = (rough - rough[0]).T
    area = float(x @ np.roll(y, -1) - np.roll(x, -1) @ y)
    if (area > 0) is hole:
        rough = np.ascontiguousarray(rough[::-1])
    length = float(arc_length(rough)[-1])
    count = int(np.clip(np.rint(length / spacing), 16, most))
    points = resample(rough, count, min(smoothing, length))
    normals = blend_normals(points)
    right, bottom = image.shape[1] - 1.0, image.shape[0] - 1.0
    cut: Bools = np.any((points < border) | (points > (right - border, bottom - border)), axis=1)
    if hidden is not None:
        column, row = np.rint(np.clip(points, 0.0, (right, bottom))).astype(np.intp).T
        cut |= hidden[row, column] != 0
    edges = edge_search(image, points, normals, reach, polarity)
    # where no edge is found the silhouette's own boundary, half a pixel outside the pixels' centres, is the best guess
    settled, strength = settle_edges(points, normals, edges, cut, 0.5, outlier)
    some = slice(None, None, max(1, count // 100))
    levels = edges[some, 2:][strength[some] > 0.0]
    inside, outside = np.median(levels, axis=0).tolist() if len(levels) else (math.nan, math.nan)
    return settled, strength, cut, inside, outside
