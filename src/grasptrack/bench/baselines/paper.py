# SPDX-License-Identifier: Apache-2.0
"""Otsu's silhouettes with the motion that their moments tell, and the paper's three methods as they stand.

No evidence is asked of the image, no verdict passed: whatever comes out of a transfer is the answer, and only a view that it
cannot work on is a loss.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, NamedTuple

import cv2
import numpy as np

from grasptrack.bench.baselines.base import NO_CONFIDENCE, Found, LostError, Peer, farthest_contact_distance
from grasptrack.bench.method import Start
from grasptrack.errors import TransferError
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import similarity_transform
from grasptrack.grasp.contacts import Grasp
from grasptrack.segmentation.images import Grey
from grasptrack.segmentation.silhouettes import Silhouette, trace_silhouettes
from grasptrack.snake.active_contour import Snake
from grasptrack.transfer import TransferStrategy, rrp, strategy_named
from grasptrack.typing import Floats

LEAST = 2e-4
"""Smallest silhouette as a share of the image."""


class Place(NamedTuple):
    """Where a silhouette is: centroid (2,) px, area px^2, angle rad of the axis of least inertia, modulo pi."""

    centre: Floats
    area: float
    angle: float


class OtsuSilhouettes:
    """Finds one silhouette in every image: in the first the one that has the contacts, then that most like the last.

    Whether the part is darker or lighter than the ground is settled in the first image, as a user would. There is no
    test: if the part is gone, something else is the most like it.

    Args:
        contacts: (k, 2) px in the first image.
    """

    def __init__(self, contacts: Floats) -> None:
        self._contacts = contacts
        self._dark = True
        self._last: Place | None = None

    def __call__(self, image: Grey) -> Silhouette:
        """The silhouette in the next image.

        Raises:
            LostError: there is none.
        """
        if self._last is None:
            both = [(shape, dark) for dark in (True, False) for shape in _otsu_silhouettes(image, dark)]
            if not both:
                raise LostError("the threshold leaves no silhouette")
            shape, self._dark = min(
                both, key=lambda pair: farthest_contact_distance(pair[0].outer.astype(np.float64), self._contacts)
            )
        else:
            found, last = _otsu_silhouettes(image, self._dark), self._last
            if not found:
                raise LostError("the threshold leaves no silhouette")
            shape = min(found, key=lambda s: _silhouette_distance(place_of(s), last))
        self._last = place_of(shape)
        return shape


def _otsu_silhouettes(image: Grey, dark: bool) -> list[Silhouette]:
    kind = cv2.THRESH_BINARY_INV if dark else cv2.THRESH_BINARY
    smooth = cv2.GaussianBlur(image, (5, 5), 0)
    _, binary = cv2.threshold(smooth, 0, 255, kind + cv2.THRESH_OTSU)
    return trace_silhouettes(np.asarray(binary, dtype=np.uint8), LEAST * image.size)


def place_of(shape: Silhouette) -> Place:
    """Centroid, area and axis of a silhouette, its holes filled."""
    m = cv2.moments(shape.outer.reshape(-1, 1, 2))
    centre = np.array([m["m10"], m["m01"]]) / m["m00"]
    return Place(centre, float(m["m00"]), 0.5 * math.atan2(2.0 * m["mu11"], m["mu20"] - m["mu02"]))


def _silhouette_distance(one: Place, other: Place) -> float:
    """How far two silhouettes are apart: their distance in sqrt(area), and the logarithm of the ratio of their areas."""
    apart = math.hypot(*(one.centre - other.centre).tolist()) / math.sqrt(other.area)
    return apart + abs(math.log(one.area / other.area))


class Otsu(Peer):
    """Otsu silhouette; centroid, area and the axis of least inertia of its outline give a similarity.

    The axis has no direction: the turn nearest to that of the frame before is taken.
    """

    name: ClassVar[str] = "otsu"

    def __init__(self, start: Start) -> None:
        super().__init__(start)
        self._find = OtsuSilhouettes(self.contacts)
        self._angle = 0.0

    def begin(self, image: Grey) -> None:
        """See Peer."""
        self._first = place_of(self._find(image))
        self._angle = self._first.angle

    def follow(self, image: Grey) -> Found:
        """See Peer."""
        now, first = place_of(self._find(image)), self._first
        self._angle = now.angle + math.pi * round((self._angle - now.angle) / math.pi)
        scale, turn = math.sqrt(now.area / first.area), self._angle - first.angle
        x, y = first.centre.tolist()
        u, v = now.centre.tolist()
        return self.moved(similarity_transform(scale, turn, (x, y), (u, v)), self.contacts, NO_CONFIDENCE)


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
    return View(
        [
            Contour.trusted(shape.outer),
            *(Contour.trusted(chain, hole=True) for chain in shape.holes if len(chain) >= 16),
        ]
    )


def view_of(polygons: tuple[Floats, ...]) -> View:
    """Polygons (N, 2) px, outer first, as outlines with a point at about every px."""
    return View([Contour(_densify_polygon(p), hole=i > 0) for i, p in enumerate(polygons)])


def _densify_polygon(polygon: Floats) -> Floats:
    """(M, 2) points along a polygon, its vertices among them."""
    ends = np.roll(polygon, -1, axis=0)
    counts = np.maximum(1, np.ceil(np.hypot(*(ends - polygon).T)).astype(int))
    pieces = [a + (b - a) * (np.arange(n) / n)[:, None] for a, b, n in zip(polygon, ends, counts, strict=True)]
    return np.concatenate(pieces)
