# SPDX-License-Identifier: Apache-2.0
"""The sides of a thick part that a tilted camera sees, and where they show beside its upper face."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.simulation.coverage import inside_mask
from grasptrack.typing import Floats

Floats32 = NDArray[np.float32]

FINER = 3
"""Sub-pixels along each axis. The sides' own outer edge carries no truth; the upper face's edge is drawn exactly."""
SUN = math.radians(-60.0)
"""Direction in the image from which the light falls that makes the sides differ."""


def side_faces(
    top: Sequence[Floats], foot: Sequence[Floats], width: int, height: int, sigma: float
) -> tuple[Floats32, Floats32] | None:
    """How much of each pixel the visible sides cover, and that share times their brightness; both (height, width).

    They are disjoint from the upper face, so that behind the same blur both shares add up to 1 where the two meet.

    Args:
        top: polygons (N, 2) px of the upper face, outer first.
        foot: those of the lower face, point by point.
        width: px.
        height: px.
        sigma: px, of the blur.

    Returns:
        None where no side is seen. The brightness is 1 on average and differs by the side's direction.
    """
    faces: list[tuple[float, float, Floats]] = []
    for upper, lower in zip(top, foot, strict=True):
        a, b = upper, np.roll(upper, -1, axis=0)
        c, d = np.roll(lower, -1, axis=0), lower
        diagonal, other = c - a, d - b
        seen = diagonal[:, 0] * other[:, 1] - diagonal[:, 1] * other[:, 0]  # twice the area; the near side is negative
        side = b - a
        lit = np.cos(np.arctan2(-side[:, 0], side[:, 1]) - SUN)
        for i in np.flatnonzero(seen < -1e-9):
            down = 0.5 * (c[i] + d[i] - a[i] - b[i])
            depth = float((a[i] + b[i]) @ down / max(1e-12, float(np.hypot(*down))))
            faces.append((depth, float(lit[i]), np.array([a[i], b[i], c[i], d[i]])))
    if not faces:
        return None
    shape = (height * FINER, width * FINER)
    bright = np.zeros(shape, np.uint8)
    for _, lit_by, face in sorted(faces, key=lambda f: f[0]):  # the nearer ones last
        corners = np.rint(((face + 0.5) * FINER - 0.5) * 16.0).astype(np.int32)
        cv2.fillPoly(bright, [corners], round(200.0 * (1.0 + 0.2 * lit_by)), shift=4)
    upper_face = inside_mask([(p + 0.5) * FINER - 0.5 for p in top], shape[1], shape[0])
    bright[upper_face] = 0
    drawn = np.where(bright > 0, np.uint8(255), np.uint8(0))  # no side is black
    return _downsample_field(drawn, width, height, sigma) / np.float32(255.0), _downsample_field(
        bright, width, height, sigma
    ) / np.float32(200.0)


def _downsample_field(field: NDArray[np.uint8], width: int, height: int, sigma: float) -> Floats32:
    small = cv2.resize(field.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)
