# SPDX-License-Identifier: Apache-2.0
"""Any image or mask that users have, checked once and as everything else works on it: 8 bit, grey or in colours."""

from __future__ import annotations

import sys
import warnings
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

DEEPEST = 1 << 12
"""What values of 10 and 12 bits are below."""
NOT_SCALED = (
    "an image of 16 bits has no value above 4095, as of a camera of 10 or 12 bits, and is read as nearly black: "
    "multiply 10 bits by 64, 12 by 16"
)


def to_grey(image: NDArray[Any]) -> Grey:
    """A grey (H, W), BGR (H, W, 3) or BGRA (H, W, 4) image of 8 or 16 bits, or Pillow's, as (H, W) uint8; alpha is dropped.

    Raises:
        SourceError: another type or shape, or a side under 32 px.
    """
    return PLAIN.to_grey(to_bgr(image))


def to_bgr(image: NDArray[Any]) -> NDArray[np.uint8]:
    """An image of any kind that `to_grey` takes as (H, W) or (H, W, 3) uint8, keeping its colours."""
    array = _check_image(image)
    return np.ascontiguousarray(array if array.ndim == 2 else array[:, :, :3])


class Channel(NamedTuple):
    """A mixture of blue, green and red, scaled so that no value leaves 0 to 255."""

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


def array_of_picture(picture: Any) -> NDArray[Any]:
    """An image of Pillow's, whose colours are in the order RGB, as (H, W), BGR (H, W, 3) or BGRA (H, W, 4)."""
    if picture.mode in ("1", "L", "F") or picture.mode.startswith("I"):
        return np.asarray(picture)
    clear = "A" in picture.mode or "a" in picture.mode or "transparency" in picture.info
    array = np.asarray(picture.convert("RGBA" if clear else "RGB"))
    return np.ascontiguousarray(array[:, :, [2, 1, 0, 3][: array.shape[2]]])


def _check_image(image: NDArray[Any]) -> NDArray[np.uint8]:
    """The image as 8 bit, (H, W), (H, W, 3) or (H, W, 4)."""
    pillow = sys.modules.get("PIL.Image")  # who has a picture of Pillow's has loaded it
    is_picture = pillow is not None and isinstance(image, pillow.Image)
    array = array_of_picture(image) if is_picture else np.asarray(image)
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
        if 255 < int(array.max()) < DEEPEST:
            warnings.warn(NOT_SCALED, stacklevel=2)
        return (array >> 8).astype(np.uint8)
    if array.dtype == np.bool_:
        return array.astype(np.uint8) * 255
    if array.dtype != np.uint8:
        raise SourceError(f"an image has 8 or 16 bit unsigned values, not {array.dtype}", dtype=str(array.dtype))
    return array


def to_mask(mask: NDArray[Any], shape: tuple[int, ...], what: str) -> Grey:
    """Any mask of the image's size as (H, W) uint8 of 0 and 255; nonzero is set. Instances of a "mask" are parted."""
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
    return part_instances(array) if what == "mask" else np.where(array != 0, np.uint8(255), np.uint8(0))


MOST_INSTANCES = 255
"""Values of a mask that numbers its instances."""


def part_instances(labels: NDArray[Any]) -> Grey:
    """(H, W) uint8, 255 where labels (H, W) are not 0, but for four pixels between instances that touch: fewer are bridged.

    Several values are labels where each fills some 3 x 3 pixels: those of a soft edge do not.
    """
    mask = np.where(labels != 0, np.uint8(255), np.uint8(0))
    if labels.dtype == np.bool_ or np.array_equal(labels != 0, labels == labels.max(initial=0)):
        return mask
    values = np.unique(labels[labels != 0])
    if len(values) > MOST_INSTANCES:
        return mask
    ids = np.where(labels != 0, 1 + np.searchsorted(values, labels), 0).astype(np.uint16)
    whole = np.ones((3, 3), np.uint8)
    cores = (cv2.erode(ids, whole) == cv2.dilate(ids, whole)) & (ids > 0)
    if len(np.unique(ids[cores])) < len(values):
        return mask
    near = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    least = cv2.erode(np.where(ids > 0, ids, np.uint16(MOST_INSTANCES + 1)), near)
    mask[(ids > 0) & (cv2.dilate(ids, near) != least)] = 0
    return mask


def with_room(mask: Grey) -> Grey:
    """A mask and two pixels round it: beside what is hidden, edges are its own."""
    return np.asarray(cv2.dilate(mask, np.ones((5, 5), np.uint8)), dtype=np.uint8)


def as_scene(mask: Grey) -> Grey:
    """A mask as an image of a white object on black, its steps softened, for everything that reads images."""
    return np.asarray(cv2.GaussianBlur(mask, (5, 5), 1.0), dtype=np.uint8)
