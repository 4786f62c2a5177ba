# SPDX-License-Identifier: Apache-2.0
"""Outlines and motions that tests draw at random."""

import math
from typing import Any

import numpy as np
from hypothesis import strategies as st

from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import similarity_transform
from grasptrack.segmentation.first_look import first_look


def dense(vertices, count=300):
    """A polygon's outline as `count` points, its vertices among them."""
    v = np.asarray(vertices, dtype=float)
    sides = np.hypot(*(np.roll(v, -1, axis=0) - v).T)
    share = np.maximum(1, np.round(count * sides / sides.sum()).astype(int))
    return np.concatenate(
        [
            a + np.linspace(0, 1, n, endpoint=False)[:, None] * (b - a)
            for a, b, n in zip(v, np.roll(v, -1, axis=0), share, strict=True)
        ]
    )


BRACKET = 40.0 * np.array([[0, 0], [5, 0], [5, 1.5], [2, 1.8], [1.6, 3.4], [0, 3.0]]) + 100.0
"""An L-shaped plate without any symmetry; six corners."""


@st.composite
def stars(draw, corners=(5, 9), count=300):
    """Star-shaped polygons with distinct corners and no symmetry to speak of."""
    n = draw(st.integers(*corners))
    return star(n, draw(st.integers(0, 10_000)), count)


def star(n, seed, count):
    """One of them, of n corners."""
    rng = np.random.default_rng(seed)
    angle = 2 * math.pi * (np.arange(n) + rng.uniform(-0.25, 0.25, n)) / n
    radius = 100.0 * rng.uniform(0.45, 1.4, n)
    stretch = np.array([1.6, 1.0])
    return dense(np.column_stack([np.cos(angle), np.sin(angle)]) * radius[:, None] * stretch + 300.0, count)


@st.composite
def blobs(draw, count=300):
    """Smooth outlines without corners."""
    return blob(draw(st.integers(0, 10_000)), count)


def blob(seed, count):
    """One of them."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 2 * math.pi, count, endpoint=False)
    r = 100.0 * (1 + sum(rng.uniform(-0.12, 0.12) * np.cos(k * t + rng.uniform(0, 6.28)) for k in range(1, 6)))
    return np.column_stack([1.5 * r * np.cos(t), r * np.sin(t)]) + 300.0


@st.composite
def similarities(draw):
    """Any turn, scale 0.3 to 3, any shift."""
    scale = math.exp(draw(st.floats(-1.1, 1.1)))
    return similarity_transform(
        scale,
        draw(st.floats(-math.pi, math.pi)),
        (300.0, 300.0),
        (draw(st.floats(-200, 900)), draw(st.floats(-200, 900))),
    )


@st.composite
def frame_motions(draw):
    """Homographies of consecutive frames: some px, some degrees, some per cent, a little tilt."""
    H = similarity_transform(
        draw(st.floats(0.95, 1.05)),
        math.radians(draw(st.floats(-5, 5))),
        (300.0, 300.0),
        (300 + draw(st.floats(-12, 12)), 300 + draw(st.floats(-12, 12))),
    )
    tilt = np.eye(3)
    tilt[2, 0], tilt[2, 1] = draw(st.floats(-1e-4, 1e-4)), draw(st.floats(-1e-4, 1e-4))
    return H @ tilt


def turned(contour: Contour, start: int, reverse: bool) -> Contour:
    """The same curve from another first point, or the other way round."""
    points = np.roll(contour.points, -start, axis=0)
    return Contour(points[::-1] if reverse else points, hole=contour.hole)


def segment_object(image: np.ndarray, object_at: tuple[float, float] | None = None, **said: Any) -> View:
    """The outline of the likeliest object."""
    return first_look(image, object_at, **said)[0].view
