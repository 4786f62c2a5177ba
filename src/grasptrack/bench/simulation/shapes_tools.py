# SPDX-License-Identifier: Apache-2.0
"""Tools and things of the kitchen, from lines, arcs and strokes."""

from __future__ import annotations

import math

import numpy as np

from grasptrack.bench.simulation.outlines import Shape, arc_points, circle_polygon, round_corners, stroke_outline


def crane_hook() -> Shape:
    """A crane hook: an eye, a shank, and a bow that narrows to its tip."""
    bow = arc_points(0.0, 0.0, 0.62, 0, 195)
    line = np.concatenate([np.linspace((0.62, -1.7), (0.62, -0.05), 34), bow])
    run = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    half = np.interp(run, [0.0, 0.15, 0.55, 0.9, 2.0, 2.8, run[-1]], [0.27, 0.27, 0.17, 0.17, 0.25, 0.24, 0.07])
    return Shape.of("hook", stroke_outline(line, half), [circle_polygon(0.62, -1.68, 0.13, 48)])


def door_key() -> Shape:
    """A door key: a round bow with a hole, a shank, a bit with two notches."""
    shank = [(2.2, -0.11), (2.2, 0.11), (2.08, 0.11), (2.08, 0.48), (1.9, 0.48), (1.9, 0.27), (1.78, 0.27), (1.78, 0.4)]
    shank += [(1.66, 0.4), (1.66, 0.11)]
    ring = np.concatenate([arc_points(0.0, 0.0, 0.55, 11.5, 348.5), shank])
    return Shape.of("key", ring, [circle_polygon(-0.14, 0.0, 0.22, 60)])


def ring_wrench() -> Shape:
    """A dog-bone wrench: a hexagon of another size at each end."""

    def hexagon(x: float, radius: float) -> list[tuple[float, float]]:
        a = [math.radians(60 * k + 15) for k in range(6)]
        return [(x + radius * math.cos(t), radius * math.sin(t)) for t in a]

    left, right = arc_points(-1.1, 0.0, 0.5, 28, 332), arc_points(1.1, 0.0, 0.42, -148, 148)
    waist = round_corners([(0.55, 0.14), (-0.45, 0.14)], 0.0)
    ring = np.concatenate([left, waist[::-1] * [1, -1], right, waist])
    return Shape.of("ring-wrench", ring, [hexagon(-1.1, 0.3), hexagon(1.1, 0.24)])


def table_fork() -> Shape:
    """A table fork: four tines, a neck, a handle that widens."""
    tines: list[tuple[float, float]] = []
    for k in range(4):
        y = -0.33 + 0.22 * k
        tines += [(-2.0, y - 0.055), (-2.0, y + 0.055)]
        if k < 3:
            tines += [(-1.35, y + 0.06), (-1.35, y + 0.16)]
    body = [(-0.95, 0.36), (-0.55, 0.1), (0.6, 0.09), (1.6, 0.2), (1.85, 0.0)]
    body += [(1.6, -0.2), (0.6, -0.09), (-0.55, -0.1), (-0.95, -0.36)]
    radii = [0.04, 0.04, 0.045, 0.045] * 3 + [0.04, 0.04] + [0.25, 0.3, 2.0, 0.15, 0.12, 0.15, 2.0, 0.3, 0.25]
    return Shape.of("fork", round_corners([*tines, *body], radii))


def table_spoon() -> Shape:
    """A spoon: smooth all round, a bowl and a long handle."""
    x = 3.2 * np.linspace(0.0, 1.0, 150) ** 1.8
    bowl = 0.42 * np.sqrt(np.clip(1.0 - ((x - 0.62) / 0.62) ** 2, 0.0, 1.0)) * (1.0 - 0.15 * (x - 0.62))
    neck = 0.075 + 0.075 / (1.0 + np.exp(-8.0 * (x - 2.5)))
    half = np.sqrt(bowl**2 + (neck / (1.0 + np.exp(-9.0 * (x - 0.8)))) ** 2)
    even = np.linspace(0.0, 3.2, 161)
    soft = np.convolve(np.pad(np.interp(even, x, half), 4, mode="edge"), np.full(9, 1 / 9), mode="valid")
    half = np.where(x < 0.8, half, np.interp(x, even, soft))
    return Shape.of("spoon", stroke_outline(np.column_stack([x, np.zeros_like(x)]), half))


def kitchen_knife() -> Shape:
    """A kitchen knife: a pointed blade with a curved edge, a heel, a handle with two rivets' holes."""
    edge = arc_points(-0.2, -1.5, 1.95, 76.5, 134)
    blade = np.concatenate([edge, [(-1.62, -0.2), (0.3, -0.14)]])
    handle = round_corners(
        [(0.3, -0.14), (1.6, -0.14), (1.6, 0.2), (1.0, 0.12), (0.26, 0.14)], [0.0, 0.14, 0.12, 0.3, 0.0]
    )
    rivets = [circle_polygon(0.65, 0.0, 0.045, 30), circle_polygon(1.25, 0.0, 0.045, 30)]
    return Shape.of("knife", np.concatenate([blade, handle[1:]]), rivets)


def bottle_opener() -> Shape:
    """A flat opener: a head with an opening that has a lip, a waist, a handle with a hole."""
    ring = [(-1.5, -0.42), (-0.75, -0.42), (-0.35, -0.2), (1.1, -0.28), (1.35, 0.0), (1.1, 0.28), (-0.35, 0.2)]
    ring += [(-0.75, 0.42), (-1.5, 0.42)]
    radii = [0.3, 0.25, 0.4, 0.2, 0.2, 0.2, 0.4, 0.25, 0.3]
    mouth = round_corners([(-1.3, -0.24), (-0.85, -0.24), (-0.85, -0.07), (-0.72, 0.0), (-0.85, 0.07), (-0.85, 0.24),
                     (-1.3, 0.24)], [0.16, 0.06, 0.03, 0.04, 0.03, 0.06, 0.16])  # fmt: skip
    return Shape.of("bottle-opener", round_corners(ring, radii), [mouth, circle_polygon(1.05, 0.0, 0.11, 40)])


def hammer_head() -> Shape:
    """The side view of a hammer's head: a square face, a neck, an eye, a peen that narrows."""
    ring = [(-1.2, -0.36), (-0.9, -0.36), (-0.84, -0.24), (-0.55, -0.24), (-0.4, -0.4), (0.3, -0.4)]
    ring += [(1.35, -0.12), (1.35, 0.04), (0.3, 0.3), (-0.4, 0.4), (-0.55, 0.24), (-0.84, 0.24), (-0.9, 0.36)]
    ring += [(-1.2, 0.36)]
    radii = [0.06, 0.05, 0.04, 0.06, 0.1, 0.3, 0.05, 0.05, 0.3, 0.1, 0.06, 0.04, 0.05, 0.06]
    eye = circle_polygon(0.0, 0.0, 1.0, 60) * [0.22, 0.15] + [-0.05, 0.0]
    return Shape.of("hammer-head", round_corners(ring, radii), [eye])


def sharpened_pencil() -> Shape:
    """A sharpened pencil: twelve times as long as wide, a blunt tip at one end, a rubber with round corners at the other."""
    ring = [(-6.0, -0.5), (-6.0, 0.5), (4.5, 0.5), (6.0, 0.07), (6.0, -0.07), (4.5, -0.5)]
    return Shape.of("pencil", round_corners(ring, [0.15, 0.15, 0.3, 0.05, 0.05, 0.3]))


def capped_bottle() -> Shape:
    """A bottle seen from the side: a body, sloping shoulders, a neck, the rim of its cap."""
    side = [(-1.5, 0.55), (0.55, 0.55), (1.05, 0.2), (1.5, 0.2), (1.5, 0.25), (1.78, 0.25)]
    radii = [0.1, 0.3, 0.25, 0.02, 0.02, 0.04]
    ring = [(x, -y) for x, y in reversed(side)]
    return Shape.of("bottle", round_corners([*side, *ring], [*radii, *reversed(radii)]))
