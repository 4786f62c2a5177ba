# SPDX-License-Identifier: Apache-2.0
"""From the pixel chain around a silhouette to a sub-pixel contour, each point localised along its normal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.geometry.contours import Contour
from grasptrack.images import Grey
from grasptrack.kernels.results import TraceOptions
from grasptrack.typing import Floats

SPACING = 1.0
"""px between contour points."""
MAX_POINTS = 1600
SMOOTHING = 4.0
"""px of outline over which the steps of the chain are averaged before the edge search."""
REACH = 4.0
"""px on either side of the silhouette's boundary in which the edge is searched; thresholds are off by at most this."""
OUTLIER = 1.0
"""px; an edge farther from the median of its neighbours is a different edge."""
BORDER = 1.5
"""px; a point nearer to the image border counts as cut off."""
BESIDE = 3.0
"""px; the same for ignored pixels, before which a silhouette ends a little early."""


class Localised(NamedTuple):
    """A contour with the median grey levels on its inner and outer side."""

    contour: Contour
    inside: float
    outside: float


def localize_contour(
    grey: Grey,
    chain: NDArray[np.int32],
    *,
    hole: bool,
    polarity: int,
    hidden: Grey | None = None,
    reach: float = REACH,
) -> Localised:
    """Sub-pixel contour from the chain (N, 2) of a silhouette's boundary pixels.

    Args:
        grey: (H, W) image.
        chain: as cv2.findContours returns it: pixel centres just inside the material.
        hole: the chain runs around a hole.
        polarity: +1 for an object darker than its surroundings, -1 for a lighter one, 0 for either.
        hidden: (H, W) nonzero where pixels are ignored; points beside them count as cut off.
        reach: px on either side of the chain in which the edge is searched.

    Raises:
        ContourError: fewer than 8 points or no area.
    """
    how = TraceOptions(hole, polarity, SPACING, MAX_POINTS, SMOOTHING, reach, BORDER, OUTLIER)
    points, strength, cut, inside, outside = kernels.trace_edges(grey, chain, hidden, how)
    if hidden is not None:
        cut = cut | _is_near_hidden(points, hidden)
    return Localised(Contour.trusted(points, hole=hole, strength=strength, clipped=cut), inside, outside)


def _is_near_hidden(points: Floats, hidden: Grey) -> NDArray[np.bool_]:
    """(N,) whether a pixel within BESIDE px along the axes is ignored. A silhouette ends just before such pixels."""
    height, width = hidden.shape
    found = np.zeros(len(points), dtype=np.bool_)
    for dx, dy in ((BESIDE, 0.0), (-BESIDE, 0.0), (0.0, BESIDE), (0.0, -BESIDE)):
        x = np.rint(np.clip(points[:, 0] + dx, 0, width - 1)).astype(np.intp)
        y = np.rint(np.clip(points[:, 1] + dy, 0, height - 1)).astype(np.intp)
        found |= hidden[y, x] != 0
    return found
