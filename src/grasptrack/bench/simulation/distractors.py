# SPDX-License-Identifier: Apache-2.0
"""What else lies on the table: other parts beside the object, a sheet of paper under it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from grasptrack.bench.simulation.outlines import Shape
from grasptrack.bench.simulation.surfaces import blank_texture
from grasptrack.bench.simulation.texture import Texture
from grasptrack.typing import Floats

TRIES = 60
"""Places that are drawn for one distractor before it is left out."""
WIDE = 7.0
"""Table units from the origin within which places are sought; what is seen is nearer."""
CELL = 0.0125
"""Table units; places are sought on a grid this fine."""


@dataclass(frozen=True)
class Distractor:
    """Something on the table that is not the object, drawn before it.

    Attributes:
        shape: its outline, about its own origin.
        surface: its texture, which is placed as the shape is; None is that of the object.
        turn: rad, about its origin.
        shift: (x, y) table units, then.
        away: (x, y) table units from its place to the one that it comes from.
        times: frames at which it sets out and comes to rest; None where it lies there from the first frame on.
        flat: it has no thickness even where the object has.
    """

    shape: Shape
    surface: Texture | None = None
    turn: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)
    away: tuple[float, float] = (0.0, 0.0)
    times: tuple[float, float] | None = None
    flat: bool = False

    def place(self, time: float) -> Floats:
        """(3, 3) from its own plane to the table at a time in frames."""
        share = 0.0
        if self.times is not None:
            share = float(np.clip((self.times[1] - time) / max(1e-9, self.times[1] - self.times[0]), 0.0, 1.0))
            share = share * share * (3.0 - 2.0 * share)
        c, s = math.cos(self.turn), math.sin(self.turn)
        x, y = self.shift[0] + share * self.away[0], self.shift[1] + share * self.away[1]
        return np.array([[c, -s, x], [s, c, y], [0.0, 0.0, 1.0]])


def scale_shape(shape: Shape, size: float) -> Shape:
    """The same outline `size` times as large; its area is no longer 1."""
    outer, *holes = [ring * size for ring in shape.polygons]
    return Shape(shape.name, outer, tuple(holes))


class Room:
    """How far every place of the table is from what lies there.

    Args:
        shapes: what lies there.
    """

    def __init__(self, shapes: Sequence[Shape]) -> None:
        side = round(2.0 * WIDE / CELL) + 1
        free = np.ones((side, side), np.uint8)
        for shape in shapes:
            cv2.fillPoly(free, [np.rint((shape.outer + WIDE) / CELL).astype(np.int32)], 0.0)
        self._distance = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * np.float32(CELL)

    def clearance(self, points: Floats) -> Floats:
        """Table units from points (..., 2) to the nearest thing, to CELL; 0 inside of one."""
        at = np.clip(np.rint((points + WIDE) / CELL), 0, len(self._distance) - 1).astype(np.int64)
        return np.asarray(self._distance[at[..., 1], at[..., 0]], dtype=np.float64)

    def pushed_up(self, shape: Shape, direction: float, clearance: float) -> tuple[float, float] | None:
        """Where a part ends that is pushed toward the origin along a direction until it nearly meets something.

        Args:
            shape: the part, turned as it is to lie.
            direction: rad, from the origin to where it comes from.
            clearance: table units that are left between it and what it meets.

        Returns:
            Its shift; None where it meets nothing.
        """
        way = np.array([math.cos(direction), math.sin(direction)])
        outer = Shape("", shape.outer).samples(160)
        distances = np.arange(WIDE - shape.radius(), 0.0, -CELL)
        clear = self.clearance(outer + (distances[:, None] * way)[:, None]).min(axis=1) >= clearance
        met = int(np.argmin(clear))
        if clear[met] or met == 0:
            return None
        return float(distances[met - 1] * way[0]), float(distances[met - 1] * way[1])


def place_beside(
    part: Shape,
    shapes: Sequence[Shape],
    rng: np.random.Generator,
    *,
    gaps: Sequence[tuple[float, float]],
    fits: Callable[[Shape], bool],
) -> list[tuple[int, float, tuple[float, float]]]:
    """Places for parts beside an object, none of which touches another.

    Args:
        part: the object, at the origin.
        shapes: what is to lie beside it.
        rng: for directions and turns.
        gaps: table units, least and most, between each and what it lies next to.
        fits: whether a part at its place is wanted there, as when it is in view.

    Returns:
        Number in `shapes`, turn in rad, and shift of each for which a place was found.
    """
    placed: list[tuple[int, float, tuple[float, float]]] = []
    lying = [part]
    for number, shape in enumerate(shapes):
        room = Room(lying)
        for _ in range(TRIES):
            turn, direction = (float(v) for v in rng.uniform(0.0, 2.0 * math.pi, 2))
            shift = room.pushed_up(shape.moved(turn), direction, float(rng.uniform(*gaps[number])))
            if shift is None or not fits(shape.moved(turn, shift)):
                continue
            placed.append((number, turn, shift))
            lying.append(shape.moved(turn, shift))
            break
    return placed


def sheet_under(part: Shape, rng: np.random.Generator, level: float) -> Distractor:
    """A blank sheet of paper under a part, somewhat larger than it.

    Half of them lie parallel to the part's sides, as near as the least rectangle around it does; the others are askew.

    Args:
        part: it, at the origin.
        rng: for its size and direction.
        level: its grey level.
    """
    turn = math.radians(float(cv2.minAreaRect(part.outer.astype(np.float32))[2]))
    if rng.uniform() < 0.5:
        turn += float(rng.uniform(-0.35, 0.35))
    c, s = math.cos(turn), math.sin(turn)
    aligned = part.outer @ np.array([[c, -s], [s, c]])
    low = aligned.min(axis=0) - rng.uniform(0.05, 0.3, 2)
    high = aligned.max(axis=0) + rng.uniform(0.05, 0.3, 2)
    ring = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    paper = blank_texture(int(rng.integers(1 << 20)), size=256, colour=(level, level, level), contrast=0.4).grey
    return Distractor(Shape("sheet", ring), paper, turn=turn, flat=True)
