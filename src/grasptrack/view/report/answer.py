# SPDX-License-Identifier: Apache-2.0
"""One answer held against the truth: a piece of the image with where the contacts were said to be, and where they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.view.draw import as_bgr, disc, stroke
from grasptrack.view.style import STATUS_RGB, Colour, Picture

Floats = NDArray[np.float64]

SIZE = (400, 300)
"""px of the picture."""
TRUE_RGB: Colour = STATUS_RGB["tracked"]
WRONG_RGB: Colour = (255, 96, 48)
_DARK: Colour = (12, 14, 18)
_WHITE: Colour = (255, 255, 255)


def draw_answer(
    image: NDArray[Any],
    truth: Floats | None,
    outline: Sequence[Floats],
    answer: Floats | None,
    size: tuple[int, int] = SIZE,
) -> Picture:
    """A piece of the image round the object, with its true outline and contacts and the contacts that were given.

    Args:
        image: grey or BGR.
        truth: (k, 2) px, true contacts; None where the object is gone.
        outline: its true polygons (n, 2) px; empty where they are not known.
        answer: (k, 2) px, contacts as they were given; None where there were none.
        size: width and height of the picture in px.

    Returns:
        (height, width, 3) uint8 BGR.
    """
    source = as_bgr(image)
    corner, scale = _window(source.shape[:2], [*outline, truth, answer], size)
    move = np.array([[scale, 0.0, 0.5 * scale - 0.5 - scale * (corner[0] + 0.5)],
                     [0.0, scale, 0.5 * scale - 0.5 - scale * (corner[1] + 0.5)]])  # fmt: skip
    way = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
    warped = cv2.warpAffine(source, move, size, flags=way, borderMode=cv2.BORDER_CONSTANT, borderValue=(30, 27, 24))
    canvas: Picture = np.ascontiguousarray(warped, dtype=np.uint8)

    def placed(points: Floats) -> Floats:
        return np.asarray(points @ move[:, :2].T + move[:, 2], dtype=np.float64)

    for width, colour in ((3.0, _DARK), (1.0, _WHITE)):
        for polygon in outline:
            stroke(canvas, placed(polygon), colour, width, closed=True)
    true = None if truth is None or not np.isfinite(truth).all() else placed(truth)
    said = None if answer is None or not np.isfinite(answer).all() else placed(answer)
    if said is not None and len(said) == 2:
        stroke(canvas, said, _DARK, 4.0)
        stroke(canvas, said, WRONG_RGB, 2.0)
    if true is not None:
        for k, at in enumerate(true):
            if said is not None and k < len(said):
                stroke(canvas, np.array([at, said[k]]), _WHITE, 1.0)
            disc(canvas, at, 8.0, _DARK, 5.0)
            disc(canvas, at, 8.0, TRUE_RGB, 3.0)
    if said is not None:
        for at in said:
            disc(canvas, at, 5.4, _DARK)
            disc(canvas, at, 4.0, WRONG_RGB)
    return canvas


def _window(
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
