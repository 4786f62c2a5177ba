# SPDX-License-Identifier: Apache-2.0
"""What lens, light and sensor do to an image: unevenness, changes, shadows, noise, exposure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from grasptrack.typing import Floats, Floats32

COARSE = 4
"""px; shadows are soft, so they are made on a grid this much coarser."""
POOL = 1536
"""px, side of the square from which pooled noise is taken."""


@dataclass(frozen=True)
class Shadow:
    """A soft shadow that crosses the image, over table and part alike: it multiplies what is there.

    Attributes:
        start, end: frames between which it crosses, from one side of the image to the other; it is nowhere else.
        depth: share of the light that it takes.
        width: as a share of the image's diagonal.
        softness: px, standard deviation of its edge.
        angle: rad, direction of its motion.
        round: a blob, else a bar.
        seed: of the blob's outline.
    """

    start: int
    end: int
    depth: float = 0.45
    width: float = 0.35
    softness: float = 14.0
    angle: float = 0.4
    round: bool = True
    seed: int = 0

    def light(self, index: int, width: int, height: int) -> Floats32 | None:
        """(height, width) share of the light that is left in a frame; None where the shadow is not in the image."""
        if not self.start <= index <= self.end:
            return None
        diagonal = math.hypot(width, height)
        share = (index - self.start) / max(1, self.end - self.start)
        half = 0.5 * self.width * diagonal
        along = np.array([math.cos(self.angle), math.sin(self.angle)])
        reach = 0.5 * diagonal + 1.5 * half + 3.0 * self.softness
        middle = np.array([width - 1.0, height - 1.0]) / 2.0 + along * (2.0 * share - 1.0) * reach
        if self.round:
            a = np.arange(90) * (2.0 * math.pi / 90)
            phase = np.random.default_rng((self.seed, 31)).uniform(0.0, 2.0 * math.pi, 3)
            radius = half * (1.0 + 0.2 * np.sin(2 * a + phase[0]) + 0.1 * np.sin(3 * a + phase[1]))
            ring = middle + radius[:, None] * np.column_stack([np.cos(a), np.sin(a)])
        else:
            across = np.array([-along[1], along[0]]) * diagonal
            ring = middle + np.array(
                [-half * along - across, half * along - across, half * along + across, across - half * along]
            )
        size = (-(-height // COARSE), -(-width // COARSE))
        sharp = np.zeros(size, np.float32)
        corners = np.rint((ring + 0.5) / COARSE * 16.0 - 8.0).astype(np.int32)
        cv2.fillPoly(sharp, [corners], 1.0, shift=4)
        field = cv2.GaussianBlur(sharp, (0, 0), self.softness / COARSE, borderType=cv2.BORDER_REPLICATE)
        whole = cv2.resize(field, (size[1] * COARSE, size[0] * COARSE), interpolation=cv2.INTER_LINEAR)
        return np.asarray(1.0 - np.float32(self.depth) * whole[:height, :width], dtype=np.float32)


@dataclass(frozen=True)
class Glare:
    """A reflected lamp: a bright spot that wanders over the image and saturates the sensor.

    Attributes:
        start: the first frame in which it shines; it grows for some frames.
        middle: px, about which it wanders.
        reach: px, of its wandering to every side.
        radius: px, of the spot that is saturated whatever lies there; softness is added around it.
        softness: px, standard deviation of its edge.
        waves: slow waves of its path over `count` frames.
        count: of frames.
        seed: of its path and outline.
    """

    start: int
    middle: tuple[float, float]
    reach: tuple[float, float]
    radius: float
    softness: float = 4.0
    waves: float = 1.0
    count: int = 100
    seed: int = 0

    def ring(self, index: int) -> Floats | None:
        """(N, 2) px around what is saturated in a frame; None before it shines."""
        if index < self.start:
            return None
        phase = np.random.default_rng((self.seed, 32)).uniform(0.0, 2.0 * math.pi, 5)
        u = 2.0 * math.pi * self.waves * index / max(1, self.count)
        across = 0.75 * math.sin(u + phase[0]) + 0.25 * math.sin(2.3 * u + phase[1])
        down = 0.75 * math.cos(u + phase[0]) + 0.25 * math.sin(1.7 * u + phase[2])
        centre = np.array(self.middle) + np.array(self.reach) * np.array([across, down])
        grown = self.radius * min(1.0, (index - self.start + 1) / GROWING)
        a = np.arange(72) * (2.0 * math.pi / 72)
        radius = grown * (1.0 + 0.15 * np.sin(2 * a + phase[3]) + 0.06 * np.sin(3 * a + phase[4]))
        return np.asarray(centre + radius[:, None] * np.column_stack([np.cos(a), np.sin(a)]), dtype=np.float64)


GROWING = 4
"""Frames in which a glare grows to its size."""
DAZZLE = 520.0
"""Grey levels that a glare adds in its middle: half of it, at the edge of its ring, saturates black as well."""


@dataclass(frozen=True)
class Conditions:
    """What lens, light and sensor do to the image.

    Attributes:
        blur: px, standard deviation of lens and pixel together. Textures are softened where it is above SHARP.
        noise: grey levels, standard deviation, independent from pixel to pixel.
        drift: relative amplitude of a slow change of brightness over the sequence.
        vignette: relative loss of light in the image's corners.
        gradient: relative change of the light from the middle to the right side, and to the lower side.
        jumps: (frame, gain): from that frame on the light is `gain` times what it was at first.
        shadow: one that crosses the image.
        exposure: share of the time from one frame to the next during which the sensor takes light: motion blur.
        readout: share of that time from the first row's exposure to that of the last: a rolling shutter. 0 exposes all
            rows at once. The frame's own time is that of the middle row.
        glare: a saturated reflection.
        jpeg: quality, 1 to 100, of the compression that the image comes through last; 0 is none.
        pooled: take the noise from a field that is drawn once, at random places of it: as good to the eye, and several
            times as fast.
    """

    blur: float = 0.7
    noise: float = 2.0
    drift: float = 0.0
    vignette: float = 0.0
    gradient: tuple[float, float] = (0.0, 0.0)
    jumps: tuple[tuple[int, float], ...] = ()
    shadow: Shadow | None = None
    exposure: float = 0.0
    readout: float = 0.0
    glare: Glare | None = None
    jpeg: int = 0
    pooled: bool = False

    def gain(self, index: int, count: int, phase: float) -> float:
        """Of the brightness, in frame `index` of `count`, where the slow change begins at `phase` rad."""
        slow = 1.0 + self.drift * math.sin(phase + 2.0 * math.pi * 1.3 * index / max(1, count))
        now = [gain for frame, gain in self.jumps if frame <= index]
        return slow * (now[-1] if now else 1.0)

    def fall(self, width: int, height: int) -> Floats32:
        """(height, width) share of the light by place: vignette and gradient."""
        x = (np.arange(width) - (width - 1) / 2.0) / (width / 2.0)
        y = (np.arange(height) - (height - 1) / 2.0) / (height / 2.0)
        corner = np.asarray((x[None] ** 2 + y[:, None] ** 2) / 2.0, dtype=np.float32)
        light = 1.0 - np.float32(self.vignette) * corner
        if self.gradient != (0.0, 0.0):
            light *= np.asarray(1.0 + self.gradient[0] * x[None] + self.gradient[1] * y[:, None], dtype=np.float32)
        return np.asarray(light, dtype=np.float32)


SHARP = 1.0
"""px of blur up to which textures are left as they are: their own pixels are about as soft."""


@lru_cache(maxsize=1)
def _noise_pool() -> Floats32:
    return np.random.default_rng(1953).standard_normal((POOL, POOL), dtype=np.float32)


def pooled_noise(rng: np.random.Generator, height: int, width: int) -> Floats32:
    """(height, width) noise of variance 1: two cuts of one field, at random places, added.

    Drawn afresh where the image is larger than the field.
    """
    if max(height, width) >= POOL:
        return rng.standard_normal((height, width), dtype=np.float32)
    y, x = rng.integers(0, POOL - height, 2), rng.integers(0, POOL - width, 2)
    field, sign = _noise_pool(), np.float32(math.sqrt(0.5))
    first = field[y[0] : y[0] + height, x[0] : x[0] + width]
    second = field[y[1] : y[1] + height, x[1] : x[1] + width][::-1, ::-1]  # turned, so that cuts never coincide
    return np.asarray(cv2.addWeighted(first, float(sign), second, float(sign), 0.0), dtype=np.float32)
