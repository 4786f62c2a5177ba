# SPDX-License-Identifier: Apache-2.0
"""A tracker for a hand that comes nearer: its reference is taken anew while the part grows in the image.

From 2.5 times the distance an outline shows less than half of the detail that it shows in the end; what was not to be seen in the
reference would then speak against it. So the contacts, where the tracker believes them, become the given grasp of a new reference.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import GraspTrackError
from grasptrack.evaluation.approach.choosing import FRICTION
from grasptrack.projective import apply_homography
from grasptrack.result import TrackResult
from grasptrack.tracker import GraspTracker

Floats = NDArray[np.float64]

NEARER = 1.25
"""The contacts' distance in the image, as a multiple of that in the reference, from which on a new one is taken."""
SURE = 0.6
"""Least confidence of a result that becomes a reference."""
ALIKE = 0.03
"""Relative difference of area up to which the outline of the new reference is that of the old one, carried along."""
MOVED = 1.5
"""px, or this share of the contacts' distance in per cent, by which a contact may move onto the new outline."""


class Looking:
    """Follows one grasp, image by image, as `GraspTracker` does.

    Args:
        tracker: that has seen its first image and chosen a grasp.
        first: what it said.
        ignore: (H, W), where the hand is in the image.
    """

    def __init__(self, tracker: GraspTracker, first: TrackResult, ignore: NDArray[Any]) -> None:
        self._tracker, self._ignore = tracker, ignore
        self._base = np.eye(3)
        self._area = 0.0 if first.view is None else first.view.outer.area
        self._length = _length(first)
        self.renewed = 0

    def update(self, image: NDArray[Any], time: float) -> TrackResult:
        """What is seen now; homographies are those from the very first view."""
        result = self._tracker.update(image, time)
        if result.homography is None:
            return result
        H = result.homography @ self._base
        told = replace(result, homography=H / H[2, 2])
        if self._grown(result):
            self._renew(image, time, result)
        return told

    def _grown(self, result: TrackResult) -> bool:
        sure = result.status == "tracked" and result.confidence >= SURE
        seen = result.seen is not None and bool((result.seen > 0.5).all())
        return sure and seen and _length(result) > NEARER * self._length

    def _renew(self, image: NDArray[Any], time: float, result: TrackResult) -> None:
        assert result.homography is not None and result.contacts is not None
        try:
            tracker = GraspTracker(grasp=result.contacts, ignore=self._ignore, friction=FRICTION)
            found = tracker.update(image, time)
        except GraspTrackError:
            return
        if found.status != "tracked" or found.view is None or found.contacts is None or result.view is None:
            return
        off = float(np.hypot(*(found.contacts - result.contacts).T).max())
        expected = self._area * _growth(result.homography, result.contacts)
        same = abs(found.view.outer.area / expected - 1.0) < ALIKE
        if not same or off > max(MOVED, 0.01 * MOVED * _length(result)):
            return
        self._tracker, self._area, self._length = tracker, found.view.outer.area, _length(found)
        H = result.homography @ self._base
        self._base = H / H[2, 2]
        self.renewed += 1


def _length(result: TrackResult) -> float:
    assert result.contacts is not None
    return float(np.hypot(*(result.contacts[1] - result.contacts[0])))


def _growth(H: Floats, contacts: Floats) -> float:
    """By how much an area near the contacts has grown, by the homography that carried them there."""
    back = np.linalg.inv(H)
    middle = apply_homography(back, contacts.mean(axis=0, keepdims=True))[0]
    corners = middle + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    o, x, y = apply_homography(H, corners)
    return math.fabs(float((x - o)[0] * (y - o)[1] - (x - o)[1] * (y - o)[0]))
