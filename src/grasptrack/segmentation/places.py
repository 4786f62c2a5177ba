# SPDX-License-Identifier: Apache-2.0
"""Compares silhouettes and outlines with the expected place, size and sharpness of the object."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.geometry.contours import View
from grasptrack.segmentation.silhouettes import Silhouette
from grasptrack.typing import Floats

MAX_GROWTH = 2.5
"""An area that differs from the expected one by more than this factor belongs to another object."""


def edge_sharpness(view: View) -> float:
    """Median gradient of the outer contour's edges, grey levels per px."""
    strength = view.outer.strength
    return math.nan if strength is None else max(float(np.median(strength)), 1.0)


def area_and_mean_point(view: View) -> tuple[float, float, float]:
    """Area and mean point of an outline."""
    x, y = view.outer.points.mean(axis=0).tolist()
    return view.outer.area, x, y


def same_place(one: tuple[float, float, float], other: tuple[float, float, float]) -> bool:
    """Whether two outlines show the same object at different thresholds."""
    (area, x, y), (a, u, v) = one, other
    return 0.97 < area / a < 1.03 and math.hypot(x - u, y - v) < 0.02 * math.sqrt(a)


def area_and_centre(points: Floats) -> tuple[float, float, float]:
    """Area and centroid of the closed curve through points (m, 2) px."""
    offsets = np.array([0, len(points)], dtype=np.int64)
    area, x, y, *_ = kernels.polygon_moments(np.ascontiguousarray(points), offsets)
    return abs(area), x, y


def most_alike(shapes: list[Silhouette], area: float, x: float, y: float) -> Silhouette | None:
    """The silhouette nearest to the expected area and place."""
    best, lowest = None, math.inf
    for shape in shapes:
        if not 1.0 / MAX_GROWTH < shape.area / area < MAX_GROWTH:
            continue
        bx, by, bw, bh = shape.box
        distance = math.hypot(bx + 0.5 * bw - x, by + 0.5 * bh - y) / math.sqrt(area)
        cost = abs(math.log(shape.area / area)) + distance
        if cost < lowest:
            best, lowest = shape, cost
    return best


def cut_by_window(shape: Silhouette, window: tuple[int, int, int, int], image: tuple[int, int]) -> bool:
    """Whether the silhouette reaches a side of the window that is not the image's own border."""
    left, top, right, bottom = window
    x, y, w, h = shape.box
    return (
        (x <= left and left > 0)
        or (y <= top and top > 0)
        or (x + w >= right and right < image[0])
        or (y + h >= bottom and bottom < image[1])
    )


def nearest_holes(holes: tuple[NDArray[np.int32], ...], centres: Floats) -> list[NDArray[np.int32]]:
    """The nearest hole to each expected centre, none twice, in the order of the centres."""
    left = list(holes)
    chosen = []
    for x, y in centres.tolist():
        if not left:
            break
        middle = [chain.mean(axis=0) for chain in left]
        nearest = min(range(len(left)), key=lambda i: (middle[i][0] - x) ** 2 + (middle[i][1] - y) ** 2)
        chosen.append(left.pop(nearest))
    return chosen
