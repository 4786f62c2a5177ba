# SPDX-License-Identifier: Apache-2.0
"""One answer held against the truth: a piece of the image with where the contacts were said to be, and where they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats
from grasptrack.view.draw import Canvas, as_bgr
from grasptrack.view.style import DARK_RGB, STATUS_RGB, WHITE_RGB, Colour, Picture

SIZE = (400, 300)
"""px of the picture."""
INSET = 104
"""px, side of the square that shows the worst contact enlarged."""
TRUE_RGB: Colour = STATUS_RGB["tracked"]
WRONG_RGB: Colour = (255, 96, 48)


def draw_answer(image: NDArray[Any], truth: Floats | None, outline: Sequence[Floats], answer: Floats | None) -> Picture:
    """(300, 400, 3) uint8 BGR: a piece of the image round the object, with its true outline and contacts, and those given.

    The true contacts (k, 2) px are None where the object is gone, the polygons (n, 2) px empty where they are not known, the
    contacts (k, 2) px of the answer None where there were none.
    """
    source = as_bgr(image)
    truth = None if truth is None or not np.isfinite(truth).all() else truth
    answer = None if answer is None or not np.isfinite(answer).all() else answer
    corner, scale = _crop_window(source.shape[:2], [*outline, truth, answer], SIZE)
    canvas = _draw_crop(source, corner, scale, SIZE, truth, outline, answer)
    if truth is not None and answer is not None and truth.shape == answer.shape:
        _add_inset(canvas, source, corner, scale, truth, outline, answer)
    return canvas


def _draw_crop(
    source: Picture,
    corner: tuple[float, float],
    scale: float,
    size: tuple[int, int],
    truth: Floats | None,
    outline: Sequence[Floats],
    answer: Floats | None,
) -> Picture:
    """A piece of an image from a corner px on, enlarged, with all that is drawn on it."""
    shift = 0.5 * scale - 0.5 - scale * (np.array(corner) + 0.5)
    move = np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]]])
    way = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR if scale < 4.0 else cv2.INTER_NEAREST
    warped = cv2.warpAffine(source, move, size, flags=way, borderMode=cv2.BORDER_CONSTANT, borderValue=(30, 27, 24))
    canvas = Canvas(np.ascontiguousarray(warped, dtype=np.uint8), scale, corner=corner)
    canvas.draw_outline(outline)
    if answer is not None and len(answer) == 2:
        canvas.draw_grasp_line(answer, WRONG_RGB)
    if truth is not None:
        for k, at in enumerate(truth):
            if answer is not None and k < len(answer):
                canvas.draw_lines([np.array([at, answer[k]])], WHITE_RGB, 1.0, casing=0.0)
            canvas.draw_ring(at, 8.0, TRUE_RGB, 3.0, casing=5.0)
    if answer is not None:
        for at in answer:
            canvas.draw_disc(at, 5.4, DARK_RGB)
            canvas.draw_disc(at, 4.0, WRONG_RGB)
    return canvas.picture


def _add_inset(
    canvas: Picture,
    source: Picture,
    corner: tuple[float, float],
    scale: float,
    truth: Floats,
    outline: Sequence[Floats],
    answer: Floats,
) -> None:
    """Put the worst contact, enlarged, into the corner of the picture that is farthest from the object; in place."""
    off = np.hypot(*(answer - truth).T)
    k = int(off.argmax())
    side = INSET
    zoom = float(np.clip(0.5 * side / max(off[k], 1e-9), 1.5 * scale, 12.0))
    if zoom * off[k] > 0.75 * side:
        return  # so far off that it is plain to see
    start = 0.5 * (truth[k] + answer[k]) - 0.5 * side / zoom
    piece = _draw_crop(source, (float(start[0]), float(start[1])), zoom, (side, side), truth, outline, answer)
    drawn = [(np.asarray(p, dtype=np.float64) - corner) * scale for p in (*outline, truth, answer)]
    points = np.concatenate([p[np.isfinite(p).all(axis=1)] for p in drawn])
    height, width = canvas.shape[:2]
    best, room = (0, 0), -1.0
    for x, y in ((0, 0), (width - side, 0), (0, height - side), (width - side, height - side)):
        reach = np.maximum(np.abs(points - (x + side / 2, y + side / 2)) - side / 2, 0.0).max(axis=1)
        if (free := float(np.partition(reach, len(reach) // 8)[len(reach) // 8])) > room:
            best, room = (x, y), free
    x, y = best
    canvas[y : y + side, x : x + side] = piece
    cv2.rectangle(canvas, (x, y), (x + side - 1, y + side - 1), WHITE_RGB, 1)


def _crop_window(
    shape: tuple[int, ...], parts: Sequence[Floats | None], size: tuple[int, int]
) -> tuple[tuple[float, float], float]:
    """Top-left corner in px and scale of the piece that shows all parts as far as they are in or near the image."""
    height, width = shape[0], shape[1]
    listed = [np.asarray(p, dtype=np.float64).reshape(-1, 2) for p in parts if p is not None and len(p)]
    points = np.concatenate(listed) if listed else np.empty((0, 2))
    points = points[np.isfinite(points).all(axis=1)]
    reach = 0.25 * max(width, height)
    points = points[((points > -reach) & (points < np.array([width, height]) + reach)).all(axis=1)]
    if not len(points):
        points = np.array([[0.0, 0.0], [width - 1.0, height - 1.0]])
    low, high = points.min(axis=0), points.max(axis=0)
    middle, span = 0.5 * (low + high), np.maximum(1.3 * (high - low), 48.0)
    scale = min(size[0] / span[0], size[1] / span[1], 6.0)
    corner = middle - 0.5 * np.array(size) / scale
    return (float(corner[0]), float(corner[1])), float(scale)
