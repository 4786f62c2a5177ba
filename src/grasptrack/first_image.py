# SPDX-License-Identifier: Apache-2.0
"""What a person says of the first image: one record, checked once, for the tracker, the command line and the page alike."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack import arguments
from grasptrack.equality import compared_by_value
from grasptrack.errors import InputError
from grasptrack.grasp.contacts import Grasp
from grasptrack.images import Grey, to_bgr, to_mask, with_room
from grasptrack.typing import Box, Floats, Point
from grasptrack.undistortion import Undistortion

DEFAULT_SURE = 0.9
"""Probability from which the choice of an object is called sure."""
FIRST_IMAGE_CHECKS = dict.fromkeys(
    ("object_at", "not_at", "box", "outline", "ignore", "background"),
    arguments.optional(arguments.array(unbounded=True)),
)
"""Types of what a person may say, by the names that public functions give it; `FirstImage` checks the values."""


@compared_by_value
@dataclass(frozen=True, eq=False)
class FirstImage:
    """Everything that is known of the first image beside the image, in px of it.

    `FirstImage.of` makes one of what users write, `without_distortion` and `within` fit it to an image.

    Attributes:
        object_at: (x, y) px each, all on the object.
        not_at: (x, y) px each, none on the object.
        box: left, top, width and height of the object, px.
        outline: (n, 2) px of a rough polygon round the object, or None.
        grasp: contacts that are given; they choose the object.
        number: of the candidate that a person took, 1 being the likeliest; None takes that one, but nobody has said so.
        ignore: (H, W) nonzero where nothing belongs to the scene, as the user gave it, or None.
        hidden: (H, W) 255 where nothing belongs to the scene, with two px of room, or None; `within` makes it of `ignore`.
        background: (H, W) or BGR (H, W, 3) the same bench without the object, or None.
        masked: the image is a softened mask, in which objects are white and nothing else is meant.
        more: images that follow the first, asked where the choice of the object is not sure.
        sure: probability from which it is.
        first_look_ms: work that the search for the object may do, see `segmentation.work`; None is no bound.
    """

    object_at: tuple[Point, ...] = ()
    not_at: tuple[Point, ...] = ()
    box: Box | None = None
    outline: Floats | None = None
    grasp: Grasp | None = None
    number: int | None = None
    ignore: NDArray[Any] | None = None
    hidden: Grey | None = None
    background: NDArray[np.uint8] | None = None
    masked: bool = False
    more: Iterable[NDArray[Any]] = field(default=(), compare=False)
    sure: float = DEFAULT_SURE
    first_look_ms: float | None = None

    @classmethod
    def of(
        cls,
        object_at: ArrayLike | None = None,
        *,
        not_at: ArrayLike | None = None,
        box: ArrayLike | None = None,
        outline: ArrayLike | None = None,
        grasp: ArrayLike | None = None,
        **given: Any,
    ) -> FirstImage:
        """The record of what users write, checked as far as that is possible without the image.

        Args:
            object_at, not_at: (x, y) px, or several such.
            box: left, top, width and height, px.
            outline: (n, 2) px, n >= 3.
            grasp: (k, 2) px of contacts, k >= 2.
            **given: the other attributes.

        Raises:
            InputError: no pixels, a box or an outline without area, a number below 1, a probability out of range, or a bound
                of the work that is not above 0.
            GraspError: contacts that are none.
        """
        said = cls(
            _parsed_points(object_at, "object_at"),
            _parsed_points(not_at, "not_at"),
            None if box is None else _parsed_box(box),
            None if outline is None else _parsed_polygon(outline),
            None if grasp is None else Grasp(grasp),
            **given,
        )
        if said.number is not None and said.number < 1:
            raise InputError(f"number counts candidates from 1, not {said.number}", number=said.number)
        if not 0.0 <= said.sure < 1.0:
            raise InputError(f"sure is a probability, 0 or more and below 1, not {said.sure:g}", sure=said.sure)
        limit_ms = said.first_look_ms
        if limit_ms is not None and not 0.0 < limit_ms < math.inf:
            raise InputError(f"first_look_ms is a number of ms above 0, not {limit_ms:g}", limit_ms=limit_ms)
        return said

    # --- what it says ----------------------------------------------------------------------------

    @property
    def is_pointed_at(self) -> bool:
        """Whether a place in the image says which object is meant: contacts do not say how far it reaches."""
        return bool(self.object_at) or self.box is not None or self.outline is not None or self.grasp is not None

    @property
    def names_object(self) -> bool:
        """Whether anything says which object is meant: a place, or a candidate that was taken."""
        return self.is_pointed_at or self.number is not None

    @property
    def is_settled(self) -> bool:
        """Whether it leaves no choice of the object: its outline, or a candidate."""
        return self.outline is not None or self.number is not None

    @property
    def says_anything(self) -> bool:
        """Whether a person said anything of the object."""
        return self.names_object or bool(self.not_at)

    def place_in_words(self) -> str:
        """The place in words, for messages: " at 10,20", " in the box", or empty."""
        if self.object_at:
            return " at " + " and ".join(f"{x:g},{y:g}" for x, y in self.object_at)
        return " in the box" if self.box is not None else ""

    def tracker_arguments(self) -> dict[str, Any]:
        """What was given, by the names of the parameters of `GraspTracker`."""
        nothing = FirstImage()
        given = {each.name: getattr(self, each.name) for each in fields(self)}
        told = {name: value for name, value in given.items() if value is not getattr(nothing, name)}
        return {**told, "grasp": self.grasp.contacts} if self.grasp is not None else told

    # --- what becomes of it ----------------------------------------------------------------------

    def of_no_object(self) -> FirstImage:
        """Without what says which object is meant; what is ignored, the background and the search's bounds stay."""
        return replace(self, object_at=(), not_at=(), box=None, outline=None, grasp=None, number=None)

    def with_pixel(self, at: Point, on: bool) -> FirstImage:
        """A pixel more. One on the object takes the place of a box, an outline or contacts."""
        if on:
            return replace(self.of_no_object(), object_at=(*self.object_at, at), not_at=self.not_at)
        return replace(self, not_at=(*self.not_at, at), number=None, grasp=None)

    def without_distortion(self, lens: Undistortion) -> FirstImage:
        """The same of the image without its lens's distortion."""

        background = None if self.background is None else _resized_background(self.background, *lens.size)
        return replace(
            self._with_places(lens.straight_points, lens.straight_box),
            ignore=lens.ignored_pixels(self.ignore),
            background=None if background is None else lens.straight_image(background),
            more=()
            if isinstance(self.more, tuple) and not self.more
            else (lens.straight_image(image) for image in self.more),
        )

    def in_window(self, left: int, top: int, right: int, bottom: int) -> FirstImage:
        """The same of a part of the image that it fits."""

        def cut_out(image: Any) -> Any:
            return None if image is None else np.ascontiguousarray(image[top:bottom, left:right])

        return replace(
            self._with_places(lambda points: points - (left, top), lambda box: (box[0] - left, box[1] - top, *box[2:])),
            hidden=cut_out(self.hidden),
            background=cut_out(self.background),
        )

    def _with_places(self, move: Callable[[Floats], Floats], move_box: Callable[[Box], Box]) -> FirstImage:
        """The same where `move` takes pixels (n, 2), and `move_box` a box."""

        def moved(points: tuple[Point, ...]) -> tuple[Point, ...]:
            return tuple((x, y) for x, y in move(np.array(points)).tolist()) if points else ()

        return replace(
            self,
            object_at=moved(self.object_at),
            not_at=moved(self.not_at),
            box=None if self.box is None else move_box(self.box),
            outline=None if self.outline is None else move(self.outline),
            grasp=None if self.grasp is None else Grasp(move(self.grasp.contacts)),
        )

    def within(self, shape: tuple[int, ...]) -> FirstImage:
        """The same for an image of this shape: boxes end at its border, masks and background are as the search takes them.

        Raises:
            InputError: a pixel, box or outline outside the image, a mask or background of another size.
            SourceError: a background that is no image.
        """
        height, width = shape[:2]
        whose = f"outside the image, which is {width}x{height} px"
        for name, points in (("object_at", self.object_at), ("not_at", self.not_at)):
            for x, y in points:
                if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
                    raise InputError(f"{name} {x:g},{y:g} is {whose}", place=(x, y))
        box, hidden = self.box, self.hidden
        if box is not None:
            left, top = max(box[0], 0.0), max(box[1], 0.0)  # a detector's may reach beyond the image
            right, bottom = min(box[0] + box[2], float(width)), min(box[1] + box[3], float(height))
            if right <= left or bottom <= top:
                raise InputError(f"the box {','.join(f'{v:g}' for v in box)} is {whose}", box=box)
            box = left, top, right - left, bottom - top
        if self.outline is not None:
            low, high = self.outline.min(axis=0), self.outline.max(axis=0)
            if high[0] < 0.0 or high[1] < 0.0 or low[0] > width - 1 or low[1] > height - 1:
                raise InputError(f"the outline lies {whose}")
            if min(low) < -(width + height) or max(high) > 2 * (width + height):
                raise InputError(f"the outline reaches far {whose}")
        if self.ignore is not None:
            hidden = with_room(to_mask(self.ignore, (height, width), "ignore mask"))
        background = None if self.background is None else _resized_background(self.background, width, height)
        return replace(self, box=box, ignore=None, hidden=hidden, background=background)


def _parsed_points(given: ArrayLike | None, name: str) -> tuple[Point, ...]:
    if given is None:
        return ()
    try:
        array = np.atleast_2d(np.asarray(given, dtype=np.float64))
    except (TypeError, ValueError, OverflowError):
        array = np.zeros((0, 0))
    if array.size == 0 and array.shape != (0, 0):
        return ()
    if array.ndim != 2 or array.shape[1] != 2 or not np.isfinite(array).all():
        raise InputError(f"{name} is (x, y) in px, or several of them, not {given!r}", given=repr(given))
    return tuple((x, y) for x, y in array.tolist())


def _parsed_box(given: Any) -> Box:
    try:
        left, top, wide, tall = (float(v) for v in given)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"a box is left, top, width and height in px, not {given!r}", given=repr(given)) from None
    if not (wide > 0.0 and tall > 0.0 and np.isfinite([left, top, wide, tall]).all()):
        raise InputError(f"a box has a width and a height above 0, not {wide:g} and {tall:g}", given=repr(given))
    return left, top, wide, tall


def _parsed_polygon(given: ArrayLike) -> Floats:
    try:
        points = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        points = np.zeros((0, 0))
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3 or not np.isfinite(points).all():
        raise InputError("an outline is at least three corners (x, y) in px", shape=points.shape)
    x, y = points.T
    area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    if area < 1.0:
        raise InputError("the outline encloses no area", area=area)
    return points


def _resized_background(background: NDArray[Any], width: int, height: int) -> NDArray[np.uint8]:
    """The background as grey or BGR, of the image's size."""
    empty = to_bgr(background)
    if empty.shape[:2] != (height, width):
        raise InputError(
            f"the background is {empty.shape[1]}x{empty.shape[0]} px, but the image is {width}x{height}",
            shape=empty.shape,
        )
    return empty
