# SPDX-License-Identifier: Apache-2.0
"""`gt.draw`: an image and what was found in it as one picture, which a notebook shows by itself."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import arguments
from grasptrack.errors import InputError
from grasptrack.geometry.contours import Contour, Outline, View
from grasptrack.grasp.contacts import Grasp
from grasptrack.images import to_bgr
from grasptrack.segmentation.candidate import Candidate
from grasptrack.trackability.result import Suitability
from grasptrack.tracking.result import TrackResult
from grasptrack.transfer.base import Transfer
from grasptrack.typing import Floats
from grasptrack.view.draw import draw_candidates, draw_grasps, draw_overlay
from grasptrack.view.inspect import write_inspection

Drawable = TrackResult | Candidate | Suitability | Grasp | Transfer | Outline | Sequence[Candidate] | Sequence[Grasp]
EMPTY, AROUND = 235, 24
"""Grey level of the ground where there is no image, and px of it beyond what is drawn."""


class Drawing(np.ndarray[tuple[Any, ...], np.dtype[np.uint8]]):  # to inherit from NDArray is refused from NumPy 2.5 on
    """A picture, uint8 BGR (H, W, 3): an array like any other, but that a notebook shows it."""

    def __repr__(self) -> str:
        return f"Drawing({self.shape[1]}x{self.shape[0]} px)" if self.ndim == 3 else repr(np.asarray(self))

    def _repr_png_(self) -> bytes | None:
        return png_bytes(self) if self.ndim == 3 and self.shape[2] == 3 and self.size else None


@arguments.checked(image=arguments.optional(arguments.array(unbounded=True)), title=arguments.text)
def draw(image: NDArray[Any] | None, found: Drawable, title: str = "") -> Drawing:
    """An image with what was found in it.

    Args:
        image: grey (H, W), BGR (H, W, 3) or BGRA (H, W, 4), 8 or 16 bits; None for a plain ground, as large as what is drawn.
        found: a result of the tracker, candidates of a first look, grasps (the first is the one that stands out), a transfer,
            an outline, or what `inspect` found.
        title: what the image is called, on a page of `inspect`.

    Returns:
        (H', W', 3) uint8 BGR: `cv2.imwrite` saves it, and a notebook shows it.

    Raises:
        InputError: no image, or something that cannot be drawn.
    """
    image = None if image is None else to_bgr(image)
    if isinstance(found, Suitability):
        return _inspection_page(_ground_for(image, found.view.points), found, title)
    if isinstance(found, TrackResult):
        points = [p for p in (found.contacts, None if found.view is None else found.view.points) if p is not None]
        return draw_overlay(_ground_for(image, *points), found).view(Drawing)
    if isinstance(found, Transfer):
        found = found.grasp
    if isinstance(found, (Contour, View)):
        return draw_grasps(_ground_for(image, found.points), [], found).view(Drawing)
    listed: list[Any] = [found] if isinstance(found, (Candidate, Grasp)) else _as_list(found)
    if listed and all(isinstance(one, Candidate) for one in listed):
        return draw_candidates(_ground_for(image, *(one.view.points for one in listed)), listed).view(Drawing)
    if all(isinstance(one, Grasp) for one in listed):
        contacts = [one.contacts for one in listed]
        return draw_grasps(_ground_for(image, *contacts), contacts).view(Drawing)
    raise InputError(
        "what can be drawn: a result of the tracker, candidates, grasps, a transfer, an outline, or what inspect found; "
        f"not {type(found).__name__}"
    )


def png_bytes(picture: NDArray[np.uint8]) -> bytes:
    """A picture, uint8 BGR (H, W, 3), as a PNG file's bytes."""
    return bytes(cv2.imencode(".png", np.ascontiguousarray(picture))[1])


def _as_list(found: object) -> list[Any]:
    return list(found) if isinstance(found, Sequence) and not isinstance(found, (str, bytes)) else [found]


def _ground_for(image: NDArray[Any] | None, *points: Floats) -> NDArray[Any]:
    """The image; where there is none a plain picture that holds these points (n, 2) px, its origin that of the image."""
    if image is not None:
        return image
    far = np.max([p.max(axis=0) for p in points], axis=0) if points else np.array([480.0, 120.0])
    width, height = (np.clip(far, 0.0, 8000.0) + AROUND).astype(int).tolist()
    return np.full((height, width), EMPTY, np.uint8)


def _inspection_page(image: NDArray[Any], found: Suitability, title: str) -> Drawing:
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "inspect.png"
        write_inspection(page, image, found, title=title)
        return np.asarray(cv2.imread(str(page)), dtype=np.uint8).view(Drawing)
