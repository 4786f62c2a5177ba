# SPDX-License-Identifier: Apache-2.0
"""Outlines of flat parts, made from lines and arcs. Unit: square root of a part's own area; origin: its centroid."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

ARC_STEP = math.radians(4.0)  # chord to arc: 0.06 % of the radius, far below what any image here resolves


@dataclass(frozen=True)
class Shape:
    """A flat part.

    Attributes:
        name: what it is called in tables.
        outer: (N, 2) outer polygon, x right, y down, positive signed area.
        holes: polygons (M, 2) with negative signed area.
    """

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
        rings = [_directed(np.asarray(outer, dtype=np.float64), 1.0)]
        rings += [_directed(np.asarray(hole, dtype=np.float64), -1.0) for hole in holes]
        moments = np.sum([polygon_moments(ring) for ring in rings], axis=0)
        if not moments[0] > 0.0:
            raise ValueError(f"{name}: the holes leave no material")
        centre, scale = moments[1:] / moments[0], 1.0 / math.sqrt(moments[0])
        first, *rest = [(ring - centre) * scale for ring in rings]
        return cls(name, first, tuple(rest))


def polygon_moments(polygon: Floats) -> Floats:
    """(3,) signed area and first moments (x, y) of a polygon (N, 2), by Green's theorem."""
    x, y = polygon.T
    xn, yn = np.roll(x, -1), np.roll(y, -1)
    cross = x * yn - xn * y
    return np.array([cross.sum() / 2.0, ((x + xn) * cross).sum() / 6.0, ((y + yn) * cross).sum() / 6.0])


def _directed(polygon: Floats, sign: float) -> Floats:
    return polygon if polygon_moments(polygon)[0] * sign > 0 else polygon[::-1].copy()


def circle(x: float, y: float, radius: float, points: int = 90) -> Floats:
    """A regular polygon (points, 2) whose area is that of the circle."""
    angles = np.arange(points) * (2.0 * math.pi / points)
    grown = radius / math.sqrt(math.sin(2.0 * math.pi / points) * points / (2.0 * math.pi))
    return np.array([x, y]) + grown * np.column_stack([np.cos(angles), np.sin(angles)])


def rounded(vertices: ArrayLike, radii: float | Sequence[float]) -> Floats:
    """A polygon whose corners are rounded by arcs tangent to both sides.

    Args:
        vertices: (N, 2) corners.
        radii: one radius, or one for each corner; 0 keeps it sharp.
    """
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


def bracket() -> Shape:
    """An L-plate with one chamfer and one hole: distinct axes, no symmetry, corners and round parts."""
    outer = rounded(
        [(0, 0), (1.5, 0), (1.75, 0.28), (1.75, 0.62), (0.72, 0.62), (0.66, 1.25), (0.08, 1.25)],
        [0.12, 0.05, 0.05, 0.2, 0.16, 0.22, 0.1],
    )
    return Shape.of("bracket", outer, [circle(0.37, 0.9, 0.13)])


def spanner() -> Shape:
    """An open-ended spanner: a narrow handle, a forked jaw, a round end with a hole."""
    jaw = [(-1.9, 0.36), (-2.45, 0.28), (-2.75, 0.42), (-2.72, 0.16), (-2.3, 0.1)]
    jaw += [(-2.2, -0.12), (-2.55, -0.2), (-2.62, -0.44), (-2.25, -0.46), (-1.86, -0.22)]
    end = circle(0.0, 0.0, 0.36, 60)
    end = end[np.abs(np.arctan2(end[:, 1], -end[:, 0])) > 0.5]
    order = np.argsort(np.arctan2(end[:, 1], end[:, 0]))
    outer = np.concatenate([end[order], rounded(jaw, [0.2, 0.2, 0.04, 0.04, 0.1, 0.1, 0.04, 0.04, 0.2, 0.25])])
    return Shape.of("spanner", outer, [circle(0.0, 0.0, 0.16, 60)])


def gasket() -> Shape:
    """A flange gasket: a bore off the centre, three bolt holes and a lug."""
    outer = rounded(
        [(-0.9, -0.6), (0.55, -0.6), (0.95, -0.95), (1.25, -0.6), (0.9, 0.6), (-0.6, 0.75), (-1.1, 0.2)],
        [0.2, 0.15, 0.12, 0.12, 0.3, 0.3, 0.2],
    )
    holes = [circle(0.0, 0.0, 0.34), circle(-0.72, -0.32, 0.09, 48), circle(0.62, 0.34, 0.09, 48)]
    return Shape.of("gasket", outer, [*holes, circle(0.9, -0.62, 0.09, 48)])


def notched_plate() -> Shape:
    """A rounded plate with a notch in one side, none of its sides parallel to another."""
    outer = rounded(
        [(-0.8, -0.5), (0.1, -0.5), (0.16, -0.28), (0.4, -0.28), (0.46, -0.5), (0.8, -0.5), (0.74, 0.5), (-0.7, 0.42)],
        [0.14, 0.03, 0.04, 0.04, 0.03, 0.14, 0.05, 0.2],
    )
    return Shape.of("notched-plate", outer)


def blob() -> Shape:
    """A smooth outline without corners: an ellipse-like curve with a few harmonics."""
    angles = np.arange(240) * (2.0 * math.pi / 240)
    radius = 1.0 + 0.28 * np.cos(2 * angles - 0.4) + 0.13 * np.cos(3 * angles + 0.9) + 0.05 * np.cos(5 * angles - 1.7)
    return Shape.of("blob", np.column_stack([radius * np.cos(angles), radius * np.sin(angles)]))


def rectangle() -> Shape:
    """Maps to itself by a half turn: the direction of its axes is open."""
    return Shape.of("rectangle", [(-0.8, -0.5), (0.8, -0.5), (0.8, 0.5), (-0.8, 0.5)])


def disc() -> Shape:
    """No axes at all, and a homography that its outline leaves partly free."""
    return Shape.of("disc", circle(0.0, 0.0, 1.0, 180))


SHAPES: dict[str, Callable[[], Shape]] = {
    "bracket": bracket,
    "spanner": spanner,
    "gasket": gasket,
    "notched-plate": notched_plate,
    "blob": blob,
    "rectangle": rectangle,
    "disc": disc,
}
"""Every shape by its name."""
