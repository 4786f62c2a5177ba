# SPDX-License-Identifier: Apache-2.0
"""What a person says of the first image, in px: pixels on the object and beside it, a box, a rough outline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import arguments
from grasptrack.errors import InputError
from grasptrack.segmentation.images import Grey, to_bgr, to_mask
from grasptrack.segmentation.silhouettes import Silhouette
from grasptrack.typing import Floats

Box = tuple[float, float, float, float]
"""Left, top, width and height, px."""
Point = tuple[float, float]
HINT_CHECKS = dict.fromkeys(
    ("object_at", "not_at", "box", "outline", "ignore", "background"),
    arguments.optional(arguments.array(unbounded=True)),
)
"""Types of what a person may say, by the names that public functions give it; `make_hints` checks the values."""
BESIDE = 3.0
"""px: a click may lie so far beside a thin part."""


@dataclass(frozen=True)
class Hints:
    """Everything that is known of the first image beside the image.

    Attributes:
        object_at: (x, y) px each, all on the object.
        not_at: (x, y) px each, none on the object.
        box: left, top, width and height of the object, px.
        outline: (n, 2) px of a rough polygon round the object, or None.
        hidden: (H, W) nonzero where nothing belongs to the scene, or None.
        background: (H, W) or BGR (H, W, 3) the same bench without the object, or None.
        first_look_ms: work that the own search may do, see `work`; None is no bound.
        masked: the image is a softened mask, in which objects are white and nothing else is meant.
    """

    object_at: tuple[Point, ...] = ()
    not_at: tuple[Point, ...] = ()
    box: Box | None = None
    outline: Floats | None = None
    hidden: Grey | None = None
    background: NDArray[np.uint8] | None = None
    masked: bool = False
    first_look_ms: float | None = None

    @property
    def names_object(self) -> bool:
        """Whether it says which object is meant."""
        return bool(self.object_at) or self.box is not None or self.outline is not None

    def allows(self, shape: Silhouette) -> bool:
        """Whether a region covers all pixels on the object, none beside it, and fills a box at least in part."""
        if any(_depth(shape, *at) < -BESIDE for at in self.object_at):
            return False
        if any(_depth(shape, *at) > 0.0 for at in self.not_at):
            return False
        return self.box is None or box_iou(shape.box, self.box) > 0.3

    def box_middle(self) -> Point | None:
        """(x, y) px, the middle of the box, or None."""
        return None if self.box is None else (self.box[0] + 0.5 * self.box[2], self.box[1] + 0.5 * self.box[3])

    def where(self) -> str:
        """The place in words, for messages: " at 10,20", " in the box", or empty."""
        if self.object_at:
            return " at " + " and ".join(f"{x:g},{y:g}" for x, y in self.object_at)
        return " in the box" if self.box is not None else ""


def make_hints(
    shape: Sequence[int],
    object_at: Any = None,
    not_at: Any = None,
    box: Any = None,
    outline: Any = None,
    ignore: NDArray[Any] | None = None,
    background: NDArray[Any] | None = None,
) -> Hints:
    """Hints from what users write, checked against an image of (height, width).

    Args:
        shape: of the image.
        object_at: (x, y) px, or several such, all on the object.
        not_at: (x, y) px, or several such, beside it.
        box: left, top, width and height of the object, px.
        outline: (n, 2) px, n >= 3, a rough polygon round it.
        ignore: (H, W) nonzero where nothing belongs to the scene.
        background: an image of the same bench without the object.

    Raises:
        InputError: a pixel outside the image, a box without area or outside it, an outline of fewer than three corners
            or without area, a mask or background of another size.
        SourceError: a background that is no image.
    """
    height, width = int(shape[0]), int(shape[1])
    on, off = _points(object_at, "object_at"), _points(not_at, "not_at")
    for name, points in (("object_at", on), ("not_at", off)):
        for x, y in points:
            if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
                raise InputError(f"{name} {x:g},{y:g} is outside the image, which is {width}x{height} px", place=(x, y))
    hidden = None if ignore is None else dilate_mask(to_mask(ignore, (height, width), "ignore mask"))
    empty = None if background is None else _background(background, width, height)
    return Hints(on, off, _box(box, width, height), _polygon(outline, width, height), hidden, empty)


def dilate_mask(hidden: Grey | None) -> Grey | None:
    """What is hidden and two pixels round it, where edges are its own."""
    return None if hidden is None else np.asarray(cv2.dilate(hidden, np.ones((5, 5), np.uint8)), dtype=np.uint8)


def box_iou(one: Box | tuple[int, int, int, int], other: Box) -> float:
    """Intersection over union of two boxes."""
    wide = min(one[0] + one[2], other[0] + other[2]) - max(one[0], other[0])
    tall = min(one[1] + one[3], other[1] + other[3]) - max(one[1], other[1])
    both = max(wide, 0.0) * max(tall, 0.0)
    return both / (one[2] * one[3] + other[2] * other[3] - both)


def _depth(shape: Silhouette, x: float, y: float) -> float:
    """px by which a pixel lies within a region's outer boundary, negative outside."""
    return float(cv2.pointPolygonTest(shape.outer, (float(x), float(y)), True))


def _points(given: Any, name: str) -> tuple[Point, ...]:
    if given is None:
        return ()
    try:
        array = np.atleast_2d(np.asarray(given, dtype=np.float64))
    except (TypeError, ValueError):
        array = np.zeros((0, 0))
    if array.size == 0 and array.shape != (0, 0):
        return ()
    if array.ndim != 2 or array.shape[1] != 2 or not np.isfinite(array).all():
        raise InputError(f"{name} is (x, y) in px, or several of them, not {given!r}", given=repr(given))
    return tuple((float(x), float(y)) for x, y in array)


def _box(given: Any, width: int, height: int) -> Box | None:
    if given is None:
        return None
    try:
        left, top, wide, tall = (float(v) for v in given)
    except (TypeError, ValueError):
        raise InputError(f"a box is left, top, width and height in px, not {given!r}", given=repr(given)) from None
    if not (wide > 0.0 and tall > 0.0 and np.isfinite([left, top, wide, tall]).all()):
        raise InputError(f"a box has a width and a height above 0, not {wide:g} and {tall:g}", given=repr(given))
    right, bottom = min(left + wide, float(width)), min(top + tall, float(height))
    left, top = max(left, 0.0), max(top, 0.0)  # a detector's may reach beyond the image
    if right <= left or bottom <= top:
        told = ",".join(f"{float(v):g}" for v in given)
        raise InputError(f"the box {told} is outside the image, which is {width}x{height} px", given=repr(given))
    return left, top, right - left, bottom - top


def _background(given: NDArray[Any], width: int, height: int) -> NDArray[np.uint8]:
    empty = to_bgr(given)
    if empty.shape[:2] != (height, width):
        raise InputError(
            f"the background is {empty.shape[1]}x{empty.shape[0]} px, but the image is {width}x{height}",
            shape=empty.shape,
        )
    return empty


def _polygon(given: Any, width: int, height: int) -> Floats | None:
    if given is None:
        return None
    try:
        points = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        points = np.zeros((0, 0))
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3 or not np.isfinite(points).all():
        raise InputError("an outline is at least three corners (x, y) in px", shape=points.shape)
    area = abs(float(cv2.contourArea(points.astype(np.float32))))
    if area < 1.0:
        raise InputError("the outline encloses no area", area=area)
    low, high = points.min(axis=0), points.max(axis=0)
    if high[0] < 0.0 or high[1] < 0.0 or low[0] > width - 1 or low[1] > height - 1:
        raise InputError(f"the outline lies outside the image, which is {width}x{height} px")
    return points
