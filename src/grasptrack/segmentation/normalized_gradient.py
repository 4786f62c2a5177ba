# SPDX-License-Identifier: Apache-2.0
"""Gradients of a colour image, in units of its own gradient noise."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.images import Grey

Planes = NDArray[np.float32]
"""(H, W, C): lightness, and for colour images the two chroma planes, in units of CIE Lab."""

LIGHTNESS = 100.0 / 255.0
"""Lab units of a step of OpenCV's lightness."""
CHROMA = 1.4
"""Weight of chroma against lightness: shadow and glare change lightness alone, another material both."""
LEAST_GRAIN = 0.8
"""Lab units per px that count as noise in an image without any."""
FINE = 100.0
"""Integer steps per unit of gradient: OpenCV's Canny takes whole numbers."""


def lab_planes(image: NDArray[np.uint8]) -> Planes:
    """Lightness and chroma of a grey (H, W) or BGR (H, W, 3) image."""
    if image.ndim == 2:
        return cv2.LUT(image, _lightness_table()).astype(np.float32)[:, :, None] * np.float32(LIGHTNESS)
    lab = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2Lab))
    return np.multiply(lab, np.array([LIGHTNESS, CHROMA, CHROMA], np.float32), dtype=np.float32)


@lru_cache(maxsize=1)
def _lightness_table() -> NDArray[np.uint8]:
    """(256,) OpenCV's lightness of each grey level."""
    greys = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)
    return np.ascontiguousarray(cv2.cvtColor(greys, cv2.COLOR_BGR2Lab)[0, :, 0], dtype=np.uint8)


class NormalizedGradient:
    """Gradients of an image, at each pixel that of its steepest plane.

    Args:
        image: planes.
        softening: px, sigma of the Gaussian blur: more suppresses noise, less follows fine parts.
        hidden: (H, W) nonzero where pixels are ignored, or None.
        unit: the image's gradient noise if known, Lab units per px; otherwise it is measured.

    Attributes:
        unit: Lab units per px, the median gradient combined with LEAST_GRAIN.
    """

    def __init__(self, image: Planes, softening: float, hidden: Grey | None = None, unit: float | None = None) -> None:
        soft = cv2.GaussianBlur(image, (0, 0), softening)
        across, along, steep = _scharr_gradients(soft if soft.ndim == 2 else np.ascontiguousarray(soft[:, :, 0]))
        for k in range(1, image.shape[2]):
            ax, ay, other = _scharr_gradients(np.ascontiguousarray(soft[:, :, k]))
            steeper: Any = cv2.compare(other, steep, cv2.CMP_GT)
            cv2.copyTo(ax, steeper, across)
            cv2.copyTo(ay, steeper, along)
            cv2.copyTo(other, steeper, steep)
        if hidden is not None:
            for each in (across, along, steep):
                each[hidden != 0] = 0.0
        if unit is None:
            some = steep[::2, ::2] if hidden is None else steep[::2, ::2][hidden[::2, ::2] == 0]
            unit = math.hypot(float(np.median(some)) / FINE if some.size else 0.0, LEAST_GRAIN)
        self.unit = unit
        self._steep = np.asarray(steep, dtype=np.float32)
        self._dx, self._dy = np.asarray(across).astype(np.int16), np.asarray(along).astype(np.int16)

    @property
    def strength(self) -> NDArray[np.float32]:
        """(H, W) gradient magnitude in units of the image's noise."""
        return np.asarray(self._steep * np.float32(1.0 / (FINE * self.unit)), dtype=np.float32)

    @property
    def slopes(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(H, W) gradients along x and y in units of the image's noise."""
        unit = np.float32(1.0 / (FINE * self.unit))
        return self._dx * unit, self._dy * unit

    @property
    def direction(self) -> NDArray[np.float32]:
        """(H, W, 2) unit vectors of the gradients, zero where there is none."""
        both = np.stack([self._dx, self._dy], axis=-1).astype(np.float32)
        return np.asarray(both / np.maximum(np.linalg.norm(both, axis=-1, keepdims=True), 1.0), dtype=np.float32)

    def thin(self, level: float) -> Grey:
        """(H, W) 255 along edges of at least `level` units that reach twice as much somewhere, one pixel wide."""
        low = level * self.unit * FINE
        return np.asarray(cv2.Canny(self._dx, self._dy, low, 2.0 * low, L2gradient=True), dtype=np.uint8)


def _scharr_gradients(plane: NDArray[Any]) -> tuple[Any, Any, Any]:
    """Gradients along x and y and their magnitude, in FINE steps per unit."""
    dx = cv2.Scharr(plane, cv2.CV_32F, 1, 0, scale=FINE / 32.0)
    dy = cv2.Scharr(plane, cv2.CV_32F, 0, 1, scale=FINE / 32.0)
    return dx, dy, cv2.magnitude(dx, dy)
