# SPDX-License-Identifier: Apache-2.0
"""Tables made on the spot from a seed: wood, laminate, gravel, cloth, stone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasptrack.simulation.texture import Texture, noise_field, tint

Floats32 = NDArray[np.float32]


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
    return Texture(tint(np.asarray(relief, np.float32), colour), extent)


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
    relief = 1.0 + contrast * (0.012 * noise_field(rng, size, 1.2, 1.2) + 0.02 * noise_field(rng, size, 60, 60))
    return Texture(tint(np.asarray(relief, np.float32), colour), extent)
