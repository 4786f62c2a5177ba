# SPDX-License-Identifier: Apache-2.0
"""A pinhole camera over a table plane, and smooth paths for it. The tracker never learns any of these numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.errors import InputError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """Intrinsics of a pinhole camera, with or without Brown's radial lens distortion.

    A point at radius r from the axis, in units of the focal length, is seen at r (1 + k1 r^2 + k2 r^4). Negative k1 is a
    barrel, positive a pincushion. Where that would turn back, far outside the image, it goes on along its tangent.

    Attributes:
        width, height: px.
        focal: px; None takes 1.1 times the width, a field of view of 49 degrees.
        k1, k2: of the distortion.

    Raises:
        InputError: the distortion turns back within the image.
    """

    width: int = 640
    height: int = 480
    focal: float | None = None
    k1: float = 0.0
    k2: float = 0.0

    def __post_init__(self) -> None:
        f = float(self.matrix[0, 0])
        corner = 0.5 * math.hypot(self.width, self.height) / f
        fold = self._fold
        if fold < math.inf and self._radius(np.array([fold]))[0] < corner:
            raise InputError(
                f"a lens with k1 {self.k1} and k2 {self.k2} folds the image: the corners need a radius of {corner:.2f}",
                k1=self.k1,
                k2=self.k2,
            )

    @property
    def matrix(self) -> Floats:
        """(3, 3) K; pixel centres lie at integer coordinates."""
        f = 1.1 * self.width if self.focal is None else self.focal
        return np.array([[f, 0.0, (self.width - 1) / 2.0], [0.0, f, (self.height - 1) / 2.0], [0.0, 0.0, 1.0]])

    @property
    def distorted(self) -> bool:
        """Whether straight lines are seen bent."""
        return self.k1 != 0.0 or self.k2 != 0.0

    def distort(self, points: ArrayLike) -> Floats:
        """(N, 2) px of the image, of points (N, 2) px of the ideal pinhole image."""
        return self._scaled(np.asarray(points, dtype=np.float64), self._radius)

    def undistort(self, points: ArrayLike) -> Floats:
        """(N, 2) px of the ideal pinhole image, of points (N, 2) px of the image. The inverse, to rounding."""
        return self._scaled(np.asarray(points, dtype=np.float64), self._ideal_radius)

    def _scaled(self, points: Floats, radius: Callable[[Floats], Floats]) -> Floats:
        if not self.distorted:
            return points
        K = self.matrix
        rays = (points - K[:2, 2]) / K[0, 0]
        r = np.maximum(np.hypot(rays[..., 0], rays[..., 1]), 1e-300)
        return np.asarray(rays * (radius(r) / r)[..., None] * K[0, 0] + K[:2, 2], dtype=np.float64)

    @property
    def _fold(self) -> float:
        """The radius up to which the polynomial holds: nine tenths of where it turns back."""
        if not self.distorted:
            return math.inf
        b, root = 3.0 * self.k1, 9.0 * self.k1**2 - 20.0 * self.k2
        if root < 0.0:
            return math.inf
        turning = [2.0 / d for d in (-b + math.sqrt(root), -b - math.sqrt(root)) if d > 1e-12]
        return 0.9 * math.sqrt(min(turning)) if turning else math.inf

    def _radius(self, r: Floats) -> Floats:
        inner = np.minimum(r, self._fold)
        q = inner * inner
        value = inner * (1.0 + q * (self.k1 + q * self.k2))
        return np.asarray(value + (r - inner) * (1.0 + q * (3.0 * self.k1 + q * 5.0 * self.k2)), dtype=np.float64)

    def _ideal_radius(self, seen: Floats) -> Floats:
        r, fold = seen.copy(), self._fold
        for _ in range(40):  # Newton's; the slope is positive everywhere
            q = np.minimum(r, fold) ** 2
            step = (self._radius(r) - seen) / (1.0 + q * (3.0 * self.k1 + q * 5.0 * self.k2))
            r -= step
            if np.abs(step).max(initial=0.0) < 1e-15:
                break
        return r


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
            rotation = _about_z(self.roll[i]) @ _about_axis(self.azimuth[i], self.tilt[i])
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
