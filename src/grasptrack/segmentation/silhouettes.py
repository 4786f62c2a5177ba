# SPDX-License-Identifier: Apache-2.0
"""Silhouettes as pixel chains: traced in a binary image, cut out by a threshold, or filled from a polygon."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.images import Grey
from grasptrack.typing import Box, Floats

Chain = NDArray[np.int32]
Window = tuple[int, int, int, int]
"""Left, top, right and bottom px of a part of an image, the latter two not included."""

MIN_AREA = 30.0
"""px^2; a smaller region is noise."""
MIN_CHAIN = 8
"""Pixels of a boundary; a shorter one bounds no region."""
MIN_HOLE_SHARE, MIN_HOLE_AREA = 0.002, 12.0
"""Smallest hole, as a share of its silhouette and in px^2."""
MIN_POLYGON_AREA = 8.0
"""px^2 of what is left of a polygon in the image."""
MIN_LEVEL_GAP = 6.0
"""Thresholds that differ by fewer grey levels give the same outlines."""
THIN_RADIUS, THIN_MARGIN = 2, 4
"""px: what a disc of this radius cannot enter is thin; and px round a region in which it is measured."""
NECK_RADII = (1, 2, 3, 4, 6, 8, 11)
"""px, half the widths of necks that are looked for."""
EVEN, STEP_PX, MAX_BAR, BAR_LEVELS, BLACK = 0.9, 3, 0.25, 6.0, 32.0
"""Black bars: share of a row's pixels that have the bar's grey, and px in which that ends, where at most a share of MAX_BAR has
it any more; no bar is deeper than that share of the image. Grey levels by which codecs and noise change it, and that it has at
most."""
SUBPIXEL_BITS = 4
"""Binary digits of a pixel's fraction with which OpenCV fills polygons."""
ROUNDING = 1e-12
"""Share of the largest variance within which others equal it."""


class Silhouette(NamedTuple):
    """One connected region.

    Attributes:
        outer: (N, 2) pixel centres along its boundary, image coordinates.
        holes: the same for its holes, largest first.
        area: px^2 within the outer boundary.
        box: x, y, width, height of the outer boundary.
    """

    outer: Chain
    holes: tuple[Chain, ...]
    area: float
    box: tuple[int, int, int, int]

    @property
    def longer_side(self) -> int:
        """px, the longer side of the box."""
        return max(self.box[2:])

    def depth_at(self, x: float, y: float) -> float:
        """px by which a pixel lies within the outer boundary, negative outside."""
        return float(cv2.pointPolygonTest(self.outer, (float(x), float(y)), True))

    def boundary_points(self, most: int) -> Floats:
        """(N, 2) px, about `most` points of its outer boundary, with positive signed area."""
        chain = self.outer[:: max(1, len(self.outer) // most)]
        forward = cv2.contourArea(self.outer, oriented=True) > 0.0
        return np.ascontiguousarray(chain if forward else chain[::-1], dtype=np.float64)

    def box_window(self, margin: int, size: tuple[int, ...]) -> Window:
        """The box with a margin in px on each side, as far as it lies in an image of (height, width)."""
        x, y, w, h = self.box
        right, bottom = min(x + w + margin, size[1]), min(y + h + margin, size[0])
        return max(x - margin, 0), max(y - margin, 0), right, bottom

    def filled_window(self, window: Window) -> Grey:
        """(h, w) of a window, 255 within the outer boundary."""
        left, top, right, bottom = window
        filled = np.zeros((bottom - top, right - left), np.uint8)
        cv2.drawContours(filled, [self.outer.reshape(-1, 1, 2)], -1, (255,), cv2.FILLED, offset=(-left, -top))
        return filled

    def material_mask(self) -> Grey:
        """(h, w) of the box, 255 on the region without its holes."""
        x, y, w, h = self.box
        filled = self.filled_window((x, y, x + w, y + h))
        cv2.drawContours(filled, [hole.reshape(-1, 1, 2) for hole in self.holes], -1, (0,), cv2.FILLED, offset=(-x, -y))
        return filled


def thin_share(shape: Silhouette, px: int) -> float:
    """Share of an outline on spurs, bridges and ragged parts, of the image reduced by `px`.

    These lie beyond what a disc of THIN_RADIUS covers within the region.
    """
    outer, filled = _fill_reduced(shape, px)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * THIN_RADIUS + 1,) * 2)
    away = cv2.distanceTransform(cv2.bitwise_not(cv2.morphologyEx(filled, cv2.MORPH_OPEN, disc)), cv2.DIST_L2, 3)
    return float((away[outer[:, 1], outer[:, 0]] > THIN_RADIUS).mean())


def neck_width(shape: Silhouette, px: int) -> float:
    """Width of a region's narrowest neck, as a share of the size of the lesser part beyond it; 1 where it has none.

    Of the image reduced by `px`. A handle is as long as it is narrow; what only touches hangs on by little.
    """
    depth, narrowest = cv2.distanceTransform(_fill_reduced(shape, px)[1], cv2.DIST_L2, 3), 1.0
    for radius in NECK_RADII:
        count, _, stats, _ = cv2.connectedComponentsWithStats(to_binary(depth > radius), connectivity=8)
        if count > 2:
            size = math.sqrt(float(np.partition(stats[1:, cv2.CC_STAT_AREA], -2)[-2]))
            narrowest = min(narrowest, 2.0 * radius / (size + 2.0 * radius))
    return narrowest


def _fill_reduced(shape: Silhouette, px: int) -> tuple[Chain, Grey]:
    """The outer boundary in the image reduced by `px`, and (h, w) 255 within it, a margin round it."""
    outer = shape.outer // px
    filled = np.zeros((np.ptp(outer, axis=0) + 2 * THIN_MARGIN + 1)[::-1], np.uint8)
    outer = (outer - outer.min(axis=0) + THIN_MARGIN).astype(np.int32)
    cv2.drawContours(filled, [outer.reshape(-1, 1, 2)], -1, (255,), cv2.FILLED)
    return outer, filled


def box_iou(one: Box | tuple[int, int, int, int], other: Box) -> float:
    """Intersection over union of two boxes."""
    wide = min(one[0] + one[2], other[0] + other[2]) - max(one[0], other[0])
    tall = min(one[1] + one[3], other[1] + other[3]) - max(one[1], other[1])
    both = max(wide, 0.0) * max(tall, 0.0)
    return both / (one[2] * one[3] + other[2] * other[3] - both)


def picture_window(grey: Grey) -> Window:
    """The part of an image (H, W) within black bars, pillars or a bezel: they come in pairs that are equally deep.

    All of it where there are none.
    """
    (top, low), (left, right) = _bar_depths(grey), _bar_depths(grey.T)
    return left, top, grey.shape[1] - right, grey.shape[0] - low


def _bar_depths(grey: Grey) -> tuple[int, int]:
    """px of the bars at both ends of an image's rows (H, W), 0 where there is none."""
    found = []
    for rows in (grey, grey[::-1]):
        most, level = int(MAX_BAR * len(rows)), float(np.median(rows[0]))
        alike = (np.abs(rows[:most].astype(np.float32) - level) <= BAR_LEVELS).mean(axis=1)
        depth = int(np.argmax(alike < EVEN)) if (alike < EVEN).any() else most
        ends = depth + STEP_PX < most and alike[depth + STEP_PX] <= MAX_BAR
        found.append(depth + STEP_PX if level <= BLACK and depth > 0 and ends else 0)
    return (found[0], found[1]) if abs(found[0] - found[1]) <= STEP_PX and min(found) else (0, 0)


def to_binary(mask: NDArray[np.bool_]) -> Grey:
    """(H, W) 255 where a mask is set, else 0."""
    return np.where(mask, np.uint8(255), np.uint8(0))


def trace_silhouettes(
    binary: Grey, least: float = MIN_AREA, origin: tuple[int, int] = (0, 0), *, holes: bool = True
) -> list[Silhouette]:
    """All silhouettes of at least so many px^2 where an image (H, W) is nonzero, largest first; to find holes takes time.

    `origin` is where its first pixel lies in the image.
    """
    mode = cv2.RETR_CCOMP if holes else cv2.RETR_EXTERNAL
    chains, tree = cv2.findContours(binary, mode, cv2.CHAIN_APPROX_NONE, offset=origin)
    found: list[Silhouette] = []
    for index, chain in enumerate(chains):
        if len(chain) < MIN_CHAIN or (holes and tree[0][index][3] >= 0):
            continue
        area = float(cv2.contourArea(chain))
        if area < least:
            continue
        inner: list[tuple[float, Chain]] = []
        child = int(tree[0][index][2]) if holes else -1
        while child >= 0:
            if len(chains[child]) >= MIN_CHAIN:
                size = float(cv2.contourArea(chains[child]))
                if size >= max(MIN_HOLE_SHARE * area, MIN_HOLE_AREA):
                    inner.append((size, _chain_points(chains[child])))
            child = int(tree[0][child][0])
        inner.sort(key=lambda pair: -pair[0])
        x, y, w, h = cv2.boundingRect(chain)
        found.append(Silhouette(_chain_points(chain), tuple(c for _, c in inner), area, (x, y, w, h)))
    found.sort(key=lambda s: -s.area)
    return found


def _chain_points(chain: NDArray[Any]) -> Chain:
    """(N, 2) of OpenCV's (N, 1, 2)."""
    return np.asarray(chain, dtype=np.int32).reshape(-1, 2)


def polygon_silhouette(polygon: Floats, size: tuple[int, ...]) -> Silhouette | None:
    """The region within a polygon (n, 2) px, as far as it lies in an image of (height, width); None where nothing does."""
    found = trace_silhouettes(fill_polygon(polygon, size), MIN_POLYGON_AREA, holes=False)
    return found[0] if found else None


def fill_polygon(polygon: Floats, size: tuple[int, ...]) -> Grey:
    """(H, W) 255 within a polygon (n, 2) px."""
    filled = np.zeros(size[:2], np.uint8)
    corners = np.rint(polygon * 2.0**SUBPIXEL_BITS).astype(np.int32)
    cv2.fillPoly(filled, [corners], (255,), cv2.LINE_8, SUBPIXEL_BITS)
    return filled


def threshold_mask(
    grey: Grey, level: float, polarity: int, hidden: Grey | None = None, window: Window | None = None
) -> Grey:
    """(h, w) nonzero where a window of a grey image, or all of it, is darker (polarity +1) or lighter (-1) than a level."""
    left, top, right, bottom = window or (0, 0, grey.shape[1], grey.shape[0])
    binary = kernels.blur_threshold(grey, left, top, right, bottom, level, polarity)
    if hidden is not None:
        binary[hidden[top:bottom, left:right] != 0] = 0
    return binary


def candidate_thresholds(values: NDArray[np.uint8]) -> list[float]:
    """Otsu's threshold of all grey levels, and of those on either side of it, where these differ."""
    # OpenCV needs a contiguous channel, and is ten times as fast as bincount
    grey = np.ascontiguousarray(values)
    histogram = cv2.calcHist([grey], [0], None, [256], [0, 256]).ravel().astype(np.float64)
    middle = otsu_threshold(histogram)
    if middle is None:
        return []
    levels = [middle]
    below, above = histogram.copy(), histogram.copy()
    below[int(middle) + 1 :] = 0.0
    above[: int(middle) + 1] = 0.0
    for part in (below, above):
        level = otsu_threshold(part)
        if level is not None and all(abs(level - other) >= MIN_LEVEL_GAP for other in levels):
            levels.append(level)
    return levels


def otsu_threshold(histogram: Floats) -> float | None:
    """The level k + 0.5 that best separates a histogram (256,) into up to k and above; None for a single level."""
    total = histogram.sum()
    below = np.cumsum(histogram)[:-1]
    above = total - below
    usable = (below > 0) & (above > 0)
    if not usable.any():
        return None
    moment = np.cumsum(histogram * np.arange(256))
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = below * above * (moment[:-1] / below - (moment[-1] - moment[:-1]) / above) ** 2
    spread[~usable] = -1.0
    top = np.flatnonzero(spread >= spread.max() * (1 - ROUNDING))
    return float(0.5 * (top[0] + top[-1]) + 0.5)
