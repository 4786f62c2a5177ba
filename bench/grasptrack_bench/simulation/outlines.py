# SPDX-License-Identifier: Apache-2.0
"""A flat part's outline: its polygons, and how to draw them from lines, arcs, strokes and fields."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import contourpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.typing import Floats

ARC_STEP = math.radians(4.0)  # chord to arc: 0.06 % of the radius, far below what any image here resolves


@dataclass(frozen=True)
class Shape:
    """A flat part: its outer polygon (N, 2), x right, y down, of positive signed area, and holes (M, 2) of negative."""

    name: str
    outer: Floats
    holes: tuple[Floats, ...] = ()

    @property
    def polygons(self) -> tuple[Floats, ...]:
        """The outer polygon, then the holes."""
        return (self.outer, *self.holes)

    @classmethod
    def of(cls, name: str, outer: ArrayLike, holes: Sequence[ArrayLike] = ()) -> Shape:
        """A shape from polygons in any unit, direction and place: brought to area 1 with its centroid at the origin."""
        rings = [_orient_polygon(np.asarray(outer, dtype=np.float64), 1.0)]
        rings += [_orient_polygon(np.asarray(hole, dtype=np.float64), -1.0) for hole in holes]
        area, centre = area_and_centroid(rings)
        if not area > 0.0:
            raise ValueError(f"{name}: the holes leave no material")
        scale = 1.0 / math.sqrt(area)
        first, *rest = [(ring - centre) * scale for ring in rings]
        return cls(name, first, tuple(rest))

    def moved(self, turn: float, shift: ArrayLike = (0.0, 0.0)) -> Shape:
        """The same part turned by `turn` rad about the origin, then shifted, in its own units."""
        c, s = math.cos(turn), math.sin(turn)
        outer, *holes = [ring @ np.array([[c, s], [-s, c]]) + np.asarray(shift) for ring in self.polygons]
        return Shape(self.name, outer, tuple(holes))

    def flipped(self) -> Shape:
        """Its mirror image, left and right exchanged about the origin."""
        outer, *holes = [ring[::-1] * np.array([-1.0, 1.0]) for ring in self.polygons]
        return Shape(f"{self.name}, mirrored", outer, tuple(holes))

    def radius(self) -> float:
        """Distance from the origin to the farthest point."""
        return float(np.hypot(self.outer[:, 0], self.outer[:, 1]).max())

    def samples(self, count: int) -> Floats:
        """(count, 2) points at equal steps along all polygons together, by their lengths."""
        starts = np.concatenate(self.polygons)
        sides = np.concatenate([np.roll(p, -1, axis=0) - p for p in self.polygons])
        run = np.concatenate([[0.0], np.cumsum(np.hypot(sides[:, 0], sides[:, 1]))])
        at = (np.arange(count) + 0.5) * (run[-1] / count)
        side = np.clip(np.searchsorted(run, at, side="right") - 1, 0, len(sides) - 1)
        share = (at - run[side]) / np.maximum(run[side + 1] - run[side], 1e-300)
        return np.asarray(starts[side] + share[:, None] * sides[side], dtype=np.float64)


def area_and_centroid(polygons: Sequence[Floats]) -> tuple[float, Floats]:
    """Area, holes (of negative area) subtracted, and centroid (2,)."""
    area, x, y = np.sum([polygon_moments(polygon) for polygon in polygons], axis=0)
    return float(area), np.array([x, y]) / area


def polygon_moments(polygon: Floats) -> Floats:
    """(3,) signed area and first moments (x, y) of a polygon (N, 2), by Green's theorem."""
    x, y = polygon.T
    xn, yn = np.roll(x, -1), np.roll(y, -1)
    cross = x * yn - xn * y
    return np.array([cross.sum() / 2.0, ((x + xn) * cross).sum() / 6.0, ((y + yn) * cross).sum() / 6.0])


def _orient_polygon(polygon: Floats, sign: float) -> Floats:
    return polygon if polygon_moments(polygon)[0] * sign > 0 else polygon[::-1].copy()


def circle_polygon(x: float, y: float, radius: float, points: int = 90) -> Floats:
    """A regular polygon (points, 2) whose area is that of the circle."""
    angles = np.arange(points) * (2.0 * math.pi / points)
    grown = radius / math.sqrt(math.sin(2.0 * math.pi / points) * points / (2.0 * math.pi))
    return np.array([x, y]) + grown * np.column_stack([np.cos(angles), np.sin(angles)])


def round_corners(vertices: ArrayLike, radii: float | Sequence[float]) -> Floats:
    """A polygon (N, 2) whose corners are rounded by arcs tangent to both sides; a radius of 0 keeps one sharp."""
    corners = np.asarray(vertices, dtype=np.float64)
    sizes = np.broadcast_to(np.asarray(radii, dtype=np.float64), (len(corners),))
    points: list[Floats] = []
    for before, corner, after, radius in zip(
        np.roll(corners, 1, axis=0), corners, np.roll(corners, -1, axis=0), sizes, strict=True
    ):
        u, v = before - corner, after - corner
        u, v = u / np.linalg.norm(u), v / np.linalg.norm(v)
        half = 0.5 * math.acos(float(np.clip(u @ v, -1.0, 1.0)))
        if radius <= 0.0 or half > 1.57:
            points.append(corner[None])
            continue
        centre = corner + (u + v) / np.linalg.norm(u + v) * (radius / math.sin(half))
        a, b = corner + u * radius / math.tan(half) - centre, corner + v * radius / math.tan(half) - centre
        turn = math.atan2(a[0] * b[1] - a[1] * b[0], float(a @ b))
        angles = np.linspace(0.0, turn, max(2, math.ceil(abs(turn) / ARC_STEP) + 1))
        normal = np.array([-a[1], a[0]])
        points.append(centre + np.cos(angles)[:, None] * a + np.sin(angles)[:, None] * normal)
    return np.concatenate(points)


def arc_points(x: float, y: float, radius: float, start: float, end: float) -> Floats:
    """Points (N, 2) on an arc from `start` to `end` degrees, both included; positive is from x to y."""
    count = max(2, math.ceil(abs(math.radians(end - start)) / ARC_STEP) + 1)
    angles = np.radians(np.linspace(start, end, count))
    return np.array([x, y]) + radius * np.column_stack([np.cos(angles), np.sin(angles)])


def stroke_outline(line: ArrayLike, half: ArrayLike) -> Floats:
    """The outline of a line (N, 2), close together where it bends, drawn with a round pen of half-widths (N,) or one.

    A half-width of 0 at an end makes it pointed.
    """
    centre = np.asarray(line, dtype=np.float64)
    radius = np.broadcast_to(np.asarray(half, dtype=np.float64), (len(centre),))
    along = np.gradient(centre, axis=0)
    along /= np.hypot(along[:, 0], along[:, 1])[:, None]
    across = np.column_stack([-along[:, 1], along[:, 0]]) * radius[:, None]
    rings = [
        centre + across,
        _round_cap(centre[-1], across[-1], 0.0),
        (centre - across)[::-1],
        _round_cap(centre[0], across[0], 180.0),
    ]
    ring = np.concatenate(rings)
    keep = np.hypot(*(ring - np.roll(ring, 1, axis=0)).T) > 1e-9  # a pointed end gives its tip twice
    return np.asarray(ring[keep], dtype=np.float64)


def _round_cap(end: Floats, across: Floats, turn: float) -> Floats:
    """The half circle about an end of a stroke, without its own ends."""
    angle = math.degrees(math.atan2(across[1], across[0])) + turn
    return arc_points(end[0], end[1], math.hypot(across[0], across[1]), angle, angle - 180.0)[1:-1]


def inside_polygons(polygons: Sequence[Floats], points: Floats) -> NDArray[np.bool_]:
    """(k,) whether points (k, 2) px lie inside, by the even-odd rule."""
    odd = np.zeros(len(points), dtype=np.bool_)
    for polygon in polygons:
        near = np.flatnonzero(np.all((points >= polygon.min(axis=0)) & (points <= polygon.max(axis=0)), axis=1))
        a, b = polygon, np.roll(polygon, -1, axis=0)
        x, y = points[near, 0, None], points[near, 1, None]
        spans = (a[:, 1] <= y) != (b[:, 1] <= y)
        rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
        crossing = a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / rise
        odd[near] ^= (np.count_nonzero(spans & (crossing <= x), axis=1) & 1).astype(np.bool_)
    return odd


def trace_isolines(field: NDArray[np.float32] | Floats, level: float) -> list[Floats]:
    """All closed curves (N, 2) px at `level`, by marching squares.

    Args:
        field: (H, W), below `level` all along its border, so that every curve closes.
        level: between two values of the field.

    Returns:
        Outer curves have positive signed area, x right and y down; curves around lower values have negative. The lowest
        curve comes first, and each ends in its lowest cell: where a curve begins decides which points a simplification keeps.
    """
    found = []
    tracer = contourpy.contour_generator(z=np.asarray(field, dtype=np.float64), line_type=contourpy.LineType.Separate)
    for closed in tracer.lines(level):
        ring = np.asarray(closed, dtype=np.float64)[:-1]
        column, row = np.floor(0.5 * (ring + np.roll(ring, -1, axis=0))).T
        lowest = int(np.lexsort((column, row))[-1])
        found.append((row[lowest], column[lowest], np.roll(ring, -(lowest + 2), axis=0)))
    return [ring for _, _, ring in sorted(found, key=lambda each: each[:2], reverse=True)]
