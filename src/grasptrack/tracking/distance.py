# SPDX-License-Identifier: Apache-2.0
"""How far the object is, where the user says how long it is."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.plane import Mode, Plane
from grasptrack.tracking.target import Target
from grasptrack.typing import Floats

ENDS = 0.25
"""Of an edge's width, a standard deviation as well, by which each end of the object is off: blur rounds what is pointed."""


class Distance(NamedTuple):
    """From the camera to the object, and its standard deviation, in the unit in which its length was told."""

    value: float
    sd: float


UNKNOWN = Distance(math.nan, math.nan)
"""Where nobody said how long the object is."""


class _Explained(NamedTuple):
    """For each theta that stands for what the views leave open.

    Attributes:
        weights: (m,), which add up to 1.
        back: (m, 3, 3) px of a view to rays.
        in_view: (m, 3, 3) px of the plane to px of the first view.
        unit: (m,) of a px of the plane, in the user's unit.
        focal: (m,) variance of the focal length's log about it.
    """

    weights: Floats
    back: Floats
    in_view: Floats
    unit: Floats
    focal: Floats


def make_ruler(target: Target, plane: Plane, length: float) -> Ruler | None:
    """What tells how far a target of this length is; None where it is cut off in the first view."""
    if target.view.is_clipped:
        return None
    ends = ENDS * target.edge_width * float(target.A[0, 0])
    return Ruler(plane, target.contacts.mean(axis=0), ends, length)


class Ruler:
    """Tells how far the object's plane is from the camera.

    Args:
        plane: as the views so far let it be known.
        middle: (2,) px of the first view, to which the distance is told.
        ends: px of the first view, standard deviation by which each end of the object is off.
        length: of the object in any unit: the longer side of the smallest rectangle round its outline, as a caliper measures
            it.
    """

    def __init__(self, plane: Plane, middle: Floats, ends: float, length: float) -> None:
        self._plane, self._middle, self._ends, self._length = plane, middle, ends, length
        self._modes: tuple[Mode, ...] = ()

    def distance(self, homography: Floats, covariance: Floats) -> Distance:
        """In a view: along the line of sight.

        Args:
            homography: (3, 3) H_current_reference.
            covariance: (9, 9) of its entries, row by row.
        """
        if self._modes is not self._plane.modes:
            self._modes, self._all = self._plane.modes, self._sample_modes()
        weights, back, in_view, unit, focal = self._all
        ray = np.array([*self._middle, 1.0])
        told = self._line_of_sight_distances(back, homography, in_view, unit, ray)
        mean = float(weights @ told)
        # a camera that is nearer by its focal length shows the same but for perspective: distances go with it
        variance = float(weights @ ((told - mean) ** 2 + focal * told**2))
        moved = self._line_of_sight_distances(back[:1], homography + self._plane.entries, in_view[:1], unit[:1], ray)
        by_entry = (moved - told[0]) / self._plane.steps
        variance += float(by_entry @ covariance @ by_entry) + (mean * self._off) ** 2
        return Distance(mean, math.sqrt(variance))

    @staticmethod
    def _line_of_sight_distances(
        back: Floats, homography: Floats, in_view: Floats, unit: Floats, middle: Floats
    ) -> Floats:
        """(m,) distances along the line of sight to the middle, a (3,) place of the first view."""
        seen = back @ homography
        axes = seen @ in_view
        # of what lies at (u, v) of the plane, u and v such that it is the middle
        at = np.linalg.solve(in_view, np.broadcast_to(middle, (len(in_view), 3))[..., None])
        ray = (axes @ (at / at[:, 2:]))[..., 0]
        lengths = np.linalg.norm(axes[:, :, :2], axis=1)
        return np.asarray(unit * np.linalg.norm(ray, axis=1) / np.sqrt(lengths[:, 0] * lengths[:, 1]))

    def _sample_modes(self) -> _Explained:
        """By the plane as it is known now."""
        plane = self._plane
        thetas, weights, focal = plane.open
        in_view = np.array([plane.in_view(theta) for theta in thetas])
        extents = np.array([outline_extent(apply_homography(np.linalg.inv(H), plane.hull)) for H in in_view])
        back = np.array([plane.rays(theta) for theta in thetas])
        self._off = math.sqrt(2.0) * self._ends / float(extents[0])
        return _Explained(weights, back, in_view, self._length / extents, focal)


def outline_extent(outline: Floats) -> float:
    """The longer side of the smallest rectangle round points (n, 2), in their unit."""
    about = outline - outline.mean(axis=0)  # it counts in single precision
    return float(max(cv2.minAreaRect(np.ascontiguousarray(about, dtype=np.float32))[1]))
