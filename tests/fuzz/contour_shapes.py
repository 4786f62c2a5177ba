# SPDX-License-Identifier: Apache-2.0
"""Degenerate contours, drawn by a generator: what people, masks and other programs hand in."""

from typing import Any

import numpy as np


def star(rng: np.random.Generator, n: int) -> np.ndarray:
    """A plain outline."""
    angle = 2 * np.pi * np.arange(n) / n
    radius = 60.0 * rng.uniform(0.7, 1.3, n)
    return 200.0 + np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def rectangle(rng: np.random.Generator, n: int) -> np.ndarray:
    """A rectangle of any aspect, down to a sliver, its points on its sides."""
    w, h = 100.0, 100.0 * 10.0 ** rng.uniform(-9, 0)
    s = np.linspace(0, 1, n // 4 + 2)[:-1]
    sides = [np.column_stack([s * w, 0 * s]), np.column_stack([0 * s + w, s * h])]
    sides += [np.column_stack([w - s * w, 0 * s + h]), np.column_stack([0 * s, h - s * h])]
    return np.concatenate(sides) + rng.uniform(-50, 300, 2)


def circle(rng: np.random.Generator, n: int) -> np.ndarray:
    """A circle as `np.linspace(0, 2 pi, n)` writes it: closed."""
    angle = np.linspace(0, 2 * np.pi, n)
    return 100.0 + 40.0 * np.column_stack([np.cos(angle), rng.uniform(0.3, 1) * np.sin(angle)])


def bow_tie(rng: np.random.Generator, n: int) -> np.ndarray:
    """A curve that crosses itself."""
    angle = 2 * np.pi * np.arange(n) / n
    return 100.0 + 50.0 * np.column_stack([np.sin(angle), rng.uniform(0.3, 1) * np.sin(2 * angle + rng.uniform(0, 1))])


def scribble(rng: np.random.Generator, n: int) -> np.ndarray:
    """Points anywhere."""
    return rng.uniform(0, 100, (n, 2))


def walk(rng: np.random.Generator, n: int) -> np.ndarray:
    """Steps on the grid of pixels: doubled points, retraced ways."""
    return 100.0 + np.cumsum(rng.integers(-1, 2, (n, 2)), axis=0).astype(np.float64)


def comb(rng: np.random.Generator, n: int) -> np.ndarray:
    """Teeth, as thin as rounding."""
    gap = 10.0 ** rng.uniform(-12, 1)
    teeth = max(n // 4, 2)
    rows = [
        [(i * 4 * gap, 0.0), (i * 4 * gap + gap, 50.0), (i * 4 * gap + 2 * gap, 50.0), (i * 4 * gap + 3 * gap, 0.0)]
        for i in range(teeth)
    ]
    return np.array([*np.concatenate(rows), (teeth * 4 * gap, -10.0), (0.0, -10.0)])


def spiked(rng: np.random.Generator, n: int) -> np.ndarray:
    """A plain outline with ways out and back of no width."""
    points = star(rng, n)
    at = int(rng.integers(1, n))
    tip = 200.0 + rng.uniform(-150, 150, 2)
    return np.concatenate([points[:at], [tip], points[at - 1 :]])


def on_a_line(rng: np.random.Generator, n: int) -> np.ndarray:
    """All points on a line, or nearly."""
    way = rng.normal(0, 1, 2)
    return 100.0 + rng.uniform(0, 100, (n, 1)) * way + rng.normal(0, 1, (n, 2)) * 10.0 ** rng.uniform(-16, -2)


def one_place(rng: np.random.Generator, n: int) -> np.ndarray:
    """All points at one place, or nearly."""
    return 100.0 + rng.normal(0, 1, (n, 2)) * 10.0 ** rng.uniform(-16, -2)


def spiral(rng: np.random.Generator, n: int) -> np.ndarray:
    """A long thin band, wound up."""
    angle = np.linspace(0.5, 4 * np.pi, n)
    inner = np.column_stack([angle * np.cos(angle), angle * np.sin(angle)])
    wide = 10.0 ** rng.uniform(-6, 0)
    return 100.0 + 8.0 * np.concatenate([inner, (inner * (1 + wide / angle[:, None]))[::-1]])


SHAPES = (star, rectangle, circle, bow_tie, scribble, walk, comb, spiked, on_a_line, one_place, spiral)


def draw_contour(rng: np.random.Generator) -> Any:
    """Points for a contour: mostly an array (n, 2), degenerate in one or several ways."""
    n = int(rng.choice([3, 8, 9, 12, 20, 40, 90, 200]))
    points = SHAPES[rng.integers(len(SHAPES))](rng, n)
    for _ in range(int(rng.choice([0, 0, 1, 1, 2]))):
        points = _deformed(points, rng)
    return points


def _deformed(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    n, way = len(points), int(rng.integers(14))
    if not n:
        return points
    out = points.copy()
    if way == 0:
        return np.concatenate([points, points[:1]])
    if way == 1:
        return np.repeat(points, rng.integers(1, 4, n), axis=0)
    if way == 2:
        return np.rint(points)
    if way == 3:
        return points * 10.0 ** rng.uniform(-12, 12)
    if way == 4:
        return points + rng.normal(0, 1, 2) * 10.0 ** rng.uniform(0, 12)
    if way == 5:
        return points * [1.0, 10.0 ** rng.uniform(-9, 9)]
    if way == 6:
        out[rng.integers(n, size=2)] = points[rng.integers(n, size=2)]
    elif way == 7:
        out.flat[rng.integers(out.size)] = rng.choice([np.nan, np.inf, -np.inf, 1e300, -1e18, 1e-300])
    elif way == 8:
        out = out[::-1]
    elif way == 9:
        out = out + rng.normal(0, 10.0 ** rng.uniform(-14, 1), out.shape)
    elif way == 10:
        out = out[: rng.integers(n + 1)]
    elif way == 11:
        out = out * 10.0 ** rng.uniform(-200, 150)
    elif way == 12:
        out = np.roll(out, rng.integers(n), axis=0)
    else:
        out = out.astype(np.float32).astype(np.float64)
    return out
