# SPDX-License-Identifier: Apache-2.0
"""ViSP's template tracker (Dame and Marchand), through ViSP's own Python bindings where they are installed.

ViSP is under the GPL and on no package index for Python: it is built from source, and only imported here.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.baselines.base import NO_CONFIDENCE, Found, LostError, Peer
from grasptrack.bench.baselines.direct import MARGIN
from grasptrack.bench.baselines.region import Region, region_of
from grasptrack.bench.method import Start
from grasptrack.errors import GraspTrackError
from grasptrack.segmentation.images import Grey
from grasptrack.typing import Floats

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

    def __init__(self, start: Start) -> None:
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

    def follow(self, image: Grey) -> Found:
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


def template_triangles(region: Region) -> NDArray[Any]:
    """(3 n, 2) px, corners of triangles that cover the convex hull of a part and its surroundings."""
    outlines, _ = cv2.findContours(region.grown(MARGIN), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    hull = cv2.convexHull(np.concatenate(outlines))
    corners = np.asarray(cv2.approxPolyDP(hull, 2.0, True), dtype=np.float64).reshape(-1, 2)
    return np.concatenate([corners[[0, i, i + 1]] for i in range(1, len(corners) - 1)])
