# SPDX-License-Identifier: Apache-2.0
"""A part from its mask, or from a photo with a mask."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.errors import ContourError, InputError
from grasptrack.typing import Floats, Pixels
from grasptrack_bench.simulation.outlines import Shape, area_and_centroid, polygon_moments, trace_isolines
from grasptrack_bench.simulation.textures import TextureMap

SOFT = 1.4
"""px, of the blur that turns the stairs of a mask into a slope; corners are rounded by about as much."""
STRAIGHT = 0.03
"""px; points that lie this near to the line between others are left out."""
SMALLEST_HOLE = 12.0
"""px^2; smaller holes are specks."""


def shape_from_mask(mask: ArrayLike, name: str = "silhouette") -> Shape:
    """The part that a silhouette shows, its outline smooth and sub-pixel, its holes kept.

    The mask (H, W) or (H, W, 1) is not 0 there. Of several pieces the largest is taken; one that touches the border ends there.
    """
    outer, *holes = mask_polygons(mask, name)
    return Shape.of(name, outer, holes)


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
    inside = [hole for hole in holes if cv2.pointPolygonTest(_as_cv_contour(rings[outer]), hole[0].tolist(), False) > 0]
    return [_simplify_ring(ring) for ring in (rings[outer], *inside)]


def _as_cv_contour(ring: Floats) -> NDArray[np.float32]:
    return np.asarray(ring[:, None, :], dtype=np.float32)


def _simplify_ring(ring: Floats) -> Floats:
    kept = cv2.approxPolyDP(_as_cv_contour(ring), STRAIGHT, closed=True)
    return np.asarray(kept[:, 0, :], dtype=np.float64)


RIM = 2.5
"""px within the mask where the photo may show its background already: mixed pixels and a mask that is not exact."""
AROUND = 24
"""px that the surface goes on beyond the mask."""


def part_of_photo(image: Pixels, mask: ArrayLike, name: str = "photo") -> tuple[Shape, TextureMap]:
    """The part that a mask (H, W) shows in a photo, and its surface in the part's own units.

    The colours a little inside the mask are carried outward over its rim and beyond, so that nothing of the photo's
    background shows at the part's edge.
    """
    picture, shown = np.asarray(image), np.asarray(mask)
    if picture.dtype != np.uint8 or picture.ndim not in (2, 3) or picture.shape[:2] != shown.shape[:2]:
        raise InputError(
            f"a part needs an 8-bit photo and a mask of the same size, not {picture.dtype} {picture.shape} "
            f"and {shown.shape}",
            image=picture.shape,
            mask=shown.shape,
        )
    rings = mask_polygons(shown, name)
    area, centre = area_and_centroid(rings)
    unit = math.sqrt(area)
    low = np.maximum(np.floor(rings[0].min(axis=0)).astype(int) - AROUND, 0)
    high = np.minimum(np.ceil(rings[0].max(axis=0)).astype(int) + AROUND + 1, [shown.shape[1], shown.shape[0]])
    window = (slice(low[1], high[1]), slice(low[0], high[0]))
    plane = shown[..., 0] if shown.ndim == 3 else shown
    surface = carried_outward(picture[window], plane[window] != 0)
    size = high - low
    middle = (low + 0.5 * (size - 1) - centre) / unit
    texture = TextureMap(surface, 0.5 * float(size[0]) / unit, (float(middle[0]), float(middle[1])))
    return Shape.of(name, rings[0], rings[1:]), texture


def carried_outward(image: Pixels, mask: NDArray[np.bool_]) -> Pixels:
    """The image with what is outside the mask, and its rim, replaced by the nearest colours well inside it."""
    depth = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    # thin parts keep their middle
    ridge = (depth > 0.0) & (depth >= cv2.dilate(depth, np.ones((3, 3), np.uint8)) - 1e-3)
    sure = (depth > RIM) | ridge
    _, labels = cv2.distanceTransformWithLabels(
        (~sure).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    source = np.zeros(int(labels.max()) + 1, np.int64)
    source[labels[sure]] = np.flatnonzero(sure)
    flat = image.reshape(mask.size, *image.shape[2:])
    filled = flat[source[labels.ravel()]].reshape(image.shape)
    soft = cv2.GaussianBlur(filled, (0, 0), 1.5, borderType=cv2.BORDER_REPLICATE)
    keep = sure if image.ndim == 2 else sure[..., None]
    return np.asarray(np.where(keep, image, soft), dtype=np.uint8)
