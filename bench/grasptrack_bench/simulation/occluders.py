# SPDX-License-Identifier: Apache-2.0
"""What comes between the camera and the part: bars, hands, and things that stay."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, Protocol

import cv2
import numpy as np

from grasptrack.errors import ConditioningError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.typing import Floats
from grasptrack_bench.simulation.camera import Pinhole
from grasptrack_bench.simulation.outlines import Shape, inside_polygons, trace_isolines
from grasptrack_bench.simulation.textures import Colour


class Cover(Protocol):
    """Something in front of the part."""

    @property
    def colour(self) -> Colour:
        """BGR."""

    @property
    def relief(self) -> float:
        """How much darker its rim is than its middle, 0 to 1: 0 is flat."""

    def polygon(self, index: int, H: Floats, camera: Pinhole) -> Floats | None:
        """(N, 2) px of the image where it is in a frame; None where it is not in view.

        H (3, 3) takes the part's plane, in table units, to ideal px.
        """


@dataclass(frozen=True)
class Bar:
    """A straight bar across the image that sweeps over it.

    Attributes:
        start, end: frames between which it crosses the image, from one side to the other.
        width: of the bar, as a share of the image's diagonal.
        angle: rad, direction of its sweep.
        colour: BGR.
    """

    start: int
    end: int
    width: float = 0.12
    angle: float = 0.5
    colour: Colour = (120, 128, 131)
    relief: float = 0.0

    def polygon(self, index: int, H: Floats, camera: Pinhole) -> Floats | None:
        """(4, 2) px where it is in a frame; None before `start` and after `end`."""
        if not self.start <= index <= self.end:
            return None
        width, height = camera.width, camera.height
        diagonal = math.hypot(width, height)
        share = (index - self.start) / max(1, self.end - self.start)
        along = np.array([math.cos(self.angle), math.sin(self.angle)])
        across = np.array([-along[1], along[0]])
        half = 0.5 * self.width * diagonal
        middle = np.array([width - 1.0, height - 1.0]) / 2.0 + along * (share - 0.5) * (diagonal + 2.0 * half)
        a, b = along * half, across * diagonal
        return np.array([middle - a - b, middle + a - b, middle + a + b, middle - a + b])


@dataclass(frozen=True)
class Laid:
    """Something that slides in over the part, rests there, and leaves: it lies in the part's plane and is carried along.

    Attributes:
        ring: (N, 2) its outline at rest, table units.
        away: (2,) table units from the place at rest to the place where it comes from, out of view.
        times: the four frames at which it sets out, comes to rest, leaves, and is gone.
        leave: "back" the way it came, or "on" to the other side.
        colour: BGR.
        relief: how much darker its rim is than its middle.
    """

    ring: Floats
    away: Floats
    times: tuple[float, float, float, float]
    leave: Literal["back", "on"] = "back"
    colour: Colour = (140, 165, 205)
    relief: float = 0.0

    def offset(self, index: int) -> float | None:
        """How far it is from its place at rest, as a share of `away`, -1 to 1; None where it is not there at all."""
        out, rest, leaves, gone = self.times
        if not out < index < gone:
            return None
        if index < rest:
            u = (rest - index) / (rest - out)
            return u if self.leave == "on" else _smooth_step(u)
        if index <= leaves:
            return 0.0
        u = (index - leaves) / (gone - leaves)
        return -u if self.leave == "on" else _smooth_step(u)

    def polygon(self, index: int, H: Floats, camera: Pinhole) -> Floats | None:
        """(N, 2) px where it is in a frame; None where it is not in view."""
        share = self.offset(index)
        if share is None:
            return None
        return _in_view(self.ring + share * self.away, H, camera)


@dataclass(frozen=True)
class Drifting:
    """Something in the part's plane that moves over it as it is told, frame by frame.

    Attributes:
        ring: (N, 2) its outline, table units.
        way: (F, 2) table units by which it is shifted in each frame; NaN where it is not there.
        turn: (F,) rad, by which it is turned about its own origin before that; None is not at all.
        colour: BGR.
        relief: how much darker its rim is than its middle.
    """

    ring: Floats
    way: Floats
    turn: Floats | None = None
    colour: Colour = (140, 165, 205)
    relief: float = 0.0

    def placed(self, index: int) -> Floats | None:
        """(N, 2) table units where it is in a frame; None where it is not there."""
        if np.isnan(self.way[index, 0]):
            return None
        ring = self.ring
        if self.turn is not None:
            c, s = math.cos(self.turn[index]), math.sin(self.turn[index])
            ring = ring @ np.array([[c, s], [-s, c]])
        return np.asarray(ring + self.way[index], dtype=np.float64)

    def polygon(self, index: int, H: Floats, camera: Pinhole) -> Floats | None:
        """(N, 2) px where it is in a frame; None where it is not in view, or reaches behind the camera."""
        ring = self.placed(index)
        return None if ring is None else _in_view(ring, H, camera)


def _in_view(ring: Floats, H: Floats, camera: Pinhole) -> Floats | None:
    """(N, 2) px of a ring in the part's plane; None where it is not in the image, or reaches behind the camera."""
    try:
        seen = camera.distort(apply_homography(H, ring))
    except ConditioningError:
        return None
    inside = np.all(seen.max(axis=0) >= 0.0) and np.all(seen.min(axis=0) <= [camera.width - 1, camera.height - 1])
    return seen if inside else None


def _smooth_step(u: float) -> float:
    return u * u * (3.0 - 2.0 * u)


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

    def hidden_share(depth: float) -> float:
        return float(inside_polygons([ring + depth * forward], points).mean())

    depths = np.arange(-shape.radius() - 1.5, 1.2, 0.1).tolist()
    shares = [hidden_share(depth) for depth in depths]
    first = next((i for i, h in enumerate(shares) if h >= share), int(np.argmax(shares)))
    low, rest = depths[max(0, first - 1)], depths[first]
    for _ in range(8):
        middle = 0.5 * (low + rest)
        low, rest = (low, middle) if hidden_share(middle) >= min(share, shares[first]) else (middle, rest)
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

    def largest_share(width: float) -> float:
        count = np.searchsorted(place, place + width, side="right") - np.arange(len(place))
        return float(count.max()) / len(place)

    low, high = 0.0, float(place[-1] - place[0])
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if largest_share(middle) <= share else (low, middle)
    a, b = 0.5 * low * along, (view + 0.8) * across
    ring = np.array([-a - b, a - b, a + b, b - a])
    return Laid(ring, -along * (view + low + 0.4), times, leave="on", colour=colour)


KEYS = 24
"""Times at which the place of a wandering occluder is sought; between them it moves evenly."""
SLOW = 2.5
"""Table units by which a wandering occluder goes in or out during the whole sequence, at most."""
BEHIND = 6.0
"""Table units that an occluder reaches behind its front: out of view."""
LONGEST_HIDDEN = 0.3
"""Share of the outline that a parallel bar may hide; where no side allows that, the one that hides least is taken."""


def _outline_length(shape: Shape) -> float:
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

    def place_ring(i: int, depth: float) -> tuple[Floats, Floats]:
        way = -np.array([math.cos(side[i]), math.sin(side[i])])
        shift = depth * way + aside[i] * np.array([-way[1], way[0]])
        c, s = way
        return ring @ np.array([[c, s], [-s, c]]) + shift, shift

    def hidden_share(i: int, depth: float) -> float:
        return float(inside_polygons([place_ring(i, depth)[0]], points).mean())

    keys = np.unique(np.linspace(0, frames - 1, KEYS).astype(int))
    depths = []
    for i in keys:
        low, high = -shape.radius() - 0.5, shape.radius()
        for _ in range(12):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if hidden_share(int(i), middle) < wanted[i] else (low, middle)
        depths.append(low)
    depth = np.interp(np.arange(frames), keys, depths)
    for i in range(frames):
        while hidden_share(i, depth[i]) > share:
            depth[i] -= 0.01
    apart = np.abs(np.arange(frames)[:, None] - np.arange(frames))
    depth = (depth + SLOW / frames * apart).min(axis=1)  # nowhere farther in than allowed, and never faster
    start, rest = 0.05 * frames, 0.25 * frames
    come = np.clip((rest - np.arange(frames)) / max(1e-9, rest - start), 0.0, 1.0)
    depth -= come * come * (3.0 - 2.0 * come) * (view + shape.radius())
    way = np.full((frames, 2), np.nan)
    for i in range(max(1, math.ceil(start)), frames):
        way[i] = place_ring(i, depth[i])[1]
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
