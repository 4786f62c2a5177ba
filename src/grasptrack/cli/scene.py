# SPDX-License-Identifier: Apache-2.0
"""One image and the outlines in it: the object that is meant first, then what lies beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from grasptrack.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grasptrack.geometry.contours import View
    from grasptrack.io.base import Frame

    Box = tuple[float, float, float, float]


def only_image(name: str, taken: str) -> Frame:
    """The image of a file.

    Args:
        name: of the file.
        taken: what the verb takes, for the message.

    Raises:
        SourceError, InputError: missing, unreadable, or more than one image.
    """
    from grasptrack.io.sources import open_source

    with open_source(name) as source:
        if source.kind != "image":
            raise InputError(f'"{name}" is a {source.kind}; {taken}')
        return next(iter(source))


def check_within(shape: tuple[int, ...], place: tuple[float, float] | None, box: Box | None) -> None:
    """See that a pixel lies in an image, and that a box overlaps it.

    Raises:
        InputError: they do not.
    """
    height, width = shape[:2]
    size = f"the image, which is {width}x{height} px"
    if place is not None and not (-0.5 <= place[0] <= width - 0.5 and -0.5 <= place[1] <= height - 0.5):
        raise InputError(f"--object {place[0]:g},{place[1]:g} is outside {size}", place=place)
    if box is not None and not (box[0] < width and box[1] < height and box[0] + box[2] > 0.0 and box[1] + box[3] > 0.0):
        raise InputError(f"--box {','.join(f'{v:g}' for v in box)} is outside {size}", box=box)


def find_outlines(
    image: NDArray[Any],
    place: tuple[float, float] | None,
    box: Box | None,
    mask: NDArray[Any] | None,
    ignore: NDArray[Any] | None,
) -> list[View]:
    """Outlines in an image, none within another, the object that is meant first.

    Args:
        image: (H, W) or BGR (H, W, 3).
        place: (x, y) px of the object that is meant.
        box: left, top, width and height of it, px.
        mask: (H, W) nonzero where there are objects; takes the image's place.
        ignore: (H, W) nonzero where nothing belongs to the scene.

    Raises:
        ObservationError: no object, or none where it should be.
        InputError: a mask of another size.
    """
    from grasptrack.segmentation.objects import find_objects

    if box is not None:  # a detector's may reach beyond the image
        height, width = image.shape[:2]
        left, top = max(box[0], 0.0), max(box[1], 0.0)
        box = left, top, min(box[0] + box[2], width) - left, min(box[1] + box[3], height) - top
    return [candidate.view for candidate in find_objects(image, place, box, ignore, mask)]
