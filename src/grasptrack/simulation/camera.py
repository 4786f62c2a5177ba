# SPDX-License-Identifier: Apache-2.0
"""A pinhole camera over a table plane, and smooth paths for it. The tracker never learns any of these numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """Intrinsics of a pinhole camera without lens distortion.

    Attributes:
        width, height: px.
        focal: px; None takes 1.1 times the width, a field of view of 49 degrees.
    """

    width: int = 640
    height: int = 480
    focal: float | None = None

    @property
    def matrix(self) -> Floats:
        """(3, 3) K; pixel centres lie at integer coordinates."""
        f = 1.1 * self.width if self.focal is None else self.focal
        return np.array([[f, 0.0, (self.width - 1) / 2.0], [0.0, f, (self.height - 1) / 2.0], [0.0, 0.0, 1.0]])


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

    def table_to_image(self, camera: Camera) -> Floats:
        """(F, 3, 3) homographies from table coordinates to pixels, the last element of each 1."""
        homographies = np.empty((len(self), 3, 3))
        for i in range(len(self)):
            rotation = _about_z(self.roll[i]) @ _about_axis(self.azimuth[i], self.tilt[i])
            shift = np.array([0.0, 0.0, self.distance[i]]) - rotation[:, :2] @ self.target[i]
            H = camera.matrix @ np.column_stack([rotation[:, :2], shift])
            homographies[i] = H / H[2, 2]
        return homographies


def _about_z(angle: float) -> Floats:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _about_axis(azimuth: float, angle: float) -> Floats:
    """Rotation by `angle` about the axis (cos azimuth, sin azimuth, 0)."""
    turn = _about_z(azimuth)
    c, s = math.cos(angle), math.sin(angle)
    lean = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return np.asarray(turn @ lean @ turn.T, dtype=np.float64)


def _wander(rng: np.random.Generator, frames: int, cycles: float) -> Floats:
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
        target=reach * np.column_stack([_wander(rng, frames, cycles), _wander(rng, frames, cycles)]),
        distance=distance * np.exp(math.log1p(zoom) * _wander(rng, frames, cycles)),
        roll=turn * _wander(rng, frames, cycles),
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
    lean_x, lean_y = _wander(rng, frames, cycles), _wander(rng, frames, cycles)
    lean = np.hypot(lean_x, lean_y)
    return Path(
        target=plain.target,
        distance=plain.distance,
        roll=plain.roll,
        tilt=tilt * lean / max(1e-9, float(lean.max())),
        azimuth=np.arctan2(lean_y, lean_x),
    )
