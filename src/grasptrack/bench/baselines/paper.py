# SPDX-License-Identifier: Apache-2.0
"""The paper's three methods as they stand: a plain outline, a transfer, and whatever comes out is the answer.

No evidence is asked of the image, no verdict passed: only a view that a transfer cannot work on is a loss.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from grasptrack.bench.baselines.base import NO_CONFIDENCE, Found, LostError, Peer
from grasptrack.bench.baselines.silhouette import OtsuSilhouettes
from grasptrack.bench.method import Start
from grasptrack.errors import TransferError
from grasptrack.geometry.contours import Contour, View
from grasptrack.grasp.contacts import Grasp
from grasptrack.segmentation.images import Grey
from grasptrack.segmentation.silhouettes import Silhouette
from grasptrack.snake.active_contour import Snake
from grasptrack.transfer import TransferStrategy, rrp, strategy_named
from grasptrack.typing import Floats


class PaperTransfer(Peer):
    """Grasp line and homography between the Otsu silhouettes of the first image and of each other (Section IV-B, C).

    The outlines are the chains of pixels. Where the border cuts them nothing is said of it: the paper has no such test.
    The search of eq. (3) is round the last frame's correspondence, and after a loss round that of the lengths.
    """

    strategy: ClassVar[str]

    def __init__(self, start: Start) -> None:
        super().__init__(start)
        self._find = OtsuSilhouettes(self.contacts)
        self._strategy: TransferStrategy = strategy_named(self.strategy)
        self._last: Floats | None = np.eye(3)

    def begin(self, image: Grey) -> None:
        """See Peer."""
        view = outline_of(self._find(image))
        self._description: Any = self._strategy.describe(Grasp(self.contacts), view)

    def follow(self, image: Grey) -> Found:
        """See Peer."""
        view = outline_of(self._find(image))
        last, self._last = self._last, None
        carried = self._strategy.apply(self._description, view, last)
        self._last = carried.homography
        return Found(carried.grasp.contacts, carried.homography, NO_CONFIDENCE)


class PaperGraspLine(PaperTransfer):
    """Grasp-line coordinates; the last frame tells the two directions of I_min apart."""

    name: ClassVar[str] = "paper-grasp-line"
    strategy: ClassVar[str] = "grasp-line"


class PaperHomography(PaperTransfer):
    """Homography from four peaks of curvature."""

    name: ClassVar[str] = "paper-homography"
    strategy: ClassVar[str] = "homography"


class PaperRRP(Peer):
    """RRP coordinates on a B-spline snake of 4 DoF (Section IV-A), which is laid round the part in the first image.

    The snake is that of this library with its judgement of itself passed over: its curve is the answer wherever it found
    an edge at all.
    """

    name: ClassVar[str] = "paper-rrp"

    def begin(self, image: Grey) -> None:
        """See Peer."""
        polygons = self.start.outline
        view = outline_of(OtsuSilhouettes(self.contacts)(image)) if not polygons else view_of(polygons)
        self._snake = Snake(view, image, "similarity", contacts=self.contacts)
        self._description = rrp.describe(Grasp(self.contacts), self._snake.template)

    def follow(self, image: Grey) -> Found:
        """See Peer."""
        self._snake.predict()
        fit = self._snake.update(image)
        if not np.isfinite(fit.residual):
            raise LostError("no edge near the predicted outline")
        moved = rrp.apply(self._description, self._snake.view(fit)).grasp
        return Found(moved.contacts, fit.homography, NO_CONFIDENCE)


def outline_of(shape: Silhouette) -> View:
    """The chains of pixels of a silhouette as outlines.

    Raises:
        TransferError: too few pixels.
    """
    if len(shape.outer) < 16:
        raise TransferError("the silhouette is a speck")
    return View([Contour(shape.outer), *(Contour(chain, hole=True) for chain in shape.holes if len(chain) >= 16)])


def view_of(polygons: tuple[Floats, ...]) -> View:
    """Polygons (N, 2) px, outer first, as outlines with a point at about every px."""
    return View([Contour(_densify_polygon(p), hole=i > 0) for i, p in enumerate(polygons)])


def _densify_polygon(polygon: Floats) -> Floats:
    """(M, 2) points along a polygon, its vertices among them."""
    ends = np.roll(polygon, -1, axis=0)
    counts = np.maximum(1, np.ceil(np.hypot(*(ends - polygon).T)).astype(int))
    pieces = [a + (b - a) * (np.arange(n) / n)[:, None] for a, b, n in zip(polygon, ends, counts, strict=True)]
    return np.concatenate(pieces)
