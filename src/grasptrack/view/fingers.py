# SPDX-License-Identifier: Apache-2.0
"""Where the parts of a grasp's drawing lie: cones, the strips in which contacts may slip, and the window around all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from grasptrack.contour import View
    from grasptrack.synthesis.result import RankedGrasp

Floats = NDArray[np.float64]
Window = tuple[float, float, float, float]
"""left, top, right, bottom in px."""
_FARTHEST = 0.6
"""Fingers are shown up to this share of the outline's extent beyond it."""


def opening(grasp: RankedGrasp) -> float:
    """Px by which the hand opens: two contacts' distance; twice the way of the farthest of more to their mean."""
    if len(grasp) == 2:
        return grasp.opening
    return 2.0 * float(np.linalg.norm(grasp.contacts - grasp.contacts.mean(axis=0), axis=1).max())


def wedge(apex: Floats, direction: Floats, half_angle: float, length: float) -> Floats:
    """A sector as a closed polygon (m, 2) px.

    Args:
        apex: (2,) px.
        direction: (2,) of its middle.
        half_angle: rad.
        length: px from apex to arc.
    """
    angles = math.atan2(direction[1], direction[0]) + half_angle * np.linspace(-1.0, 1.0, 17)
    return np.vstack([apex, apex + length * np.column_stack([np.cos(angles), np.sin(angles)])])


def normals(grasp: RankedGrasp, view: View, friction: float) -> Floats:
    """(k, 2) unit normals into the material; where the analysis refuses the outline, the directions of motion."""
    from grasptrack.analysis import analyze
    from grasptrack.errors import GraspError

    try:
        return analyze(grasp, view, friction).normals
    except GraspError:
        return grasp.directions


def strips(grasp: RankedGrasp, view: View) -> list[Floats]:
    """For each contact the piece of outline (m, 2) px within its region; empty where it may not slip at all."""
    return [
        strip(view, int(contour), position, region)
        for (contour, position, _), region in zip(grasp.on(view).tolist(), grasp.regions.tolist(), strict=True)
    ]


def strip(view: View, contour: int, position: float, half: float) -> Floats:
    """The piece of one contour that reaches `half` px of arc length to both sides of a position.

    Args:
        view: the outline.
        contour, position: a place on it.
        half: px; the whole contour where it is no longer than twice that.

    Returns:
        (m, 2) px along the outline; (0, 2) where `half` is not positive.
    """
    if not half > 0.0:
        return np.zeros((0, 2))
    curve = view.contours[contour]
    arc, length = curve.arc_length, curve.length
    closed = np.vstack([curve.points, curve.points[:1]])
    half = min(half, 0.5 * length)
    middle = float(np.interp(position, np.arange(len(arc)), arc))
    knots = np.concatenate([arc[:-1] - length, arc[:-1], arc[:-1] + length])
    between = knots[(knots > middle - half) & (knots < middle + half)]
    at = np.concatenate([[middle - half], between, [middle + half]]) % length
    return np.column_stack([np.interp(at, arc, closed[:, axis]) for axis in (0, 1)])


def window(
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
    low, high = _bounds(outlines)
    reach = _FARTHEST * float((high - low).max())
    if fingers:
        first, last = _bounds(fingers)
        low, high = np.maximum(np.minimum(low, first), low - reach), np.minimum(np.maximum(high, last), high + reach)
    margin = room * float((high - low).max()) + 2.0
    limit = np.array([shape[1], shape[0]], dtype=np.float64)
    # Room is left beyond the image only where something is drawn there.
    low = np.where(low >= -0.5, np.maximum(low - margin, -0.5), low - margin)
    high = np.where(high <= limit - 0.5, np.minimum(high + margin, limit - 0.5), high + margin)
    size = _framed(high - low, aspect)
    if (limit <= most * size).all():
        filled = np.minimum(limit, [aspect * limit[1], limit[0] / aspect])
        if (filled >= high - low).all():
            size = filled  # as much of the image as fills the frame
        else:
            low, high = np.minimum(low, -0.5), np.maximum(high, limit - 0.5)
            size = _framed(high - low, aspect)
    # Moved into the image as far as that hides nothing, for what is outside of it says nothing.
    start = 0.5 * (low + high - size)
    start = np.where(size <= limit, np.minimum(np.maximum(start, -0.5), limit - 0.5 - size), start)
    left, top = np.minimum(np.maximum(start, high - size), low).tolist()
    return left, top, left + float(size[0]), top + float(size[1])


def _framed(size: Floats, aspect: float) -> Floats:
    """The least size of some proportions that holds another."""
    return np.maximum(size, [aspect * size[1], size[0] / aspect])


def quiet_corner(frame: Window, share: float, crowd: Floats) -> int | None:
    """Which corner of a window is the emptiest: 0 to 3 as read, None where each has something that must be seen.

    Args:
        frame: the window.
        share: of its width and height that is needed.
        crowd: (n, 2) px, points that must be seen.
    """
    left, top, right, bottom = frame
    x, y = (crowd[:, 0] - left) / (right - left), (crowd[:, 1] - top) / (bottom - top)
    inside = [
        int(np.count_nonzero((x > 1.0 - share if i % 2 else x < share) & (y > 1.0 - share if i > 1 else y < share)))
        for i in range(4)
    ]
    least = min(inside)
    return inside.index(least) if least == 0 else None


def _bounds(parts: Sequence[Floats]) -> tuple[Floats, Floats]:
    listed = np.vstack([p.reshape(-1, 2) for p in parts])
    return listed.min(axis=0), listed.max(axis=0)
