# SPDX-License-Identifier: Apache-2.0
"""Benches with a grain, reflections, shadows and light of their own, with or without a plate on them."""

from collections.abc import Sequence

import cv2
import numpy as np

PLATE = np.array([[200, 150], [450, 170], [440, 240], [310, 250], [290, 340], [190, 320]])


def grained(seed: int, level: float = 120.0, depth: float = 25.0, size: tuple[int, int] = (480, 640)) -> np.ndarray:
    """(H, W, 3) float32, a bench with grain of several sizes."""
    rng = np.random.default_rng(seed)
    grain = np.zeros(size, np.float32)
    for blur in (1.0, 3.0, 9.0):
        each = cv2.GaussianBlur(rng.standard_normal(size).astype(np.float32), (0, 0), blur)
        grain += each / each.std()
    return (level + depth * grain / 3.0)[..., None] * np.array([0.85, 1.0, 1.1], np.float32)


def lit(
    bench: np.ndarray,
    light: Sequence[float] = (1.0, 0.0, 0.0),
    tint: Sequence[float] = (1.0, 1.0, 1.0),
    offset: float = 0.0,
) -> np.ndarray:
    """A bench (H, W, 3) under a light of gain light[0] + light[1] x + light[2] y, x and y from 0 to 1 over the image."""
    h, w = bench.shape[:2]
    y, x = np.mgrid[0:h, 0:w].astype(np.float32)
    return bench * (light[0] + light[1] * x / w + light[2] * y / h)[..., None] * np.asarray(tint, np.float32) + offset


def laid(bench: np.ndarray, polygon: np.ndarray, colour: Sequence[float]) -> np.ndarray:
    """A bench with a plate of one colour on it."""
    cover = np.zeros(bench.shape[:2], np.float32)
    cv2.fillPoly(cover, [np.rint(16.0 * np.asarray(polygon)).astype(np.int32)], (1.0,), cv2.LINE_AA, 4)
    cover = cv2.GaussianBlur(cover, (0, 0), 0.7)[..., None]
    return bench * (1.0 - cover) + cover * np.asarray(colour, np.float32)


def glare(bench: np.ndarray, x: float, y: float, strength: float = 200.0, wide: float = 20.0) -> np.ndarray:
    """A bench with the reflection of a lamp."""
    rows, columns = np.mgrid[0 : bench.shape[0], 0 : bench.shape[1]].astype(np.float32)
    return bench + strength * np.exp(-(((columns - x) / wide) ** 2) - ((rows - y) / (2.0 * wide)) ** 2)[..., None]


def photographed(scene: np.ndarray, seed: int, moved: np.ndarray | None = None, noise: float = 1.5) -> np.ndarray:
    """(H, W, 3) uint8 of a camera with noise, which has moved by the affine or projective map `moved` of px."""
    h, w = scene.shape[:2]
    if moved is not None:
        H = np.vstack([moved, [0.0, 0.0, 1.0]]) if moved.shape == (2, 3) else moved
        scene = cv2.warpPerspective(scene, H, (w, h), borderMode=cv2.BORDER_REFLECT)
    rough = scene + noise * np.random.default_rng(seed).standard_normal(scene.shape)
    return np.clip(np.rint(rough), 0, 255).astype(np.uint8)


def overlap(points: np.ndarray, truth: np.ndarray, size: tuple[int, int] = (480, 640)) -> float:
    """Intersection over union of two polygons (n, 2) px."""
    one, two = (np.zeros(size, np.uint8) for _ in range(2))
    for mask, polygon in ((one, points), (two, truth)):
        cv2.fillPoly(mask, [np.rint(polygon).astype(np.int32)], (1,))
    return float((one & two).sum() / (one | two).sum())
