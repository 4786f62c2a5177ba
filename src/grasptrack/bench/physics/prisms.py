# SPDX-License-Identifier: Apache-2.0
"""A polygon with holes as convex pieces: physics engines take the convex hull of whatever they are given.

Diagonals of a triangulation that convexity does not need are taken out again (S. Hertel and K. Mehlhorn 1983), which leaves at
most four times the least number of pieces.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grasptrack.errors import ContourError, InputError
from grasptrack.typing import Floats, Ints

_STRAIGHT = 1e-9
"""Share of the polygon's own area below which a corner counts as straight."""


def convex_pieces(polygons: Sequence[Floats]) -> list[Floats]:
    """Convex polygons that cover the inside of a polygon exactly, and do not overlap.

    Args:
        polygons: (N, 2) the outer one with positive signed area, then holes with negative; simple, holes inside the outer.

    Returns:
        (M, 2) each with positive signed area.

    Raises:
        ContourError: polygons that cross themselves or each other.
        InputError: the triangulation is not installed.
    """
    try:
        from mapbox_earcut import triangulate_float64
    except ImportError:
        raise InputError('the physical world needs mapbox_earcut: pip install "grasptrack[sim]"') from None
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
    """Twice the signed area."""
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
