# SPDX-License-Identifier: Apache-2.0
"""A flat part as a body: an outline in m, extruded and cut into convex pieces, with its mass and what it stands on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from grasptrack.errors import ContourError, InputError, install_hint
from grasptrack.typing import Floats, Ints
from grasptrack_bench.simulation.outlines import Shape, polygon_moments

_STRAIGHT = 1e-9
"""Share of the polygon's own area below which a corner counts as straight."""


def convex_pieces(polygons: Sequence[Floats]) -> list[Floats]:
    """Convex polygons that cover the inside of a polygon exactly, and do not overlap: physics takes the convex hull of each.

    Diagonals of a triangulation that convexity does not need are taken out again (S. Hertel and K. Mehlhorn 1983), which leaves
    at most four times the least number of pieces.

    Args:
        polygons: (N, 2) the outer one with positive signed area, then holes with negative; simple, holes inside the outer.

    Returns:
        (M, 2) each with positive signed area.
    """
    try:
        from mapbox_earcut import triangulate_float64
    except ImportError:
        raise InputError(f"the physical world needs mapbox_earcut: {install_hint('sim')}") from None
    points = np.concatenate(polygons)
    ends = np.cumsum([len(polygon) for polygon in polygons]).astype(np.uint32)
    triangles = triangulate_float64(points, ends).reshape(-1, 3).astype(np.int64)
    areas = np.array([_twice_area(points[t]) for t in triangles])
    triangles[areas < 0.0] = triangles[areas < 0.0, ::-1]
    whole = sum(_twice_area(polygon) for polygon in polygons)
    if abs(np.abs(areas).sum() - whole) > 1e-5 * abs(whole):
        raise ContourError("the outline crosses itself: it cannot be cut into convex pieces", points=len(points))
    tiny = _STRAIGHT * whole
    return _merge_triangles(points, triangles[np.abs(areas) > tiny], tiny)


def _twice_area(polygon: Floats) -> float:
    (x, y), (xn, yn) = polygon.T, np.roll(polygon, -1, axis=0).T
    return float((x * yn - xn * y).sum())


def _merge_triangles(points: Floats, triangles: Ints, tiny: float) -> list[Floats]:
    pieces: dict[int, list[int]] = dict(enumerate(triangles.tolist()))
    owner = {edge: n for n, t in pieces.items() for edge in zip(t, [*t[1:], t[0]], strict=True)}
    for i, j in [edge for edge in owner if edge[::-1] in owner and edge[0] < edge[1]]:
        one, other = owner[i, j], owner[j, i]
        if one == other:
            continue
        p, q = pieces[one], pieces[other]
        at, to = p.index(i), q.index(j)
        # round p from j to i, then round q from i to j
        joined = [*p[at + 1 :], *p[: at + 1], *(q[to + 1 :] + q[:to])[1:]]
        if len(set(joined)) != len(joined) or min(_turn_at(points, joined, c) for c in (i, j)) < -tiny:
            continue
        pieces[one] = joined
        del pieces[other]
        owner.update(dict.fromkeys(zip(joined, [*joined[1:], joined[0]], strict=True), one))
    return [points[piece] for piece in pieces.values()]


def _turn_at(points: Floats, piece: list[int], corner: int) -> float:
    """Positive where a piece is convex at a corner: twice the area of the triangle of the corner and its neighbours."""
    at = piece.index(corner)
    return _twice_area(points[[piece[at - 1], corner, piece[(at + 1) % len(piece)]]])


TOLERANCE = 1.5e-4
"""m by which the sides of the body may differ from the outline: below what a pad feels."""
MOST_PIECES = 100
"""Convex pieces beyond which the tolerance is doubled: every piece costs time in each step."""
FEET = 8
"""Points on which it stands at most: corners of its convex hull, where a flat part on a flat table rests."""


@dataclass(frozen=True)
class Body:
    """A flat part in its own axes: x right and y toward the top as seen from above, z up, from the centroid of its foot.

    Attributes:
        size: m, the square root of the area.
        shape: the outline in m, x right and y down as all outlines are.
        thickness: m.
        mass: kg.
        inertia: (3,) kg m^2 about the centre of mass, in the frame of `axis`.
        axis: rad, angle of the first principal axis from x.
        pieces: convex polygons (M, 2) in its own axes that make it up.
        feet: (f, 2) points of its convex hull, in its own axes.
    """

    size: float
    shape: Shape
    thickness: float
    mass: float
    inertia: Floats
    axis: float
    pieces: tuple[Floats, ...]
    feet: Floats


def extrude_body(shape: Shape, size: float, thickness: float, density: float) -> Body:
    """A part cut from a plate.

    Args:
        shape: its outline, of any unit of length in which its area is 1.
        size: m, the square root of its area.
        thickness: m.
        density: kg/m^3.
    """
    scaled = Shape(shape.name, shape.outer * size, tuple(hole * size for hole in shape.holes))
    mass = density * thickness * size * size
    moments = _second_moments([ring * np.array([1.0, -1.0]) for ring in scaled.polygons]) * density * thickness
    values, vectors = np.linalg.eigh(moments)
    # the moment about an axis is what lies off it, and a plate of finite thickness has some along z as well
    slab = mass * thickness**2 / 12.0
    inertia = np.array([values[1] + slab, values[0] + slab, values.sum()])
    axis = math.atan2(vectors[1, 0], vectors[0, 0])
    pieces = _split_into_convex(scaled)
    return Body(size, scaled, thickness, mass, inertia, axis, pieces, _support_points(scaled))


def _split_into_convex(shape: Shape) -> tuple[Floats, ...]:
    tolerance = TOLERANCE
    while True:
        rings = [_simplify_ring(ring, tolerance) for ring in shape.polygons]
        found = convex_pieces([ring for ring in rings if len(ring) >= 3])
        if len(found) <= MOST_PIECES or tolerance > 1e-3:
            break
        tolerance *= 2.0
    # y turned up reverses the direction of a polygon
    return tuple((piece * np.array([1.0, -1.0]))[::-1] for piece in found)


def _simplify_ring(ring: Floats, tolerance: float) -> Floats:
    kept = cv2.approxPolyDP(np.asarray(ring[:, None] * 1e3, dtype=np.float32), tolerance * 1e3, closed=True)
    return np.asarray(kept[:, 0], dtype=np.float64) * 1e-3


def _support_points(shape: Shape) -> Floats:
    """Corners of the convex hull, farthest apart in turn."""
    outer = shape.outer * np.array([1.0, -1.0])
    hull = outer[cv2.convexHull(outer.astype(np.float32), returnPoints=False)[:, 0]]
    angles = np.arange(FEET) * (2.0 * math.pi / FEET)
    best = np.unique((hull @ np.array([np.cos(angles), np.sin(angles)])).argmax(axis=0))
    return np.asarray(hull[best], dtype=np.float64)


def _second_moments(polygons: list[Floats]) -> Floats:
    """(2, 2) integral of x x^T over the area about the origin, by Green's theorem; the sign of the area is taken out."""
    total, area = np.zeros((2, 2)), 0.0
    for polygon in polygons:
        p, q = polygon, np.roll(polygon, -1, axis=0)
        cross = p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]
        both = np.einsum("n,ni,nj->ij", cross, p, p) + np.einsum("n,ni,nj->ij", cross, q, q)
        mixed = np.einsum("n,ni,nj->ij", cross, p, q)
        total += (both + 0.5 * (mixed + mixed.T)) / 12.0
        area += float(polygon_moments(polygon)[0])
    return np.asarray(total * math.copysign(1.0, area), dtype=np.float64)
