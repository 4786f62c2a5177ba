# SPDX-License-Identifier: Apache-2.0
"""Whether a closed contour crosses itself, exactly."""

from fractions import Fraction

import numpy as np

from grasptrack.typing import Floats
from reference.checks import check_contour

__all__ = ["first_crossing"]

ROUNDING = 3.3306690738754716e-16
"""Of the two products of a triangle's area: where their difference is more, its sign is that of the exact one."""

Point = tuple[float, float]


def first_crossing(points: Floats) -> tuple[int, int]:
    check_contour(points)
    n = len(points)
    at: list[Point] = [(x, y) for x, y in points.tolist()]
    following = np.roll(points, -1, axis=0)
    low, high = np.minimum(points, following), np.maximum(points, following)
    order = np.lexsort((np.arange(n), low[:, 0]))
    low, high = low[order], high[order]
    for k in range(n):
        end = int(np.searchsorted(low[:, 0], high[k, 0], side="right"))
        near = (low[k + 1 : end, 1] <= high[k, 1]) & (high[k + 1 : end, 1] >= low[k, 1])
        for other in order[k + 1 : end][near].tolist():
            i, j = sorted((int(order[k]), other))
            if j - i > 1 and j - i != n - 1 and _sides_cross(at, i, j):
                return i, j
    return -1, -1


def _sides_cross(at: list[Point], i: int, j: int) -> bool:
    n = len(at)
    a, b, after_b = at[i], at[i + 1], at[(i + 2) % n]
    c, d, after_d = at[j], at[(j + 1) % n], at[(j + 2) % n]
    ci, di, aj, bj = turn(a, b, c), turn(a, b, d), turn(c, d, a), turn(c, d, b)
    if ci * di < 0 and aj * bj < 0:
        return True
    # each point belongs to the side that it ends
    if b == d:
        return _within_angle(a, b, after_b, c) * _within_angle(a, b, after_b, after_d) < 0
    if bj == 0 and _dot(b, c, d) < 0 and aj * turn(c, d, after_b) < 0:
        return True
    return di == 0 and _dot(d, a, b) < 0 and ci * turn(a, b, after_d) < 0


def turn(a: Point, b: Point, c: Point) -> int:
    """1, 0 or -1: the sign of the area of a triangle, exact."""
    left, right = (a[0] - c[0]) * (b[1] - c[1]), (a[1] - c[1]) * (b[0] - c[0])
    if abs(left - right) > ROUNDING * (abs(left) + abs(right)):
        return 1 if left > right else -1
    (ax, ay), (bx, by), (cx, cy) = ([Fraction(v) for v in p] for p in (a, b, c))
    area = (ax - cx) * (by - cy) - (ay - cy) * (bx - cx)
    return (area > 0) - (area < 0)


def _dot(x: Point, p: Point, q: Point) -> float:
    """Of the ways from x to two others: below 0 where x, in a row with them, lies between them."""
    return (p[0] - x[0]) * (q[0] - x[0]) + (p[1] - x[1]) * (q[1] - x[1])


def _within_angle(a: Point, b: Point, c: Point, x: Point) -> int:
    """Whether x lies within the angle at b that opens to the left of a, b, c: 1, on one of its sides 0, outside -1."""
    from_a, from_c, bend = turn(b, a, x), turn(b, c, x), turn(b, c, a)
    if (from_a == 0 and _dot(b, a, x) > 0) or (from_c == 0 and _dot(b, c, x) > 0):
        return 0
    if bend > 0:
        return 1 if from_c > 0 and from_a < 0 else -1
    if bend < 0:
        return 1 if from_c > 0 or from_a < 0 else -1
    if _dot(b, a, c) > 0:  # there and back again
        return 0
    return 1 if from_c > 0 else -1
