# SPDX-License-Identifier: Apache-2.0
"""ECC: the homography that makes the part and its surroundings look most alike, from OpenCV (Evangelidis, Psarakis)."""

from __future__ import annotations

from typing import ClassVar

import cv2
import numpy as np

from grasptrack.bench.baselines.base import Found, LostError, Peer
from grasptrack.bench.baselines.region import region_of
from grasptrack.bench.method import Start
from grasptrack.errors import GraspTrackError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.segmentation.images import Grey
from grasptrack.typing import Floats

MARGIN = 12
"""px round the part that are compared too: there are its edges."""
SCALES = (0.125, 0.25)
"""Of the first fits, which find motions too large for the last."""
SMALLEST = 24
"""px of the shorter side, below which a reduced part tells no homography."""
CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-3)
SMOOTHING = 5
"""px, size of the Gauss filter in a fit."""
LEAST = 0.7
"""Correlation below which nothing was found."""


class Ecc(Peer):
    """cv2.findTransformECC against the first image, started from the last answer, coarse before fine.

    Its confidence is the correlation. After a loss it starts again from its last answer.
    """

    name: ClassVar[str] = "ecc"

    def __init__(self, start: Start) -> None:
        super().__init__(start)
        self._H: Floats = np.eye(3)

    def begin(self, image: Grey) -> None:
        """See Peer."""
        region = region_of(self.start, image)
        x, y, width, height = region.box(MARGIN)
        self._origin = np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])
        self._mask = region.grown(MARGIN)
        self._template = image[y : y + height, x : x + width].copy()
        least = SMALLEST / min(self._template.shape)
        self._small = {scale: _downscale_image(self._template, scale) for scale in SCALES if scale >= least}
        if not self._template.std() > 0.0:
            raise LostError("the part and its surroundings are of one grey")
        self._corners = region.corners

    def follow(self, image: Grey) -> Found:
        """See Peer."""
        reason = ""
        for guess in (self._coarse_homography(image), self._H):
            try:
                H, correlation = self._refined_homography(image, guess)
                if not correlation >= LEAST:
                    raise LostError(f"ECC ends at a correlation of {correlation:.2f}")
                found = self.moved(H, self._corners, correlation)
            except cv2.error:
                reason = reason or "ECC did not converge"
            except GraspTrackError as error:
                reason = reason or str(error)
            else:
                self._H = H
                return found
        raise LostError(reason)

    def _coarse_homography(self, image: Grey) -> Floats:
        """(3, 3) H_current_reference as far as reduced images tell it, the smallest first."""
        H = self._H
        for scale, small in self._small.items():
            mask = np.asarray(cv2.warpPerspective(self._mask, H, image.shape[::-1]), dtype=np.uint8)
            warp = _rescale_warp(H @ self._origin, scale)
            try:
                warp, correlation = _fit_warp(
                    small, _downscale_image(image, scale), warp, _downscale_image(mask, scale)
                )
            except cv2.error:  # too little to see at this scale: the finer ones have to do alone
                continue
            if correlation >= LEAST:
                H = _rescale_warp(warp, 1.0 / scale) @ np.linalg.inv(self._origin)
        return H

    def _refined_homography(self, image: Grey, H: Floats) -> tuple[Floats, float]:
        """(3, 3) H_current_reference from the image itself, started at H, and its correlation."""
        shift, window, mask = self._search_window(H, image)
        warp, correlation = _fit_warp(self._template, window, shift @ H @ self._origin, mask)
        return np.linalg.inv(shift) @ warp @ np.linalg.inv(self._origin), correlation

    def _search_window(self, H: Floats, image: Grey) -> tuple[Floats, Grey, Grey]:
        """What has to be looked at when the part moved by H (3, 3): image to window (3, 3), image and mask in it."""
        around = apply_homography(H, self._corners)
        low = np.maximum(np.floor(around.min(axis=0)) - 2 * MARGIN, 0.0)
        high = np.minimum(np.ceil(around.max(axis=0)) + 2 * MARGIN, image.shape[::-1])
        if not (high - low >= MARGIN).all():
            raise LostError("the part has left the image")
        (x, y), (right, bottom) = low.astype(int).tolist(), high.astype(int).tolist()
        shift = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [0.0, 0.0, 1.0]])
        mask = cv2.warpPerspective(self._mask, shift @ H, (right - x, bottom - y))
        return shift, np.ascontiguousarray(image[y:bottom, x:right]), np.asarray(mask, dtype=np.uint8)


def _fit_warp(template: Grey, image: Grey, warp: Floats, mask: Grey) -> tuple[Floats, float]:
    """The warp (3, 3) from the template's pixels to the image's, and the correlation under it."""
    first = np.asarray(warp / warp[2, 2], dtype=np.float32)
    correlation, found = cv2.findTransformECC(template, image, first, cv2.MOTION_HOMOGRAPHY, CRITERIA, mask, SMOOTHING)
    return np.asarray(found, dtype=np.float64), min(float(correlation), 1.0)  # rounding can exceed it


def _downscale_image(image: Grey, scale: float) -> Grey:
    """The image, smaller."""
    return np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _rescale_warp(warp: Floats, scale: float) -> Floats:
    """A warp between images that are both smaller by `scale`; pixel centres are at integer coordinates."""
    half = 0.5 * scale - 0.5
    S = np.array([[scale, 0.0, half], [0.0, scale, half], [0.0, 0.0, 1.0]])
    return np.asarray(S @ warp @ np.linalg.inv(S), dtype=np.float64)
