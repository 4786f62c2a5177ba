# SPDX-License-Identifier: Apache-2.0
"""Any image or mask that users have, checked once and as everything else works on it: 8 bit, grey or in colours."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError, SourceError

Grey = NDArray[np.uint8]

MIN_SIDE = 32
"""px; a smaller image cannot show a usable outline."""
MOST_SLENDER = 500
"""Of the longer side to the shorter: a small copy of a more slender image has no pixel across."""


def to_grey(image: NDArray[Any]) -> Grey:
    """A grey (H, W), BGR (H, W, 3) or BGRA (H, W, 4) image of 8 or 16 bits as (H, W) uint8; alpha is dropped.

    Raises:
        SourceError: another type or shape, or a side under 32 px.
    """
    return PLAIN.to_grey(to_bgr(image))


def to_bgr(image: NDArray[Any]) -> NDArray[np.uint8]:
    """An image of any kind that `to_grey` takes as (H, W) or (H, W, 3) uint8, keeping its colours.

    Raises:
        SourceError: as `to_grey`.
    """
    array = _check_image(image)
    return np.ascontiguousarray(array if array.ndim == 2 else array[:, :, :3])


class Channel(NamedTuple):
    """A mixture of blue, green and red, scaled so that no value leaves 0 to 255.

    Attributes:
        weights: of blue, green and red, with absolute values that sum to 1; None is plain grey.
    """

    weights: tuple[float, float, float] | None = None

    def to_grey(self, colours: NDArray[np.uint8]) -> Grey:
        """(H, W) an image as `to_bgr` gives it in this mixture; plain grey if it has no colours."""
        if colours.ndim == 2:
            return colours
        if self.weights is None:
            return np.asarray(cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        below = sum(min(w, 0.0) for w in self.weights)
        mix = np.array([[*self.weights, -255.0 * below]], np.float32)
        return np.asarray(cv2.transform(colours, mix), dtype=np.uint8)


PLAIN = Channel()


def _check_image(image: NDArray[Any]) -> NDArray[np.uint8]:
    """The image as 8 bit, (H, W), (H, W, 3) or (H, W, 4)."""
    array = np.asarray(image)
    if array.ndim == 3 and array.shape[2] == 1:
        array = array[:, :, 0]
    if array.ndim not in (2, 3) or (array.ndim == 3 and array.shape[2] not in (3, 4)):
        raise SourceError(f"an image is an array (H, W), (H, W, 3) or (H, W, 4), not {array.shape}", shape=array.shape)
    if min(array.shape[:2]) < MIN_SIDE:
        raise SourceError(
            f"the image is {array.shape[1]}x{array.shape[0]} px; at least {MIN_SIDE}x{MIN_SIDE} are needed",
            shape=array.shape,
        )
    if max(array.shape[:2]) > MOST_SLENDER * min(array.shape[:2]):
        raise SourceError(
            f"the image is {array.shape[1]}x{array.shape[0]} px; no side may be more than {MOST_SLENDER} times the other",
            shape=array.shape,
        )
    if array.dtype == np.uint16:
        return (array >> 8).astype(np.uint8)
    if array.dtype == np.bool_:
        return array.astype(np.uint8) * 255
    if array.dtype != np.uint8:
        raise SourceError(f"an image has 8 or 16 bit unsigned values, not {array.dtype}", dtype=str(array.dtype))
    return array


def to_mask(mask: NDArray[Any], shape: tuple[int, ...], what: str) -> Grey:
    """Any mask of the image's size as (H, W) uint8 of 0 and 255; nonzero is set.

    Raises:
        InputError: not the image's size.
    """
    array = np.asarray(mask)
    if array.ndim == 3:
        array = np.asarray(np.any(array[:, :, :3], axis=2))
    if array.ndim != 2:
        raise InputError(f"the {what} must be an array (H, W), not of shape {np.shape(mask)}", shape=np.shape(mask))
    if array.shape != shape:
        raise InputError(
            f"the {what} is {array.shape[-1]}x{array.shape[0]} px, but the images are {shape[1]}x{shape[0]}",
            shape=array.shape,
        )
    return np.where(array != 0, np.uint8(255), np.uint8(0))


def with_room(mask: Grey) -> Grey:
    """A mask and two pixels round it: beside what is hidden, edges are its own."""
    return np.asarray(cv2.dilate(mask, np.ones((5, 5), np.uint8)), dtype=np.uint8)


def as_scene(mask: Grey) -> Grey:
    """A mask as an image of a white object on black, its steps softened, for everything that reads images."""
    return np.asarray(cv2.GaussianBlur(mask, (5, 5), 1.0), dtype=np.uint8)
