# SPDX-License-Identifier: Apache-2.0
"""How a scene looks: which table, which surface, how light and how dark, drawn from a seed."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.simulation.surfaces import SURFACES
from grasptrack.bench.simulation.tables import TABLES
from grasptrack.bench.simulation.texture import Texture

MEAN = 150.0
"""Grey level at which patterns are made; they are brought to the level that is asked for."""
PATTERNS = 3
"""Patterns of each kind; each also comes turned by quarters and mirrored."""
LEAST_CONTRAST = 55.0


@dataclass(frozen=True)
class Look:
    """What lies there.

    Attributes:
        table, surface: textures.
        table_level, surface_level: their mean grey levels.
    """

    table: Texture
    surface: Texture
    table_level: float
    surface_level: float


def sample_look(name: str, seed: int) -> Look:
    """A table and a surface of different lightness, either of them the darker one.

    Args:
        name: of the part: parts differ in their looks with the same seed.
        seed: of the look.
    """
    rng = np.random.default_rng((seed, zlib.crc32(name.encode()), 61))
    contrast = rng.uniform(LEAST_CONTRAST, 125.0)
    low = rng.uniform(32.0, 195.0 - contrast)
    levels = (low, low + contrast) if rng.uniform() < 0.5 else (low + contrast, low)
    table = str(rng.choice(list(TABLES)))
    return Look(
        table=adjust_grey_level(
            _rotate_or_flip(_table_texture(table, int(rng.integers(PATTERNS))), int(rng.integers(8))), levels[0], rng
        ),
        surface=another_surface(levels[1], rng),
        table_level=levels[0],
        surface_level=levels[1],
    )


def another_surface(level: float, rng: np.random.Generator) -> Texture:
    """A surface of some kind at a mean grey level: that of another part of the same make."""
    kind, pattern = str(rng.choice(list(SURFACES))), int(rng.integers(PATTERNS))
    return adjust_grey_level(
        _rotate_or_flip(_surface_texture(kind, pattern, level < 110.0), int(rng.integers(8))), level, rng
    )


@lru_cache(maxsize=32)
def _table_texture(kind: str, pattern: int) -> Texture:
    contrast = 0.6 if kind == "gravel" else 1.0
    return TABLES[kind](pattern, size=1024, colour=(MEAN, MEAN, MEAN), contrast=contrast).grey


@lru_cache(maxsize=32)
def _surface_texture(kind: str, pattern: int, dark: bool) -> Texture:
    level = 80.0 if dark else MEAN
    return SURFACES[kind](pattern, colour=(level, level, level)).grey


def _rotate_or_flip(texture: Texture, way: int) -> Texture:
    """One of the eight ways to lay a square picture."""
    image = np.rot90(texture.image, way % 4)
    return Texture(np.ascontiguousarray(image[:, ::-1] if way >= 4 else image), texture.extent, texture.middle)


def adjust_grey_level(texture: Texture, level: float, rng: np.random.Generator) -> Texture:
    """The grey pattern with another mean, faintly tinted: B, G and R differ, their grey is the level."""
    gain = level / float(texture.image.mean())
    tint = 1.0 + rng.uniform(-0.12, 0.12, 2)
    factors = np.array([tint[0], (1.0 - 0.114 * tint[0] - 0.299 * tint[1]) / 0.587, tint[1]])
    planes: list[NDArray[np.uint8]] = [
        np.asarray(cv2.convertScaleAbs(texture.image, alpha=gain * float(f)), dtype=np.uint8) for f in factors
    ]
    return Texture(np.asarray(cv2.merge(planes), dtype=np.uint8), texture.extent, texture.middle)
