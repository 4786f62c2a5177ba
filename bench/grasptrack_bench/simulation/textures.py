# SPDX-License-Identifier: Apache-2.0
"""Textures of tables and parts, made on the spot from a seed, and the look that a seed gives a part."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats, Floats32, Ints, Pixels

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class TextureMap:
    """A picture that lies on the table plane, mirrored at its borders where the view goes beyond it.

    Attributes:
        image: (H, W, 3) BGR or (H, W) grey.
        extent: table units from its middle to its left and right sides.
        middle: table units, where its middle lies; a part has its centroid at (0, 0).
    """

    image: Pixels
    extent: float
    middle: tuple[float, float] = (0.0, 0.0)

    @property
    def to_table(self) -> NDArray[np.float64]:
        """(3, 3) from its pixels to table coordinates."""
        height, width = self.image.shape[:2]
        scale = 2.0 * self.extent / width
        x, y = self.middle
        return np.array(
            [[scale, 0.0, x - 0.5 * (width - 1) * scale], [0.0, scale, y - 0.5 * (height - 1) * scale], [0.0, 0.0, 1.0]]
        )

    @property
    def grey(self) -> TextureMap:
        """The same without colour."""
        if self.image.ndim == 2:
            return self
        grey = np.asarray(cv2.cvtColor(self.image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        return TextureMap(grey, self.extent, self.middle)

    @property
    def coloured(self) -> TextureMap:
        """The same with three channels."""
        if self.image.ndim == 3:
            return self
        return TextureMap(np.asarray(cv2.cvtColor(self.image, cv2.COLOR_GRAY2BGR), np.uint8), self.extent, self.middle)


def noise_field(rng: np.random.Generator, size: int, sx: float, sy: float) -> Floats32:
    """Noise of variance 1 with correlation lengths sx and sy px."""
    fx, fy = max(1, int(sx / 3.0)), max(1, int(sy / 3.0))  # slow waves are made small and enlarged
    noise = rng.standard_normal((-(-size // fy) + 1, -(-size // fx) + 1), dtype=np.float32)
    small = cv2.GaussianBlur(noise, (0, 0), sigmaX=sx / fx, sigmaY=sy / fy, borderType=cv2.BORDER_REFLECT_101)
    field = cv2.resize(small, (small.shape[1] * fx, small.shape[0] * fy), interpolation=cv2.INTER_CUBIC)[:size, :size]
    return np.asarray(field / field.std(), dtype=np.float32)


def tint_relief(value: Floats32, colour: Colour) -> Pixels:
    """Grey relief around 1 times a BGR colour."""
    return np.clip(np.rint(value[..., None] * np.array(colour, np.float32)), 0, 255).astype(np.uint8)


def _texture_maker(
    stream: int, size: int, extent: float, colour: Colour
) -> Callable[[Callable[..., Floats32]], Callable[..., TextureMap]]:
    """Makes of a function that draws a relief around 1 one that makes a texture from a seed.

    Args:
        stream: of the seed's random numbers.
        size: px of the square picture, if not told otherwise.
        extent: table units from its middle to its sides, likewise.
        colour: mean BGR, likewise.
    """
    usual = {"size": size, "extent": extent, "colour": colour, "contrast": 1.0}

    def wrap_relief(relief: Callable[..., Floats32]) -> Callable[..., TextureMap]:
        def make_texture(seed: int = 0, **options: Any) -> TextureMap:
            told = {**usual, **options}
            value = relief(np.random.default_rng((seed, stream)), **told)
            return TextureMap(tint_relief(value, told["colour"]), told["extent"])

        make_texture.__name__, make_texture.__doc__ = relief.__name__, relief.__doc__
        return make_texture

    return wrap_relief


@_texture_maker(13, size=768, extent=1.6, colour=(66, 54, 47))
def brushed_texture(
    rng: np.random.Generator, size: int, extent: float, colour: Colour, contrast: float, mark: str = ""
) -> Floats32:
    """A part's own surface: brushed metal, some 5 % of the brightness; `mark` is a word engraved around the centroid."""
    relief = 1.0 + contrast * (0.045 * noise_field(rng, size, 40, 0.8) + 0.05 * noise_field(rng, size, 90, 90))
    if mark:
        layer = np.zeros((size, size), np.uint8)
        (width, height), _ = cv2.getTextSize(mark, cv2.FONT_HERSHEY_DUPLEX, 1.15, 2)
        place = ((size - width) // 2, (size + height) // 2)
        cv2.putText(layer, mark, place, cv2.FONT_HERSHEY_DUPLEX, 1.15, 255, 2, cv2.LINE_AA)
        relief = relief * (1.0 + 0.42 * cv2.GaussianBlur(layer.astype(np.float32) / 255.0, (0, 0), 0.8))
    return np.asarray(relief, np.float32)


@_texture_maker(20, size=512, extent=1.6, colour=(66, 60, 56))
def blank_texture(rng: np.random.Generator, size: int, extent: float, colour: Colour, contrast: float) -> Floats32:
    """Cast plastic or card: nearly one grey, with a breath of mottling."""
    relief = 1.0 + contrast * (0.012 * noise_field(rng, size, 1.5, 1.5) + 0.012 * noise_field(rng, size, 60, 60))
    return np.asarray(relief, np.float32)


@_texture_maker(21, size=640, extent=1.6, colour=(70, 62, 58))
def printed_texture(rng: np.random.Generator, size: int, extent: float, colour: Colour, contrast: float) -> Floats32:
    """A printed label: lines of words, boxes, bars, lighter or darker than the card by up to a third."""
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
    return np.asarray(relief, np.float32)


@_texture_maker(23, size=640, extent=1.6, colour=(110, 104, 98))
def picture_texture(rng: np.random.Generator, size: int, extent: float, colour: Colour, contrast: float) -> Floats32:
    """A picture in print: patches of many shades with soft and sharp borders, as a photo has them, and fine detail."""
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
    return np.asarray(1.0 + 0.8 * contrast * (relief - relief.mean()), np.float32)


SURFACES: dict[str, Callable[..., TextureMap]] = {
    "brushed": brushed_texture,
    "blank": blank_texture,
    "printed": printed_texture,
}
"""Every kind of surface by its name; each takes a seed, `colour` and `contrast`."""


@_texture_maker(11, size=1536, extent=4.5, colour=(152, 190, 214))
def wood_texture(rng: np.random.Generator, size: int, extent: float, colour: Colour, contrast: float) -> Floats32:
    """A table of planks: year rings, fibres, faint seams; at contrast 1 the grain is some 4 % of the brightness."""
    rows, planks = np.arange(size), 7
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
    return np.asarray(relief, np.float32)


@_texture_maker(12, size=1024, extent=4.5, colour=(188, 190, 190))
def plain_texture(rng: np.random.Generator, size: int, extent: float, colour: Colour, contrast: float) -> Floats32:
    """A laminate or cloth: fine and coarse mottling without a direction."""
    relief = 1.0 + contrast * (0.012 * noise_field(rng, size, 1.2, 1.2) + 0.02 * noise_field(rng, size, 60, 60))
    return np.asarray(relief, np.float32)


def _draw_pebbles(relief: Floats32, middle: Ints, radius: Floats, flat: Floats, turn: Floats, shade: Floats) -> None:
    """Draw ellipses one over the other, in place; their middles (n, 2) in eighths of a px, the other arrays (n,)."""
    for (x, y), r, f, angle, level in zip(middle.tolist(), radius, flat, turn.tolist(), shade.tolist(), strict=True):
        cv2.ellipse(relief, (x, y), (round(8 * r), round(8 * r * f)), angle, 0, 360, level, -1, cv2.LINE_8, 3)


@_texture_maker(14, size=1024, extent=4.5, colour=(150, 156, 160))
def gravel_texture(rng: np.random.Generator, size: int, extent: float, colour: Colour, contrast: float) -> Floats32:
    """Fine gravel or terrazzo: pebbles of many sizes and shades, close together."""
    relief = np.full((size, size), 0.86, np.float32)
    count = size * size // 90
    middle, radius = rng.integers(0, size, (count, 2)), np.sort(rng.gamma(4.0, 1.1, count))[::-1] + 2.0
    shade, turn, flat = 1.0 + 0.13 * rng.standard_normal(count), rng.uniform(0, 180, count), rng.uniform(0.6, 1, count)
    _draw_pebbles(relief, 8 * middle, radius, flat, turn, shade)
    relief = np.asarray(cv2.GaussianBlur(relief, (0, 0), 0.9), np.float32) + 0.02 * noise_field(rng, size, 1.0, 1.0)
    return np.asarray(1.0 + contrast * (relief - relief.mean()), np.float32)


@_texture_maker(22, size=1440, extent=3.0, colour=(150, 156, 160))
def pebble_texture(rng: np.random.Generator, size: int, extent: float, colour: Colour, contrast: float) -> Floats32:
    """Strong gravel: dense pebbles of 6 to 15 px where the object is some 175 px in size, as light and dark as parts are."""
    unit = 0.5 * size / extent
    least, most = 0.5 * 6.0 / 175.0 * unit, 0.5 * 15.0 / 175.0 * unit
    relief = np.full((size, size), 0.6, np.float32)
    count = int(2.5 * size * size / (math.pi * least * most))
    middle, radius = rng.integers(0, 8 * size, (count, 2)), np.sort(rng.uniform(least, most, count))[::-1]
    shade = 1.0 + 0.33 * np.clip(rng.standard_normal(count), -1.9, 1.9)
    turn, flat = rng.uniform(0, 180, count), rng.uniform(0.65, 1, count)
    _draw_pebbles(relief, middle, radius, flat, turn, shade)
    relief = np.asarray(cv2.GaussianBlur(relief, (0, 0), 1.0), np.float32) + 0.02 * noise_field(rng, size, 1.0, 1.0)
    return np.asarray(1.0 + contrast * (relief - relief.mean()), np.float32)


@_texture_maker(15, size=1024, extent=4.5, colour=(140, 146, 150))
def woven_texture(rng: np.random.Generator, size: int, extent: float, colour: Colour, contrast: float) -> Floats32:
    """Coarse cloth: threads over and under each other, uneven as spun ones are."""
    pitch = 9.0  # px; far enough from the pixels of any image here not to alias
    y, x = np.mgrid[:size, :size].astype(np.float32)
    u = x / pitch + 0.12 * noise_field(rng, size, 8, 160)
    v = y / pitch + 0.12 * noise_field(rng, size, 160, 8)
    over = np.sin(np.pi * u) * np.sin(np.pi * v) > 0.0
    across, along = np.abs(np.sin(np.pi * u)), np.abs(np.sin(np.pi * v))
    thread = np.where(over, across * (0.75 + 0.25 * along), along * (0.75 + 0.25 * across) - 0.06)
    relief = 0.11 * (thread - thread.mean()) + 0.02 * noise_field(rng, size, 70, 70)
    relief = cv2.GaussianBlur(np.asarray(relief, np.float32), (0, 0), 0.8) + 0.012 * noise_field(rng, size, 1.2, 1.2)
    return np.asarray(1.0 + contrast * relief, np.float32)


@_texture_maker(16, size=1024, extent=4.5, colour=(158, 164, 166))
def stone_texture(rng: np.random.Generator, size: int, extent: float, colour: Colour, contrast: float) -> Floats32:
    """A worktop of granite: clouds, grains of three sizes, a few veins."""
    clouds = noise_field(rng, size, 90, 90)
    grains = sum(w * noise_field(rng, size, s, s) for w, s in ((0.02, 1.3), (0.022, 3.0), (0.018, 8.0)))
    dark = np.clip(noise_field(rng, size, 2.2, 2.2) - 1.6, 0.0, 1.0)
    vein = np.exp(-((noise_field(rng, size, 120, 45) / 0.05) ** 2))
    relief = 1.0 + contrast * (0.02 * clouds + grains - 0.18 * dark + 0.05 * vein)
    return np.asarray(relief, np.float32)


TABLES: dict[str, Callable[..., TextureMap]] = {
    "wood": wood_texture,
    "plain": plain_texture,
    "gravel": gravel_texture,
    "woven": woven_texture,
    "stone": stone_texture,
}
"""Every kind of table by its name; each takes a seed, `colour` and `contrast`."""


MEAN = 150.0
"""Grey level at which patterns are made; they are brought to the level that is asked for."""
PATTERNS = 3
"""Patterns of each kind; each also comes turned by quarters and mirrored."""
LEAST_CONTRAST = 55.0


@dataclass(frozen=True)
class SceneAppearance:
    """What lies there: textures of table and surface, and their mean grey levels."""

    table: TextureMap
    surface: TextureMap
    table_level: float
    surface_level: float


def sample_look(name: str, seed: int) -> SceneAppearance:
    """A table and a surface of different lightness, either of them the darker one; parts differ with the same seed."""
    rng = np.random.default_rng((seed, zlib.crc32(name.encode()), 61))
    contrast = rng.uniform(LEAST_CONTRAST, 125.0)
    low = rng.uniform(32.0, 195.0 - contrast)
    levels = (low, low + contrast) if rng.uniform() < 0.5 else (low + contrast, low)
    table = str(rng.choice(list(TABLES)))
    return SceneAppearance(
        table=adjust_grey_level(
            _rotate_or_flip(_table_texture(table, int(rng.integers(PATTERNS))), int(rng.integers(8))), levels[0], rng
        ),
        surface=another_surface(levels[1], rng),
        table_level=levels[0],
        surface_level=levels[1],
    )


def another_surface(level: float, rng: np.random.Generator) -> TextureMap:
    """A surface of some kind at a mean grey level: that of another part of the same make."""
    kind, pattern = str(rng.choice(list(SURFACES))), int(rng.integers(PATTERNS))
    return adjust_grey_level(
        _rotate_or_flip(_surface_texture(kind, pattern, level < 110.0), int(rng.integers(8))), level, rng
    )


@lru_cache(maxsize=32)
def _table_texture(kind: str, pattern: int) -> TextureMap:
    contrast = 0.6 if kind == "gravel" else 1.0
    return TABLES[kind](pattern, size=1024, colour=(MEAN, MEAN, MEAN), contrast=contrast).grey


@lru_cache(maxsize=32)
def _surface_texture(kind: str, pattern: int, dark: bool) -> TextureMap:
    level = 80.0 if dark else MEAN
    return SURFACES[kind](pattern, colour=(level, level, level)).grey


def _rotate_or_flip(texture: TextureMap, way: int) -> TextureMap:
    """One of the eight ways to lay a square picture."""
    image = np.rot90(texture.image, way % 4)
    return TextureMap(np.ascontiguousarray(image[:, ::-1] if way >= 4 else image), texture.extent, texture.middle)


def adjust_grey_level(texture: TextureMap, level: float, rng: np.random.Generator) -> TextureMap:
    """The grey pattern with another mean, faintly tinted: B, G and R differ, their grey is the level."""
    gain = level / float(texture.image.mean())
    tint = 1.0 + rng.uniform(-0.12, 0.12, 2)
    factors = np.array([tint[0], (1.0 - 0.114 * tint[0] - 0.299 * tint[1]) / 0.587, tint[1]])
    planes: list[NDArray[np.uint8]] = [
        np.asarray(cv2.convertScaleAbs(texture.image, alpha=gain * float(f)), dtype=np.uint8) for f in factors
    ]
    return TextureMap(np.asarray(cv2.merge(planes), dtype=np.uint8), texture.extent, texture.middle)
