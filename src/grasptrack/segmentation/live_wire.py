# SPDX-License-Identifier: Apache-2.0
"""A live wire: between two clicks the path runs along edges, and a click can be dragged afterwards.

OpenCV's intelligent scissors (Mortensen and Barrett, Graphical Models and Image Processing 60, 1998) find the path, in this
package's own gradients, which are those of lightness and colour in units of the image's noise.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import arguments
from grasptrack.errors import InputError
from grasptrack.images import to_bgr
from grasptrack.segmentation.closed_edges import RECIPES, ClosedEdgeSegmenter, lab_planes
from grasptrack.typing import Floats

SNAP = 5.0
"""px within which a click goes to an edge, in an image that is not reduced."""
MAX_MAPS = 4
"""Clicks from which the paths to all pixels are kept: those on either side of one that is dragged, and more."""

Pixel = tuple[int, int]


class LiveWire:
    """Draws an outline between clicks.

    An image of more than 800 px is reduced by a whole number, as for the first look, and the path is as coarse as that:
    `first_look(outline=...)` localises it in the full image.

    Args:
        image: 8 or 16 bit, grey, BGR or BGRA.
        snap: px within which a click goes to the nearest edge; 0 keeps clicks where they are, None is SNAP.

    Raises:
        InputError: no image, or `snap` below 0.
    """

    @arguments.checked(image=arguments.array(unbounded=True), snap=arguments.optional(arguments.number))
    def __init__(self, image: NDArray[Any], *, snap: float | None = None) -> None:
        colours = to_bgr(image)
        edges = ClosedEdgeSegmenter(lab_planes(colours))
        field, self._shrink = edges.fields[0], edges.shrink
        self._size = (colours.shape[1], colours.shape[0])
        self._snap = SNAP if snap is None else snap / self._shrink
        if not self._snap >= 0.0:
            raise InputError(f"snap is 0 or more px, not {snap:g}", snap=snap)
        self._off_edge = np.where(field.thin_edges(RECIPES[0].level) > 0, np.uint8(0), np.uint8(1))
        self._weakness = np.asarray(1.0 / (1.0 + field.gradient_magnitude), dtype=np.float32)
        self._direction = field.gradient_direction
        self._scissors: dict[Pixel, Any] = {}
        self._points: list[Pixel] = []
        self._pieces: list[NDArray[np.int32]] = []

    @property
    def points(self) -> list[tuple[float, float]]:
        """(x, y) px of the clicks, each on the edge that it went to."""
        return [(x, y) for x, y in self._to_image(np.array(self._points, np.int32).reshape(-1, 2)).tolist()]

    @property
    def is_closed(self) -> bool:
        """Whether the last click is joined with the first."""
        return bool(self._points) and len(self._pieces) == len(self._points)

    @property
    def path(self) -> Floats:
        """(n, 2) px from the first click to the last, or round to the first again, which is not repeated."""
        last = [] if self.is_closed else self._points[-1:]
        chain = [*(piece[:-1] for piece in self._pieces), np.array(last, np.int32).reshape(-1, 2)]
        return self._to_image(np.vstack(chain))

    @arguments.checked(x=arguments.number, y=arguments.number)
    def start(self, x: float, y: float) -> tuple[float, float]:
        """Begin at a click; what was drawn before is gone.

        Returns:
            (x, y) px on the edge that it went to.

        Raises:
            InputError: outside the image.
        """
        self._points, self._pieces = [self._snap_click(x, y)], []
        return self.points[0]

    @arguments.checked(x=arguments.number, y=arguments.number)
    def path_to(self, x: float, y: float) -> Floats:
        """(n, 2) px from the last click to where the pointer is, both included. It is not kept.

        Raises:
            InputError: outside the image, not begun, or closed already.
        """
        self._check_open()
        return self._to_image(self._find_piece(self._points[-1], self._snap_click(x, y)))

    @arguments.checked(x=arguments.number, y=arguments.number)
    def add(self, x: float, y: float) -> Floats:
        """Fix the path to a click.

        Returns:
            (n, 2) px, as of `path_to`.

        Raises:
            InputError: as of `path_to`.
        """
        self._check_open()
        at = self._snap_click(x, y)
        piece = self._find_piece(self._points[-1], at)
        self._points.append(at)
        self._pieces.append(piece)
        return self._to_image(piece)

    def close(self) -> Floats:
        """Join the last click with the first.

        Returns:
            (n, 2) px, a closed polygon, as `first_look(outline=...)` takes it.

        Raises:
            InputError: fewer than three clicks, or closed already.
        """
        self._check_open()
        if len(self._points) < 3:
            raise InputError(f"an outline takes at least three clicks, not {len(self._points)}")
        self._pieces.append(self._find_piece(self._points[-1], self._points[0]))
        return self.path

    def take_back(self) -> None:
        """Undo the last step: that the outline was closed, else the last click; the first one stays.

        Raises:
            InputError: not begun, or nothing but the first click.
        """
        if not self._pieces:
            raise InputError("there is nothing to take back but the first click: start(x, y) begins anew")
        if not self.is_closed:
            self._points.pop()
        self._pieces.pop()

    @arguments.checked(k=arguments.whole, x=arguments.number, y=arguments.number)
    def move(self, k: int, x: float, y: float) -> Floats:
        """Drag click k somewhere else; only the two pieces that end there are found again.

        Returns:
            (n, 2) px, the whole path.

        Raises:
            InputError: no such click, or outside the image.
        """
        n = len(self._points)
        if not 0 <= k < n:
            raise InputError(f"there is no click {k}: there are {n}, counted from 0", k=k)
        self._points[k] = self._snap_click(x, y)
        for piece in {(k - 1) % n, k}:
            if piece < len(self._pieces):
                self._pieces[piece] = self._find_piece(self._points[piece], self._points[(piece + 1) % n])
        return self.path

    def _check_open(self) -> None:
        if not self._points:
            raise InputError("a live wire begins with start(x, y)")
        if self.is_closed:
            raise InputError("the outline is closed: move(k, x, y) changes it, start(x, y) begins another one")

    def _to_image(self, chain: NDArray[np.int32]) -> Floats:
        """(n, 2) px of the image, of pixels (n, 2) of the reduced one."""
        return np.asarray(chain * self._shrink + 0.5 * (self._shrink - 1), dtype=np.float64)

    def _snap_click(self, x: float, y: float) -> Pixel:
        """The nearest pixel of an edge, if one is near; of the reduced image."""
        width, height = self._size
        if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
            raise InputError(f"{x:g},{y:g} is outside the image, which is {width}x{height} px", place=(x, y))
        x, y = ((v - 0.5 * (self._shrink - 1)) / self._shrink for v in (x, y))
        rows, columns = self._off_edge.shape
        column, row = min(max(round(x), 0), columns - 1), min(max(round(y), 0), rows - 1)
        reach = int(self._snap) + 1
        left, top = max(column - reach, 0), max(row - reach, 0)
        down, right = np.nonzero(self._off_edge[top : row + reach + 1, left : column + reach + 1] == 0)
        away = np.hypot(right + left - x, down + top - y)
        if not len(away) or away.min() > self._snap:
            return column, row
        nearest = int(away.argmin())
        return int(right[nearest]) + left, int(down[nearest]) + top

    def _find_piece(self, start: Pixel, end: Pixel) -> NDArray[np.int32]:
        """(n, 2) pixels along edges; it depends on its ends alone, not on what was asked before."""
        scissors = self._scissors.pop(start, None)
        if scissors is None:
            scissors = cv2.segmentation.IntelligentScissorsMB()
            scissors.applyImageFeatures(self._off_edge, self._direction, self._weakness)
            scissors.buildMap(start)
        self._scissors[start] = scissors
        while len(self._scissors) > MAX_MAPS:
            del self._scissors[next(iter(self._scissors))]
        return np.asarray(scissors.getContour(end), dtype=np.int32).reshape(-1, 2)
