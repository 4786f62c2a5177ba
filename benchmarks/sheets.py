# SPDX-License-Identifier: Apache-2.0
"""Pictures of what a segmentation found: an outline on its photo, numbered objects, sheets of many."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

Array = np.ndarray

WIDTH = 480  # px of a tile
STRIP = 24  # px of its caption
GREEN, RED, YELLOW, BLUE, WHITE = (60, 220, 60), (60, 60, 255), (0, 230, 255), (255, 120, 0), (255, 255, 255)
PASSED, FAILED = (50, 90, 30), (30, 30, 130)
FONT = cv2.FONT_HERSHEY_SIMPLEX


def judged_tile(image: Array, truth: Array, row: Any, hint: tuple[float, float] | None) -> Array:
    """The true outline green, the found one red, the hint as a cross; name, F and IoU above, on red where it failed."""
    scale = WIDTH / image.shape[1]
    tile = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    for mask, colour in ((truth, GREEN), (row.mask, RED)):
        outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        for outline in outlines:
            draw(tile, outline[:, 0] * scale, colour)
    if hint is not None:
        at = (round(hint[0] * scale), round(hint[1] * scale))
        cv2.drawMarker(tile, at, YELLOW, cv2.MARKER_CROSS, 14, 2)
    strip = np.full((STRIP, tile.shape[1], 3), PASSED if row.enough else FAILED, dtype=np.uint8)
    text = f"{row.name}  {'pixel' if hint else 'no hint'}  F {row.f:.2f}  IoU {row.iou:.2f}"
    cv2.putText(strip, text, (6, 17), FONT, 0.5, WHITE, 1, cv2.LINE_AA)
    return np.vstack([strip, tile])


def found_tile(image: Array, views: Sequence[Any]) -> Array:
    """Every view's outline red, its holes blue, and its rank, from 1, below its top."""
    picture = image.copy()
    for view in views:
        for contour in view.contours:
            draw(picture, contour.points, BLUE if contour.hole else RED)
    for rank, view in enumerate(views, start=1):
        x, y = view.outer.points[np.argmin(view.outer.points[:, 1])]
        for colour, width in ((WHITE, 5), (RED, 2)):
            cv2.putText(picture, str(rank), (round(x) + 2, round(y) + 16), FONT, 0.6, colour, width, cv2.LINE_AA)
    return picture


def draw(picture: Array, points: Array, colour: tuple[int, int, int]) -> None:
    """A closed curve through points (N, 2) px, to a sixteenth of a pixel."""
    cv2.polylines(picture, [np.rint(points * 16).astype(np.int32)], True, colour, 1, cv2.LINE_AA, 4)


def sheet(tiles: Sequence[Array], columns: int) -> Array:
    """Tiles of one size in rows, the last filled up with black."""
    filled = [*tiles, *[np.zeros_like(tiles[0])] * (-len(tiles) % columns)]
    return np.vstack([np.hstack(filled[i : i + columns]) for i in range(0, len(filled), columns)])
