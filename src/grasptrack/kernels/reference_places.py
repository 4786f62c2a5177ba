# SPDX-License-Identifier: Apache-2.0
"""Places on contours: the nearest to a point, and the point of a place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats


def _segment_end_indices(offsets: NDArray[np.int64], count: int) -> NDArray[np.intp]:
    following = np.arange(1, count + 1)
    following[offsets[1:] - 1] = offsets[:-1]
    return following


def locate(points: Floats, offsets: NDArray[np.int64], queries: Floats) -> Floats:
    """The nearest point of the outline to each query.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).
        queries: (k, 2) px.

    Returns:
        (k, 3) contour, position, distance in px. Of equally near places, the first.
    """
    side = points[_segment_end_indices(offsets, len(points))] - points
    square = np.einsum("ij,ij->i", side, side)
    square[square == 0] = 1.0
    out = np.empty((len(queries), 3))
    for row, query in zip(out, queries, strict=True):
        relative = query - points
        f = np.clip(np.einsum("ij,ij->i", relative, side) / square, 0.0, 1.0)
        gap = relative - f[:, None] * side
        distance = np.einsum("ij,ij->i", gap, gap)
        i = int(np.argmin(distance))
        c = int(np.searchsorted(offsets, i, side="right")) - 1
        place = i - offsets[c] + f[i]
        row[:] = c, place if place < offsets[c + 1] - offsets[c] else 0.0, np.sqrt(distance[i])
    return out


def fixed_places(points: Floats, offsets: NDArray[np.int64], queries: Floats) -> Floats:
    """`locate`, its numbers rounded to multiples of 2**-32, so that they can be told again without loss."""
    return np.asarray(np.rint(locate(points, offsets, queries) * 2.0**32) / 2.0**32)


def carry_places(places: Floats, offsets: NDArray[np.int64], points: Floats, current: NDArray[np.int64]) -> Floats:
    """`point_at` of places that were found on another outline.

    Args:
        places: (k, >= 2) rows of contour, position.
        offsets: (C + 1,) of the outline that they were found on.
        points: (N, 2) px of the outline that they are wanted on.
        current: (C + 1,) its offsets.

    Raises:
        ValueError: the outlines differ in their number of contours or points, or as `point_at`.
    """
    if not np.array_equal(offsets, current):
        raise ValueError("the outlines' points do not correspond")
    return point_at(points, current, places)


def point_at(points: Floats, offsets: NDArray[np.int64], places: Floats) -> Floats:
    """The points of places on the outline.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).
        places: (k, >= 2) rows of contour, position; further columns are ignored. A position equal to the number of
            points is 0.

    Returns:
        (k, 2) px.

    Raises:
        ValueError: a contour or a position out of range.
    """
    out = np.empty((len(places), 2))
    for row, place in zip(out, places, strict=True):
        first, n, i, f = find_place(offsets, place)
        row[:] = points[first + i] + f * (points[first + (i + 1) % n] - points[first + i])
    return out


def find_place(offsets: NDArray[np.int64], place: Floats) -> tuple[int, int, int, float]:
    """First point of the contour, its number of points, segment and fraction of one place, checked."""
    if not 0 <= place[0] < len(offsets) - 1:
        raise ValueError(f"contour {place[0]:g} is not one of {len(offsets) - 1}")
    c = int(place[0])
    n = int(offsets[c + 1] - offsets[c])
    if not 0 <= place[1] <= n:
        raise ValueError(f"position {place[1]:g} is not on a contour of {n} points")
    i = int(place[1])
    return (int(offsets[c]), n, i, float(place[1] - i)) if i < n else (int(offsets[c]), n, 0, 0.0)
