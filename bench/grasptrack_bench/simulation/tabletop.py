# SPDX-License-Identifier: Apache-2.0
"""What lies on the table, and what is printed on the part: from a setting to the arguments of a scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from grasptrack.geometry.homographies import apply_homography
from grasptrack_bench.simulation.camera import Pinhole
from grasptrack_bench.simulation.effects import EffectSetting, Parts
from grasptrack_bench.simulation.lookalikes import Distractor, place_beside, scale_shape, sheet_under
from grasptrack_bench.simulation.occluders import hand_over
from grasptrack_bench.simulation.outlines import Shape
from grasptrack_bench.simulation.paths import Path, add_camera_retreat
from grasptrack_bench.simulation.scene import Guest
from grasptrack_bench.simulation.shapes import SHAPES
from grasptrack_bench.simulation.textures import (
    TextureMap,
    adjust_grey_level,
    another_surface,
    pebble_texture,
    picture_texture,
    printed_texture,
)

OUT = 6.0
"""px that a part keeps from the image in which it is not to show."""
PAPERS = (238.0, 205.0, 165.0, 120.0, 70.0, 30.0)
"""Grey levels of sheets, in the order in which they are tried."""
PATTERNS = 4
"""Prints and kinds of gravel that are made; they are turned by the seed."""


# --- background ----------------------------------------------------------------------------------


@lru_cache(maxsize=PATTERNS)
def _cached_pebble_texture(pattern: int) -> TextureMap:
    return pebble_texture(pattern, colour=(128.0, 128.0, 128.0)).grey


def gravel_table(s: EffectSetting) -> Parts:
    """Pebbles around the table's own level, as far from it as the part is."""
    made = _cached_pebble_texture(int(s.rng.integers(PATTERNS))).image.astype(np.float32)
    spread = 0.4 * abs(s.level - s.table_level)
    level = float(np.clip(s.table_level, 1.6 * spread, 255.0 - 1.6 * spread))
    turned = np.rot90(made, int(s.rng.integers(4)))
    relief = (turned - turned.mean()) / turned.std()
    image = np.clip(np.rint(level + spread * relief), 0, 255).astype(np.uint8)
    return {"path": s.course(), "table": TextureMap(np.ascontiguousarray(image), 3.0)}


def paper_sheet(s: EffectSetting) -> Parts:
    """Half of the sheets go along with the part over the table, the others lie on it."""
    told = [p for p in PAPERS if abs(p - s.level) >= 50.0 and abs(p - s.table_level) >= 30.0]
    level = told[0] if told else max(PAPERS, key=lambda p: abs(p - s.level))
    paper = sheet_under(s.shape, s.rng, level)
    slide = (0.0, 0.0)
    if s.rng.uniform() < 0.5:
        angle, step = s.rng.uniform(0.0, 2.0 * math.pi), s.rng.uniform(1.5, 4.0) / 175.0
        slide = (float(step * math.cos(angle)), float(step * math.sin(angle)))
    return {"path": s.course(speed=3.0), "distractors": (paper,), "slide": slide}


def crowded_table(s: EffectSetting) -> Parts:
    """Four to seven other parts, half of them within some px of a neighbour."""
    s = replace(s, size=0.75 * s.size)
    path = s.course(reach=0.25)
    others = [str(n) for n in s.rng.permutation([n for n in SHAPES if n != s.shape.name])]
    count = int(s.rng.integers(4, 8))
    shapes = [scale_shape(SHAPES[n](), float(s.rng.uniform(0.6, 1.05))) for n in others[:count]]
    gaps = [(0.04, 0.07) if k % 2 == 0 else (0.1, 0.4) for k in range(count)]
    placed = place_beside(s.shape, shapes, s.rng, gaps=gaps, fits=visible_at_first(s, path, 0.6))
    made = []
    for part in placed:
        level = s.level if s.rng.uniform() < 0.5 else 2.0 * s.table_level - s.level
        surface = another_surface(float(np.clip(level, 25.0, 225.0)), s.rng)
        made.append(Distractor(shapes[part.number], surface, turn=part.turn, shift=part.shift))
    return {"path": path, "distractors": tuple(made)}


# --- equal parts ---------------------------------------------------------------------------------


def identical_parts(s: EffectSetting) -> Parts:
    """Equal parts, as from the same drawer: outline and surface are those of the object."""
    s = replace(s, size=0.75 * s.size)
    path, count = s.course(reach=0.25), int(s.rng.integers(1, 4))
    fits = visible_at_first(s, path, 0.7)
    placed = place_beside(s.shape, [s.shape] * count, s.rng, gaps=[(0.06, 0.5)] * count, fits=fits)
    made = tuple(Distractor(s.shape, turn=part.turn, shift=part.shift) for part in placed)
    return {"path": path, "distractors": made}


def equal_enters(s: EffectSetting) -> Parts:
    """Half of them move in, the others come into view as the camera draws back; a hand lies over the first."""
    s = replace(s, size=0.75 * s.size)
    path = s.course(speed=3.0, reach=0.2)
    angle, turn = (float(v) for v in s.rng.uniform(0.0, 2.0 * math.pi, 2))
    out, there, a, b, c, d = s.at(0.2, 0.5, 0.25, 0.42, 0.62, 0.8)
    if s.rng.uniform() < 0.5:
        placed = place_beside(s.shape, [s.shape], s.rng, gaps=[(0.06, 0.4)], fits=visible_at_first(s, path, 0.6))
        turn, shift = (
            (placed[0].turn, placed[0].shift) if placed else (turn, _nearest_place_outside(s, path, angle, turn))
        )
        far = _nearest_place_outside(s, path, math.atan2(shift[1], shift[0]), turn)
        away = (far[0] - shift[0], far[1] - shift[1])
        equal = Distractor(s.shape, turn=turn, shift=shift, away=away, times=(max(out, 1.0), there))
    else:
        shift = _nearest_place_outside(s, path, angle, turn)
        path = add_camera_retreat(path, factor=1.5, shift=(0.27 * shift[0], 0.27 * shift[1]), times=(out, there))
        equal = Distractor(s.shape, turn=turn, shift=shift)
    hand = hand_over(
        s.shape,
        (a, b, c, d),
        share=0.28,
        side=float(s.rng.uniform(0.0, 2.0 * math.pi)),
        view=s.view(path),
        seed=int(s.rng.integers(1 << 20)),
    )
    return {"path": path, "distractors": (equal,), "covers": (hand,)}


def visible_at_first(s: EffectSetting, path: Path, share: float) -> Callable[[Shape], bool]:
    """Whether a part on the table has at least a share of its outline in the first image."""
    camera = Pinhole(s.width, s.height)
    H, limit = path.table_to_image(camera)[0], np.array([s.width - 1, s.height - 1])

    def fits_view(shape: Shape) -> bool:
        seen = apply_homography(H, shape.samples(120))
        return bool(np.all((seen >= 0.0) & (seen <= limit), axis=1).mean() >= share)

    return fits_view


def _nearest_place_outside(s: EffectSetting, path: Path, direction: float, turn: float) -> tuple[float, float]:
    """The nearest place in a direction at which an equal part does not show in the first image."""
    camera = Pinhole(s.width, s.height)
    H, limit = path.table_to_image(camera)[0], np.array([s.width - 1, s.height - 1])
    for distance in np.arange(0.0, 12.0, 0.05):
        shift = (float(distance * math.cos(direction)), float(distance * math.sin(direction)))
        seen = apply_homography(H, s.shape.moved(turn, shift).outer)
        low, high = seen.min(axis=0) - OUT, seen.max(axis=0) + OUT
        if np.any(high < 0.0) or np.any(low > limit):
            break
    return shift


# --- prints --------------------------------------------------------------------------------------


@lru_cache(maxsize=4 * PATTERNS)
def _cached_print_texture(kind: str, pattern: int, level: float) -> TextureMap:
    make, contrast = (printed_texture, 240.0 / level) if kind == "words" else (picture_texture, 1.0)
    return make(pattern, colour=(level, level, level), contrast=contrast).grey


def drawn_print(s: EffectSetting, kind: str, pattern: int) -> TextureMap:
    """A print at the part's level; an ink that would be too faint or too strong is kept within the grey levels."""
    return adjust_grey_level(_cached_print_texture(kind, pattern, 80.0 if s.level < 110.0 else 150.0), s.level, s.rng)


def printed_part(s: EffectSetting) -> Parts:
    """Words, or a picture, on a part that tilts."""
    kind, pattern = str(s.rng.choice(["words", "picture"])), int(s.rng.integers(PATTERNS))
    return {"path": s.course(tilt=math.radians(28.0)), "surface": drawn_print(s, kind, pattern)}


def print_exchange(s: EffectSetting) -> Parts:
    """The other print is of the same kind and as light."""
    kind, patterns = str(s.rng.choice(["words", "picture"])), s.rng.permutation(PATTERNS)
    own, other = (drawn_print(s, kind, int(k)) for k in patterns[:2])
    start, end = (round(f) for f in s.at(0.35, 0.65))
    guest = Guest(max(1, start), end, s.shape, other)
    return {"path": s.course(), "surface": own, "guests": (guest,)}
