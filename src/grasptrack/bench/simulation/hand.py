# SPDX-License-Identifier: Apache-2.0
"""A hand and a bar that come over a part and hide a stated share of its outline."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from grasptrack.bench.simulation.coverage import inside_polygons
from grasptrack.bench.simulation.isolines import trace_isolines
from grasptrack.bench.simulation.occlusion_events import Colour, Laid
from grasptrack.bench.simulation.outlines import Shape
from grasptrack.typing import Floats

SKINS: tuple[Colour, ...] = (
    (120, 150, 200),
    (95, 125, 175),
    (60, 85, 130),
    (190, 125, 60),
    (70, 66, 60),
    (205, 210, 212),
)
"""BGR of three skins, and of gloves of nitrile, leather and cotton."""
GRAIN = 45.0
"""Pixels to a table unit in which a hand is drawn."""
FOREARM = 5.0
"""Table units behind the wrist: it reaches out of view."""


@lru_cache(maxsize=8)
def _hand_outline(seed: int) -> Floats:
    """(N, 2) table units: a hand whose fingers point along x, its palm at the origin, an arm behind it."""
    rng = np.random.default_rng((seed, 51))
    bones: list[tuple[float, float, float, float, float, float]] = []  # from, to, radius at either end
    spread, bend = rng.uniform(0.05, 0.28), rng.uniform(0.85, 1.0)
    for k, long in enumerate((0.58, 0.7, 0.66, 0.5)):
        y, lean = 0.27 - 0.18 * k, spread * (1.5 - k) / 1.5 + rng.uniform(-0.04, 0.04)
        knuckle, reach = 0.3 - 0.05 * abs(k - 1.2), bend * long * rng.uniform(0.93, 1.05)
        tip = (knuckle + reach * math.cos(lean), y + reach * math.sin(lean))
        bones.append((knuckle - 0.25, y * 0.9, *tip, 0.1, 0.078))
    thumb = rng.uniform(0.5, 0.95)
    bones.append((-0.2, 0.24, -0.1 + 0.55 * math.cos(thumb), 0.3 + 0.5 * math.sin(thumb), 0.14, 0.09))
    bones += [(0.1, 0.2, 0.1, -0.2, 0.2, 0.19), (-0.2, 0.14, -0.25, -0.1, 0.22, 0.2)]
    bones.append((-0.45, 0.0, -FOREARM, 0.0, 0.23, 0.36))
    low = np.array([-FOREARM - 0.6, -0.75])
    size = np.ceil((np.array([1.5, 1.2]) - low) * GRAIN).astype(int)
    x, y_ = np.meshgrid(*(low[i] + np.arange(size[i]) / GRAIN for i in (0, 1)))
    near = np.zeros(x.shape)
    for x0, y0, x1, y1, r0, r1 in bones:
        dx, dy = x1 - x0, y1 - y0
        along = np.clip(((x - x0) * dx + (y_ - y0) * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        off = np.hypot(x - x0 - along * dx, y_ - y0 - along * dy) - (r0 + along * (r1 - r0))
        near += np.exp(np.minimum(-off / 0.025, 40.0))  # a soft union: webs between the fingers, no creases
    curves = trace_isolines(np.log(near + 1e-30), 0.0)
    longest = max(curves, key=len)
    return np.asarray(low + longest / GRAIN, dtype=np.float64)


def hand_over(
    shape: Shape,
    times: tuple[float, float, float, float],
    *,
    share: float = 0.3,
    side: float = 0.5 * math.pi,
    aside: float = 0.0,
    view: float = 3.0,
    seed: int = 0,
) -> Laid:
    """A hand that reaches over a part from one side, rests there, and withdraws.

    Args:
        shape: the part, at the origin.
        times: frames at which it sets out, rests, leaves, is gone.
        share: of the outline's length that is hidden at rest; less where the hand cannot hide as much.
        side: rad, the direction it comes from; pi / 2 is from below.
        aside: table units by which it passes beside the middle.
        view: table units from the middle of the image to its farthest corner.
        seed: of the hand's pose and colour.
    """
    ring = _hand_outline(seed % 5)
    if seed % 2:
        ring = ring[::-1] * np.array([1.0, -1.0])  # the other hand
    c, s = math.cos(side + math.pi), math.sin(side + math.pi)
    forward = np.array([c, s])
    ring = ring @ np.array([[c, s], [-s, c]]) + aside * np.array([-s, c])
    points = shape.samples(400)

    def hidden(depth: float) -> float:
        return float(inside_polygons([ring + depth * forward], points).mean())

    depths = np.arange(-shape.radius() - 1.5, 1.2, 0.1).tolist()
    shares = [hidden(depth) for depth in depths]
    first = next((i for i, h in enumerate(shares) if h >= share), int(np.argmax(shares)))
    low, rest = depths[max(0, first - 1)], depths[first]
    for _ in range(8):
        middle = 0.5 * (low + rest)
        low, rest = (low, middle) if hidden(middle) >= min(share, shares[first]) else (middle, rest)
    return Laid(
        ring=ring + rest * forward,
        away=-forward * (view + shape.radius() + 1.6),
        times=times,
        colour=SKINS[seed % len(SKINS)],
        relief=0.35,
    )


def bar_over(
    shape: Shape,
    times: tuple[float, float, float, float],
    *,
    share: float = 0.3,
    angle: float = 0.5,
    view: float = 3.0,
    colour: Colour = (120, 128, 131),
) -> Laid:
    """A long bar that sweeps over a part, as wide as hides a share of its outline at most.

    Args:
        shape: the part, at the origin.
        times: frames at which it sets out, is over the part's middle, goes on, is gone.
        share: of the outline's length, hidden where it hides most.
        angle: rad, the direction of its sweep.
        view: table units from the middle of the image to its farthest corner.
        colour: BGR.
    """
    along = np.array([math.cos(angle), math.sin(angle)])
    across = np.array([-along[1], along[0]])
    place = np.sort(shape.samples(2000) @ along)

    def most(width: float) -> float:
        count = np.searchsorted(place, place + width, side="right") - np.arange(len(place))
        return float(count.max()) / len(place)

    low, high = 0.0, float(place[-1] - place[0])
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if most(middle) <= share else (low, middle)
    a, b = 0.5 * low * along, (view + 0.8) * across
    ring = np.array([-a - b, a - b, a + b, b - a])
    return Laid(ring, -along * (view + low + 0.4), times, leave="on", colour=colour)
