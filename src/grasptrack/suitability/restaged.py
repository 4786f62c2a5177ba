# SPDX-License-Identifier: Apache-2.0
"""An image as it would look after a small motion of the camera, with fresh noise."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.observation.images import Channel, Grey

Floats = NDArray[np.float64]

TURN, TILT, GROWTH, SHIFT = 12.0, 12.0, 0.04, 0.1
"""Degrees, degrees, share, and share of the size by which a course ends."""
DISTANCE = 6.0
"""Sizes of the object from which the camera looks."""
_PATCHES = 5, 15
"""px, of the patches that are compared, and of the window in which they are."""


def restaged(image: NDArray[np.uint8], H: Floats, noise: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """An image under a homography, with noise added; what comes into view mirrors what was there.

    Args:
        image: (H, W) or BGR (H, W, 3).
        H: (3, 3) from the image to the new one.
        noise: grey levels, standard deviation that is added to each pixel.
        rng: draws it.
    """
    size = (image.shape[1], image.shape[0])
    moved = cv2.warpPerspective(image, H, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
    spoilt = np.asarray(moved, np.float32) + noise * rng.standard_normal(moved.shape, np.float32)
    return np.asarray(np.clip(np.rint(spoilt), 0.0, 255.0), dtype=np.uint8)


def denoised(image: NDArray[np.uint8], noise: float) -> NDArray[np.uint8]:
    """An image without its noise (non-local means), for what comes after it must not share it.

    Whatever is no stronger than the noise is smoothed away as well.

    Args:
        image: (H, W) or BGR (H, W, 3).
        noise: grey levels, standard deviation of a pixel.
    """
    if image.ndim == 2:
        return np.asarray(cv2.fastNlMeansDenoising(image, None, noise, *_PATCHES), dtype=np.uint8)
    return np.asarray(cv2.fastNlMeansDenoisingColored(image, None, noise, noise, *_PATCHES), dtype=np.uint8)


class Stage:
    """A first view that can be moved: freed of its noise, which would come along and pass for a surface of the scene.

    Args:
        image: (H, W) or BGR (H, W, 3).
        channel: the mixture of colours that shows the object.
        noise: grey levels, standard deviation of a pixel.
    """

    def __init__(self, image: NDArray[np.uint8], channel: Channel, noise: float) -> None:
        self._source, self._channel, self._noise = denoised(image, noise), channel, noise
        self._rng = np.random.default_rng(0)
        self.middle: Floats = 0.5 * np.array([image.shape[1] - 1.0, image.shape[0] - 1.0])

    def moved(self, H: Floats) -> NDArray[np.uint8]:
        """(H, W) or BGR (H, W, 3) the view under a homography (3, 3), with fresh noise."""
        return restaged(self._source, H, self._noise, self._rng)

    def seen(self, H: Floats) -> Grey:
        """(H, W) the same in the mixture of colours that shows the object."""
        return self._channel.grey(self.moved(H))


def course(steps: int, centre: Floats, size: float, middle: Floats) -> list[Floats]:
    """(3, 3) motions of an object, each a small step after the one before: it turns, comes nearer, tilts and shifts.

    Args:
        steps: number of motions.
        centre: (2,) px, of the object.
        size: px, of it.
        middle: (2,) px, of the image, towards which it shifts.
    """
    made = []
    away = middle - centre
    way = away / max(float(np.hypot(*away)), 1e-9)
    for i in range(1, steps + 1):
        u = i / steps
        turn, tilt, growth = math.radians(TURN) * u, math.radians(TILT) * u, 1.0 + GROWTH * u
        c, s = math.cos(turn), math.sin(turn)
        # a tilt about the axis (1, 1), seen from DISTANCE sizes away
        a = np.array([[1.0, 1.0], [1.0, 1.0]]) / 2.0
        squeeze = np.eye(2) - (1.0 - math.cos(tilt)) * (np.eye(2) - a)
        bend = math.sin(tilt) / (DISTANCE * size) * np.array([1.0, -1.0]) / math.sqrt(2.0)
        H = np.eye(3)
        H[:2, :2] = growth * np.array([[c, -s], [s, c]]) @ squeeze
        H[2, :2] = bend
        shift = centre + min(SHIFT * size * u, float(np.hypot(*away))) * way
        there, back = np.eye(3), np.eye(3)
        there[:2, 2], back[:2, 2] = shift, -centre
        made.append(there @ H @ back)
    return made
