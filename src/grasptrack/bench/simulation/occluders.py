# SPDX-License-Identifier: Apache-2.0
"""Occluders that stay: an irregular one that wanders over a part, a bar whose edge lies parallel to one of its sides."""

from __future__ import annotations

import math

import cv2
import numpy as np

from grasptrack.bench.simulation.coverage import inside_polygons
from grasptrack.bench.simulation.hand import SKINS
from grasptrack.bench.simulation.occlusion_events import Colour, Drifting
from grasptrack.bench.simulation.outlines import Shape
from grasptrack.typing import Floats

KEYS = 24
"""Times at which the place of a wandering occluder is sought; between them it moves evenly."""
SLOW = 2.5
"""Table units by which a wandering occluder goes in or out during the whole sequence, at most."""
BEHIND = 6.0
"""Table units that an occluder reaches behind its front: out of view."""
LONGEST_HIDDEN = 0.3
"""Share of the outline that a parallel bar may hide; where no side allows that, the one that hides least is taken."""


def _outline_length(shape: Shape) -> float:
    """Length of all its polygons together."""
    return float(sum(np.hypot(*(np.roll(p, -1, axis=0) - p).T).sum() for p in shape.polygons))


def _mitten_outline(rng: np.random.Generator) -> Floats:
    """(N, 2) table units: an irregular hand or sleeve; its front, fairly straight, is at x = 0, its arm behind."""
    half = float(rng.uniform(0.45, 0.75))
    y = np.linspace(-1.0, 1.0, 81)
    phase, weight = rng.uniform(0.0, 2.0 * math.pi, 4), rng.uniform(0.3, 1.0, 4) * (0.05, 0.04, 0.03, 0.02)
    front = sum(w * np.sin((k + 2) * 1.7 * y + p) for k, (w, p) in enumerate(zip(weight, phase, strict=True)))
    front = front - 0.35 * half * np.abs(y) ** 5
    x = np.linspace(0.05, 1.0, 30)
    sides = [half * (1.0 + 0.5 * x + 0.06 * np.sin(9.0 * x + p) - 0.06 * math.sin(p)) for p in rng.uniform(0, 6.3, 2)]
    tip = np.column_stack([front, half * y])
    upper = np.column_stack([front[-1] - BEHIND * x, sides[0]])
    lower = np.column_stack([front[0] - BEHIND * x, -sides[1]])
    return np.concatenate([tip, upper, lower[::-1]])


def irregular_over(
    shape: Shape, frames: int, rng: np.random.Generator, *, share: float = 0.3, view: float = 3.0
) -> Drifting:
    """A hand-like occluder that comes over a part and stays, slowly moving round it and in and out.

    Args:
        shape: the part, at the origin.
        frames: number of frames; it is there from a twentieth on, and rests over the part from a quarter on.
        rng: for its outline, its way and its colour.
        share: of the outline's length that is hidden, at most.
        view: table units from the middle of the image to its farthest corner.
    """
    ring, points = _mitten_outline(rng), shape.samples(400)
    u = np.linspace(0.0, 1.0, frames)
    first, swing, bend = (float(v) for v in rng.uniform([0.0, 0.4, 0.0], [2.0 * math.pi, 0.8, 2.0 * math.pi]))
    side = first + swing * np.sin(2.0 * math.pi * 0.8 * u + bend)
    aside = 0.15 * np.sin(2.0 * math.pi * 1.3 * u + float(rng.uniform(0.0, 6.3)))
    wanted = share * (0.62 + 0.33 * np.sin(2.0 * math.pi * 2.2 * u + float(rng.uniform(0.0, 6.3))))

    def placed(i: int, depth: float) -> tuple[Floats, Floats]:
        way = -np.array([math.cos(side[i]), math.sin(side[i])])
        shift = depth * way + aside[i] * np.array([-way[1], way[0]])
        c, s = way
        return ring @ np.array([[c, s], [-s, c]]) + shift, shift

    def hidden(i: int, depth: float) -> float:
        return float(inside_polygons([placed(i, depth)[0]], points).mean())

    keys = np.unique(np.linspace(0, frames - 1, KEYS).astype(int))
    depths = []
    for i in keys:
        low, high = -shape.radius() - 0.5, shape.radius()
        for _ in range(12):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if hidden(int(i), middle) < wanted[i] else (low, middle)
        depths.append(low)
    depth = np.interp(np.arange(frames), keys, depths)
    for i in range(frames):
        while hidden(i, depth[i]) > share:
            depth[i] -= 0.01
    apart = np.abs(np.arange(frames)[:, None] - np.arange(frames))
    depth = (depth + SLOW / frames * apart).min(axis=1)  # nowhere farther in than allowed, and never faster
    start, rest = 0.05 * frames, 0.25 * frames
    come = np.clip((rest - np.arange(frames)) / max(1e-9, rest - start), 0.0, 1.0)
    depth -= come * come * (3.0 - 2.0 * come) * (view + shape.radius())
    way = np.full((frames, 2), np.nan)
    for i in range(max(1, math.ceil(start)), frames):
        way[i] = placed(i, depth[i])[1]
    colour = SKINS[int(rng.integers(len(SKINS)))]
    return Drifting(ring, way, turn=side + math.pi, colour=colour, relief=0.3)


def parallel_bar(
    shape: Shape,
    frames: int,
    rng: np.random.Generator,
    *,
    depths: tuple[float, float],
    view: float = 3.0,
    colour: Colour = (120, 128, 131),
) -> Drifting:
    """A straight bar that comes from outside over one side of a part, and rests with its edge parallel to that side.

    Args:
        shape: the part, at the origin.
        frames: number of frames; it rests from three tenths to three quarters of them, and then withdraws.
        rng: for the side, the bar's width and its motion.
        depths: table units, least and most, by which its edge lies inside the part's while it rests.
        view: table units from the middle of the image to its farthest corner.
        colour: BGR.
    """
    hull = np.asarray(cv2.convexHull(shape.outer.astype(np.float32), clockwise=False)[:, 0], dtype=np.float64)
    sides = np.roll(hull, -1, axis=0) - hull
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    points = shape.samples(600)
    longest = np.argsort(-lengths, kind="stable")[:8]
    normals = np.column_stack([sides[:, 1], -sides[:, 0]])[longest] / lengths[longest, None]
    normals *= np.sign((normals * hull[longest]).sum(axis=1))[:, None]  # out of the hull, whose inside has the origin
    edge = (normals * hull[longest]).sum(axis=1)
    inside = edge[:, None] - normals @ points.T
    along = (inside < 0.01).sum(axis=1) * _outline_length(shape) / len(points)
    hides = (inside < depths[1]).mean(axis=1)
    allowed = np.flatnonzero((hides <= LONGEST_HIDDEN) & (along > 0.7 * lengths[longest]))  # no side spans a recess
    k = int(rng.choice(allowed[:3])) if len(allowed) else int(np.argmin(hides))
    out, across = normals[k], np.array([-normals[k][1], normals[k][0]])
    width, half = float(rng.uniform(0.3, 0.6)), view + 0.8
    inner, outer = edge[k] * out, (edge[k] + width) * out
    ring = np.array([inner - half * across, outer - half * across, outer + half * across, inner + half * across])
    i = np.arange(frames, dtype=np.float64) / max(1, frames)
    away = np.clip(np.maximum((0.3 - i) / 0.18, (i - 0.75) / 0.18), 0.0, 1.0)
    wave = np.sin(2.0 * math.pi * 1.5 * i + float(rng.uniform(0.0, 6.3)))
    depth = 0.5 * (depths[0] + depths[1]) + 0.5 * (depths[1] - depths[0]) * wave
    offset = -depth + away * away * (3.0 - 2.0 * away) * (view + shape.radius())
    way = offset[:, None] * out
    way[away >= 1.0] = np.nan
    return Drifting(ring, way, colour=colour)
