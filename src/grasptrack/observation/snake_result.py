# SPDX-License-Identifier: Apache-2.0
"""What a snake says of one image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.observation.shape_space import ShapeSpace
from grasptrack.observation.snake_search import columns

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class SnakeFit:
    """What one image said.

    Attributes:
        ok: whether the fit is believed.
        reason: why not; empty when ok.
        homography: (3, 3) H_current_reference as measured in this image, not filtered: it does not lag.
        points: (n, 2) px, the fitted curve at the template's samples.
        seen: (n,) whether an edge like the template's lies within 1.75 px of the curve there.
        residual: px, rms distance of the supporting edges; inf where there are none.
        misfit: px, rms over the outline of what a homography would still move it: tilt that the shape space lacks.
        support: share of the samples inside the image that are seen, of those that had an edge in the first image.
        outside: share of the samples outside the image, which speak neither for nor against the fit.
        bias, covariance: (8,) px and (8, 8) px^2 of the parameters of `snake_search.columns`.
        linear: (2, 2) linear part of the homography.
        offsets: (C + 1,) first sample of each contour.
        space: the shape space.
    """

    ok: bool
    reason: str
    homography: Floats
    points: Floats
    seen: Bools
    residual: float
    misfit: float
    support: float
    outside: float
    bias: Floats
    covariance: Floats
    linear: Floats
    offsets: NDArray[np.int64]
    space: ShapeSpace

    def covariance_at(self, points: ArrayLike) -> Floats:
        """(k, 2, 2) px^2 in this image of reference points (k, 2).

        It holds the noise of the edges, and what the shape space cannot follow: the part that the edges show, and as
        much again as an unseen side may hide.
        """
        field = columns(self.linear, (np.asarray(points, dtype=np.float64) - self.space.centre) / self.space.rho)
        shift = field @ self.bias
        return np.asarray(field @ self.covariance @ field.transpose(0, 2, 1) + shift[:, :, None] * shift[:, None, :])

    @property
    def refined(self) -> Floats:
        """(3, 3) H_current_reference with what the shape space lacks put in: `bias` to first order.

        Beside the snake of the paper, not part of it: its points no longer lie in the shape space. Good to a few
        hundredths of a px for a misfit of some px.
        """
        p0, p1, p2, p3, p4, p5, p6, p7 = (self.bias / self.space.rho).tolist()
        small = np.array(((1.0 + p2 + p4, p5 - p3, p0), (p3 + p5, 1.0 + p2 - p4, p1), (-p6, -p7, 1.0)))
        rho, (x, y) = self.space.rho, self.space.centre.tolist()
        out = np.array(((rho, 0.0, x), (0.0, rho, y), (0.0, 0.0, 1.0)))
        back = np.array(((1.0 / rho, 0.0, -x / rho), (0.0, 1.0 / rho, -y / rho), (0.0, 0.0, 1.0)))
        H = self.homography @ out @ small @ back
        return np.asarray(H / H[2, 2])

    def seen_at(self, places: ArrayLike, width: int = 6) -> Floats:
        """(k,) 0 to 1: share of the samples about places (k, >= 2; contour, position) of the template that are seen.

        Args:
            places: as `Grasp.on(snake.template)` gives them.
            width: samples on either side.
        """
        out = []
        around = np.arange(-width, width + 1)
        for c, position in np.asarray(places, dtype=np.float64)[:, :2].tolist():
            first, last = self.offsets[int(c)], self.offsets[int(c) + 1]
            out.append(self.seen[first + (round(position) + around) % (last - first)].mean())
        return np.array(out)
