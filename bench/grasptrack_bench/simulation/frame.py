# SPDX-License-Identifier: Apache-2.0
"""One frame of a scene: its image, and what is true of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.geometry.homographies import apply_homography
from grasptrack.typing import Floats
from grasptrack_bench.simulation.camera import Pinhole, RollingShutter
from grasptrack_bench.simulation.coverage import sample_outline
from grasptrack_bench.simulation.outlines import inside_polygons, polygon_moments

PINHOLE = Pinhole()
STEP = 1.0
"""px between the points at which an outline is asked whether it is seen."""


SEAM = 0.01
"""Table units."""


@dataclass(frozen=True)
class Hinge:
    """A part of two pieces round a rivet, as scissors: two opposite quadrants are the first, the others the second.

    Attributes:
        rivet: (x, y) table units, where the quadrants meet.
        axis: rad, the direction of one of the lines between them.
        angle: (F,) rad by which the second piece has turned about the rivet in each frame.
    """

    rivet: tuple[float, float]
    axis: float
    angle: Floats

    def holds(self, points: Floats) -> NDArray[np.bool_]:
        """(k,) which points (k, 2) of the part's plane lie on the second piece."""
        c, s = math.cos(self.axis), math.sin(self.axis)
        along, across = ((points - np.array(self.rivet)) @ np.array([[c, -s], [s, c]])).T
        return np.asarray(along * across < 0.0, dtype=np.bool_)

    def pieces(self, reach: float) -> tuple[list[Floats], list[Floats]]:
        """Squares (4, 2) of the part's plane over the quadrants of the first and of the second piece, `reach` wide.

        Those of the second reach a little below the first, so that no seam lets the table through.
        """
        c, s = reach * math.cos(self.axis), reach * math.sin(self.axis)
        out = np.array([[c, s], [-s, c], [-c, -s], [s, -c]])
        corners = [np.array([0.0 * a, a, a + b, b]) + self.rivet for a, b in zip(out, np.roll(out, -1, 0), strict=True)]
        return corners[::2], [ring + SEAM * (ring[0] - ring[2]) / reach for ring in corners[1::2]]

    def turn(self, time: float) -> Floats:
        """(3, 3) motion of the second piece in the part's plane at a time in frames."""
        angle = float(np.interp(time, np.arange(len(self.angle)), self.angle))
        c, s = math.cos(angle), math.sin(angle)
        x, y = self.rivet
        return np.array([[c, -s, x - c * x + s * y], [s, c, y - s * x - c * y], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class SceneFrame:
    """One image and what is true of it.

    Attributes:
        index: from 0.
        time: s.
        image: (height, width) or (height, width, 3) 8 bit.
        name: for messages.
        H_current_reference: (3, 3) pixels of frame 0 to pixels of this frame, of the plane in which the contacts lie;
            exact. Where the lens distorts, pixels of the ideal image; where rows are exposed one after another, at the
            time of the middle row: see `carry`.
        outline: polygons in px of the image, outer first, where the tracked object is, seen or not. Empty when it is
            not on the table.
        covers: polygons in px of the image of what hides the part: what lies in front, and saturated glare.
        present: the tracked object itself is on the table; not while it is exchanged for another or taken away.
        camera: its intrinsics, with the lens.
        shutters: of a rolling shutter, from the plane of the contacts to frame 0 and to this frame; None where all rows
            are exposed at once.
        swing: of a hinged part: its hinge, (3, 3) ideal px of frame 0 to the part's plane, and (3, 3) to ideal px of this
            frame, of the second piece; None of a rigid part.
    """

    index: int
    time: float | None
    image: NDArray[np.uint8]
    name: str
    H_current_reference: Floats
    outline: tuple[Floats, ...]
    covers: tuple[Floats, ...] = ()
    present: bool = True
    camera: Pinhole = PINHOLE
    shutters: tuple[RollingShutter, RollingShutter] | None = None
    swing: tuple[Hinge, Floats, Floats] | None = None

    def carry(self, points: ArrayLike) -> Floats:
        """(k, 2) px of this frame, of points (k, 2) px of frame 0 in the plane of the contacts; exact.

        Under a rolling shutter both are where the image shows the point: at the time of its own row.
        """
        if self.shutters is not None:
            return self._map_rolling_points(*self.shutters, points)
        moved = self._map_points(self.H_current_reference, points)
        if self.swing is None:
            return moved
        return np.where(self._on_second(points), self._map_points(self.swing[2], points), moved)

    def back(self, points: ArrayLike) -> Floats:
        """(k, 2) px of frame 0, of points (k, 2) px of this frame: the inverse of `carry`.

        Where the pieces of a hinged part lie over each other, of the upper one.
        """
        if self.shutters is not None:
            return self._map_rolling_points(*self.shutters[::-1], points)
        rest = self._map_points(np.asarray(np.linalg.inv(self.H_current_reference), dtype=np.float64), points)
        if self.swing is None:
            return rest
        there = self._map_points(np.asarray(np.linalg.inv(self.swing[2]), dtype=np.float64), points)
        return np.where(self._on_second(rest), there, rest)

    def _on_second(self, points: ArrayLike) -> NDArray[np.bool_]:
        """(k, 1) which points (k, 2) px of frame 0 lie on the second piece of a hinged part."""
        assert self.swing is not None
        hinge, to_plane, _ = self.swing
        return hinge.holds(apply_homography(to_plane, self.camera.undistort(points)))[:, None]

    def _map_points(self, H: Floats, points: ArrayLike) -> Floats:
        if not self.camera.distorted:
            return apply_homography(H, points)
        return self.camera.distort(apply_homography(H, self.camera.undistort(points)))

    def _map_rolling_points(self, seen: RollingShutter, shown: RollingShutter, points: ArrayLike) -> Floats:
        px = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        return shown.project(seen.back(px, self.camera), self.camera)

    def visible(self, points: ArrayLike) -> NDArray[np.bool_]:
        """(k,) which points (k, 2) px of this frame can be seen: in the image, not covered, and the object present."""
        pts = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        height, width = self.image.shape[:2]
        seen = np.all((pts >= 0.0) & (pts <= np.array([width - 1, height - 1])), axis=1)
        for cover in self.covers:
            seen &= ~inside_polygons([cover], pts)
        return np.asarray(seen & self.present, dtype=np.bool_)

    @property
    def outline_visible(self) -> float:
        """Share of the outline's length that is in view and uncovered, 0 to 1; 0 when the object is not present."""
        if not self.present or not self.outline:
            return 0.0
        points, weights = sample_outline(self.outline, STEP)
        return float(weights[self.visible(points)].sum() / weights.sum())

    @property
    def area(self) -> float:
        """Area of the object's image in px^2, holes subtracted; 0 when it is not present."""
        return float(sum(polygon_moments(polygon)[0] for polygon in self.outline))
