# SPDX-License-Identifier: Apache-2.0
"""Edges of a colour image: how steep it is, in units of what its own grain makes of a slope."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.observation.images import Grey

Planes = NDArray[np.float32]
"""(H, W, C): lightness, and for colour images the two chromas, in units of CIE Lab."""

CHROMA = 1.4
"""Weight of the chromas against lightness: shadow and glare change lightness, another material both."""
LEAST_GRAIN = 0.8
"""Lab units per px that count as grain in an image without any."""
FINE = 100.0
"""Steps of a slope of 1 for OpenCV's edge thinning, which wants whole numbers."""


def planes(image: NDArray[np.uint8]) -> Planes:
    """Lightness and chromas of a grey (H, W) or BGR (H, W, 3) image."""
    if image.ndim == 2:
        return (image.astype(np.float32) * np.float32(100.0 / 255.0))[:, :, None]
    lab = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2Lab), dtype=np.float32)
    return np.asarray(lab * np.array([100.0 / 255.0, CHROMA, CHROMA], np.float32))


class EdgeField:
    """Slopes of an image, each that of the plane in which it is steepest there.

    Args:
        image: planes.
        softening: px, sigma of the Gaussian before slopes are taken: more sees through grain, less follows fine parts.
        hidden: (H, W) nonzero where nothing belongs to the scene, or None.

    Attributes:
        strength: (H, W) float32, slope in units of the image's grain, which is the median slope, LEAST_GRAIN allowed for.
    """

    def __init__(self, image: Planes, softening: float, hidden: Grey | None = None) -> None:
        soft = cv2.GaussianBlur(image, (0, 0), softening)
        across, along, steep = _slopes(soft if soft.ndim == 2 else np.ascontiguousarray(soft[:, :, 0]))
        for k in range(1, image.shape[2]):
            ax, ay, other = _slopes(np.ascontiguousarray(soft[:, :, k]))
            steeper: Any = cv2.compare(other, steep, cv2.CMP_GT)
            cv2.copyTo(ax, steeper, across)
            cv2.copyTo(ay, steeper, along)
            cv2.copyTo(other, steeper, steep)
        if hidden is not None:
            for each in (across, along, steep):
                each[hidden != 0] = 0.0
        some = steep[::2, ::2]
        grain = float(np.median(some if hidden is None else some[hidden[::2, ::2] == 0]))
        self.unit = math.hypot(0.0 if math.isnan(grain) else grain, LEAST_GRAIN)
        self.strength: NDArray[np.float32] = np.asarray(steep / np.float32(self.unit), dtype=np.float32)
        self._dx, self._dy = (np.asarray(np.rint(d * np.float32(FINE)), dtype=np.int16) for d in (across, along))

    def thin(self, level: float) -> Grey:
        """(H, W) 255 along edges of at least `level` units that somewhere reach twice as much, one pixel wide."""
        low = level * self.unit * FINE
        return np.asarray(cv2.Canny(self._dx, self._dy, low, 2.0 * low, L2gradient=True), dtype=np.uint8)


def _slopes(plane: NDArray[Any]) -> tuple[Any, Any, Any]:
    """Slopes across and along in units per px, and their size."""
    dx = cv2.Scharr(plane, cv2.CV_32F, 1, 0, scale=1.0 / 32.0)
    dy = cv2.Scharr(plane, cv2.CV_32F, 0, 1, scale=1.0 / 32.0)
    return dx, dy, cv2.magnitude(dx, dy)
