# SPDX-License-Identifier: Apache-2.0
"""Where the parts of a grasp's drawing lie: cones, the strips in which contacts may slip, and the window around all."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from grasptrack.contour import View
    from grasptrack.synthesis.result import RankedGrasp

Floats = NDArray[np.float64]
Window = tuple[float, float, float, float]
"""left, top, right, bottom in px."""


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


def window(parts: Iterable[Floats], shape: tuple[int, int], aspect: float, room: float, most: float = 1.0) -> Window:
    """The part of an image that shows everything given, in the proportions of its frame as far as the image reaches.

    Args:
        parts: arrays (..., 2) px to be shown.
        shape: height and width of the image.
        aspect: width over height of the frame.
        room: share of the larger extent that is added on every side.
        most: show the whole image where it is at most so many times as wide and high as the window.
    """
    listed = np.vstack([p.reshape(-1, 2) for p in parts])
    height, width = shape
    low = np.maximum(listed.min(axis=0), -0.5)
    high = np.minimum(listed.max(axis=0), [width - 0.5, height - 0.5])
    margin = room * float((high - low).max()) + 4.0
    size = high - low + 2.0 * margin
    wide, tall = max(float(size[0]), aspect * float(size[1])), max(float(size[1]), float(size[0]) / aspect)
    if max(width / wide, height / tall) <= most:
        return -0.5, -0.5, width - 0.5, height - 0.5
    middle = 0.5 * (low + high)
    left, right = _placed(float(middle[0]), wide, width)
    top, bottom = _placed(float(middle[1]), tall, height)
    return left, top, right, bottom


def _placed(middle: float, size: float, limit: int) -> tuple[float, float]:
    """An interval of a size about a middle, moved and cut so that it lies within an image."""
    size = min(size, float(limit))
    start = min(max(middle - 0.5 * size, -0.5), limit - 0.5 - size)
    return start, start + size
