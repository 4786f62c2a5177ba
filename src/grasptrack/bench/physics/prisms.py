# SPDX-License-Identifier: Apache-2.0
"""A polygon with holes as convex pieces: physics engines take the convex hull of whatever they are given.

Ears are clipped off (G. H. Meisters 1975), holes joined to the outer polygon by bridges before; then diagonals that convexity
does not need are taken out again (S. Hertel and K. Mehlhorn 1983), which leaves at most four times the least number of pieces.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grasptrack.errors import ContourError
from grasptrack.typing import Floats

_STRAIGHT = 1e-9
"""Share of the polygon's own area below which a corner counts as straight."""
_CROSSED = "the outline crosses itself: it cannot be cut into convex pieces"


def convex_pieces(polygons: Sequence[Floats]) -> list[Floats]:
    """Convex polygons that cover the inside of a polygon exactly, and do not overlap.

    Args:
        polygons: (N, 2) the outer one with positive signed area, then holes with negative; simple, holes inside the outer.

    Returns:
        (M, 2) each with positive signed area.

    Raises:
        ContourError: polygons that cross themselves or each other, so that no ear is left before the end.
    """
    points = _bridge_holes([np.asarray(p, dtype=np.float64) for p in polygons])
    doubled = float(_cross_product(points, np.roll(points, -1, axis=0)).sum())
    tiny = _STRAIGHT * abs(doubled)
    pieces = [points[piece] for piece in _merge_triangles(points, _clip_ears(points, tiny), tiny)]
    covered = sum(float(_cross_product(piece, np.roll(piece, -1, axis=0)).sum()) for piece in pieces)
    if abs(covered - doubled) > 1e-5 * abs(doubled):
        raise ContourError(_CROSSED, points=len(points))
    return pieces


def _cross_product(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], dtype=np.float64)


def _twice_signed_area(a: Floats, b: Floats, c: Floats) -> float:
    """Twice the signed area of a triangle."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _bridge_holes(polygons: list[Floats]) -> Floats:
    """One closed walk round all polygons: each hole is entered from its rightmost point and left the same way."""
    walk = polygons[0]
    holes = sorted(polygons[1:], key=lambda hole: -float(hole[:, 0].max()))
    for number, hole in enumerate(holes):
        start = int(hole[:, 0].argmax())
        ring = np.roll(hole, -start, axis=0)
        at = _nearest_visible_vertex(ring[0], walk, holes[number:])
        walk = np.concatenate([walk[: at + 1], ring, ring[:1], walk[at:]])
    return walk


def _nearest_visible_vertex(point: Floats, walk: Floats, holes: Sequence[Floats]) -> int:
    """The nearest vertex of the walk to which a straight line from `point` meets no side, and leads inside there."""
    before, after = np.roll(walk, 1, axis=0), np.roll(walk, -1, axis=0)
    sides = [(ring, np.roll(ring, -1, axis=0)) for ring in (walk, *holes)]
    starts, ends = np.concatenate([s for s, _ in sides]), np.concatenate([e for _, e in sides])
    for i in np.argsort(np.hypot(*(walk - point).T)):
        vertex = walk[i]
        left, right = (
            _twice_signed_area(before[i], vertex, point) > 0.0,
            _twice_signed_area(vertex, after[i], point) > 0.0,
        )
        convex = _twice_signed_area(before[i], vertex, after[i]) > 0.0
        if not ((left and right) if convex else (left or right)):
            continue
        way = vertex - point
        a, b = _cross_product(way, starts - point), _cross_product(way, ends - point)
        side = ends - starts
        c, d = _cross_product(side, point - starts), _cross_product(side, vertex - starts)
        ours = (np.abs(starts - vertex).sum(axis=1) == 0) | (np.abs(ends - vertex).sum(axis=1) == 0)
        ours |= (np.abs(starts - point).sum(axis=1) == 0) | (np.abs(ends - point).sum(axis=1) == 0)
        if not ((a * b <= 0.0) & (c * d <= 0.0) & ~ours).any():
            return int(i)
    raise ContourError("a hole of the outline cannot be reached from outside: do its polygons cross?")


def _clip_ears(points: Floats, tiny: float) -> list[tuple[int, int, int]]:
    """Triangles, as indices of points, that fill the walk."""
    left = list(range(len(points)))
    triangles: list[tuple[int, int, int]] = []
    at, idle = 0, 0
    while len(left) > 3:
        n = len(left)
        if idle > n:
            raise ContourError(_CROSSED, points=len(points))
        i, j, k = left[at % n], left[(at + 1) % n], left[(at + 2) % n]
        a, b, c = points[i], points[j], points[k]
        area = _twice_signed_area(a, b, c)
        if abs(area) <= tiny and not _turns_back(a, b, c):
            left.pop((at + 1) % n)  # a straight corner: nothing is cut off
            triangles.append((i, j, k))
            at, idle = max(0, at - 1), 0
        elif area > tiny and not _holds_any(points, left, (i, j, k)):
            triangles.append((i, j, k))
            left.pop((at + 1) % n)
            at, idle = at + 1, 0  # not the neighbour at once: fans of slivers would grow from one corner
        else:
            at, idle = at + 1, idle + 1
        at %= len(left)
    triangles.append((left[0], left[1], left[2]))
    return triangles


def _turns_back(a: Floats, b: Floats, c: Floats) -> bool:
    return float((b - a) @ (c - b)) < 0.0


def _holds_any(points: Floats, left: list[int], triangle: tuple[int, int, int]) -> bool:
    """Whether another vertex lies in the triangle or on its sides; those that coincide with its corners do not count."""
    a, b, c = (points[i] for i in triangle)
    p = points[left]
    inside = (
        (_cross_product(b - a, p - a) >= 0.0)
        & (_cross_product(c - b, p - b) >= 0.0)
        & (_cross_product(a - c, p - c) >= 0.0)
    )
    same = (p == a).all(axis=1) | (p == b).all(axis=1) | (p == c).all(axis=1)
    return bool((inside & ~same).any())


def _merge_triangles(points: Floats, triangles: list[tuple[int, int, int]], tiny: float) -> list[list[int]]:
    pieces: dict[int, list[int]] = {n: list(t) for n, t in enumerate(triangles)}
    owner = {edge: n for n, t in pieces.items() for edge in zip(t, [*t[1:], t[0]], strict=True)}
    for i, j in [edge for edge in owner if edge[::-1] in owner and edge[0] < edge[1]]:
        one, other = owner[i, j], owner[j, i]
        if one == other:
            continue
        p, q = pieces[one], pieces[other]
        at, to = p.index(i), q.index(j)
        # round p from j to i, then round q from i to j
        joined = [*p[at + 1 :], *p[: at + 1], *(q[to + 1 :] + q[:to])[1:]]
        if len(set(joined)) != len(joined) or not _convex_at(points, joined, (i, j), tiny):
            continue
        pieces[one] = joined
        del pieces[other]
        for edge in zip(joined, [*joined[1:], joined[0]], strict=True):
            owner[edge] = one
    areas = {n: float(_cross_product(points[p], np.roll(points[p], -1, axis=0)).sum()) for n, p in pieces.items()}
    return [p for n, p in pieces.items() if areas[n] > tiny]


def _convex_at(points: Floats, piece: list[int], corners: tuple[int, int], tiny: float) -> bool:
    for corner in corners:
        at = piece.index(corner)
        a, b, c = points[piece[at - 1]], points[corner], points[piece[(at + 1) % len(piece)]]
        if _twice_signed_area(a, b, c) < -tiny:
            return False
    return True
