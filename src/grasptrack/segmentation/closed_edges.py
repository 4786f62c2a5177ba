# SPDX-License-Identifier: Apache-2.0
"""Silhouettes from closed edges: for objects of several colours, glossy ones, or as bright as their background.

Edges are thinned at several levels, their broken ends linked by good continuation, the remaining gaps bridged by a
morphological closing, and everything enclosed is filled. The right level and closing radius are not known, so each
recipe proposes and one rating decides.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack import kernels
from grasptrack.images import Grey
from grasptrack.segmentation.normalized_gradient import NormalizedGradient, Planes
from grasptrack.segmentation.silhouettes import Silhouette, trace_silhouettes
from grasptrack.segmentation.work import CLOSING, RATED, SEARCH_SHARE, Work

WORKING_SIDE = 800
"""px; larger images are reduced first, and outlines are localised in the full image afterwards."""
SOFTENING = (1.0, 1.6)
"""px, Gaussian blur before gradients: the first follows fine parts, the second suppresses noise."""
RECIPES = (
    (0, 2.5, 1),
    (0, 4.0, 2),
    (0, 7.5, 3),
    (0, 3.0, 6),
    (0, 2.5, 8),
    (0, 5.5, 8),
    (1, 3.0, 3),
    (1, 2.0, 3),
    (1, 1.6, 4),
)
"""Index into SOFTENING, level in units of noise, and closing radius in px. Low levels find faint edges and clutter, wide
closings bridge gaps and fill notches."""
REACH = 0.125
"""Edge ends are linked across gaps of at most this share of the image's longer side, ..."""
BEND, LOOSE = float(np.radians(25.0)), float(np.radians(70.0))
"""... and may point aside by these angles, rad; the second for gaps of a few px."""
MAX_SHARE = 0.9
"""Edges that enclose a larger share of the image enclose the background."""


class Closure(NamedTuple):
    """A region enclosed by edges.

    Attributes:
        silhouette: in px of the image, without holes.
        bridge: px, the widest gap that the closing bridges.
        recipe: index into RECIPES.
        grain: noise unit of the gradient field in which it was found.
    """

    silhouette: Silhouette
    bridge: float
    recipe: int
    grain: float


class ClosedEdgeSegmenter:
    """The edges of one image.

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
        if self.shrink > 1:
            image, hidden = _downsample_planes(image, self.shrink), _downsample_mask(hidden, self.shrink)
        self._reach = REACH * max(image.shape[:2])
        self.planes = image
        self.fields = tuple(NormalizedGradient(image, softening, hidden) for softening in SOFTENING)

    def closures(self, least: float, extent: float, work: Work | None = None) -> list[Closure]:
        """Regions enclosed by any recipe, of at least `least` px^2 and `extent` px across, as far as `work` allows."""
        work = Work() if work is None else work
        cost = CLOSING * self.fields[0].strength.size / 1e6
        px = self.shrink
        found: list[Closure] = []
        edges: dict[tuple[int, float], Grey] = {}
        for recipe, (field, level, radius) in enumerate(RECIPES):
            if not work.allows(cost, SEARCH_SHARE):
                break
            if (field, level) not in edges:
                edges[field, level] = link_edges(self.fields[field].thin(level), self._reach)
            for shape in enclosed_silhouettes(edges[field, level], radius, least / px**2, extent / px):
                found.append(
                    Closure(_to_full_resolution(shape, px), 2.0 * radius * px, recipe, self.fields[field].unit)
                )
                work.spend(RATED)
            work.spend(cost)
        return found


class Closing:
    """One recipe, applied again to later images.

    Args:
        recipe: index into RECIPES.
        grain: noise of the image in which it found the object. In a window that the object fills it cannot be measured.
        size: height and width of the image.
    """

    def __init__(self, recipe: int, grain: float, size: tuple[int, ...]) -> None:
        self._softening, self._level, self._radius = RECIPES[recipe]
        self._grain, self._shrink = grain, _shrink_factor(size)
        self._reach = REACH * max(size[:2]) / self._shrink

    def shapes(self, image: Planes, hidden: Grey | None, least: float, origin: tuple[int, int]) -> list[Silhouette]:
        """Regions enclosed by edges.

        Args:
            image: planes of an image or of a window of it.
            hidden: (H, W) nonzero where pixels are ignored.
            least: px^2.
            origin: (x, y) px of the window's first pixel in the image.
        """
        px = self._shrink
        if px > 1:
            image, hidden = _downsample_planes(image, px), _downsample_mask(hidden, px)
        field = NormalizedGradient(image, SOFTENING[self._softening], hidden, self._grain)
        edges = link_edges(field.thin(self._level), self._reach)
        return [
            _to_full_resolution(s, px, origin)
            for s in enclosed_silhouettes(edges, self._radius, least / px**2, math.sqrt(least) / px)
        ]


def link_edges(edges: Grey, reach: float) -> Grey:
    """Link the broken ends of thin edges (H, W), in place, across gaps of at most `reach` px."""
    for x0, y0, x1, y1 in kernels.edge_links(edges, reach, BEND, LOOSE).tolist():
        cv2.line(edges, (x0, y0), (x1, y1), (255,), 1)
    return edges


def enclosed_silhouettes(edges: Grey, radius: int, least: float, extent: float) -> list[Silhouette]:
    """Silhouettes enclosed by thin edges.

    Args:
        edges: (H, W) one pixel wide.
        radius: px, of the closing.
        least: px^2.
        extent: px across at least.
    """
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    found: list[Silhouette] = []
    for shape in trace_silhouettes(np.asarray(cv2.dilate(edges, disc), dtype=np.uint8), least, holes=False):
        x, y, w, h = shape.box
        if shape.area > MAX_SHARE * edges.size or max(w, h) < extent + 2 * radius:
            continue
        filled = np.zeros((h + 2, w + 2), np.uint8)
        cv2.drawContours(filled, [shape.outer.reshape(-1, 1, 2)], -1, (255,), cv2.FILLED, offset=(1 - x, 1 - y))
        shrunk = np.asarray(cv2.erode(filled, disc, borderValue=0), dtype=np.uint8)
        found.extend(trace_silhouettes(shrunk, least, (x - 1, y - 1), holes=False))
    return found


def _shrink_factor(size: tuple[int, ...]) -> int:
    return max(1, -(-max(size[:2]) // WORKING_SIDE))


def _downsample_planes(image: Planes, times: int) -> Planes:
    height, width = image.shape[0] // times, image.shape[1] // times
    small = cv2.resize(image[: height * times, : width * times], (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.float32).reshape(height, width, -1)


def _downsample_mask(hidden: Grey | None, times: int) -> Grey | None:
    if hidden is None:
        return None
    height, width = hidden.shape[0] // times, hidden.shape[1] // times
    blocks = hidden[: height * times, : width * times].reshape(height, times, width, times)
    return np.where((blocks != 0).any(axis=(1, 3)), np.uint8(255), np.uint8(0))


def _to_full_resolution(shape: Silhouette, px: int, origin: tuple[int, int] = (0, 0)) -> Silhouette:
    """A silhouette of a reduced window in px of the image: pixel centres go to block centres."""
    if px == 1 and origin == (0, 0):
        return shape
    outer = shape.outer * px + (px - 1) // 2 + np.array(origin, np.int32)
    x, y, w, h = cv2.boundingRect(outer.reshape(-1, 1, 2))
    return Silhouette(outer, (), shape.area * px**2, (x, y, w, h))
