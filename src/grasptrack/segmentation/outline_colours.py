# SPDX-License-Identifier: Apache-2.0
"""Colours on both sides of an outline: whether the object goes on beyond it."""

from __future__ import annotations

import numpy as np

from grasptrack.segmentation.closed_edges import Planes
from grasptrack.segmentation.silhouettes import Silhouette
from grasptrack.typing import Floats, Pixels

SIDE_DEPTH = 4.0
"""px of the working image on either side of an outline at which colours are compared."""
SIDE_SAMPLES = 128
"""Points of an outline, some, at which they are."""
MIN_LENGTH = 1e-9


def outward_normals(points: Floats, step: int) -> Floats:
    """(n, 2) unit normals of a closed curve, of the chord from `step` points before each to as many after it."""
    ahead = np.roll(points, -step, axis=0) - np.roll(points, step, axis=0)
    lengths = np.maximum(np.hypot(*ahead.T), MIN_LENGTH)
    return np.asarray(np.column_stack([ahead[:, 1], -ahead[:, 0]]) / lengths[:, None])


def sample_colours(image: Pixels | Planes, points: Floats) -> Floats:
    """(n, C) colours at points (n, 2) px, clamped to the image (H, W, C)."""
    column, row = np.rint(points).astype(np.intp).T
    return np.asarray(image[row.clip(0, image.shape[0] - 1), column.clip(0, image.shape[1] - 1)], dtype=np.float64)


def leaking_share(shape: Silhouette, planes: Planes, px: int) -> float:
    """Share of a region's outline outside which it looks as inside, rather than as outside: there it cuts through the object.

    The planes (h, w, C) are of the image reduced by `px`.
    """
    points = (shape.boundary_points(SIDE_SAMPLES) - 0.5 * (px - 1)) / px
    normals = outward_normals(points, 2)
    inside, outside = (sample_colours(planes, points + side * SIDE_DEPTH * normals) for side in (-1.0, 1.0))
    within, beyond = (np.linalg.norm(outside - np.median(of, axis=0), axis=1) for of in (inside, outside))
    return float((within < beyond).mean())
