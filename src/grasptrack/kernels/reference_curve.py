# SPDX-License-Identifier: Apache-2.0
"""One closed contour as a curve of its arc length: length, means along it, curvature, vertex normals."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats


def arc_length(points: Floats) -> Floats:
    """(N + 1,) arc length s in px at each vertex of one closed contour (N, 2); the last entry is the whole length."""
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


def curvature_vector(points: Floats, clipped: NDArray[np.bool_] | None, smoothing: float) -> tuple[Floats, Floats]:
    """Scale-free curvature of one closed contour and the arc length it is a function of.

    Args:
        points: (N, 2) px.
        clipped: (N,) True where the image border shapes the contour instead of the object, or None.
        smoothing: step of `curvature` as a fraction of the length, above 0 and at most a quarter.

    Returns:
        (N + 1,) arc length, px; (N,) curvature times length, NaN within 1.5 steps of a clipped point.

    Raises:
        ValueError: smoothing out of range.
    """
    arc = arc_length(points)
    length = float(arc[-1])
    step = smoothing * length
    out = curvature(points, step) * length
    if clipped is not None:
        if len(clipped) != len(points):
            raise ValueError("each point needs its flag")
        bad = clipped.copy()
        for shift in range(1, min(math.ceil(1.5 * step / (length / len(points))), len(points)) + 1):
            bad |= np.roll(clipped, shift) | np.roll(clipped, -shift)
        out[bad] = np.nan
    return arc, out


def resample(points: Floats, count: int, smooth: float) -> Floats:
    """One closed contour at `count` points equally spaced in its arc length, the first at its first point.

    Args:
        points: (N, 2) px.
        count: number of points wanted, at least 1.
        smooth: px; each output is the mean of the curve over +-smooth/2 of arc length, 0 for plain interpolation.

    Returns:
        (count, 2) px.

    Raises:
        ValueError: count below 1, or smooth negative or above the length.
    """
    F = _Integral(points)
    if count < 1:
        raise ValueError(f"count must be at least 1, not {count}")
    if not 0 <= smooth <= F.length:
        raise ValueError(f"smooth must be between 0 and the length {F.length:g}, not {smooth:g}")
    s = np.arange(count, dtype=np.float64) * (F.length / count)
    # Below this the difference of two integrals has no digits left, and the mean is the point itself.
    if smooth <= 1e-7 * F.length:
        return F.point(s)
    return np.asarray(F.origin + (F(s + 0.5 * smooth) - F(s - 0.5 * smooth)) / smooth)


def blend_normals(points: Floats) -> Floats:
    """(N, 2) unit normals out of the material at the vertices of one contour, across the chord of the neighbours.

    Where the neighbours coincide the segment that follows is taken; where that has no length either, (0, 0).
    """
    following = np.roll(points, -1, axis=0)
    chord = following - np.roll(points, 1, axis=0)
    length = np.hypot(chord[:, 0], chord[:, 1])
    flat = length == 0
    if flat.any():
        chord[flat] = (following - points)[flat]
        length = np.hypot(chord[:, 0], chord[:, 1])
    length[length == 0] = 1.0
    return np.column_stack([chord[:, 1] / length, -chord[:, 0] / length])
