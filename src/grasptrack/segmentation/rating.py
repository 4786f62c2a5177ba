# SPDX-License-Identifier: Apache-2.0
"""How much an outline looks like that of an object: one score, a product of named terms."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.segmentation.normalized_gradient import NormalizedGradient
from grasptrack.segmentation.silhouettes import Silhouette

ENOUGH = 4.0
"""Units of noise; a stronger edge is no better. Otherwise a sharp part would win over the whole object."""
NOTHING = 1.0
"""Units of noise; noise alone reaches this."""
CLOSED = 2.0
"""Units of noise from which an edge counts as present."""
COMPACT = 8.0
"""An outline is smooth enough up to this many times a circle's length^2 / area."""
TOUCHING = 0.5
"""Factor for each image side that the silhouette reaches."""
BRIDGED = 0.8
"""Factor for a closing that bridges gaps of 16 px."""


SAMPLES = 200
"""Pixels of an outline that are sampled."""


class Rating(NamedTuple):
    """Terms between 0 and 1.

    Attributes:
        closed: share of the outline on an edge.
        contrast: mean strength of the edge along it, capped at ENOUGH.
        complete: not cut by the image's border.
        smooth: short for the area it encloses.
        exact: found without bridging wide gaps.
        size: square root of the convex hull's length over the image's width and height; large outlines are less likely
            to arise by chance.
        in_view: `closed` times `contrast` of the part of the outline that is not at the image's border.
    """

    closed: float
    contrast: float
    complete: float
    smooth: float
    exact: float
    size: float
    in_view: float = 0.0

    @property
    def score(self) -> float:
        """The product of the first six."""
        return self.closed * self.contrast * self.complete * self.smooth * self.exact * self.size

    @property
    def score_in_view(self) -> float:
        """The same of the part in view, however much the image's border cuts."""
        return self.in_view * self.smooth * self.exact * self.size


NONE = Rating(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""The rating of a silhouette that was not examined."""


class SilhouetteScorer:
    """Rates silhouettes by the edges of one image.

    Args:
        field: gradients, possibly of a reduced image.
        shrink: image px per px of the field.
        shape: height and width of the image.
    """

    def __init__(self, field: NormalizedGradient, shrink: int, shape: tuple[int, int]) -> None:
        soft = cv2.GaussianBlur(field.strength, (0, 0), 0.7)
        self._strength = np.asarray(cv2.dilate(soft, np.ones((3, 3), np.uint8)), dtype=np.float32)
        self._shrink, self._shape = shrink, shape

    def rate(self, shape: Silhouette, bridge: float = 0.0) -> Rating:
        """Rate a silhouette; `bridge` px is the widest gap that a closing bridged for it."""
        chain = shape.outer[:: max(1, len(shape.outer) // SAMPLES)]
        height, width = self._strength.shape
        column, row = np.minimum(chain // self._shrink, (width - 1, height - 1)).T
        strength = self._strength[row.clip(0), column.clip(0)]
        closed = float((strength > CLOSED).mean())
        contrast = float((np.minimum(strength, ENOUGH) - NOTHING).mean()) / (ENOUGH - NOTHING)
        length = cv2.arcLength(shape.outer.reshape(-1, 1, 2), True)
        around = cv2.arcLength(cv2.convexHull(shape.outer.reshape(-1, 1, 2)), True)
        compact = 4.0 * math.pi * shape.area / max(length, 1.0) ** 2
        high, wide = self._shape
        # a closing shrinks back from the border by its radius
        near = 0.5 * bridge + 2.0 * self._shrink
        sides = self._near_image_sides(chain, near, wide, high)
        outside = sides.any(axis=0)
        cut, shown = float(outside.mean()), strength[~outside]
        in_view = 0.0
        if len(shown):
            part = float((np.minimum(shown, ENOUGH) - NOTHING).mean()) / (ENOUGH - NOTHING)
            in_view = float((shown > CLOSED).mean()) * max(part, 0.0)
        return Rating(
            closed,
            max(contrast, 0.0),
            (1.0 - cut) ** 2 * TOUCHING ** int(sides.any(axis=1).sum()),
            math.sqrt(min(1.0, COMPACT * compact)),
            BRIDGED ** (bridge / (16.0 * self._shrink)),
            min(1.0, math.sqrt(around / (wide + high))),
            in_view,
        )

    @staticmethod
    def _near_image_sides(chain: NDArray[np.int32], near: float, wide: int, high: int) -> NDArray[np.bool_]:
        """(4, N) whether each pixel of the chain lies at each image side."""
        x, y = chain[:, 0], chain[:, 1]
        return np.stack([x <= near, y <= near, x >= wide - 1 - near, y >= high - 1 - near])
