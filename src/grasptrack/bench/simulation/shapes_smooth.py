# SPDX-License-Identifier: Apache-2.0
"""Parts with few corners or none: what a method that lives on corners cannot hold."""

from __future__ import annotations

import math

import numpy as np

from grasptrack.bench.simulation.outlines import Shape, arc_points, circle_polygon, stroke_outline
from grasptrack.typing import Floats


def _polar_curve(radius: Floats) -> Floats:
    angles = np.arange(len(radius)) * (2.0 * math.pi / len(radius))
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles)])


def ellipse_shape() -> Shape:
    """Smooth, maps to itself by a half turn and by two mirrors."""
    return Shape.of("ellipse", circle_polygon(0.0, 0.0, 1.0, 160) * [1.0, 0.62])


def egg_shape() -> Shape:
    """Smooth and convex, blunt at one end: one mirror, no corner."""
    a = np.arange(200) * (2.0 * math.pi / 200)
    x, y = np.cos(a), np.sin(a)
    return Shape.of("egg", np.column_stack([1.25 * x, 0.92 * y * (1.0 - 0.18 * x)]))


def kidney_bean() -> Shape:
    """A kidney: smooth, with one hollow."""
    line = arc_points(0.0, 0.0, 1.0, 200, 345)
    half = np.interp(np.linspace(0.0, 1.0, len(line)), [0.0, 0.35, 1.0], [0.52, 0.46, 0.4])
    return Shape.of("bean", stroke_outline(line, half))


def s_blob() -> Shape:
    """A fat S with round ends, one larger: smooth, deep hollows on both sides."""
    upper, lower = arc_points(0.0, -0.5, 0.5, -20, -270), arc_points(0.0, 0.5, 0.5, -90, 150)
    line = np.concatenate([upper, lower[1:]])
    return Shape.of("s-blob", stroke_outline(line, np.linspace(0.24, 0.18, len(line))))


def crescent_moon() -> Shape:
    """A sickle moon: two arcs that meet in sharp horns."""
    outer = arc_points(0.0, 0.0, 1.0, 40, 320)
    inner = arc_points(0.42, 0.0, math.hypot(math.cos(math.radians(40)) - 0.42, math.sin(math.radians(40))), -60, -300)
    tip = math.degrees(math.atan2(math.sin(math.radians(40)), math.cos(math.radians(40)) - 0.42))
    inner = arc_points(0.42, 0.0, float(np.hypot(*(outer[0] - [0.42, 0.0]))), 360.0 - tip, tip)
    return Shape.of("crescent", np.concatenate([outer, inner[1:-1]]))


def stemmed_leaf() -> Shape:
    """A leaf: two bows of different curvature, a point, and a short stem."""
    u = np.linspace(0.0, 1.0, 60)
    upper = np.column_stack([2.2 * u, -0.62 * np.sin(math.pi * u**0.8) ** 1.1])
    lower = np.column_stack([2.2 * u, 0.48 * np.sin(math.pi * u**1.1) ** 1.1])
    stem = np.array([(-0.5, 0.12), (-0.5, 0.02)])
    return Shape.of("leaf", np.concatenate([upper[3:], lower[::-1][1:-3], stem]))


def guitar_body() -> Shape:
    """The body of a guitar without its cutaway, lopsided: smooth, with a round hole."""
    a = np.arange(220) * (2.0 * math.pi / 220)
    radius = 1.0 + 0.33 * np.cos(2 * a) - 0.12 * np.cos(a) + 0.05 * np.sin(3 * a + 0.5)
    return Shape.of("guitar", _polar_curve(radius), [circle_polygon(0.18, 0.02, 0.26)])
