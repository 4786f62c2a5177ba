# SPDX-License-Identifier: Apache-2.0
"""Surfaces of parts made on the spot from a seed: brushed metal, bare card, printed card."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.simulation.texture import Colour, Texture, noise_field, tint_relief

Floats32 = NDArray[np.float32]


def brushed_texture(
    seed: int = 0,
    *,
    size: int = 768,
    extent: float = 1.6,
    colour: Colour = (66, 54, 47),
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
    return Texture(tint_relief(np.asarray(relief, np.float32), colour), extent)


def blank_texture(
    seed: int = 0,
    *,
    size: int = 512,
    extent: float = 1.6,
    colour: Colour = (66, 60, 56),
    contrast: float = 1.0,
) -> Texture:
    """Cast plastic or card: nearly one grey, with a breath of mottling."""
    rng = np.random.default_rng((seed, 20))
    relief = 1.0 + contrast * (0.012 * noise_field(rng, size, 1.5, 1.5) + 0.012 * noise_field(rng, size, 60, 60))
    return Texture(tint_relief(np.asarray(relief, np.float32), colour), extent)


def printed_texture(
    seed: int = 0,
    *,
    size: int = 640,
    extent: float = 1.6,
    colour: Colour = (70, 62, 58),
    contrast: float = 1.0,
) -> Texture:
    """A printed label: lines of words, boxes, bars, lighter or darker than the card by up to a third."""
    rng = np.random.default_rng((seed, 21))
    ink = np.zeros((size, size), np.uint8)
    words = ("GRASP", "LOT 218", "SERIES 5", "MADE IN EU", "FRAGILE", "TOP", "STEEL", "M8 DIN 934", "24V", "KEEP DRY")
    y = 0
    while y < size:
        height = int(rng.integers(18, 46))
        x = int(rng.integers(-40, 20))
        while x < size:
            kind, strength = rng.uniform(), int(rng.integers(100, 256))
            if kind < 0.6:
                word, scale = str(rng.choice(words)), height / 38.0
                (width, _), _ = cv2.getTextSize(word, cv2.FONT_HERSHEY_DUPLEX, scale, 2)
                cv2.putText(ink, word, (x, y + height - 6), cv2.FONT_HERSHEY_DUPLEX, scale, strength, 2, cv2.LINE_AA)
            elif kind < 0.8:
                width = int(rng.integers(20, 90))
                cv2.rectangle(ink, (x, y + 3), (x + width, y + height - 5), strength, -1 if kind < 0.68 else 2)
            else:
                width = int(rng.integers(50, 110))
                for bar in range(x, x + width, 6):
                    cv2.rectangle(ink, (bar, y + 2), (bar + int(rng.integers(1, 4)), y + height - 4), strength, -1)
            x += width + int(rng.integers(8, 60))
        y += height + int(rng.integers(4, 16))
    laid_on = np.asarray(cv2.GaussianBlur(ink, (0, 0), 0.8), np.float32) / np.float32(255.0)
    mean = sum(colour) / 3.0
    sign, depth = (1.0 if mean < 110.0 else -1.0), 0.33 * max(1.0, 80.0 / mean)
    relief = (1.0 + 0.012 * noise_field(rng, size, 60, 60)) * (1.0 + sign * depth * contrast * laid_on)
    return Texture(tint_relief(np.asarray(relief, np.float32), colour), extent)


def picture_texture(
    seed: int = 0,
    *,
    size: int = 640,
    extent: float = 1.6,
    colour: Colour = (110, 104, 98),
    contrast: float = 1.0,
) -> Texture:
    """A picture in print: patches of many shades with soft and sharp borders, as a photo has them, and fine detail."""
    rng = np.random.default_rng((seed, 23))
    relief = 0.25 * noise_field(rng, size, 70, 70)
    for _ in range(40):
        middle, half = rng.uniform(0.0, size, 2), rng.uniform(0.03, 0.16, 2) * size
        box = (tuple(middle.tolist()), tuple((2.0 * half).tolist()), float(rng.uniform(0.0, 180.0)))
        patch = np.zeros((size, size), np.float32)
        if rng.uniform() < 0.6:
            cv2.ellipse(patch, box, 1.0, -1, cv2.LINE_8)
        else:
            cv2.fillPoly(patch, [np.rint(cv2.boxPoints(box)).astype(np.int32)], 1.0)
        soft = float(rng.choice([1.0, 1.0, 6.0]))
        share = np.asarray(cv2.GaussianBlur(patch, (0, 0), soft), np.float32) * np.float32(rng.uniform(0.5, 1.0))
        relief += share * (np.float32(rng.uniform(-0.7, 0.7)) + 0.15 * noise_field(rng, size, 8, 8) - relief)
    relief += 0.04 * noise_field(rng, size, 1.5, 1.5)
    return Texture(tint_relief(np.asarray(1.0 + 0.8 * contrast * (relief - relief.mean()), np.float32), colour), extent)


SURFACES: dict[str, Callable[..., Texture]] = {
    "brushed": brushed_texture,
    "blank": blank_texture,
    "printed": printed_texture,
}
"""Every kind of surface by its name; each takes a seed, `colour` and `contrast`."""
