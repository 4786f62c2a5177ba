# SPDX-License-Identifier: Apache-2.0
"""Trays of parts that were taught in another image: how many are found, how exactly, and what is taken for a part that is none.

Each tray has 4 to 20 parts of 1 to 5 kinds on a table, each with a surface of its own, in a scale, tilt and light that differ
from those of the image in which its kind was taught.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grasptrack.geometry.homographies import apply_homography
from grasptrack.typing import Floats, Pixels
from grasptrack_bench.simulation import SHAPES, Conditions, Path, Pinhole, Scene, Shape
from grasptrack_bench.simulation.lookalikes import Distractor, Room
from grasptrack_bench.simulation.textures import TABLES, TextureMap, adjust_grey_level, another_surface

TAUGHT, TRAY = Pinhole(640, 480), Pinhole(1280, 960)
LEVELS = 35.0, 215.0
LEAST_CONTRAST = 50.0
"""Grey levels between a part and what it lies on."""


class Lying(NamedTuple):
    """A part in a tray: its kind, and (3, 3) from its own plane to the image."""

    kind: str
    H: Floats


class Tray(NamedTuple):
    """An image of a tray, and what lies in it."""

    image: Pixels
    lying: list[Lying]


def draw_table(level: float, rng: np.random.Generator) -> TextureMap:
    """A table of some kind at a grey level."""
    kind, contrast = str(rng.choice(list(TABLES))), float(rng.uniform(0.3, 0.9))
    made = TABLES[kind](int(rng.integers(99)), size=1024, colour=(150.0, 150.0, 150.0), contrast=contrast)
    return adjust_grey_level(made.grey, level, rng)


def look_from(distance: float, tilt: float, rng: np.random.Generator) -> Path:
    """A pose of the camera, in table units and rad."""
    turn, azimuth = rng.uniform(0.0, 2.0 * math.pi, 2)
    return Path(np.zeros((1, 2)), *(np.array([float(v)]) for v in (distance, turn, tilt, azimuth)))


def draw_conditions(rng: np.random.Generator) -> Conditions:
    """Lens, light and sensor."""
    return Conditions(blur=float(rng.uniform(0.6, 1.1)), noise=float(rng.uniform(1.0, 3.0)))


def draw_taught(shape: Shape, level: float, seed: int) -> tuple[Pixels, Floats]:
    """The image in which a kind is taught, and (3, 3) where it lies there."""
    rng = np.random.default_rng((seed, 1))
    table = level + (1.0 if level < 125.0 else -1.0) * float(rng.uniform(LEAST_CONTRAST, 90.0))
    share = 0.45 * TAUGHT.height
    path = look_from(2.0 * shape.radius() * TAUGHT.matrix[0, 0] / share / 1.3, float(rng.uniform(0.0, 0.15)), rng)
    scene = Scene(
        shape,
        path,
        camera=TAUGHT,
        table=draw_table(table, rng),
        surface=another_surface(level, rng),
        conditions=draw_conditions(rng),
        seed=seed,
    )
    return scene[0].image, path.table_to_image(TAUGHT)[0]


def draw_tray(shapes: list[Shape], levels: list[float], count: int, seed: int, gap: float = 0.08, tilt: float = 0.8) -> Tray:
    """A tray of some kinds."""
    rng = np.random.default_rng((seed, 2))
    dark = float(np.mean(levels)) < 125.0
    table = max(levels) + rng.uniform(LEAST_CONTRAST, 80.0) if dark else min(levels) - rng.uniform(LEAST_CONTRAST, 80.0)
    px = 100.0 * float(rng.uniform(0.75, 1.3))
    leaning = float(rng.uniform(0.0, tilt))
    path = look_from(TRAY.matrix[0, 0] / px, leaning, rng)
    H = path.table_to_image(TRAY)[0]
    limit = np.array([TRAY.width - 1, TRAY.height - 1])
    kinds = [int(k) for k in [*range(len(shapes)), *rng.integers(len(shapes), size=max(0, count - len(shapes)))]]
    placed: list[tuple[int, float, tuple[float, float]]] = []
    lying: list[Shape] = []
    for k in kinds:
        room = Room(lying) if lying else None
        for _ in range(60):
            turn, x, y = float(rng.uniform(0.0, 2 * math.pi)), *rng.uniform(-6.0, 6.0, 2).tolist()
            moved = shapes[k].moved(turn, (x, y))
            seen = apply_homography(H, moved.samples(80))
            if not bool(((seen > 6.0) & (seen < limit - 6.0)).all()):
                continue
            if room is not None and room.clearance(moved.samples(200)).min() < gap:
                continue
            placed.append((k, turn, (x, y)))
            lying.append(moved)
            break
    surfaces = [another_surface(levels[k], rng) for k, _, _ in placed]
    made = [Distractor(shapes[k], s, turn=t, shift=at) for (k, t, at), s in zip(placed, surfaces, strict=True)]
    away = Distractor(shapes[0], shift=(100.0, 100.0))
    conditions = draw_conditions(rng)
    far = Path(path.target, path.distance, path.roll, path.tilt, path.azimuth)
    scene = Scene(
        SHAPES["square"](), far, camera=TRAY, table=draw_table(float(np.clip(table, *LEVELS)), rng), distractors=(*made, away),
        conditions=conditions, seed=seed, moves=np.array([[60.0, 60.0, 0.0]]),
    )  # fmt: skip
    return Tray(scene[0].image, [Lying(shapes[k].name, H @ d.place(0.0)) for (k, _, _), d in zip(placed, made, strict=True)])
