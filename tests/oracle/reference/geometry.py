# SPDX-License-Identifier: Apache-2.0
"""Contours as curves of their arc length, their moments, places on them, and where lines cross them."""

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.results import CurvatureVector, PolygonMoments
from grasptrack.typing import Floats
from reference.checks import check_contour, check_outline, check_within

__all__ = [
    "arc_length", "blend_normals", "carry_places", "curvature_vector", "fixed_places", "point_at", "polygon_moments",
    "project_to_contour", "resample",
]  # fmt: skip


# --- One closed contour as a curve of its arc length: length, means along it, curvature, vertex normals -----


def arc_length(points: Floats) -> Floats:
    check_contour(points)
    sides = np.roll(points, -1, axis=0) - points
    out = np.zeros(len(points) + 1)
    np.cumsum(np.hypot(sides[:, 0], sides[:, 1]), out=out[1:])
    return out


class _Integral:
    """F(s), the integral of the curve P from 0 to s, exact on the polygon; F(s + L) = F(s) + F(L)."""

    def __init__(self, points: Floats) -> None:
        self.origin = points[0].copy()
        self.start = points - self.origin
        self.side = np.roll(self.start, -1, axis=0) - self.start
        self.arc = arc_length(points)
        self.length = float(self.arc[-1])
        self.span = np.diff(self.arc)
        self.prefix = np.zeros((len(points) + 1, 2))
        np.cumsum(self.span[:, None] * (self.start + 0.5 * self.side), axis=0, out=self.prefix[1:])

    def _locate_segments(self, s: Floats) -> tuple[Floats, NDArray[np.intp], Floats]:
        laps = np.floor(s / self.length)
        rest = s - laps * self.length
        i = np.clip(np.searchsorted(self.arc, rest, side="right") - 1, 0, len(self.start) - 1)
        return laps, i, rest - self.arc[i]

    def __call__(self, s: Floats) -> Floats:
        laps, i, d = self._locate_segments(s)
        slope = self.side[i] / np.where(self.span[i] > 0, self.span[i], 1.0)[:, None]
        part = d[:, None] * (self.start[i] + 0.5 * d[:, None] * slope)
        return np.asarray(laps[:, None] * self.prefix[-1] + self.prefix[i] + part)

    def point(self, s: Floats) -> Floats:
        _, i, d = self._locate_segments(s)
        fraction = d / np.where(self.span[i] > 0, self.span[i], 1.0)
        return np.asarray(self.origin + self.start[i] + fraction[:, None] * self.side[i])


def curvature(points: Floats, step: float) -> Floats:
    """Curvature at each vertex of one closed contour, from chords of box means.

    With Q(s) the mean of the curve over [s - step/2, s + step/2], it is the signed angle from Q(s) - Q(s - step) to
    Q(s + step) - Q(s), divided by step.

    Args:
        points: (N, 2) px.
        step: px, above 0 and at most a quarter of the length. A longer one sees less noise and rounds off corners.

    Returns:
        (N,) in 1/px, positive where an outer contour is convex.

    Raises:
        ValueError: step out of range.
    """
    F = _Integral(points)
    if not 0 < step <= F.length / 4:
        raise ValueError(f"step must be above 0 and at most a quarter of the length {F.length:g}, not {step:g}")
    s = F.arc[:-1]
    a, b, c, d = (F(s + k * step) for k in (-1.5, -0.5, 0.5, 1.5))
    before, after = c - 2 * b + a, d - 2 * c + b
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.asarray(np.arctan2(cross, (before * after).sum(axis=1)) / step)


def curvature_vector(
    points: Floats, clipped: NDArray[np.bool_] | None, smoothing: float, whole: float = 0.0
) -> CurvatureVector:
    arc = arc_length(points)
    length = float(arc[-1])
    scale = whole if whole > 0.0 else length
    step = smoothing * scale
    out = curvature(points, step) * scale
    if clipped is not None:
        if len(clipped) != len(points):
            raise ValueError("each point needs its flag")
        bad = clipped.copy()
        for shift in range(1, min(math.ceil(1.5 * step / (length / len(points))), len(points)) + 1):
            bad |= np.roll(clipped, shift) | np.roll(clipped, -shift)
        out[bad] = np.nan
    return CurvatureVector(arc, out)


def resample(points: Floats, count: int, smooth: float) -> Floats:
    check_contour(points)
    check_within(count, 1, 1 << 24, "count")
    F = _Integral(points)
    if not F.length > 0:
        raise ValueError("a contour without length has no equal steps")
    if not 0 <= smooth <= F.length:
        raise ValueError(f"smooth must be between 0 and the length {F.length:g}, not {smooth:g}")
    s = np.arange(count, dtype=np.float64) * (F.length / count)
    # Below this the difference of two integrals has no digits left, and the mean is the point itself.
    if smooth <= 1e-7 * F.length:
        return F.point(s)
    return np.asarray(F.origin + (F(s + 0.5 * smooth) - F(s - 0.5 * smooth)) / smooth)


def blend_normals(points: Floats) -> Floats:
    check_contour(points)
    following = np.roll(points, -1, axis=0)
    chord = following - np.roll(points, 1, axis=0)
    length = np.hypot(chord[:, 0], chord[:, 1])
    flat = length == 0
    if flat.any():
        chord[flat] = (following - points)[flat]
        length = np.hypot(chord[:, 0], chord[:, 1])
    length[length == 0] = 1.0
    return np.column_stack([chord[:, 1] / length, -chord[:, 0] / length])


# --- Area, centroid and inertia of the material inside contours, by Green's theorem (Section III-B) -----

# Below this a third moment, as a share of area^2.5, is that of a symmetric shape.
SYMMETRIC = 1e-9


def polygon_moments(points: Floats, offsets: NDArray[np.int64]) -> PolygonMoments:
    check_outline(points, offsets)
    following = np.arange(1, len(points) + 1)
    following[offsets[1:] - 1] = offsets[:-1]
    x, y = (points - points[0]).T
    X, Y = x[following], y[following]
    a = x * Y - X * y
    with np.errstate(all="ignore"):
        m00 = a.sum() / 2
        gx, gy = (a * (x + X)).sum() / 6 / m00, (a * (y + Y)).sum() / 6 / m00
        m20 = (a * (x * x + x * X + X * X)).sum() / 12 / m00
        m02 = (a * (y * y + y * Y + Y * Y)).sum() / 12 / m00
        m11 = (a * (2 * x * y + x * Y + X * y + 2 * X * Y)).sum() / 24 / m00
        m30 = (a * (x + X) * (x * x + X * X)).sum() / 20 / m00
        m03 = (a * (y + Y) * (y * y + Y * Y)).sum() / 20 / m00
        m21 = (a * (x * x * (3 * y + Y) + 2 * x * X * (y + Y) + X * X * (y + 3 * Y))).sum() / 60 / m00
        m12 = (a * (y * y * (3 * x + X) + 2 * y * Y * (x + X) + Y * Y * (x + 3 * X))).sum() / 60 / m00
        # About the centroid.
        c20, c02, c11 = m20 - gx * gx, m02 - gy * gy, m11 - gx * gy
        c30 = m30 - 3 * gx * c20 - gx**3
        c03 = m03 - 3 * gy * c02 - gy**3
        c21 = m21 - gy * c20 - 2 * gx * c11 - gx * gx * gy
        c12 = m12 - gx * c02 - 2 * gy * c11 - gx * gy * gy
        mean, half, off = (c20 + c02) / 2, (c20 - c02) / 2, c11
        radius = math.hypot(half, off)
        theta = 0.5 * math.atan2(off, half)
        # Exactly upright, atan2 may answer -pi: the half-open interval keeps +pi/2.
        if theta <= -0.5 * math.pi:
            theta = 0.5 * math.pi
        c, s = math.cos(theta), math.sin(theta)
        size = abs(m00) ** 1.5
        t30 = (c**3 * c30 + 3 * c * c * s * c21 + 3 * c * s * s * c12 + s**3 * c03) / size
        t21 = (-c * c * s * c30 + (c**3 - 2 * c * s * s) * c21 + (2 * c * c * s - s**3) * c12 + c * s * s * c03) / size
        t12 = (c * s * s * c30 + (s**3 - 2 * c * c * s) * c21 + (c**3 - 2 * c * s * s) * c12 + c * c * s * c03) / size
        t03 = (-(s**3) * c30 + 3 * c * s * s * c21 - 3 * c * c * s * c12 + c**3 * c03) / size
    qu, qv = t30 + t12, t21 + t03
    if qu < -SYMMETRIC or (abs(qu) <= SYMMETRIC and qv < -SYMMETRIC):
        theta += -math.pi if theta > 0 else math.pi
        t30, t21, t12, t03 = -t30, -t21, -t12, -t03
    values = (m00, points[0, 0] + gx, points[0, 1] + gy, theta, mean + radius, mean - radius, t30, t21, t12, t03)
    return PolygonMoments(*(float(v) for v in values))


# --- Places on contours: the nearest to a point, and the point of a place -----


def segment_end_indices(offsets: NDArray[np.int64], count: int) -> NDArray[np.intp]:
    """(N,) index of the point that ends each segment."""
    following = np.arange(1, count + 1)
    following[offsets[1:] - 1] = offsets[:-1]
    return following


def project_to_contour(points: Floats, offsets: NDArray[np.int64], queries: Floats) -> Floats:
    check_outline(points, offsets)
    side = points[segment_end_indices(offsets, len(points))] - points
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
    return np.asarray(np.rint(project_to_contour(points, offsets, queries) * 2.0**32) / 2.0**32)


def carry_places(places: Floats, offsets: NDArray[np.int64], points: Floats, current: NDArray[np.int64]) -> Floats:
    if not np.array_equal(offsets, current):
        raise ValueError("the outlines' points do not correspond")
    return point_at(points, current, places)


def point_at(points: Floats, offsets: NDArray[np.int64], places: Floats) -> Floats:
    check_outline(points, offsets)
    if places.ndim != 2 or places.shape[1] < 2:
        raise ValueError("a place is a contour and a position")
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


# --- Where a straight line meets the contours -----


def crossings(points: Floats, offsets: NDArray[np.int64], x: float, y: float, ux: float, uy: float) -> Floats:
    """Where the infinite line through (x, y) along u crosses the contours.

    A vertex exactly on the line counts once when the contour changes sides there and not at all when it only touches;
    of a stretch that lies along the line and changes sides, the end with the smaller t counts.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).
        x: px, a point of the line.
        y: px.
        ux: unit direction of the line.
        uy: its second coordinate.

    Returns:
        (M, 3) contour, position, t in px along u from (x, y), sorted by t.
    """
    rows: list[tuple[float, float, float]] = []
    for c in range(len(offsets) - 1):
        relative = points[offsets[c] : offsets[c + 1]] - (x, y)
        n = len(relative)
        t = relative[:, 0] * ux + relative[:, 1] * uy
        d = relative[:, 1] * ux - relative[:, 0] * uy
        off = np.flatnonzero(d)
        if len(off) == 0:
            continue
        following = np.roll(off, -1)
        for i, j in zip(off, following, strict=True):
            if (d[i] > 0) == (d[j] > 0):
                continue
            first, last = (i + 1) % n, (j - 1) % n
            if first == j:
                f = d[i] / (d[i] - d[j])
                place, along = i + f, t[i] + f * (t[j] - t[i])
            else:
                at = first if t[first] <= t[last] else last
                place, along = at, t[at]
            rows.append((c, place if place < n else 0.0, along))
    rows.sort(key=lambda row: row[2])
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def nearest_crossings(
    points: Floats, offsets: NDArray[np.int64], x: float, y: float, ux: float, uy: float, t1: float, t2: float
) -> tuple[float, float, float, float]:
    """The crossing nearest to t1 and the one nearest to t2, px along u from (x, y); ties go to the smaller t.

    Returns:
        x1, y1, x2, y2 in px; NaN where the line meets no contour. One crossing may be nearest to both.
    """
    t = crossings(points, offsets, x, y, ux, uy)[:, 2]
    if len(t) == 0:
        return math.nan, math.nan, math.nan, math.nan
    a = float(t[np.argmin(np.abs(t - t1))])
    b = float(t[np.argmin(np.abs(t - t2))])
    return x + a * ux, y + a * uy, x + b * ux, y + b * uy
