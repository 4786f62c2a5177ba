# SPDX-License-Identifier: Apache-2.0
"""A part from a photo with a mask: its outline, and its own surface, which moves along with it."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.bench.simulation.outlines import Shape, area_and_centroid
from grasptrack.bench.simulation.silhouette import mask_polygons
from grasptrack.bench.simulation.texture import Texture
from grasptrack.errors import InputError
from grasptrack.typing import Pixels

RIM = 2.5
"""px within the mask where the photo may show its background already: mixed pixels and a mask that is not exact."""
AROUND = 24
"""px that the surface goes on beyond the mask."""


def part_of_photo(image: Pixels, mask: ArrayLike, name: str = "photo") -> tuple[Shape, Texture]:
    """The part that a mask shows in a photo, and its surface in the part's own units.

    The colours a little inside the mask are carried outward over its rim and beyond, so that nothing of the photo's
    background shows at the part's edge.

    Args:
        image: (H, W) grey or (H, W, 3) BGR, 8 bit.
        mask: (H, W), not 0 where the part is; see `silhouette`.
        name: of the shape.

    Raises:
        InputError: image and mask of different sizes, or an image that is not 8 bit.
        ContourError: a mask without a part.
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
    texture = Texture(surface, 0.5 * float(size[0]) / unit, (float(middle[0]), float(middle[1])))
    return Shape.of(name, rings[0], rings[1:]), texture


def carried_outward(image: Pixels, mask: NDArray[np.bool_]) -> Pixels:
    """The image with what is outside the mask, and its rim, replaced by the nearest colours well inside it."""
    depth = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    ridge = (depth > 0.0) & (
        depth >= cv2.dilate(depth, np.ones((3, 3), np.uint8)) - 1e-3
    )  # thin parts keep their middle
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
