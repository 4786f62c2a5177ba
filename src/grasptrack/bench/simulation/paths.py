# SPDX-License-Identifier: Apache-2.0
"""Where the camera is, frame by frame, and smooth paths for it. The tracker never learns any of these numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grasptrack.bench.simulation.camera import Camera
from grasptrack.geometry.homographies import rotation_about_z
from grasptrack.typing import Floats


@dataclass(frozen=True)
class Path:
    """Where the camera is in each frame: it looks at a point of the table from a distance, rolled and tilted.

    Attributes:
        target: (F, 2) the point of the table that the optical axis meets, in table units.
        distance: (F,) from the camera's centre to it, in table units.
        roll: (F,) rad, about the optical axis.
        tilt: (F,) rad, between the optical axis and the table's normal; 0 is frontal.
        azimuth: (F,) rad, the direction in the table of the axis that the camera tilts about.
    """

    target: Floats
    distance: Floats
    roll: Floats
    tilt: Floats
    azimuth: Floats

    def __len__(self) -> int:
        """Frames."""
        return len(self.distance)

    def pose(self, index: int) -> Path:
        """The path of one frame that stays at that pose."""
        k = slice(index, index + 1)
        return Path(self.target[k], self.distance[k], self.roll[k], self.tilt[k], self.azimuth[k])

    def table_to_image(self, camera: Camera, height: float = 0.0) -> Floats:
        """(F, 3, 3) homographies from table coordinates to ideal pixels, the last element of each 1.

        Args:
            camera: its intrinsics; distortion comes after, by `Camera.distort`.
            height: table units above the table of the plane that is seen.
        """
        homographies = np.empty((len(self), 3, 3))
        for i in range(len(self)):
            rotation = rotation_about_z(self.roll[i]) @ _about_axis(self.azimuth[i], self.tilt[i])
            shift = np.array([0.0, 0.0, self.distance[i]]) - rotation[:, :2] @ self.target[i]
            if height != 0.0:
                shift = shift - height * rotation[:, 2]  # the table's normal points away from the camera
            H = camera.matrix @ np.column_stack([rotation[:, :2], shift])
            homographies[i] = H / H[2, 2]
        return homographies

    def between(self, index: int, offsets: ArrayLike) -> Path:
        """The poses at `index` + offsets (K,) frames, on the cubic through the four poses around; 0 is the pose itself."""
        lean = self.tilt[:, None] * np.column_stack([np.cos(self.azimuth), np.sin(self.azimuth)])
        known = np.column_stack([self.target, self.distance, self.roll, lean])
        last = len(known) - 1
        k = index + np.arange(-2, 3)
        poses = known[np.clip(k, 0, last)]
        if last > 0:  # beyond its ends the path goes on evenly
            poses += np.minimum(k, 0)[:, None] * (known[1] - known[0])
            poses += np.maximum(k - last, 0)[:, None] * (known[last] - known[last - 1])
        u = np.asarray(offsets, dtype=np.float64)[:, None]
        v, side = np.abs(u), np.where(u < 0.0, -1, 1)[:, 0]
        a, b, before, beyond = poses[2], poses[2 + side], poses[2 - side], poses[2 + 2 * side]
        m, n = 0.5 * (b - before), 0.5 * (beyond - a)  # slopes of Catmull and Rom
        at = a + m * v + (3 * (b - a) - 2 * m - n) * v**2 + (2 * (a - b) + m + n) * v**3
        return Path(at[:, :2], at[:, 2], at[:, 3], np.hypot(at[:, 4], at[:, 5]), np.arctan2(at[:, 5], at[:, 4]))


def _about_axis(azimuth: float, angle: float) -> Floats:
    """Rotation by `angle` about the axis (cos azimuth, sin azimuth, 0)."""
    turn = rotation_about_z(azimuth)
    c, s = math.cos(angle), math.sin(angle)
    lean = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return np.asarray(turn @ lean @ turn.T, dtype=np.float64)


def _random_smooth_curve(rng: np.random.Generator, frames: int, cycles: float) -> Floats:
    """(frames,) a smooth curve that starts at 0 and stays within -1..1."""
    u = np.linspace(0.0, cycles, frames)
    phase = rng.uniform(0.0, 2.0 * math.pi, 3)
    weight = rng.uniform(0.4, 1.0, 3) / np.array([1.0, 2.0, 3.0])
    waves = sum(w * np.sin(2.0 * math.pi * k * u + p) for k, w, p in zip((1, 2, 3), weight, phase, strict=True))
    curve = np.asarray(waves - waves[0], dtype=np.float64)
    return curve / max(1e-9, float(np.abs(curve).max()))


def similarity_path(
    frames: int,
    *,
    distance: float = 3.6,
    reach: float = 0.35,
    zoom: float = 0.2,
    turn: float = math.pi / 2,
    cycles: float = 0.6,
    seed: int = 0,
) -> Path:
    """A path of 4 DoF: the table stays parallel to the image, which moves by a similarity (paper, Section III).

    Args:
        frames: number of frames.
        distance: of the camera in the first frame, table units.
        reach: largest shift along each axis, table units.
        zoom: largest relative change of the distance.
        turn: largest roll, rad.
        cycles: slow waves over the whole path; more is faster.
        seed: of the path.
    """
    rng = np.random.default_rng(seed)
    still = np.zeros(frames)
    return Path(
        target=reach
        * np.column_stack([_random_smooth_curve(rng, frames, cycles), _random_smooth_curve(rng, frames, cycles)]),
        distance=distance * np.exp(math.log1p(zoom) * _random_smooth_curve(rng, frames, cycles)),
        roll=turn * _random_smooth_curve(rng, frames, cycles),
        tilt=still,
        azimuth=still,
    )


def tilting_path(
    frames: int,
    *,
    tilt: float = math.radians(25.0),
    distance: float = 3.6,
    reach: float = 0.3,
    zoom: float = 0.15,
    turn: float = math.pi / 3,
    cycles: float = 0.6,
    seed: int = 0,
) -> Path:
    """A path of 6 DoF: that of `similarity_path`, and the camera leans up to `tilt` rad in changing directions.

    The first frame is frontal.
    """
    plain = similarity_path(frames, distance=distance, reach=reach, zoom=zoom, turn=turn, cycles=cycles, seed=seed)
    rng = np.random.default_rng((seed, 1))
    lean_x, lean_y = _random_smooth_curve(rng, frames, cycles), _random_smooth_curve(rng, frames, cycles)
    lean = np.hypot(lean_x, lean_y)
    return Path(
        target=plain.target,
        distance=plain.distance,
        roll=plain.roll,
        tilt=tilt * lean / max(1e-9, float(lean.max())),
        azimuth=np.arctan2(lean_y, lean_x),
    )
