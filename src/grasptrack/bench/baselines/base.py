# SPDX-License-Identifier: Apache-2.0
"""What all peers share: the first image is where the grasp is, everything that fails is a loss with a reason."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.method import Start
from grasptrack.errors import GraspTrackError
from grasptrack.geometry.homographies import apply_homography, check_plausible, normalize_homography
from grasptrack.segmentation.images import Grey, to_grey
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats


class LostError(GraspTrackError):
    """A peer has no answer in this image; the message is the reason."""


class Found(NamedTuple):
    """A peer's answer.

    Attributes:
        contacts: (k, 2) px.
        homography: (3, 3) H_current_reference, or None.
        confidence: NaN where there is none.
    """

    contacts: Floats
    homography: Floats | None
    confidence: float


class Peer(ABC):
    """A method that is given the grasp in the first image; subclasses say how it begins and how it follows.

    Args:
        start: what is known of the first image.
    """

    name: ClassVar[str]
    failures: ClassVar[tuple[type[Exception], ...]] = (GraspTrackError, cv2.error, np.linalg.LinAlgError)
    """What its library raises when an image defeats it."""

    def __init__(self, start: Start) -> None:
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
    def follow(self, image: Grey) -> Found:
        """The grasp in a later image (H, W).

        Raises:
            LostError: with the reason.
        """

    def update(self, image: NDArray[Any], time: float | None) -> TrackResult:
        """See `grasptrack.bench.method:Method`."""
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

    def _look(self, image: NDArray[Any]) -> Found:
        grey = to_grey(image)
        if self._frame == 0:
            self.begin(grey)
            return Found(self.contacts, np.eye(3), 1.0)
        if self._begun:
            raise LostError(f"it could not begin: {self._begun}")
        return self.follow(grey)

    def moved(self, H: Floats | None, region: Floats, confidence: float) -> Found:
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
        check_plausible(H, region)
        return Found(apply_homography(H, self.contacts), normalize_homography(H), confidence)


def _one_line(error: Exception) -> str:
    """The message of an error, whatever library it is from, as one sentence."""
    text = " ".join(str(getattr(error, "err", "") or error).split())
    return text or type(error).__name__


NO_CONFIDENCE = math.nan
"""Of a method that has no measure of its own."""
