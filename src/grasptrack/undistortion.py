# SPDX-License-Identifier: Apache-2.0
"""Undistorts images of a calibrated camera, and maps results back to px of the original images."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.errors import InputError, SourceError
from grasptrack.geometry.cameras import Camera
from grasptrack.geometry.contours import Contour, View
from grasptrack.grasp.contacts import RankedGrasp
from grasptrack.images import to_bgr, to_mask
from grasptrack.typing import Box, Floats

if TYPE_CHECKING:
    from grasptrack.tracking.result import TrackResult

MOST = 0.3
"""An undistorted image is larger than the original by at most this share on each side."""
_COARSE = 8
_STEP = 0.05


class Undistortion:
    """Undistorts images of one size, and maps points and masks both ways.

    The undistorted ("straight") image has the camera's matrix, so that its middle keeps its scale. It is large enough to
    hold everything seen, up to MOST, and symmetric about the optical axis, up to MOST. What lies outside the original
    image is hidden.

    Args:
        camera: as calibrated; a calibration for an image of another size but the same shape is scaled.
        width, height: px of the original images.

    Attributes:
        camera: scaled to this size.
        offset: (2,) ideal px of the straight image's pixel (0, 0); whole numbers.
        hidden: (h, w) uint8, 255 where the straight image shows nothing.
        focal: focal length in widths of the straight image, and the width of a pixel for each unit of its height; None if the
            optical axis is not in the middle.

    Raises:
        InputError: a calibration for images of another shape, or one by which nothing comes to lie in the image.
    """

    def __init__(self, camera: Camera, width: int, height: int) -> None:
        self.camera = camera.resized(width, height)
        self.size = width, height
        reach = math.ceil(MOST * width), math.ceil(MOST * height)
        x, y = (np.arange(-m, n + m + _COARSE, _COARSE) for m, n in zip(reach, self.size, strict=True))
        shown = self._distort_with_visibility(self._pixel_grid(x, y))[1]
        columns, rows = np.flatnonzero(shown.any(axis=0)), np.flatnonzero(shown.any(axis=1))
        if not len(columns):
            raise InputError(
                "by its matrix and distortion, the camera shows nothing within its image: calibrate it again"
            )
        left, right = int(x[columns[0]]) - _COARSE, int(x[columns[-1]]) + _COARSE
        top, bottom = int(y[rows[0]]) - _COARSE, int(y[rows[-1]]) + _COARSE
        if not self.camera.distorted:
            left, top, right, bottom = 0, 0, width - 1, height - 1
        (left, right), (top, bottom) = (
            _centered_range(middle, low, high, MOST * side)
            for middle, low, high, side in zip(
                self.camera.matrix[:2, 2].tolist(), (left, top), (right, bottom), self.size, strict=True
            )
        )
        self.offset: Floats = np.array([left, top], dtype=np.float64)
        seen, shown = self._distort_with_visibility(
            self._pixel_grid(np.arange(left, right + 1), np.arange(top, bottom + 1))
        )
        nearest = np.clip(seen, 0.0, (width - 1, height - 1)).astype(np.float32)  # so that no edge is invented
        self._maps = cv2.convertMaps(nearest[..., 0], nearest[..., 1], cv2.CV_16SC2)
        self.hidden: NDArray[np.uint8] = np.where(shown, np.uint8(0), np.uint8(255))
        (fx, fy), (x, y) = np.diag(self.camera.matrix)[:2].tolist(), self.camera.matrix[:2, 2].tolist()
        aside = max(abs(left + right - 2.0 * x), abs(top + bottom - 2.0 * y))
        self.focal = (fx / (right - left + 1), fy / fx) if aside <= 2.0 else None

    @staticmethod
    def _pixel_grid(x: NDArray[Any], y: NDArray[Any]) -> Floats:
        return np.stack(np.meshgrid(x, y), axis=-1).astype(np.float64)

    def _distort_with_visibility(self, ideal: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Where points (..., 2) appear in the original image, and whether they lie within it."""
        seen = self.camera.distort(ideal)
        inside = np.all((seen >= -0.5) & (seen <= np.array(self.size) - 0.5), axis=-1)
        return seen, np.asarray(inside & self.camera.within(ideal))

    # --- what goes in ----------------------------------------------------------------------------

    def straight_image(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """A grey or BGR image as a lens without distortion would show it.

        Raises:
            SourceError: an image that cannot be used, or of another size.
        """
        colours = to_bgr(image)
        if colours.shape[1::-1] != self.size:
            w, h = self.size
            raise SourceError(
                f"the image is {colours.shape[1]}x{colours.shape[0]} px, but the first was {w}x{h}; all must have one size"
            )
        return np.asarray(cv2.remap(colours, *self._maps, cv2.INTER_LINEAR), dtype=np.uint8)

    def straight_mask(self, mask: NDArray[Any], what: str = "mask", least: int = 128) -> NDArray[np.uint8]:
        """A mask of the straight image, 0 and 255; pixels covered by at least `least` / 255 are set.

        Raises:
            InputError: not of the images' size.
        """
        given = to_mask(mask, self.size[::-1], what)
        straight = np.asarray(cv2.remap(given, *self._maps, cv2.INTER_LINEAR))
        return np.where(straight >= least, np.uint8(255), np.uint8(0))

    def ignored_pixels(self, mask: NDArray[Any] | None) -> NDArray[Any] | None:
        """Ignored pixels: outside the original image, and under the user's mask; None if there are none.

        Raises:
            InputError: not of the images' size.
        """
        hidden = self.hidden if mask is None else self.hidden | self.straight_mask(mask, "ignore mask", least=1)
        return hidden if hidden.any() else None

    def straight_points(self, seen: ArrayLike) -> Floats:
        """Points (k, 2) of the original image in px of the straight one."""
        return self.camera.undistort(np.asarray(seen, dtype=np.float64)) - self.offset

    def straight_box(self, box: Box) -> Box:
        """A box of the original image in the straight one: the rectangle around its undistorted sides."""
        x, y, w, h = box
        along = np.linspace(0.0, 1.0, 9)
        sides = [(x + w * t, y + h * e) for t in along for e in (0, 1)] + [
            (x + w * e, y + h * t) for t in along for e in (0, 1)
        ]
        at = self.straight_points(np.array(sides))
        (left, top), (right, bottom) = at.min(axis=0).tolist(), at.max(axis=0).tolist()
        return left, top, right - left, bottom - top

    # --- what comes out --------------------------------------------------------------------------

    def points_seen(self, points: ArrayLike) -> Floats:
        """Points (k, 2) of the straight image in px of the original one."""
        return self.camera.distort(np.asarray(points, dtype=np.float64) + self.offset)

    def _seen_near(self, points: Floats) -> tuple[Floats, Floats]:
        """`points_seen` and `point_jacobian` together, for the few points of every frame."""
        around = self.points_seen(points[:, None] + _STEP * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]]))
        J = np.stack([around[:, 1] - around[:, 2], around[:, 3] - around[:, 4]], axis=-1) / (2.0 * _STEP)
        return around[:, 0], J

    def point_jacobian(self, points: ArrayLike) -> Floats:
        """(k, 2, 2) derivatives of `points_seen` at points (k, 2) of the straight image."""
        return self.camera.jacobian(np.asarray(points, dtype=np.float64) + self.offset)

    def view_seen(self, view: View) -> View:
        """An outline of the straight image in px of the original one."""
        return View(
            [
                Contour.trusted(self.points_seen(c.points), hole=c.hole, strength=c.strength, clipped=c.clipped)
                for c in view.contours
            ]
        )

    def grasp_seen(self, grasp: RankedGrasp) -> SeenGrasp:
        """A grasp of the straight image in px of the original one; lengths stay those of the straight image."""
        turned = (self.point_jacobian(grasp.contacts) @ grasp.directions[..., None])[..., 0]
        return SeenGrasp(
            self.points_seen(grasp.contacts),
            grasp.quality,
            grasp.terms,
            spread=grasp.spread,
            margin=grasp.margin,
            directions=turned / np.linalg.norm(turned, axis=1, keepdims=True),
            regions=grasp.regions,
            fingers=self.points_seen(grasp.fingers),
            swept=self.points_seen(grasp.swept),
            straight=grasp.contacts,
        )

    def result_seen(self, result: TrackResult) -> TrackResult:
        """A result with contacts, covariance and outline in px of the original image, homographies in ideal px."""
        contacts, covariance = result.contacts, result.covariance
        H, spread = result.homography, result.homography_covariance
        x, y = self.offset
        there, back = np.array([[1, 0, x], [0, 1, y], [0, 0, 1.0]]), np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1.0]])
        plane = None if result.rectification is None else result.rectification @ back
        if contacts is not None:
            contacts, J = self._seen_near(contacts)
            covariance = None if covariance is None else J @ covariance @ np.swapaxes(J, 1, 2)
        if H is not None:
            moved = there @ H @ back
            if spread is not None:
                # of the entries row by row, the last one being 1 again
                entries = np.kron(there, back.T)
                J = (entries - np.outer(moved / moved[2, 2], entries[8])) / moved[2, 2]
                spread = J @ spread @ J.T
            H = moved / moved[2, 2]
        view = None if result.view is None else self.view_seen(result.view)
        return replace(
            result,
            contacts=contacts,
            covariance=covariance,
            homography=H,
            homography_covariance=spread,
            view=view,
            rectification=plane,
        )


def _centered_range(middle: float, low: int, high: int, most: float) -> tuple[int, int]:
    """The range of whole px from low to high, extended at one end by at most `most`, so that its middle is as given."""
    if 2.0 * middle > low + high + 1.0:
        return low, min(math.floor(2.0 * middle) - low, high + math.floor(most))
    if 2.0 * middle < low + high - 1.0:
        return max(math.ceil(2.0 * middle) - high, low - math.floor(most)), high
    return low, high


class SeenGrasp(RankedGrasp):
    """A grasp in px of the original image; opening, regions and margin are those of the straight image.

    Attributes:
        straight: (k, 2) px, the contacts in the straight image.
    """

    __slots__ = ("straight",)

    def __init__(self, *args: Any, straight: Floats, **values: Any) -> None:
        super().__init__(*args, **values)
        self.straight = straight
