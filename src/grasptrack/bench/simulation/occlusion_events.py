# SPDX-License-Identifier: Apache-2.0
"""What comes between the camera and the part: a bar across the image, or something that lies in the part's plane."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from grasptrack.bench.simulation.camera import Camera
from grasptrack.errors import ConditioningError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.typing import Floats

Colour = tuple[float, float, float]


class Cover(Protocol):
    """Something in front of the part."""

    @property
    def colour(self) -> Colour:
        """BGR."""

    @property
    def relief(self) -> float:
        """How much darker its rim is than its middle, 0 to 1: 0 is flat."""

    def polygon(self, index: int, H: Floats, camera: Camera) -> Floats | None:
        """(N, 2) px of the image where it is in a frame; None where it is not in view.

        Args:
            index: of the frame.
            H: (3, 3) from the part's plane, in table units, to ideal px.
            camera: the image's size and lens.
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

    def polygon(self, index: int, H: Floats, camera: Camera) -> Floats | None:
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

    def polygon(self, index: int, H: Floats, camera: Camera) -> Floats | None:
        """(N, 2) px where it is in a frame; None where it is not in view."""
        share = self.offset(index)
        if share is None:
            return None
        ring = camera.distort(apply_homography(H, self.ring + share * self.away))
        low, high = ring.min(axis=0), ring.max(axis=0)
        seen = np.all(high >= 0.0) and np.all(low <= np.array([camera.width - 1, camera.height - 1]))
        return ring if seen else None


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

    def polygon(self, index: int, H: Floats, camera: Camera) -> Floats | None:
        """(N, 2) px where it is in a frame; None where it is not in view, or reaches behind the camera."""
        ring = self.placed(index)
        if ring is None:
            return None
        try:
            ring = camera.distort(apply_homography(H, ring))
        except ConditioningError:
            return None
        low, high = ring.min(axis=0), ring.max(axis=0)
        seen = np.all(high >= 0.0) and np.all(low <= np.array([camera.width - 1, camera.height - 1]))
        return ring if seen else None


def _smooth_step(u: float) -> float:
    return u * u * (3.0 - 2.0 * u)
