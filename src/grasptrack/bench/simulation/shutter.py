# SPDX-License-Identifier: Apache-2.0
"""A rolling shutter: every row of the image has its own time, so its own homography."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.simulation.camera import Camera
from grasptrack.typing import Floats

Floats32 = NDArray[np.float32]

KNOTS = 17
"""Rows whose poses are computed; between them homographies are interpolated. That is what the image and the truth are."""
EXACT = 1e-12
"""px at which the search for a point's own row ends."""


@dataclass(frozen=True)
class RollingShutter:
    """From a plane to ideal px while rows are exposed one after another.

    Attributes:
        homographies: (K, 3, 3) at rows spread evenly from the first to the last.
        height: px, of the image.
    """

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

    def project(self, points: Floats, camera: Camera) -> Floats:
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

    def back(self, points: Floats, camera: Camera) -> Floats:
        """(N, 2) of the plane, of points (N, 2) px of the image: the inverse of `project`, in one step."""
        ideal = np.column_stack([camera.undistort(points), np.ones(len(points))])
        plane = np.linalg.solve(self.at(points[:, 1]), ideal[:, :, None])[:, :, 0]
        return np.asarray(plane[:, :2] / plane[:, 2:], dtype=np.float64)

    def back_map(self, x0: int, y0: int, x1: int, y1: int, rays: Floats32 | None = None) -> tuple[Floats32, Floats32]:
        """Where each pixel of a box looks at the plane: x and y, (y1 - y0, x1 - x0) each.

        Args:
            x0, y0, x1, y1: px, the box.
            rays: (y1 - y0, x1 - x0, 2) ideal px of its pixels; None where the lens does not distort.
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
