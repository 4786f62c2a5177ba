# SPDX-License-Identifier: Apache-2.0
"""A pinhole camera with a lens. The tracker never learns any of its numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grasptrack.errors import InputError
from grasptrack.typing import Floats


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
        return np.array([[f, 0.0, (self.width - 1) / 2.0], [0.0, f, (self.height - 1) / 2.0], [0.0, 0.0, 1.0]])

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
        rays = (points - K[:2, 2]) / K[0, 0]
        r = np.maximum(np.hypot(rays[..., 0], rays[..., 1]), 1e-300)
        return np.asarray(rays * (radius(r) / r)[..., None] * K[0, 0] + K[:2, 2], dtype=np.float64)

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
