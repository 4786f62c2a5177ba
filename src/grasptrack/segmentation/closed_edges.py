# SPDX-License-Identifier: Apache-2.0
"""Silhouettes from closed edges: for objects of several colours, glossy ones, or as bright as their background.

Edges are thinned at several levels of a gradient in units of the image's own noise, their broken ends linked by good
continuation, the remaining gaps bridged by a morphological closing, and everything enclosed is filled. The right level and
closing radius are not known, so each recipe proposes and one rating decides.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.images import Grey
from grasptrack.segmentation.silhouettes import Silhouette, to_binary, trace_silhouettes
from grasptrack.typing import Floats32

Planes = Floats32
"""(H, W, C): lightness, and for colour images the two chroma planes, in units of CIE Lab."""

LIGHTNESS = 100.0 / 255.0
"""Lab units of a step of OpenCV's lightness."""
CHROMA = 1.4
"""Weight of chroma against lightness: shadow and glare change lightness alone, another material both."""
MIN_NOISE = 0.8
"""Lab units per px that count as noise in an image without any."""
FINE = 100.0
"""Integer steps per unit of gradient: OpenCV's Canny takes whole numbers."""
SCHARR_WEIGHT = 32.0
"""Sum of the positive weights of Scharr's derivative, of a step of one pixel."""
HYSTERESIS = 2.0
"""A thin edge reaches somewhere this many times the level at which it ends."""
WORKING_SIDE = 800
"""px; larger images are reduced first, and outlines are localised in the full image afterwards."""
SOFTENING = (1.0, 1.6)
"""px, Gaussian blur before gradients: the first follows fine parts, the second suppresses noise."""


class ClosingRecipe(NamedTuple):
    """How edges are closed: low levels find faint edges and clutter, wide closings bridge gaps and fill notches.

    Softening is an index into SOFTENING, the level in units of noise, the radius in px.
    """

    softening: int
    level: float
    radius: int


RECIPES = (
    *(ClosingRecipe(0, *each) for each in ((2.5, 1), (4.0, 2), (7.5, 3), (3.0, 6), (2.5, 8), (5.5, 8))),
    *(ClosingRecipe(1, *each) for each in ((3.0, 3), (2.0, 3), (1.6, 4))),
)
MAX_GAP = 0.125
"""Edge ends are linked across gaps of at most this share of the image's longer side, ..."""
MAX_BEND, MAX_BEND_NEAR = math.radians(25.0), math.radians(70.0)
"""... and may point aside by these angles, rad; the second for gaps of a few px."""
MAX_FILLED_SHARE = 0.9
"""Edges that enclose a larger share of the image enclose the background."""


def lab_planes(image: NDArray[np.uint8]) -> Planes:
    """Lightness and chroma of a grey (H, W) or BGR (H, W, 3) image."""
    if image.ndim == 2:
        return cv2.LUT(image, _lightness_table()).astype(np.float32)[:, :, None] * np.float32(LIGHTNESS)
    lab = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2Lab))
    return np.multiply(lab, np.array([LIGHTNESS, CHROMA, CHROMA], np.float32), dtype=np.float32)


@lru_cache(maxsize=1)
def _lightness_table() -> NDArray[np.uint8]:
    """(256,) OpenCV's lightness of each grey level."""
    greys = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)
    return np.ascontiguousarray(cv2.cvtColor(greys, cv2.COLOR_BGR2Lab)[0, :, 0], dtype=np.uint8)


class NormalizedGradient:
    """Gradients of an image, at each pixel that of its steepest plane, in units of the image's own gradient noise.

    Args:
        image: planes.
        softening: px, sigma of the Gaussian blur: more suppresses noise, less follows fine parts.
        hidden: (H, W) nonzero where pixels are ignored, or None.
        unit: the image's gradient noise if known, Lab units per px; otherwise it is measured.

    Attributes:
        unit: Lab units per px, the median gradient combined with MIN_NOISE.
    """

    def __init__(self, image: Planes, softening: float, hidden: Grey | None = None, unit: float | None = None) -> None:
        soft = cv2.GaussianBlur(image, (0, 0), softening)
        across, along, steep = _scharr_gradients(soft if soft.ndim == 2 else np.ascontiguousarray(soft[:, :, 0]))
        for k in range(1, image.shape[2]):
            ax, ay, other = _scharr_gradients(np.ascontiguousarray(soft[:, :, k]))
            steeper: Any = cv2.compare(other, steep, cv2.CMP_GT)
            for of_plane, chosen in ((ax, across), (ay, along), (other, steep)):
                cv2.copyTo(of_plane, steeper, chosen)
        if hidden is not None:
            for each in (across, along, steep):
                each[hidden != 0] = 0.0
        if unit is None:
            some = steep[::2, ::2] if hidden is None else steep[::2, ::2][hidden[::2, ::2] == 0]
            unit = math.hypot(float(np.median(some)) / FINE if some.size else 0.0, MIN_NOISE)
        self.unit = unit
        self._steep = np.asarray(steep, dtype=np.float32)
        self._dx, self._dy = np.asarray(across).astype(np.int16), np.asarray(along).astype(np.int16)

    @property
    def gradient_magnitude(self) -> Floats32:
        """(H, W) gradient magnitude in units of the image's noise."""
        return np.asarray(self._steep * np.float32(1.0 / (FINE * self.unit)), dtype=np.float32)

    @property
    def gradient_components(self) -> tuple[Floats32, Floats32]:
        """(H, W) gradients along x and y in units of the image's noise."""
        unit = np.float32(1.0 / (FINE * self.unit))
        return self._dx * unit, self._dy * unit

    @property
    def gradient_direction(self) -> Floats32:
        """(H, W, 2) unit vectors of the gradients, zero where there is none."""
        both = np.stack([self._dx, self._dy], axis=-1).astype(np.float32)
        return np.asarray(both / np.maximum(np.linalg.norm(both, axis=-1, keepdims=True), 1.0), dtype=np.float32)

    def thin_edges(self, level: float) -> Grey:
        """(H, W) 255 along edges of at least `level` units that reach twice as much somewhere, one pixel wide."""
        low = level * self.unit * FINE
        return np.asarray(cv2.Canny(self._dx, self._dy, low, HYSTERESIS * low, L2gradient=True), dtype=np.uint8)


def _scharr_gradients(plane: NDArray[Any]) -> tuple[Any, Any, Any]:
    """Gradients along x and y and their magnitude, in FINE steps per unit."""
    dx, dy = (cv2.Scharr(plane, cv2.CV_32F, *way, scale=FINE / SCHARR_WEIGHT) for way in ((1, 0), (0, 1)))
    return dx, dy, cv2.magnitude(dx, dy)


class ClosedEdgeSegmenter:
    """The edges of one image, reduced where it is large.

    Args:
        image: planes, (H, W, C).
        hidden: (H, W) nonzero where pixels are ignored.

    Attributes:
        shrink: image px per px here.
        planes: (h, w, C), the image made smaller so.
        fields: gradients, one for each softening.
    """

    def __init__(self, image: Planes, hidden: Grey | None = None) -> None:
        self.shrink = _shrink_factor(image.shape)
        self.planes, hidden = _downsample_planes(image, hidden, self.shrink)
        self.fields = tuple(NormalizedGradient(self.planes, softening, hidden) for softening in SOFTENING)
        self._max_gap = MAX_GAP * max(self.planes.shape[:2])
        self._edges: dict[tuple[int, float], Grey] = {}

    def enclosed_regions(self, recipe: ClosingRecipe, least: float, extent: float) -> list[Silhouette]:
        """Regions enclosed by edges, of at least `least` px^2 and `extent` px across, in px of the image."""
        key = recipe.softening, recipe.level
        if key not in self._edges:
            self._edges[key] = link_edges(self.fields[recipe.softening].thin_edges(recipe.level), self._max_gap)
        px = self.shrink
        shapes = enclosed_silhouettes(self._edges[key], recipe.radius, least / px**2, extent / px)
        return [to_full_resolution(shape, px) for shape in shapes]


class ObjectClosing:
    """The recipe that found an object, applied again to later images.

    Args:
        recipe: index into RECIPES.
        grain: noise of the image in which it found the object. In a window that the object fills it cannot be measured.
        size: height and width of the image.
    """

    def __init__(self, recipe: int, grain: float, size: tuple[int, ...]) -> None:
        self._recipe, self._grain, self._shrink = RECIPES[recipe], grain, _shrink_factor(size)
        self._max_gap = MAX_GAP * max(size[:2]) / self._shrink

    def enclosed(self, image: Planes, hidden: Grey | None, least: float, origin: tuple[int, int]) -> list[Silhouette]:
        """Regions of at least so many px^2 enclosed by edges of an image, or of a window that begins at px `origin` (x, y)."""
        px, recipe = self._shrink, self._recipe
        image, hidden = _downsample_planes(image, hidden, px)
        field = NormalizedGradient(image, SOFTENING[recipe.softening], hidden, self._grain)
        edges = link_edges(field.thin_edges(recipe.level), self._max_gap)
        shapes = enclosed_silhouettes(edges, recipe.radius, least / px**2, math.sqrt(least) / px)
        return [to_full_resolution(shape, px, origin) for shape in shapes]


def link_edges(edges: Grey, max_gap: float) -> Grey:
    """Link the broken ends of thin edges (H, W), in place, across gaps of at most `max_gap` px."""
    for x0, y0, x1, y1 in kernels.edge_links(edges, max_gap, MAX_BEND, MAX_BEND_NEAR).tolist():
        cv2.line(edges, (x0, y0), (x1, y1), (255,), 1)
    return edges


def enclosed_silhouettes(edges: Grey, radius: int, least: float, extent: float) -> list[Silhouette]:
    """Silhouettes of at least so many px^2, `extent` px across, enclosed by thin edges (H, W) when closed by `radius` px."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    found: list[Silhouette] = []
    for shape in trace_silhouettes(np.asarray(cv2.dilate(edges, disc), dtype=np.uint8), least, holes=False):
        x, y, w, h = shape.box
        if shape.area > MAX_FILLED_SHARE * edges.size or shape.longer_side < extent + 2 * radius:
            continue
        filled = shape.filled_window((x - 1, y - 1, x + w + 1, y + h + 1))
        shrunk = np.asarray(cv2.erode(filled, disc, borderValue=0), dtype=np.uint8)
        found.extend(trace_silhouettes(shrunk, least, (x - 1, y - 1), holes=False))
    return found


def _shrink_factor(size: tuple[int, ...]) -> int:
    return max(1, -(-max(size[:2]) // WORKING_SIDE))


def _downsample_planes(image: Planes, hidden: Grey | None, times: int) -> tuple[Planes, Grey | None]:
    """Planes and a mask reduced by a whole number; a pixel is hidden where one of its block is."""
    if times == 1:
        return image, hidden
    height, width = image.shape[0] // times, image.shape[1] // times
    small = cv2.resize(image[: height * times, : width * times], (width, height), interpolation=cv2.INTER_AREA)
    if hidden is not None:
        blocks = hidden[: height * times, : width * times].reshape(height, times, width, times)
        hidden = to_binary((blocks != 0).any(axis=(1, 3)))
    return np.asarray(small, dtype=np.float32).reshape(height, width, -1), hidden


def to_full_resolution(shape: Silhouette, px: int, origin: tuple[int, int] = (0, 0)) -> Silhouette:
    """A silhouette of a reduced window in px of the image: pixel centres go to block centres."""
    if px == 1 and origin == (0, 0):
        return shape
    outer, *holes = (chain * px + (px - 1) // 2 + np.array(origin, np.int32) for chain in (shape.outer, *shape.holes))
    x, y, w, h = cv2.boundingRect(outer.reshape(-1, 1, 2))
    return Silhouette(outer, tuple(holes), shape.area * px**2, (x, y, w, h))
