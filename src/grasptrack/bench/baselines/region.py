# SPDX-License-Identifier: Apache-2.0
"""Which pixels of the first image a peer looks at: what a user would draw round the part."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from grasptrack.bench.method import Start
from grasptrack.errors import ObservationError
from grasptrack.geometry.contours import View
from grasptrack.segmentation.images import Grey
from grasptrack.segmentation.objects import find_objects
from grasptrack.typing import Floats


class Region(NamedTuple):
    """The part in the first image.

    Attributes:
        mask: (H, W) uint8, 255 on the part, holes left out.
        outer: (N, 2) px, its outer polygon.
    """

    mask: Grey
    outer: Floats

    def grown(self, margin: int) -> Grey:
        """(H, W) uint8, 255 on the part and up to `margin` px round it."""
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * margin + 1, 2 * margin + 1))
        return np.asarray(cv2.dilate(self.mask, disc), dtype=np.uint8)

    def box(self, margin: int) -> tuple[int, int, int, int]:
        """x, y, width and height of the part and `margin` px round it, cut to the image."""
        x, y, width, height = cv2.boundingRect(self.mask)
        left, top = max(0, x - margin), max(0, y - margin)
        right = min(self.mask.shape[1], x + width + margin)
        bottom = min(self.mask.shape[0], y + height + margin)
        return left, top, right - left, bottom - top

    @property
    def corners(self) -> Floats:
        """(4, 2) px, the corners of the part's bounding box."""
        (x0, y0), (x1, y1) = self.outer.min(axis=0), self.outer.max(axis=0)
        return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def region_of(start: Start, image: Grey) -> Region:
    """The part as the start tells it, else as the product's own segmentation finds it at the contacts, else a box.

    Args:
        start: what is known of the first image.
        image: (H, W), the first image.
    """
    polygons = start.outline
    if not polygons:
        view = view_at(image, start.contacts)
        polygons = (_box_round(start.contacts),) if view is None else tuple(c.points for c in view.contours)
    mask = np.zeros(image.shape, np.uint8)
    cv2.fillPoly(mask, [np.rint(16.0 * p).astype(np.int32) for p in polygons], (255,), shift=4)
    if not mask.any():
        raise ObservationError("the part is not in the first image")
    return Region(mask, np.asarray(polygons[0], dtype=np.float64))


def view_at(image: Grey, contacts: Floats) -> View | None:
    """The object in an image whose outline is nearest to some contacts (k, 2) px; None where no object stands out."""
    try:
        found = [candidate.view for candidate in find_objects(image)]
    except ObservationError:
        return None
    return min(found, key=lambda view: farthest_contact_distance(view.points, contacts))


def farthest_contact_distance(points: Floats, contacts: Floats) -> float:
    """px from that of the contacts (k, 2) which is farthest from some points (N, 2) to the nearest of them."""
    return float(np.hypot(*(points[:, None] - contacts[None]).T).min(axis=1).max())


def _box_round(contacts: Floats) -> Floats:
    """(4, 2) px: a square round the contacts, half as large again as what they span."""
    middle = contacts.mean(axis=0)
    half = max(16.0, 0.75 * float(np.ptp(contacts, axis=0).max()))
    return np.asarray(middle + half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]))
