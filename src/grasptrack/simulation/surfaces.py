# SPDX-License-Identifier: Apache-2.0
"""Surfaces of parts made on the spot from a seed: brushed metal, bare card, printed card."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.simulation.texture import Texture, noise_field, tint

Floats32 = NDArray[np.float32]


def brushed(
    seed: int = 0,
    *,
    size: int = 768,
    extent: float = 1.6,
    colour: tuple[float, float, float] = (66, 54, 47),
    contrast: float = 1.0,
    mark: str = "",
) -> Texture:
    """A part's own surface: brushed metal, with a faint engraved mark if asked for.

    Args:
        seed: of the brushing.
        size: px of the square picture.
        extent: table units from the part's centroid to the picture's sides.
        colour: mean BGR.
        contrast: of the brushing; 1 is some 5 % of the brightness.
        mark: a word engraved around the centroid.
    """
    rng = np.random.default_rng((seed, 13))
    relief = 1.0 + contrast * (0.045 * noise_field(rng, size, 40, 0.8) + 0.05 * noise_field(rng, size, 90, 90))
    if mark:
        layer = np.zeros((size, size), np.uint8)
        (width, height), _ = cv2.getTextSize(mark, cv2.FONT_HERSHEY_DUPLEX, 1.15, 2)
        place = ((size - width) // 2, (size + height) // 2)
        cv2.putText(layer, mark, place, cv2.FONT_HERSHEY_DUPLEX, 1.15, 255, 2, cv2.LINE_AA)
        relief = relief * (1.0 + 0.42 * cv2.GaussianBlur(layer.astype(np.float32) / 255.0, (0, 0), 0.8))
    return Texture(tint(np.asarray(relief, np.float32), colour), extent)
