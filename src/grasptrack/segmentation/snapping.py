# SPDX-License-Identifier: Apache-2.0
"""A rough outline drawn to the edges beside it: one offset for each of its points, all chosen together.

Each point of the outline may move along its normal. It gains where the image's slope across the outline is steep, where the
colours that it takes in are those of the inside and the colours that it leaves out those of the outside (both told from
the outline's neighbourhood), and where a segmenter's map says so; it pays for the way and for steps beside its neighbours.
"""

from __future__ import annotations

import json
import math
from functools import lru_cache
from importlib.resources import files
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.segmentation.closed_edges import ClosedEdgeSegmenter
from grasptrack.segmentation.silhouettes import Silhouette, fill_polygon
from grasptrack.typing import Bools, Floats, Floats32

STEP, COARSE_STEP = 2.0, 4.0
"""px between the points that are moved, and between those that are displaced to see whether they return."""
MIN_POINTS, MOST_POINTS = 16, 8192
INSIDE_DEPTH, OUTSIDE_DEPTH = 5.0, 6.0
"""px inside an outline and outside it from which colours are those of the object and of its surroundings, if the outline
is off by no more."""
COLOR_VARIANCE = 9.0
"""Lab units^2 by which any colour may vary."""
APART_WEIGHT, VARIANCE_WEIGHT = 0.75, 0.15
"""Of the terms of a colour's log likelihood: how far it lies from the pooled ones, and how much these vary. Less than those of
a normal distribution, as planes and neighbours are not independent."""
MAX_COLOR_ODDS = 2.0
"""Logarithm of odds that one pixel's colour counts at most."""
MIN_POOL = 20.0
"""Pixels from which colours are known."""
DISPLACED = 5.0
"""px by which an outline is displaced, in four directions, to see whether it returns; ..."""
RETURNED = 2.5
"""... and px within which its points count as back."""
FAR, MARGIN = 255, 2
"""What a plane has off a line that distances are measured from, and px round it that the plane needs."""
ALL_ROUND = 0.97
"""Share of two outlines beside each other from which they agree."""
TINY = 1e-9


class SnapNumbers(NamedTuple):
    """What moves an outline's points; fitted by `research.studies.polygons`.

    Attributes:
        reach: px of the working image in which edges are looked for.
        least, most: units of the image's gradient noise; less is noise, more draws no more.
        bend: cost of a step of one px from a point's offset to the next.
        away: cost of each px, so that of two edges the nearer draws.
        spread: px, standard deviation of what a person draws.
        colour: weight of the colours' log odds.
        pool: points on either side from which colours are pooled.
        map: weight of a segmenter's map.
    """

    reach: float
    least: float
    most: float
    bend: float
    away: float
    spread: float
    colour: float
    pool: int
    map: float


@lru_cache(maxsize=2)
def snap_numbers(mapped: bool) -> SnapNumbers:
    """The fitted numbers, with or without a segmenter's map."""
    numbers = json.loads(files("grasptrack.segmentation").joinpath("snapping.json").read_text(encoding="utf-8"))
    return SnapNumbers(**numbers["with map" if mapped else "without map"])


class OutlineSnapper:
    """Moves outlines onto the edges of one image, with what a segmenter's map (H, W), 0 to 1, says.

    Numbers are the fitted ones if None.
    """

    def __init__(
        self, edges: ClosedEdgeSegmenter, map_: Floats32 | None = None, numbers: SnapNumbers | None = None
    ) -> None:
        self._px = edges.shrink
        self._planes = edges.planes
        self._across, self._along = edges.fields[0].gradient_components
        height, width = self._across.shape
        self._map = None
        if map_ is not None:
            self._map = np.asarray(cv2.resize(map_, (width, height), interpolation=cv2.INTER_AREA), dtype=np.float32)
        self._numbers = snap_numbers(map_ is not None) if numbers is None else numbers

    def snap(self, polygon: Floats, reach: float | None = None) -> Floats:
        """A closed polygon moved onto the edges beside it; where there is none it stays.

        Args:
            polygon: (n, 2) px.
            reach: px of the working image on either side in which edges are looked for; the fitted reach if None.

        Returns:
            (m, 2) px, points about STEP px apart.
        """
        moved = self._snap_copies(self._to_working(polygon)[None], STEP, reach)[0]
        return np.asarray(moved * self._px + 0.5 * (self._px - 1), dtype=np.float64)

    def return_share(self, outline: Floats) -> float:
        """Share of an outline's points that come back to it when it is displaced as a whole and snapped.

        An outline on edges that stand alone, between colours that differ, returns; one that cuts through its object or bridges
        a gap does not. Of an outline (n, 2) px, 0 to 1.
        """
        own = self._to_working(outline)
        by = DISPLACED * np.array([(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
        back = self._snap_copies(own[None] + by[:, None, :], COARSE_STEP)
        low = np.floor(np.minimum(own.min(axis=0), back.min(axis=(0, 1)))).astype(np.int32) - MARGIN
        high = np.ceil(np.maximum(own.max(axis=0), back.max(axis=(0, 1)))).astype(np.int32) + MARGIN + 1
        line, at = (np.rint(points - low).astype(np.int32) for points in (own, back))
        return float((_polyline_distances(line, at, high - low) <= RETURNED).mean())

    def _to_working(self, polygon: Floats) -> Floats:
        return np.asarray((polygon - 0.5 * (self._px - 1)) / self._px, dtype=np.float64)

    def _snap_copies(self, polygons: Floats, step: float, reach: float | None = None) -> Floats:
        """(k, m, 2) polygons (k, n, 2) that are displaced copies of one, snapped; all in px of the working image."""
        numbers = self._numbers
        pool = round(numbers.pool * STEP / step)
        count = math.ceil(numbers.reach if reach is None else reach)
        points, normals = _resample_polygon(polygons[0], step)
        points = points[None] + (polygons[:, :1] - polygons[:1, :1])
        steps = np.arange(-count, count + 1)
        at = points[:, :, None, :] + steps[None, None, :, None] * normals[None, :, None, :]
        x, y = (normals[None, :, None, axis] for axis in (0, 1))
        slope = np.abs(read_bilinear(self._across, at) * x + read_bilinear(self._along, at) * y)
        gain = np.clip(slope, numbers.least, numbers.most) - numbers.least
        gain -= numbers.away * np.abs(steps) + steps**2 / (2.0 * numbers.spread**2)
        odds = numbers.colour * np.stack([self._colour_odds(p, normals, count, pool) for p in points])
        if self._map is not None:
            odds += numbers.map * (2.0 * read_bilinear(self._map, at) - 1.0)
        taken_in = np.cumsum(odds, axis=2)
        gain += taken_in - taken_in[:, :, count : count + 1]
        chosen = steps[_smoothest_paths(gain, numbers.bend)]
        return np.asarray(points + chosen[:, :, None] * normals[None], dtype=np.float64)

    def _colour_odds(self, points: Floats, normals: Floats, count: int, pool: int) -> Floats:
        """(n, 2 count + 1) log odds that the colour at each offset is the object's, by those well inside and well outside."""
        reach = count + math.ceil(OUTSIDE_DEPTH)
        steps = np.arange(-reach, reach + 1)
        at = points[:, None, :] + steps[None, :, None] * normals[:, None, :]
        colours = read_bilinear(self._planes, at).reshape(len(points), len(steps), -1)
        inside, outside = _polygon_depths(points, at)
        deepest = np.maximum(inside.max(axis=1, keepdims=True) - 1.0, 1.0)
        within = (inside >= np.minimum(INSIDE_DEPTH, deepest)) & (steps < 0)
        beyond = (outside >= OUTSIDE_DEPTH) & (steps > 0)
        middle = colours[:, reach - count : reach + count + 1]
        likely, enough = [], np.ones(len(points), dtype=np.bool_)
        for chosen in (within, beyond):
            mean, variance, pixels = _pool_colors(colours, chosen, pool)
            apart = np.log1p((middle - mean[:, None]) ** 2 / variance[:, None]).sum(axis=2)
            likely.append(-APART_WEIGHT * apart - VARIANCE_WEIGHT * np.log(variance).sum(axis=1, keepdims=True))
            enough &= pixels > MIN_POOL
        odds = np.clip(likely[0] - likely[1], -MAX_COLOR_ODDS, MAX_COLOR_ODDS)
        odds[~enough] = 0.0
        return np.asarray(odds, dtype=np.float64)


def outline_agreement(shape: Silhouette, polygon: Floats, tolerance: float) -> float:
    """Share of a region's outline within some px of a polygon (n, 2), or of the polygon beside the region: the less."""
    x, y, w, h = shape.box
    low = np.floor(np.minimum(polygon.min(axis=0), (x, y)) - tolerance - MARGIN).astype(np.int32)
    high = np.ceil(np.maximum(polygon.max(axis=0), (x + w, y + h)) + tolerance + MARGIN).astype(np.int32)
    drawn, found = np.rint(polygon - low).astype(np.int32), (shape.outer - low).astype(np.int32)
    points = np.rint(_resample_polygon(polygon, STEP)[0] - low).astype(np.int32)
    pairs = ((drawn, found), (found, points))
    return min(float((_polyline_distances(line, asked, high - low) <= tolerance).mean()) for line, asked in pairs)


def _polyline_distances(line: NDArray[np.int32], at: NDArray[np.int32], size: NDArray[np.int32]) -> Floats32:
    """(...) px from pixels (..., 2) to a closed polyline (n, 2), both in a plane of (width, height)."""
    plane = np.full((size[1], size[0]), FAR, np.uint8)
    cv2.polylines(plane, [line.reshape(-1, 1, 2)], True, (0,), 1)
    away = np.asarray(cv2.distanceTransform(plane, cv2.DIST_L2, 5), dtype=np.float32)
    return away[at[..., 1], at[..., 0]]


def _resample_polygon(polygon: Floats, step: float) -> tuple[Floats, Floats]:
    """Points along a closed polygon, `step` px apart, and its unit normals, outward, of a tangent over a few points."""
    closed = np.vstack([polygon, polygon[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    n = min(max(MIN_POINTS, round(along[-1] / step)), MOST_POINTS)
    t = np.arange(n) * (along[-1] / n)
    points = np.column_stack([np.interp(t, along, closed[:, 0]), np.interp(t, along, closed[:, 1])])
    tangents = np.roll(points, -2, axis=0) - np.roll(points, 2, axis=0)
    normals = np.column_stack([tangents[:, 1], -tangents[:, 0]])
    turned = float(np.sum(points[:, 0] * np.roll(points[:, 1], -1) - points[:, 1] * np.roll(points[:, 0], -1)))
    return points, math.copysign(1.0, turned) * normals / np.maximum(np.hypot(*normals.T), TINY)[:, None]


def _polygon_depths(points: Floats, at: Floats) -> tuple[Floats, Floats]:
    """(n, m) px by which positions (n, m, 2) lie inside a closed polygon (n, 2), and outside of it; 0 on the other side."""
    low = np.floor(at.min(axis=(0, 1))) - 1.0
    width, height = (np.ceil(at.max(axis=(0, 1)) - low) + 2.0).astype(int).tolist()
    mask = fill_polygon(points - low, (height, width))
    inside, outside = (np.asarray(cv2.distanceTransform(m, cv2.DIST_L2, 5), np.float32) for m in (mask, FAR - mask))
    return read_bilinear(inside, at - low), read_bilinear(outside, at - low)


def _pool_colors(colours: Floats, chosen: Bools, pool: int) -> tuple[Floats, Floats, Floats]:
    """(n, c) means and variances and (n,) numbers of the chosen colours (n, m, c), over so many rows on either side."""
    weight = chosen.astype(np.float64)
    some = colours * weight[:, :, None]
    sums = np.column_stack([weight.sum(axis=1), some.sum(axis=1), (some * colours).sum(axis=1)])
    pool = min(pool, (len(sums) - 1) // 2)
    total = np.cumsum(np.vstack([np.zeros_like(sums[:1]), sums[-pool:], sums, sums[:pool]]), axis=0)
    near = total[2 * pool + 1 :] - total[: len(sums)]
    pixels = np.maximum(near[:, 0], TINY)
    c = colours.shape[2]
    mean = near[:, 1 : 1 + c] / pixels[:, None]
    variance = np.maximum(near[:, 1 + c :] / pixels[:, None] - mean**2, 0.0) + COLOR_VARIANCE
    return mean, variance, pixels


def _smoothest_paths(gain: Floats, bend: float) -> NDArray[np.intp]:
    """(k, n) column of each row of (k, n, m), the sum of gains less the cost of steps being largest, round closed curves.

    Dynamic programming over the rows twice round; the second half of the doubled path starts where it ends. The best that
    leads to each column is a running maximum from both sides, as the cost grows with the distance.
    """
    k, n, m = gain.shape
    rows = np.ascontiguousarray(gain.transpose(1, 0, 2))
    ramp, columns = bend * np.arange(m), np.arange(m)
    best = np.zeros((2 * n, k, m))
    best[0] = rows[0]
    for row in range(1, 2 * n):
        up = np.maximum.accumulate(best[row - 1] + ramp, axis=1) - ramp
        down = np.maximum.accumulate((best[row - 1] - ramp)[:, ::-1], axis=1)[:, ::-1] + ramp
        best[row] = np.maximum(up, down) + rows[row % n]
    path = np.zeros((2 * n, k), dtype=np.intp)
    path[-1] = np.argmax(best[-1], axis=1)
    cost = bend * np.abs(columns[:, None] - columns[None, :])
    for row in range(2 * n - 1, 0, -1):
        path[row - 1] = np.argmax(best[row - 1] - cost[path[row]], axis=1)
    middle = n // 2
    return np.roll(path[middle : middle + n], middle, axis=0).T


def read_bilinear(plane: Floats32, at: Floats) -> Floats:
    """Values of a plane (h, w), or of planes (h, w, c), at points (..., m, 2), those of the border beyond it: of the shape of
    the points, with c behind."""
    flat = at.reshape(-1, at.shape[-2], 2).astype(np.float32)
    read = cv2.remap(plane, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(read, dtype=np.float64).reshape(*at.shape[:-1], *plane.shape[2:])
