# SPDX-License-Identifier: Apache-2.0
"""A pinhole camera with a lens and, where asked for, a rolling shutter. The tracker never learns any of its numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grasptrack.errors import InputError
from grasptrack.typing import Floats, Floats32


@dataclass(frozen=True)
class Pinhole:
    """Intrinsics of a pinhole camera, with or without Brown's radial lens distortion.

    A point at radius r from the axis, in units of the focal length, is seen at r (1 + k1 r^2 + k2 r^4). Negative k1 is a
    barrel, positive a pincushion. Where that would turn back, far outside the image, it goes on along its tangent.

    Attributes:
        width, height: px.
        focal: px; None takes 1.1 times the width, a field of view of 49 degrees.
        k1, k2: of the distortion.
        aspect: width of a pixel as a share of its height; `focal` counts in pixel heights.
    """

    width: int = 640
    height: int = 480
    focal: float | None = None
    k1: float = 0.0
    k2: float = 0.0
    aspect: float = 1.0

    def __post_init__(self) -> None:
        f = float(self.matrix[1, 1])
        corner = 0.5 * math.hypot(self.width * self.aspect, self.height) / f
        fold = self._fold_radius
        if fold < math.inf and self._distorted_radius(np.array([fold]))[0] < corner:
            raise InputError(
                f"a lens with k1 {self.k1} and k2 {self.k2} folds the image: the corners need a radius of {corner:.2f}",
                k1=self.k1,
                k2=self.k2,
            )

    @property
    def matrix(self) -> Floats:
        """(3, 3) K; pixel centres lie at integer coordinates."""
        f = 1.1 * self.width if self.focal is None else self.focal
        return np.array(
            [[f / self.aspect, 0.0, (self.width - 1) / 2.0], [0.0, f, (self.height - 1) / 2.0], [0.0, 0.0, 1.0]]
        )

    @property
    def distorted(self) -> bool:
        """Whether straight lines are seen bent."""
        return self.k1 != 0.0 or self.k2 != 0.0

    def distort(self, points: ArrayLike) -> Floats:
        """(N, 2) px of the image, of points (N, 2) px of the ideal pinhole image."""
        return self._scale_radially(np.asarray(points, dtype=np.float64), self._distorted_radius)

    def undistort(self, points: ArrayLike) -> Floats:
        """(N, 2) px of the ideal pinhole image, of points (N, 2) px of the image. The inverse, to rounding."""
        return self._scale_radially(np.asarray(points, dtype=np.float64), self._ideal_radius)

    def _scale_radially(self, points: Floats, radius: Callable[[Floats], Floats]) -> Floats:
        if not self.distorted:
            return points
        K = self.matrix
        focal = np.diagonal(K)[:2]
        rays = (points - K[:2, 2]) / focal
        r = np.maximum(np.hypot(rays[..., 0], rays[..., 1]), 1e-300)
        return np.asarray(rays * (radius(r) / r)[..., None] * focal + K[:2, 2], dtype=np.float64)

    @property
    def _fold_radius(self) -> float:
        """The radius up to which the polynomial holds: nine tenths of where it turns back."""
        if not self.distorted:
            return math.inf
        b, root = 3.0 * self.k1, 9.0 * self.k1**2 - 20.0 * self.k2
        if root < 0.0:
            return math.inf
        turning = [2.0 / d for d in (-b + math.sqrt(root), -b - math.sqrt(root)) if d > 1e-12]
        return 0.9 * math.sqrt(min(turning)) if turning else math.inf

    def _distorted_radius(self, r: Floats) -> Floats:
        inner = np.minimum(r, self._fold_radius)
        q = inner * inner
        value = inner * (1.0 + q * (self.k1 + q * self.k2))
        return np.asarray(value + (r - inner) * (1.0 + q * (3.0 * self.k1 + q * 5.0 * self.k2)), dtype=np.float64)

    def _ideal_radius(self, seen: Floats) -> Floats:
        r, fold = seen.copy(), self._fold_radius
        for _ in range(40):  # Newton's; the slope is positive everywhere
            q = np.minimum(r, fold) ** 2
            step = (self._distorted_radius(r) - seen) / (1.0 + q * (3.0 * self.k1 + q * 5.0 * self.k2))
            r -= step
            if np.abs(step).max(initial=0.0) < 1e-15:
                break
        return r


KNOTS = 17
"""Rows whose poses are computed; between them homographies are interpolated. That is what the image and the truth are."""
EXACT = 1e-12
"""px at which the search for a point's own row ends."""


@dataclass(frozen=True)
class RollingShutter:
    """From a plane to ideal px, (K, 3, 3) at rows spread evenly from the first to the last, exposed one after another."""

    homographies: Floats
    height: int

    def __matmul__(self, other: Floats) -> RollingShutter:
        """With a homography (3, 3) of the plane, or (K, 3, 3) for each knot, before it."""
        return RollingShutter(self.homographies @ other, self.height)

    def at(self, rows: Floats) -> Floats:
        """(N, 3, 3) of rows (N,), fractional ones and those beyond the image included."""
        last = len(self.homographies) - 1
        u = rows * (last / (self.height - 1))
        k = np.clip(np.floor(u), 0, last - 1).astype(np.int64)
        share = (u - k)[:, None, None]
        return np.asarray((1.0 - share) * self.homographies[k] + share * self.homographies[k + 1], dtype=np.float64)

    def project(self, points: Floats, camera: Pinhole) -> Floats:
        """(N, 2) px of the image, of points (N, 2) of the plane: each where it is when its own row is exposed."""
        plane = np.column_stack([points, np.ones(len(points))])
        rows = np.full(len(points), 0.5 * (self.height - 1))
        seen = np.empty((len(points), 2))
        for _ in range(40):  # a point moves by a few per cent of the rows that pass: each step gains a digit or two
            ideal = np.einsum("nij,nj->ni", self.at(rows), plane)
            seen = camera.distort(ideal[:, :2] / ideal[:, 2:])
            change = float(np.abs(seen[:, 1] - rows).max(initial=0.0))
            rows = seen[:, 1]
            if change < EXACT:
                break
        return seen

    def back(self, points: Floats, camera: Pinhole) -> Floats:
        """(N, 2) of the plane, of points (N, 2) px of the image: the inverse of `project`, in one step."""
        ideal = np.column_stack([camera.undistort(points), np.ones(len(points))])
        plane = np.linalg.solve(self.at(points[:, 1]), ideal[:, :, None])[:, :, 0]
        return np.asarray(plane[:, :2] / plane[:, 2:], dtype=np.float64)

    def back_map(self, x0: int, y0: int, x1: int, y1: int, rays: Floats32 | None = None) -> tuple[Floats32, Floats32]:
        """Where each pixel of a box looks at the plane: x and y, (y1 - y0, x1 - x0) each.

        Rays are ideal px (y1 - y0, x1 - x0, 2) of its pixels; None where the lens does not distort.
        """
        rows = np.arange(y0, y1, dtype=np.float64)
        back = np.linalg.inv(self.at(rows))
        back /= back[:, 2:, 2:]
        coefficients = back.astype(np.float32)[:, None]
        if rays is None:
            x, y = np.arange(x0, x1, dtype=np.float32)[None], rows.astype(np.float32)[:, None]
        else:
            x, y = rays[..., 0], rays[..., 1]
        over = coefficients[..., 2, 0] * x + coefficients[..., 2, 1] * y + 1.0
        u = (coefficients[..., 0, 0] * x + coefficients[..., 0, 1] * y + coefficients[..., 0, 2]) / over
        v = (coefficients[..., 1, 0] * x + coefficients[..., 1, 1] * y + coefficients[..., 1, 2]) / over
        return np.ascontiguousarray(u, dtype=np.float32), np.ascontiguousarray(v, dtype=np.float32)
