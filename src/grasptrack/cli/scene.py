# SPDX-License-Identifier: Apache-2.0
"""One image and the outlines in it: the object that is meant first, then what lies beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from grasptrack.errors import InputError, ObservationError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from grasptrack.contour import View
    from grasptrack.io.base import Frame

    Floats = NDArray[np.float64]
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


def outlines(
    image: NDArray[Any],
    place: tuple[float, float] | None,
    box: Box | None,
    mask: NDArray[Any] | None,
    ignore: NDArray[Any] | None,
) -> list[View]:
    """Outlines in an image, the object that is meant first.

    What lies within another one, as a print does, or round it, as a table does, is left out after it.

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
    if box is not None:  # a detector's may reach beyond the image
        height, width = image.shape[:2]
        left, top = max(box[0], 0.0), max(box[1], 0.0)
        box = left, top, min(box[0] + box[2], width) - left, min(box[1] + box[3], height) - top
    kept: list[View] = []
    for view in _found(image, place, box, mask, ignore):
        if not any(_nested(view, other) for other in kept):
            kept.append(view)
    return kept


def _found(
    image: NDArray[Any],
    place: tuple[float, float] | None,
    box: Box | None,
    mask: NDArray[Any] | None,
    ignore: NDArray[Any] | None,
) -> list[View]:
    from grasptrack.observation.images import as_scene, to_grey, to_mask
    from grasptrack.observation.segmentation import candidates, grow

    grey = to_grey(image)
    hidden = None if ignore is None else grow(to_mask(ignore, grey.shape, "ignore mask"))
    polarities: tuple[int, ...] = (1, -1)
    if mask is not None:
        grey, polarities = as_scene(to_mask(mask, grey.shape, "mask")), (-1,)
    views = [c.view for c in candidates(grey, None, hidden, polarities)]
    if place is not None:
        return [candidates(grey, place, hidden, polarities)[0].view, *views]
    if box is None:
        return views
    chosen = max(views, key=lambda v: _overlap(v.outer.points, box))
    if _overlap(chosen.outer.points, box) < 0.3:
        raise ObservationError("no object fills the box", box=box)
    return [chosen, *views]


def _overlap(points: Floats, box: Box) -> float:
    """Intersection over union of an outline's bounding box with a box."""
    (x0, y0), (x1, y1) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    x, y, w, h = box
    wide, tall = min(x1, x + w) - max(x0, x), min(y1, y + h) - max(y0, y)
    both = max(wide, 0.0) * max(tall, 0.0)
    return float(both / ((x1 - x0) * (y1 - y0) + w * h - both))


def _nested(one: View, other: View) -> bool:
    """Whether one outline lies within the other, or both are the same, of which about half lies within the other."""
    return _share_within(one, other) + _share_within(other, one) > 0.5


def _share_within(inner: View, outer: View) -> float:
    """Share of an outline's points, of some thirty, that lie within another: a ray to the right crosses it oddly."""
    import numpy as np

    points, ends = inner.outer.points[:: max(1, len(inner.outer) // 30)], outer.outer.points
    x, y = points[:, :1], points[:, 1:]
    (x0, y0), (x1, y1) = ends.T, np.roll(ends, -1, axis=0).T
    crosses = (y0 > y) != (y1 > y)
    rise = np.where(y1 == y0, 1.0, y1 - y0)
    inside = np.count_nonzero(crosses & (x < x0 + (y - y0) * (x1 - x0) / rise), axis=1) % 2
    return float(inside.mean())
