# SPDX-License-Identifier: Apache-2.0
"""Tables made on the spot from a seed: wood, laminate, gravel, cloth, stone."""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.simulation.texture import Colour, Texture, noise_field, tint_relief

Floats32 = NDArray[np.float32]


def wood_texture(
    seed: int = 0,
    *,
    size: int = 1536,
    extent: float = 4.5,
    colour: Colour = (152, 190, 214),
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
    bend = noise_field(rng, size, 170, 22)
    slide = rng.integers(0, size, planks)
    for i in range(planks):
        bend[plank == i] = np.roll(bend[plank == i], int(slide[i]), axis=1)
    phase = rows[:, None] / 21.0 + 1.35 * bend + (rng.uniform(0, 7, planks))[plank][:, None]
    wave = np.sin(2.0 * np.pi * phase)
    rings = np.sign(wave) * np.abs(wave) ** 1.6 * (0.55 + 0.45 * np.tanh(noise_field(rng, size, 120, 30)))
    fibres = noise_field(rng, size, 22, 0.9)
    clouds = noise_field(rng, size, 160, 60)
    tone = rng.uniform(-0.035, 0.035, planks)[plank][:, None]
    relief = 1.0 + contrast * (0.028 * rings + 0.017 * fibres + 0.014 * clouds + tone)
    to_seam = np.abs((rows * planks / size + 0.5) % 1.0 - 0.5) * size / planks
    relief *= 1.0 - 0.14 * contrast * np.exp(-0.5 * (to_seam / 1.3) ** 2)[:, None]
    return Texture(tint_relief(np.asarray(relief, np.float32), colour), extent)


def plain_texture(
    seed: int = 0,
    *,
    size: int = 1024,
    extent: float = 4.5,
    colour: Colour = (188, 190, 190),
    contrast: float = 1.0,
) -> Texture:
    """A laminate or cloth: fine and coarse mottling without a direction."""
    rng = np.random.default_rng((seed, 12))
    relief = 1.0 + contrast * (0.012 * noise_field(rng, size, 1.2, 1.2) + 0.02 * noise_field(rng, size, 60, 60))
    return Texture(tint_relief(np.asarray(relief, np.float32), colour), extent)


def gravel_texture(
    seed: int = 0,
    *,
    size: int = 1024,
    extent: float = 4.5,
    colour: Colour = (150, 156, 160),
    contrast: float = 1.0,
) -> Texture:
    """Fine gravel or terrazzo: pebbles of many sizes and shades, close together."""
    rng = np.random.default_rng((seed, 14))
    relief = np.full((size, size), 0.86, np.float32)
    count = size * size // 90
    middle, radius = rng.integers(0, size, (count, 2)), np.sort(rng.gamma(4.0, 1.1, count))[::-1] + 2.0
    shade, turn, flat = 1.0 + 0.13 * rng.standard_normal(count), rng.uniform(0, 180, count), rng.uniform(0.6, 1, count)
    for i in range(count):
        axes = (round(8 * radius[i]), round(8 * radius[i] * flat[i]))
        at = (8 * int(middle[i, 0]), 8 * int(middle[i, 1]))
        cv2.ellipse(relief, at, axes, float(turn[i]), 0, 360, float(shade[i]), -1, cv2.LINE_8, 3)
    relief = np.asarray(cv2.GaussianBlur(relief, (0, 0), 0.9), np.float32) + 0.02 * noise_field(rng, size, 1.0, 1.0)
    return Texture(tint_relief(1.0 + contrast * (relief - relief.mean()), colour), extent)


def pebble_texture(
    seed: int = 0,
    *,
    size: int = 1440,
    extent: float = 3.0,
    colour: Colour = (150, 156, 160),
    contrast: float = 1.0,
) -> Texture:
    """Strong gravel: dense pebbles of 6 to 15 px where the object is some 175 px in size, as light and dark as parts are.

    Args:
        seed: of the pebbles.
        size: px of the square picture.
        extent: table units from its centre to its sides.
        colour: mean BGR.
        contrast: of the pebbles; 1 spreads their brightness by a third of the mean.
    """
    rng = np.random.default_rng((seed, 22))
    unit = 0.5 * size / extent
    least, most = 0.5 * 6.0 / 175.0 * unit, 0.5 * 15.0 / 175.0 * unit
    relief = np.full((size, size), 0.6, np.float32)
    count = int(2.5 * size * size / (math.pi * least * most))
    middle, radius = rng.integers(0, 8 * size, (count, 2)), np.sort(rng.uniform(least, most, count))[::-1]
    shade = 1.0 + 0.33 * np.clip(rng.standard_normal(count), -1.9, 1.9)
    turn, flat = rng.uniform(0, 180, count), rng.uniform(0.65, 1, count)
    for i in range(count):
        axes = (round(8 * radius[i]), round(8 * radius[i] * flat[i]))
        at = (int(middle[i, 0]), int(middle[i, 1]))
        cv2.ellipse(relief, at, axes, float(turn[i]), 0, 360, float(shade[i]), -1, cv2.LINE_8, 3)
    relief = np.asarray(cv2.GaussianBlur(relief, (0, 0), 1.0), np.float32) + 0.02 * noise_field(rng, size, 1.0, 1.0)
    return Texture(tint_relief(1.0 + contrast * (relief - relief.mean()), colour), extent)


def woven_texture(
    seed: int = 0,
    *,
    size: int = 1024,
    extent: float = 4.5,
    colour: Colour = (140, 146, 150),
    contrast: float = 1.0,
) -> Texture:
    """Coarse cloth: threads over and under each other, uneven as spun ones are."""
    rng = np.random.default_rng((seed, 15))
    pitch = 9.0  # px; far enough from the pixels of any image here not to alias
    y, x = np.mgrid[:size, :size].astype(np.float32)
    u = x / pitch + 0.12 * noise_field(rng, size, 8, 160)
    v = y / pitch + 0.12 * noise_field(rng, size, 160, 8)
    over = np.sin(np.pi * u) * np.sin(np.pi * v) > 0.0
    across, along = np.abs(np.sin(np.pi * u)), np.abs(np.sin(np.pi * v))
    thread = np.where(over, across * (0.75 + 0.25 * along), along * (0.75 + 0.25 * across) - 0.06)
    relief = 0.11 * (thread - thread.mean()) + 0.02 * noise_field(rng, size, 70, 70)
    relief = cv2.GaussianBlur(np.asarray(relief, np.float32), (0, 0), 0.8) + 0.012 * noise_field(rng, size, 1.2, 1.2)
    return Texture(tint_relief(np.asarray(1.0 + contrast * relief, np.float32), colour), extent)


def stone_texture(
    seed: int = 0,
    *,
    size: int = 1024,
    extent: float = 4.5,
    colour: Colour = (158, 164, 166),
    contrast: float = 1.0,
) -> Texture:
    """A worktop of granite: clouds, grains of three sizes, a few veins."""
    rng = np.random.default_rng((seed, 16))
    clouds = noise_field(rng, size, 90, 90)
    grains = sum(w * noise_field(rng, size, s, s) for w, s in ((0.02, 1.3), (0.022, 3.0), (0.018, 8.0)))
    dark = np.clip(noise_field(rng, size, 2.2, 2.2) - 1.6, 0.0, 1.0)
    vein = np.exp(-((noise_field(rng, size, 120, 45) / 0.05) ** 2))
    relief = 1.0 + contrast * (0.02 * clouds + grains - 0.18 * dark + 0.05 * vein)
    return Texture(tint_relief(np.asarray(relief, np.float32), colour), extent)


TABLES: dict[str, Callable[..., Texture]] = {
    "wood": wood_texture,
    "plain": plain_texture,
    "gravel": gravel_texture,
    "woven": woven_texture,
    "stone": stone_texture,
}
"""Every kind of table by its name; each takes a seed, `colour` and `contrast`."""
