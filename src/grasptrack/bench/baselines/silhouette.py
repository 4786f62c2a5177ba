# SPDX-License-Identifier: Apache-2.0
"""The plainest silhouette there is, Otsu's threshold, and the motion that its moments tell."""

from __future__ import annotations

import math
from typing import ClassVar, NamedTuple

import cv2
import numpy as np

from grasptrack.bench.baselines.base import NO_CONFIDENCE, Found, LostError, Peer
from grasptrack.bench.baselines.region import farthest_contact_distance
from grasptrack.bench.method import Start
from grasptrack.geometry.homographies import similarity_transform
from grasptrack.segmentation.images import Grey
from grasptrack.segmentation.silhouettes import Silhouette, trace_silhouettes
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
