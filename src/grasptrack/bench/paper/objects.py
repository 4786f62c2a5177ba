# SPDX-License-Identifier: Apache-2.0
"""Three objects, a grasp on each, and the predefined trajectories on which Section V is rerun."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from grasptrack import kernels
from grasptrack.bench.simulation import SHAPES, Camera, Path, Shape, similarity_path, tilting_path
from grasptrack.errors import ObservationError
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.synthesis import synthesize
from grasptrack.tracking.initialization import count_describing_strategies
from grasptrack.typing import Floats

Motion = Literal["4 DoF", "6 DoF"]
MOTIONS: tuple[Motion, ...] = ("4 DoF", "6 DoF")

OBJECTS = ("bracket", "spanner", "notched-plate")
"""A bracket, a tool and a plate: distinct axes, at least four corners, no symmetry."""
POINTS = 300
"""Of an outer contour, as in Section V."""
LEAST_POINTS = 24
"""Of a hole's contour."""
FRAMES = 100
"""Of the whole trajectory; a shorter run is its beginning, so that the motion between frames is the same."""
DISTANCE = 5.4
"""Camera to table in roots of the object's area: the root of the area is then some 130 px."""
TILT = math.radians(20.0)
"""Largest tilt of the trajectory of 6 DoF."""


@dataclass(frozen=True)
class Part:
    """One object in the first view of a trajectory.

    Attributes:
        name: of its shape.
        shape: its polygons.
        reference: contours of about `POINTS` points in the first view, px.
        contacts: (2, 2) px, the best grasp that all strategies can describe.
    """

    name: str
    shape: Shape
    reference: View
    contacts: Floats

    @property
    def opening(self) -> float:
        """px in the first view."""
        return float(np.hypot(*(self.contacts[1] - self.contacts[0])))


def camera_trajectory(motion: Motion, frames: int, seed: int) -> Path:
    """The path of the camera. Both motions share the first frame, which is frontal.

    Args:
        motion: "4 DoF" (the image moves by similarities) or "6 DoF" (the camera tilts as well).
        frames: the first so many frames of the path.
        seed: of the path.
    """
    whole = max(frames, FRAMES)
    turn, zoom, reach = math.radians(60.0), 0.12, 0.2
    if motion == "4 DoF":
        path = similarity_path(whole, distance=DISTANCE, reach=reach, zoom=zoom, turn=turn, seed=seed)
    else:
        path = tilting_path(whole, tilt=TILT, distance=DISTANCE, reach=reach, zoom=zoom, turn=turn, seed=seed)
    cut = {name: getattr(path, name)[:frames] for name in ("target", "distance", "roll", "tilt", "azimuth")}
    return replace(path, **cut)


def path_homographies(path: Path) -> Floats:
    """(F, 3, 3) H_current_reference of each frame, the reference being the first."""
    to_image = path.table_to_image(Camera())
    moved = to_image @ np.linalg.inv(to_image[0])
    return np.asarray(moved / moved[:, 2:, 2:], dtype=np.float64)


def sample_view(polygons: tuple[Floats, ...]) -> View:
    """Outer contour of `POINTS` points and holes as dense, equal steps along closed polygons (N, 2) px."""
    lengths = [float(kernels.arc_length(p)[-1]) for p in polygons]
    counts = [max(LEAST_POINTS, round(POINTS * length / lengths[0])) for length in lengths]
    counts[0] = POINTS
    rings = [kernels.resample(p, count, 0.0) for p, count in zip(polygons, counts, strict=True)]
    return View([Contour(ring, hole=i > 0) for i, ring in enumerate(rings)])


def make_part(name: str, seed: int) -> Part:
    """An object and its grasp in the first view of the trajectories.

    Raises:
        ObservationError: no stable grasp that all strategies can describe.
    """
    shape = SHAPES[name]()
    to_image = camera_trajectory("4 DoF", 1, seed).table_to_image(Camera())[0]
    reference = sample_view(tuple(np.ascontiguousarray(apply_homography(to_image, p)) for p in shape.polygons))
    for grasp in synthesize(reference, top=10):
        if count_describing_strategies(grasp, reference) == 2:
            return Part(name, shape, reference, grasp.contacts)
    raise ObservationError(f"no grasp on the {name} that every strategy can describe")
