# SPDX-License-Identifier: Apache-2.0
"""Other parts: near twins and mirror images of one, and what else lies on the table."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack.errors import ContourError
from grasptrack.typing import Floats
from grasptrack_bench.simulation.outlines import Shape, inside_polygons
from grasptrack_bench.simulation.textures import TextureMap, blank_texture

SYMMETRIC = 0.04
"""sqrt(area); an outline that comes this near to its own mirror image has none that could be told from it."""
TURNS = 120
SAME = 0.002
"""sqrt(area); nearer than this, no better fit is looked for."""
ROOM = ((0.93, 0.06), (0.8, 0.04), (0.6, 0.025))
"""What a place for a notch or tab needs, the next where the outline has no such place: how straight it is (chord over
length), and how much a notch leaves of the material, a tab of the gap, in sqrt(area)."""


@dataclass(frozen=True)
class Fit:
    """The rigid motion that lays one outline on another best: a turn about the origin, rad, then a shift (2,).

    The distance is the largest left between them, from either to the other, in their unit.
    """

    distance: float
    turn: float
    shift: tuple[float, float]


def best_fit(moving: Shape, fixed: Shape) -> Fit:
    """The best rigid motion of one outline onto another, holes included: all turns in steps, the best ones refined."""
    a, b = moving.samples(130), fixed.samples(130)
    turns = np.arange(TURNS) * (2.0 * math.pi / TURNS)
    za, zb = a[:, 0] + 1j * a[:, 1], (b[:, 0] + 1j * b[:, 1]).conj()
    middle, goal = za.mean(), zb.mean().conj()
    za, zb = za - middle, zb - zb.mean()
    squares = (np.abs(za) ** 2)[:, None] + (np.abs(zb) ** 2)[None]
    worst = np.empty(TURNS)
    for i, turn in enumerate(turns):
        gap = squares - 2.0 * np.real(np.outer(za * np.exp(1j * turn), zb))
        worst[i] = max(gap.min(axis=1).max(), gap.min(axis=0).max())
    best: Fit | None = None
    for i in np.argsort(worst, kind="stable")[:3]:
        away = goal - middle * np.exp(1j * turns[i])
        fit = _refine_fit(moving, fixed, float(turns[i]), np.array([away.real, away.imag]))
        best = fit if best is None or fit.distance < best.distance else best
        if best.distance < SAME:
            break
    assert best is not None
    return best


def _refine_fit(moving: Shape, fixed: Shape, turn: float, shift: Floats) -> Fit:
    """Iterated closest points from a first turn; the better of where they began and where they ended."""
    b = fixed.samples(260)
    first = _measure_fit(moving, fixed, turn, shift)
    if first.distance < SAME:
        return first
    for _ in range(5):
        points = moving.moved(turn, shift).samples(130)
        gap = (points[:, 0, None] - b[:, 0]) ** 2 + (points[:, 1, None] - b[:, 1]) ** 2
        near = b[np.argmin(gap, axis=1)]
        p, q = points - points.mean(axis=0), near - near.mean(axis=0)
        step = math.atan2(float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum()), float((p * q).sum()))
        c, s = math.cos(step), math.sin(step)
        shift = np.array([[c, -s], [s, c]]) @ (shift - points.mean(axis=0)) + near.mean(axis=0)
        turn += step
    last = _measure_fit(moving, fixed, turn, shift)
    return last if last.distance < first.distance else first


def _measure_fit(moving: Shape, fixed: Shape, turn: float, shift: Floats) -> Fit:
    now = moving.moved(turn, shift)
    distance = max(_max_outline_distance(now.samples(180), fixed), _max_outline_distance(fixed.samples(180), now))
    return Fit(distance, turn, (float(shift[0]), float(shift[1])))


def _max_outline_distance(points: Floats, shape: Shape) -> float:
    """Largest distance of points (N, 2) from a shape's outlines."""
    starts = np.concatenate(shape.polygons)
    sides = np.concatenate([np.roll(p, -1, axis=0) - p for p in shape.polygons])
    tx, ty = points[:, 0, None] - starts[:, 0], points[:, 1, None] - starts[:, 1]
    sx, sy = sides[:, 0], sides[:, 1]
    along = np.clip((tx * sx + ty * sy) / np.maximum(sx * sx + sy * sy, 1e-300), 0.0, 1.0)
    return float(np.sqrt(((tx - along * sx) ** 2 + (ty - along * sy) ** 2).min(axis=1).max()))


def mirrored_shape(shape: Shape) -> Shape:
    """The mirror image, laid over the part itself as well as a rigid motion can."""
    image = shape.flipped()
    fit = best_fit(image, shape)
    return image.moved(fit.turn, fit.shift)


def mirror_symmetric(shape: Shape) -> bool:
    """Whether the outline comes within SYMMETRIC of its own mirror image."""
    return best_fit(shape.flipped(), shape).distance <= SYMMETRIC


def near_twin(shape: Shape, seed: int = 0) -> Shape:
    """The same part but for one notch or tab, 10 to 15 % of sqrt(area) wide and deep, somewhere on its outer outline."""
    rng = np.random.default_rng((seed, zlib.crc32(shape.name.encode()), 41))
    for straight, clearance in ROOM:
        for _ in range(300):
            width, depth = rng.uniform(0.10, 0.15, 2)
            signed = float(depth if rng.uniform() < 0.5 else -depth)
            ring = _add_tab_or_notch(shape, float(rng.uniform()), float(width), signed, straight, clearance)
            if ring is not None:
                return Shape(f"{shape.name}, near twin", ring, shape.holes)
    raise ContourError(f"{shape.name}: no room for a notch or a tab of 10 % of its size")


def _add_tab_or_notch(
    shape: Shape, place: float, width: float, depth: float, straight: float, clearance: float
) -> Floats | None:
    """The outer polygon with a tab (depth > 0) or notch on a stretch from a share of its length on; None if it fails."""
    ring = shape.outer
    sides = np.roll(ring, -1, axis=0) - ring
    run = np.concatenate([[0.0], np.cumsum(np.hypot(sides[:, 0], sides[:, 1]))])
    total = float(run[-1])
    start = place * total
    if total < 4.0 * width:
        return None

    def point_at(s: float) -> Floats:
        i = min(int(np.searchsorted(run, s % total, side="right")) - 1, len(ring) - 1)
        return np.asarray(ring[i] + sides[i] * ((s % total - run[i]) / max(run[i + 1] - run[i], 1e-300)))

    a, b = point_at(start), point_at(start + width)
    chord = b - a
    length = float(np.hypot(chord[0], chord[1]))
    if length < straight * width:  # a bend
        return None
    t = chord / length
    n = np.array([t[1], -t[0]])  # out of the material
    slope = 0.12 * width * t
    bump = np.array([a, a + depth * n + slope, b + depth * n - slope, b])
    after = (run[:-1] - start) % total  # of each corner, along the outline from the bump's first foot
    rest = np.flatnonzero(after > width + 1e-9)
    rest = rest[np.argsort(after[rest], kind="stable")]
    new = np.concatenate([bump, ring[rest]])

    feet = np.linspace(0.15, 1.0, 8)[:, None]
    probes = np.concatenate([a + feet * (bump[1] - a), bump[1] + feet * (bump[2] - bump[1]), b + feet * (bump[2] - b)])
    inside = inside_polygons(shape.polygons, probes)
    if inside.any() if depth > 0.0 else not inside.all():
        return None
    far = np.linspace(width + 0.05, total - 0.05, 400)
    others = np.concatenate([np.array([point_at(start + s) for s in far]), *(h for h in shape.holes)])
    # Near its feet the bump is near the outline it grew from; there, only its far side has to be clear.
    face = probes[8:16]
    gap = np.sqrt(((face[:, None] - others[None]) ** 2).sum(axis=2)).min()
    return new if gap >= clearance else None


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
    surface: TextureMap | None = None
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
    """How far every place of the table is from what lies there."""

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
        """The shift of a part that is pushed toward the origin until it nearly meets something; None where it meets nothing.

        It is turned as it is to lie, and comes from a direction, rad; table units of clearance are left.
        """
        way = np.array([math.cos(direction), math.sin(direction)])
        outer = Shape("", shape.outer).samples(160)
        distances = np.arange(WIDE - shape.radius(), 0.0, -CELL)
        clear = self.clearance(outer + (distances[:, None] * way)[:, None]).min(axis=1) >= clearance
        met = int(np.argmin(clear))
        if clear[met] or met == 0:
            return None
        return float(distances[met - 1] * way[0]), float(distances[met - 1] * way[1])


class PlacedPart(NamedTuple):
    """A part that found a place: its number among those that were to lie there, its turn in rad, then its shift."""

    number: int
    turn: float
    shift: tuple[float, float]


def place_beside(
    part: Shape,
    shapes: Sequence[Shape],
    rng: np.random.Generator,
    *,
    gaps: Sequence[tuple[float, float]],
    fits: Callable[[Shape], bool],
) -> list[PlacedPart]:
    """Places for parts beside an object at the origin, none of which touches another; those for which one was found.

    Between each and what it lies next to are table units, least and most; `fits` says whether it is wanted there.
    """
    placed: list[PlacedPart] = []
    lying = [part]
    for number, shape in enumerate(shapes):
        room = Room(lying)
        for _ in range(TRIES):
            turn, direction = (float(v) for v in rng.uniform(0.0, 2.0 * math.pi, 2))
            shift = room.pushed_up(shape.moved(turn), direction, float(rng.uniform(*gaps[number])))
            if shift is None or not fits(shape.moved(turn, shift)):
                continue
            placed.append(PlacedPart(number, turn, shift))
            lying.append(shape.moved(turn, shift))
            break
    return placed


def sheet_under(part: Shape, rng: np.random.Generator, level: float) -> Distractor:
    """A blank sheet of paper under a part, somewhat larger than it.

    Half of them lie parallel to the part's sides, as near as the least rectangle around it does; the others are askew.
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
