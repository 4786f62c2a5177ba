# SPDX-License-Identifier: Apache-2.0
"""What all peers share: the first image is where the grasp and the part are, everything that fails is a loss with a reason."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.errors import GraspTrackError, ObservationError
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography, judge_distortion, normalize_homography
from grasptrack.images import Grey, to_grey
from grasptrack.segmentation.first_look import find_objects
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats
from grasptrack_bench.method import MethodStart


class PartRegion(NamedTuple):
    """The part in the first image: (H, W) 255 on it, holes left out, and its outer polygon (N, 2) px."""

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


def region_of(start: MethodStart, image: Grey) -> PartRegion:
    """The part as the start tells it, else as the product's own segmentation finds it at the contacts, else a box."""
    polygons = start.outline
    if not polygons:
        view = view_at(image, start.contacts)
        polygons = (_box_round(start.contacts),) if view is None else tuple(c.points for c in view.contours)
    mask = np.zeros(image.shape, np.uint8)
    cv2.fillPoly(mask, [np.rint(16.0 * p).astype(np.int32) for p in polygons], (255,), shift=4)
    if not mask.any():
        raise ObservationError("the part is not in the first image")
    return PartRegion(mask, np.asarray(polygons[0], dtype=np.float64))


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


class LostError(GraspTrackError):
    """A peer has no answer in this image; the message is the reason."""


class BaselineAnswer(NamedTuple):
    """A peer's answer: contacts (k, 2) px, H_current_reference (3, 3) or None, and its confidence, NaN where there is none."""

    contacts: Floats
    homography: Floats | None
    confidence: float


class Peer(ABC):
    """A method that is given the grasp in the first image; subclasses say how it begins and how it follows."""

    name: ClassVar[str]
    failures: ClassVar[tuple[type[Exception], ...]] = (GraspTrackError, cv2.error, np.linalg.LinAlgError)
    """What its library raises when an image defeats it."""

    def __init__(self, start: MethodStart) -> None:
        self.start = start
        self.contacts = np.array(start.contacts, dtype=np.float64)
        self._frame = -1
        self._begun = ""  # why it could not begin

    @abstractmethod
    def begin(self, image: Grey) -> None:
        """Learn what is needed from the first image (H, W).

        Raises:
            LostError: nothing to follow in it.
        """

    @abstractmethod
    def follow(self, image: Grey) -> BaselineAnswer:
        """The grasp in a later image (H, W).

        Raises:
            LostError: with the reason.
        """

    def update(self, image: NDArray[Any], time: float | None) -> TrackResult:
        """See `grasptrack_bench.method:Method`."""
        self._frame += 1
        cv2.setRNGSeed(self._frame)  # some of OpenCV draws from a generator that all of a process share
        try:
            found = self._look(image)
        except self.failures as error:
            reason = _one_line(error)
            if self._frame == 0:
                self._begun = reason
            return TrackResult(self._frame, time, "lost", reason, grasp_id=1)
        return TrackResult(
            self._frame,
            time,
            "tracked",
            "",
            self.name,
            1,
            contacts=found.contacts,
            confidence=found.confidence,
            homography=found.homography,
        )

    def _look(self, image: NDArray[Any]) -> BaselineAnswer:
        grey = to_grey(image)
        if self._frame == 0:
            self.begin(grey)
            return BaselineAnswer(self.contacts, np.eye(3), 1.0)
        if self._begun:
            raise LostError(f"it could not begin: {self._begun}")
        return self.follow(grey)

    def moved(self, H: Floats | None, region: Floats, confidence: float) -> BaselineAnswer:
        """The contacts carried by a homography, if any view of a flat object could give it.

        Args:
            H: (3, 3) H_current_reference, or None where a fit gave none.
            region: (N, 2) px, points that span the object in the first image.
            confidence: of the answer.

        Raises:
            LostError: no homography.
            ConditioningError: one that is not plausible.
        """
        if H is None:
            raise LostError("no homography fits")
        H = np.asarray(H, dtype=np.float64)
        judge_distortion(H, *kernels.distortion(H, region))
        return BaselineAnswer(apply_homography(H, self.contacts), normalize_homography(H), confidence)


def _one_line(error: Exception) -> str:
    """The message of an error, whatever library it is from, as one sentence."""
    text = " ".join(str(getattr(error, "err", "") or error).split())
    return text or type(error).__name__


NO_CONFIDENCE = math.nan
"""Of a method that has no measure of its own."""
