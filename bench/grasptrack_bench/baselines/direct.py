# SPDX-License-Identifier: Apache-2.0
"""Direct alignment: OpenCV's ECC (Evangelidis, Psarakis) and ViSP's template tracker (Dame, Marchand).

ViSP is under the GPL and on no package index for Python: it is built from source, and only imported here.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import GraspTrackError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.images import Grey
from grasptrack.typing import Floats
from grasptrack_bench.baselines.base import NO_CONFIDENCE, BaselineAnswer, LostError, PartRegion, Peer, region_of
from grasptrack_bench.method import MethodStart

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

    def __init__(self, start: MethodStart) -> None:
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

    def follow(self, image: Grey) -> BaselineAnswer:
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
    return np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _rescale_warp(warp: Floats, scale: float) -> Floats:
    """A warp between images that are both smaller by `scale`; pixel centres are at integer coordinates."""
    half = 0.5 * scale - 0.5
    S = np.array([[scale, 0.0, half], [0.0, scale, half], [0.0, 0.0, 1.0]])
    return np.asarray(S @ warp @ np.linalg.inv(S), dtype=np.float64)


TRACKER = "TemplateTrackerZNCCInverseCompositional"
SAMPLING = 2
"""Every so many-th row and column of the template is compared."""
LEVELS = 3
"""Of the pyramid; the finest is the image itself."""
LAMBDA, ITERATIONS = 0.001, 200
"""Of ViSP's own tutorial."""


def why_not() -> str:
    """Why ViSP cannot be used here; empty where it can."""
    if find_spec("visp") is None:
        return "ViSP's Python bindings are not installed (https://visp-doc.inria.fr, build with the Python module)"
    try:
        core, tt = import_module("visp.core"), import_module("visp.tt")
    except ImportError as error:
        return f"ViSP's Python bindings cannot be loaded: {error}"
    if not hasattr(core, "ImageGray") or not hasattr(tt, TRACKER):
        return "ViSP's Python bindings are there without the module tt, which holds the template tracker"
    return ""


class ViSP(Peer):
    """Zero-mean normalised correlation, inverse compositional, a homography, on the part and its surroundings.

    It goes on from its last answer, after a loss as well. It gives no measure of its own that orders answers.
    """

    name: ClassVar[str] = "visp"
    failures: ClassVar[tuple[type[Exception], ...]] = (
        GraspTrackError,
        cv2.error,
        np.linalg.LinAlgError,
        RuntimeError,  # what the bindings make of ViSP's exceptions
    )

    def __init__(self, start: MethodStart) -> None:
        super().__init__(start)
        self._missing = why_not()
        self._p: Floats = np.zeros(8)

    def begin(self, image: Grey) -> None:
        """See Peer."""
        if self._missing:
            raise LostError(self._missing)
        self._core, tt = import_module("visp.core"), import_module("visp.tt")
        region = region_of(self.start, image)
        self._corners = region.corners
        self._warp = tt.TemplateTrackerWarpHomography()  # the tracker keeps but a pointer to it
        self._tracker = getattr(tt, TRACKER)(self._warp)
        self._tracker.setSampling(SAMPLING, SAMPLING)
        self._tracker.setLambda(LAMBDA)
        self._tracker.setIterationMax(ITERATIONS)
        self._tracker.setPyramidal(LEVELS, 0)
        points = [self._core.ImagePoint(y, x) for x, y in template_triangles(region).tolist()]
        self._tracker.initFromPoints(self._core.ImageGray(image), points, False)

    def follow(self, image: Grey) -> BaselineAnswer:
        """See Peer."""
        try:
            self._tracker.track(self._core.ImageGray(image))
            if self._tracker.getDiverge():
                raise LostError("ViSP's tracker diverged")
            p = np.array(self._tracker.getp().numpy(), dtype=np.float64)
            found = self.moved(homography_of(p), self._corners, NO_CONFIDENCE)
        except self.failures:
            self._tracker.setp(self._core.ColVector(self._p))
            raise
        self._p = p
        return found


def homography_of(p: Floats) -> Floats:
    """(3, 3) H_current_reference of the parameters (8,) of vpTemplateTrackerWarpHomography, as its header tells them."""
    return np.array([[1.0 + p[0], p[3], p[6]], [p[1], 1.0 + p[4], p[7]], [p[2], p[5], 1.0]])


def template_triangles(region: PartRegion) -> NDArray[Any]:
    """(3 n, 2) px, corners of triangles that cover the convex hull of a part and its surroundings."""
    outlines, _ = cv2.findContours(region.grown(MARGIN), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    hull = cv2.convexHull(np.concatenate(outlines))
    corners = np.asarray(cv2.approxPolyDP(hull, 2.0, True), dtype=np.float64).reshape(-1, 2)
    return np.concatenate([corners[[0, i, i + 1]] for i in range(1, len(corners) - 1)])
