# SPDX-License-Identifier: Apache-2.0
"""Grey levels inside an object and on the ground round it, as the reference view shows them."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.contour import View
from grasptrack.observation.images import Grey

Floats = NDArray[np.float64]

ROUND = 0.6
"""The ground is looked at within this fraction of sqrt(area) of the object, ..."""
ROUND_PX = 40.0
"""... or so many px, whichever is more."""
FROM_OUTLINE = 3.0
"""Pixels of the shrunk image between a place and the outline, whose edge is evidence of its own."""
LIGHT, GAIN = 6, 2.0
"""Pixels of the shrunk image over which light does not change; and how many times differences are enlarged."""
BORDER = 2
"""Pixels of the shrunk image between a place and the border."""


class Surfaces(NamedTuple):
    """Places of the object's surface, then of the ground round it, in an image shrunk by a whole number.

    Attributes:
        shrink: how many times.
        places: (p, 2) px of the full image.
        values: (p,) grey levels.
        slopes: (p, 2) grey levels per px.
        starts: (3,) where the places of each begin, and their number.
    """

    shrink: int
    places: Floats
    values: Floats
    slopes: Floats
    starts: NDArray[np.int64]


def shrunk(grey: Grey, by: int) -> Grey:
    """The image with each pixel the mean of by x by."""
    height, width = grey.shape
    cut = grey[: height - height % by, : width - width % by]
    return np.asarray(cv2.resize(cut, (width // by, height // by), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def relief(coarse: Grey) -> Grey:
    """A shrunk image without the light on it: differences from the mean round each pixel, as twice as many grey levels
    above and below the middle. A shadow changes slowly; print, grain and scratches do not."""
    height, width = coarse.shape
    mean = cv2.resize(coarse, (max(width // LIGHT, 1), max(height // LIGHT, 1)), interpolation=cv2.INTER_AREA)
    slow = cv2.resize(mean, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(cv2.addWeighted(coarse, GAIN, slow, -GAIN, 128.0), dtype=np.uint8)


def surfaces(
    view: View, grey: Grey, by: int, most: int, hidden: Grey | None = None, *, shaded: bool = False
) -> Surfaces:
    """The places that show a motion best: of each small square the one with the steepest slope.

    Args:
        view: the object's outline.
        grey: (H, W) the image of it.
        by: how many times it is shrunk.
        most: places on each surface.
        hidden: (H, W) nonzero where nothing belongs to the scene.
        shaded: of the image's relief.
    """
    coarse = relief(shrunk(grey, by)) if shaded else shrunk(grey, by)
    height, width = coarse.shape
    mask = np.zeros((height, width), np.uint8)
    cv2.fillPoly(mask, [np.rint((c.points + 0.5) / by - 0.5).astype(np.int32) for c in view.contours], (1,))
    outlines = np.ones((height, width), np.uint8)
    chains = [np.rint((c.points + 0.5) / by - 0.5).astype(np.int32) for c in view.contours]
    cv2.polylines(outlines, chains, True, (0,))
    away = cv2.distanceTransform(outlines, cv2.DIST_L2, 5)
    usable = np.zeros((height, width), np.bool_)
    usable[BORDER : height - BORDER, BORDER : width - BORDER] = True
    if hidden is not None:
        usable &= cv2.dilate(shrunk(hidden, by), np.ones((5, 5), np.uint8)) == 0
    usable &= away >= (LIGHT + 1.0 if shaded else FROM_OUTLINE)  # the outline's own step lies in the light round it
    far = max(ROUND * math.sqrt(view.outer.area), ROUND_PX) / by
    light: Floats = coarse.astype(np.float64)
    down, across = (np.asarray(slope, dtype=np.float64) for slope in np.gradient(light))
    steep: Floats = np.asarray(np.hypot(across, down))
    groups = [
        _steepest(steep, usable & (mask != 0), most),
        _steepest(steep, usable & (mask == 0) & (away <= far), most),
    ]
    at = np.concatenate(groups)
    row, column = at.T
    return Surfaces(
        by,
        np.ascontiguousarray(by * (np.column_stack([column, row]) + 0.5) - 0.5),
        np.ascontiguousarray(light[row, column]),
        np.ascontiguousarray(np.column_stack([across[row, column], down[row, column]]) / by),
        np.cumsum([0, *(len(g) for g in groups)], dtype=np.int64),
    )


def _steepest(steep: Floats, usable: NDArray[np.bool_], most: int) -> NDArray[np.intp]:
    """(n, 2) rows and columns: of each square of the usable pixels the one with the steepest slope."""
    count = int(np.count_nonzero(usable))
    if count == 0:
        return np.zeros((0, 2), np.intp)
    row, column = np.nonzero(usable)
    step = max(1, math.ceil(math.sqrt(count / most)))
    row, column = row.astype(np.intp), column.astype(np.intp)
    square = (row // step) * (usable.shape[1] // step + 1) + column // step
    order = np.lexsort((-steep[row, column], square))
    first: NDArray[np.intp] = order[np.flatnonzero(np.diff(square[order], prepend=-1))]
    if len(first) > most:  # squares that are cut count as well
        first = first[np.argsort(-steep[row[first], column[first]], kind="stable")[:most]]
    return np.column_stack([row[first], column[first]])
