# SPDX-License-Identifier: Apache-2.0
"""A part from its silhouette: a binary image, a mask, or one that was drawn."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.bench.simulation.isolines import trace_isolines
from grasptrack.bench.simulation.outlines import Shape, polygon_moments
from grasptrack.errors import ContourError
from grasptrack.typing import Floats

SOFT = 1.4
"""px, of the blur that turns the stairs of a mask into a slope; corners are rounded by about as much."""
STRAIGHT = 0.03
"""px; points that lie this near to the line between others are left out."""
SMALLEST_HOLE = 12.0
"""px^2; smaller holes are specks."""


def shape_from_mask(mask: ArrayLike, name: str = "silhouette") -> Shape:
    """The part that a silhouette shows, its outline smooth and sub-pixel, its holes kept.

    Args:
        mask: (H, W) or (H, W, 1), not 0 where the part is. Of several pieces the largest is taken. One that touches the
            border ends there.
        name: of the shape.

    Raises:
        ContourError: no image, nothing in it, or too little to be a part.
    """
    return Shape.of(name, *_outer_and_holes(mask_polygons(mask, name)))


def mask_polygons(mask: ArrayLike, name: str = "silhouette") -> list[Floats]:
    """The polygons of `shape_from_mask` in px of the mask, outer first, not brought to any unit; same errors."""
    given = np.asarray(mask)
    if given.ndim == 3 and given.shape[2] == 1:
        given = given[..., 0]
    if given.ndim != 2:
        raise ContourError(f"{name}: a silhouette is one plane (H, W), not {given.shape}", shape=given.shape)
    count, labels, stats, _ = cv2.connectedComponentsWithStats((given != 0).astype(np.uint8), connectivity=8)
    if count < 2:
        raise ContourError(f"{name}: the silhouette is empty")
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    x, y, width, height, area = (int(v) for v in stats[largest, :5])
    if area < 64:
        raise ContourError(f"{name}: the silhouette has {area} px, too few for a part; 64 are the least", area=area)
    alone = (labels[y : y + height, x : x + width] == largest).astype(np.float32)
    pad = 6
    blurred = cv2.GaussianBlur(np.pad(alone, pad), (0, 0), SOFT, borderType=cv2.BORDER_CONSTANT)
    soft = np.asarray(blurred, dtype=np.float32)
    rings = [ring + np.array([x - pad, y - pad]) for ring in trace_isolines(soft, 0.5)]
    areas = np.array([polygon_moments(ring)[0] for ring in rings])
    if not len(rings) or areas.max() < 32.0:
        raise ContourError(f"{name}: the silhouette is too thin for a part", area=area)
    outer = int(np.argmax(areas))
    holes = [ring for ring, a in zip(rings, areas, strict=True) if a < -SMALLEST_HOLE]
    inside = [
        hole for hole in holes if cv2.pointPolygonTest(_as_cv_contour(rings[outer]), _first_point(hole), False) > 0
    ]
    return [_simplify_ring(ring) for ring in (rings[outer], *inside)]


def _outer_and_holes(rings: Sequence[Floats]) -> tuple[Floats, list[Floats]]:
    return rings[0], list(rings[1:])


def _first_point(ring: Floats) -> tuple[float, float]:
    return float(ring[0, 0]), float(ring[0, 1])


def _as_cv_contour(ring: Floats) -> NDArray[np.float32]:
    return np.asarray(ring[:, None, :], dtype=np.float32)


def _simplify_ring(ring: Floats) -> Floats:
    kept = cv2.approxPolyDP(_as_cv_contour(ring), STRAIGHT, closed=True)
    return np.asarray(kept[:, 0, :], dtype=np.float64)
