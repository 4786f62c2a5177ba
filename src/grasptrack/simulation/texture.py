# SPDX-License-Identifier: Apache-2.0
"""Surfaces made on the spot from a seed: wood for tables, brushed metal or card for parts."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Floats32 = NDArray[np.float32]
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class Texture:
    """A picture that lies on the table plane, mirrored at its borders where the view goes beyond it.

    Attributes:
        image: (S, S, 3) BGR.
        extent: table units from its centre, which lies at the origin, to its sides.
    """

    image: Pixels
    extent: float

    @property
    def to_table(self) -> NDArray[np.float64]:
        """(3, 3) from its pixels to table coordinates."""
        size = self.image.shape[0]
        scale = 2.0 * self.extent / size
        shift = -0.5 * (size - 1) * scale
        return np.array([[scale, 0.0, shift], [0.0, scale, shift], [0.0, 0.0, 1.0]])

    @property
    def grey(self) -> Texture:
        """The same without colour."""
        return Texture(np.asarray(cv2.cvtColor(self.image, cv2.COLOR_BGR2GRAY), dtype=np.uint8), self.extent)


def _noise(rng: np.random.Generator, size: int, sx: float, sy: float) -> Floats32:
    """Noise of variance 1 with correlation lengths sx and sy px."""
    fx, fy = max(1, int(sx / 3.0)), max(1, int(sy / 3.0))  # slow waves are made small and enlarged
    noise = rng.standard_normal((-(-size // fy) + 1, -(-size // fx) + 1), dtype=np.float32)
    small = cv2.GaussianBlur(noise, (0, 0), sigmaX=sx / fx, sigmaY=sy / fy, borderType=cv2.BORDER_REFLECT_101)
    field = cv2.resize(small, (small.shape[1] * fx, small.shape[0] * fy), interpolation=cv2.INTER_CUBIC)[:size, :size]
    return np.asarray(field / field.std(), dtype=np.float32)


def _tint(value: Floats32, colour: tuple[float, float, float]) -> Pixels:
    """Grey relief around 1 times a BGR colour."""
    return np.clip(np.rint(value[..., None] * np.array(colour, np.float32)), 0, 255).astype(np.uint8)


def wood(
    seed: int = 0,
    *,
    size: int = 1536,
    extent: float = 4.5,
    colour: tuple[float, float, float] = (152, 190, 214),
    contrast: float = 1.0,
    planks: int = 7,
) -> Texture:
    """A table of planks with year rings, fibres and faint seams.

    Args:
        seed: of the grain.
        size: px of the square picture.
        extent: table units from its centre to its sides.
        colour: mean BGR.
        contrast: of the grain; 1 is some 4 % of the brightness, as on a lacquered table.
        planks: across the picture.
    """
    rng = np.random.default_rng((seed, 11))
    rows = np.arange(size)
    plank = np.minimum(rows * planks // size, planks - 1)
    bend = _noise(rng, size, 170, 22)
    slide = rng.integers(0, size, planks)
    for i in range(planks):
        bend[plank == i] = np.roll(bend[plank == i], int(slide[i]), axis=1)
    phase = rows[:, None] / 21.0 + 1.35 * bend + (rng.uniform(0, 7, planks))[plank][:, None]
    wave = np.sin(2.0 * np.pi * phase)
    rings = np.sign(wave) * np.abs(wave) ** 1.6 * (0.55 + 0.45 * np.tanh(_noise(rng, size, 120, 30)))
    fibres = _noise(rng, size, 22, 0.9)
    clouds = _noise(rng, size, 160, 60)
    tone = rng.uniform(-0.035, 0.035, planks)[plank][:, None]
    relief = 1.0 + contrast * (0.028 * rings + 0.017 * fibres + 0.014 * clouds + tone)
    to_seam = np.abs((rows * planks / size + 0.5) % 1.0 - 0.5) * size / planks
    relief *= 1.0 - 0.14 * contrast * np.exp(-0.5 * (to_seam / 1.3) ** 2)[:, None]
    return Texture(_tint(np.asarray(relief, np.float32), colour), extent)


def plain(
    seed: int = 0,
    *,
    size: int = 1024,
    extent: float = 4.5,
    colour: tuple[float, float, float] = (188, 190, 190),
    contrast: float = 1.0,
) -> Texture:
    """A laminate or cloth: fine and coarse mottling without a direction."""
    rng = np.random.default_rng((seed, 12))
    relief = 1.0 + contrast * (0.012 * _noise(rng, size, 1.2, 1.2) + 0.02 * _noise(rng, size, 60, 60))
    return Texture(_tint(np.asarray(relief, np.float32), colour), extent)


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
    relief = 1.0 + contrast * (0.045 * _noise(rng, size, 40, 0.8) + 0.05 * _noise(rng, size, 90, 90))
    if mark:
        layer = np.zeros((size, size), np.uint8)
        (width, height), _ = cv2.getTextSize(mark, cv2.FONT_HERSHEY_DUPLEX, 1.15, 2)
        place = ((size - width) // 2, (size + height) // 2)
        cv2.putText(layer, mark, place, cv2.FONT_HERSHEY_DUPLEX, 1.15, 255, 2, cv2.LINE_AA)
        relief = relief * (1.0 + 0.42 * cv2.GaussianBlur(layer.astype(np.float32) / 255.0, (0, 0), 0.8))
    return Texture(_tint(np.asarray(relief, np.float32), colour), extent)
