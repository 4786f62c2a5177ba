# SPDX-License-Identifier: Apache-2.0
"""Simple drawn objects, for inspections: polygons and discs of a given contrast, blur and noise."""

import cv2
import numpy as np

L_PLATE = np.array([[-70, -45], [70, -45], [70, 5], [-20, 5], [-20, 45], [-70, 45]], dtype=np.float64)
SQUARE = 50.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)


def ellipse(a: float, b: float) -> np.ndarray:
    t = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False)
    return np.column_stack([a * np.cos(t), b * np.sin(t)])


def drawn(
    *shapes: np.ndarray,
    centres: tuple[tuple[float, float], ...] = ((160.0, 120.0),),
    angle: float = 0.3,
    contrast: float = 100.0,
    noise: float = 1.5,
    blur: float = 0.8,
    size: tuple[int, int] = (240, 320),
    seed: int = 0,
) -> np.ndarray:
    """(H, W) dark shapes, one at each centre, on a light ground."""
    image = np.full(size, 180, np.uint8)
    c, s = np.cos(angle), np.sin(angle)
    for shape, centre in zip(shapes, centres, strict=True):
        corners = shape @ np.array([[c, s], [-s, c]]) + centre
        cv2.fillPoly(image, [np.rint(16.0 * corners).astype(np.int32)], round(180 - contrast), cv2.LINE_AA, 4)
    soft = cv2.GaussianBlur(image.astype(np.float32), (0, 0), blur)
    rough = soft + noise * np.random.default_rng(seed).standard_normal(size)
    return np.clip(np.rint(rough), 0, 255).astype(np.uint8)
