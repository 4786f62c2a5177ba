# SPDX-License-Identifier: Apache-2.0
"""One image of a flat part on a table, through a homography, as a camera would record it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.projective import apply_homography
from grasptrack.simulation.coverage import coverage
from grasptrack.simulation.shapes import Shape
from grasptrack.simulation.texture import Texture

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]


@dataclass(frozen=True)
class Conditions:
    """What lens, light and sensor do to the image.

    Attributes:
        blur: px, standard deviation of lens and pixel together.
        noise: grey levels, standard deviation, independent from pixel to pixel.
        drift: relative amplitude of a slow change of brightness over the sequence.
        vignette: relative loss of light in the image's corners.
    """

    blur: float = 0.7
    noise: float = 2.0
    drift: float = 0.0
    vignette: float = 0.0


@dataclass(frozen=True)
class Bar:
    """An occluder: a straight bar across the image that sweeps over it.

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
    colour: tuple[float, float, float] = (120, 128, 131)

    def polygon(self, index: int, width: int, height: int) -> Floats | None:
        """(4, 2) px where it is in a frame of a sequence; None before `start` and after `end`."""
        if not self.start <= index <= self.end:
            return None
        diagonal = math.hypot(width, height)
        share = (index - self.start) / max(1, self.end - self.start)
        along = np.array([math.cos(self.angle), math.sin(self.angle)])
        across = np.array([-along[1], along[0]])
        half = 0.5 * self.width * diagonal
        middle = np.array([width - 1.0, height - 1.0]) / 2.0 + along * (share - 0.5) * (diagonal + 2.0 * half)
        a, b = along * half, across * diagonal
        return np.array([middle - a - b, middle + a - b, middle + a + b, middle - a + b])


class Renderer:
    """Renders a part on a table.

    Args:
        shape: its outline, in table units, lying at the origin.
        table: the texture below it.
        surface: its own texture.
        width: px.
        height: px.
        blur: px, see `Conditions`.
        colour: BGR images, else grey ones.
    """

    def __init__(
        self, shape: Shape, table: Texture, surface: Texture, *, width: int, height: int, blur: float, colour: bool
    ) -> None:
        self.shape = shape
        self.size = (width, height)
        self.blur = blur
        self.colour = colour
        self._table = table if colour else table.grey
        self._surface = surface if colour else surface.grey
        x = (np.arange(width) - (width - 1) / 2.0) / (width / 2.0)
        y = (np.arange(height) - (height - 1) / 2.0) / (height / 2.0)
        self._corner = np.asarray((x[None] ** 2 + y[:, None] ** 2) / 2.0, dtype=np.float32)

    def outline(self, H: Floats) -> tuple[Floats, ...]:
        """The part's polygons in px under H, table to image."""
        return tuple(apply_homography(H, polygon) for polygon in self.shape.polygons)

    def light(self, H: Floats, slide: Floats | None = None) -> Floats32:
        """(height, width) or (height, width, 3) grey levels before light, occluder and noise.

        Args:
            H: (3, 3) table to image.
            slide: (2,) table units by which the table's texture has moved under the part.
        """
        moved = np.eye(3)
        if slide is not None:
            moved[:2, 2] = slide
        below = self._warp(self._table, H @ moved)
        self._over(below, self.outline(H), self._warp(self._surface, H))
        return below

    def occlude(self, image: Floats32, bar: Bar, polygon: Floats) -> None:
        """Draws the bar over the image, in place."""
        colour = np.array(bar.colour, np.float32)
        grey = np.float32(colour @ np.array([0.114, 0.587, 0.299], np.float32))
        self._over(image, (polygon,), np.broadcast_to(colour if self.colour else grey, image.shape))

    def expose(
        self, image: Floats32, rng: np.random.Generator, *, gain: float, noise: float, vignette: float
    ) -> NDArray[np.uint8]:
        """8 bit from grey levels: light falling off to the corners, gain, noise."""
        if vignette > 0.0 or gain != 1.0:
            fall = np.float32(gain) * (1.0 - np.float32(vignette) * self._corner)
            image *= fall[..., None] if self.colour else fall
        if noise > 0.0:
            image += np.float32(noise) * rng.standard_normal(image.shape, dtype=np.float32)
        np.maximum(image, 0.0, out=image)
        return np.asarray(cv2.convertScaleAbs(image), dtype=np.uint8)

    def _warp(self, texture: Texture, H: Floats) -> Floats32:
        warped = cv2.warpPerspective(
            texture.image, H @ texture.to_table, self.size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101
        )
        return np.asarray(warped, dtype=np.float32)

    def _over(self, below: Floats32, polygons: tuple[Floats, ...], above: Floats32) -> None:
        """Lays `above` on `below` inside the polygons, in place, only where they are."""
        corners = np.concatenate(polygons)
        margin = 5.0 * self.blur + 2.0
        x0, y0 = np.clip(np.floor(corners.min(axis=0) - margin), 0, self.size).astype(int)
        x1, y1 = np.clip(np.ceil(corners.max(axis=0) + margin), 0, self.size).astype(int)
        if x1 <= x0 or y1 <= y0:
            return
        share = coverage([p - np.array([x0, y0]) for p in polygons], x1 - x0, y1 - y0, self.blur)
        if self.colour:
            share = share[..., None]
        part = below[y0:y1, x0:x1]
        part += share * (above[y0:y1, x0:x1] - part)
