# SPDX-License-Identifier: Apache-2.0
"""What a panel shows of an image, and where panels lie on the page of grasps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grasptrack.typing import Floats

Window = tuple[float, float, float, float]
"""left, top, right, bottom in px."""
_FARTHEST = 0.6
"""Fingers are shown up to this share of the outline's extent beyond it."""
_CAPTION, _GAP = 0.27, 0.12
Box = tuple[float, float, float, float]
"""left, bottom, width and height in inches."""


def image_window(
    outlines: Sequence[Floats],
    fingers: Sequence[Floats],
    shape: tuple[int, int],
    aspect: float,
    room: float,
    most: float = 1.0,
) -> Window:
    """The part of an image that shows outlines and fingers, in the proportions of its frame.

    Where the image is too small for that the window reaches beyond it, as fingers do.

    Args:
        outlines: arrays (n, 2) px, which are shown altogether.
        fingers: arrays (..., 2) px, shown as far as they do not dwarf the outlines.
        shape: height and width of the image.
        aspect: width over height of the frame.
        room: share of the larger extent that is added on every side.
        most: show all that the frame can of an image that is at most so many times as wide and high as the window.
    """
    low, high = _bounding_box(outlines)
    reach = _FARTHEST * float((high - low).max())
    if fingers:
        first, last = _bounding_box(fingers)
        low, high = np.maximum(np.minimum(low, first), low - reach), np.minimum(np.maximum(high, last), high + reach)
    margin = room * float((high - low).max()) + 2.0
    limit = np.array([shape[1], shape[0]], dtype=np.float64)
    # Room is left beyond the image only where something is drawn there.
    low = np.where(low >= -0.5, np.maximum(low - margin, -0.5), low - margin)
    high = np.where(high <= limit - 0.5, np.minimum(high + margin, limit - 0.5), high + margin)
    size = _expand_to_aspect(high - low, aspect)
    if (limit <= most * size).all():
        filled = np.minimum(limit, [aspect * limit[1], limit[0] / aspect])
        if (filled >= high - low).all():
            size = filled  # as much of the image as fills the frame
        else:
            low, high = np.minimum(low, -0.5), np.maximum(high, limit - 0.5)
            size = _expand_to_aspect(high - low, aspect)
    # Moved into the image as far as that hides nothing, for what is outside of it says nothing.
    start = 0.5 * (low + high - size)
    start = np.where(size <= limit, np.minimum(np.maximum(start, -0.5), limit - 0.5 - size), start)
    left, top = np.minimum(np.maximum(start, high - size), low).tolist()
    return left, top, left + float(size[0]), top + float(size[1])


def _expand_to_aspect(size: Floats, aspect: float) -> Floats:
    """The least size of some proportions that holds another."""
    return np.maximum(size, [aspect * size[1], size[0] / aspect])


def quiet_corner(frame: Window, share: float, seen: Floats, rather: Sequence[Floats]) -> int | None:
    """Which corner of a window has room for an inset: 0 to 3 as read, None where each hides what must be seen.

    Args:
        frame: the window.
        share: of its width and height that the inset takes.
        seen: (n, 2) px, points that must be seen.
        rather: arrays (n, 2) px of which as few points as can be are hidden.
    """
    hidden = _in_corners(frame, share, seen)
    others = np.sum([_in_corners(frame, share, points) for points in rather], axis=0) if rather else np.zeros(4)
    free = [i for i in range(4) if hidden[i] == 0]
    return min(free, key=lambda i: float(others[i])) if free else None


def _in_corners(frame: Window, share: float, points: Floats) -> list[int]:
    left, top, right, bottom = frame
    x, y = (points[:, 0] - left) / (right - left), (points[:, 1] - top) / (bottom - top)
    inside = (x >= 0.0) & (x <= 1.0) & (y >= 0.0) & (y <= 1.0)
    across, down = (x < share, x > 1.0 - share), (y < share, y > 1.0 - share)
    return [int(np.count_nonzero(inside & across[i % 2] & down[i // 2])) for i in range(4)]


def _bounding_box(parts: Sequence[Floats]) -> tuple[Floats, Floats]:
    listed = np.vstack([p.reshape(-1, 2) for p in parts])
    return listed.min(axis=0), listed.max(axis=0)


def panel_grid(area: Box, count: int, aspect: float) -> list[Box]:
    """Places of small panels, row by row, in as many columns as make a subject of some proportions largest."""

    def cell(columns: int) -> tuple[float, float]:
        rows = -(-count // columns)
        tall = (area[3] - (rows - 1) * _GAP) / rows - _CAPTION
        return (area[2] - (columns - 1) * _GAP) / columns, tall

    columns = max(range(1, min(count, 3) + 1), key=lambda n: min(cell(n)[0] / aspect, cell(n)[1]))
    wide, tall = cell(columns)
    tall = min(tall, 1.2 * max(wide, wide / aspect))
    left, top = area[0], area[1] + area[3]
    return [
        (
            left + (i % columns) * (wide + _GAP),
            top - (i // columns) * (tall + _CAPTION + _GAP) - _CAPTION - tall,
            wide,
            tall,
        )
        for i in range(count)
    ]


def aspect_of(points: Floats) -> float:
    """Width over height of an outline, a very thin one being taken as less so."""
    width, height = np.ptp(points, axis=0).tolist()
    return float(min(max(width / max(height, 1e-9), 0.2), 5.0))
