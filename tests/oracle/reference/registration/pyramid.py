# SPDX-License-Identifier: Apache-2.0
"""Grey images and their halves looked at through a homography, and the small algebra of a pose."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Bools, Floats, Ints

Grey = NDArray[np.uint8]

STEP = 1.5
"""px of a level between neighbouring samples at most, as long as a coarser level is left."""


@dataclass(frozen=True)
class Level:
    """An image of a pyramid."""

    grey: Grey  # (H, W) grey levels
    hidden: Bools | None = None  # (H, W) True where a pixel shows nothing of the scene; None where every pixel does

    def holds(self, x: Floats, y: Floats, margin: float) -> Bools:
        """Whether px x, y lie in the image, `margin` px from its border, on a pixel that shows the scene."""
        height, width = self.grey.shape
        inside = (x >= margin) & (y >= margin) & (x < width - 1.0 - margin) & (y < height - 1.0 - margin)
        inside = np.asarray(inside)
        if self.hidden is not None:
            at = (y[inside] + 0.5).astype(np.int64), (x[inside] + 0.5).astype(np.int64)
            inside[inside] = ~self.hidden[at]
        return inside

    def between(self, x: Floats, y: Floats) -> Floats:
        """Bilinear grey levels at px x, y, which must lie in the image."""
        a, b = x.astype(np.int64), y.astype(np.int64)
        fx, fy = x - a, y - b
        corner, right, below, across = (
            self.grey[b + j, a + i].astype(np.float64) for j, i in ((0, 0), (0, 1), (1, 0), (1, 1))
        )
        top, bottom = corner + fx * (right - corner), below + fx * (across - below)
        return np.asarray(top + fy * (bottom - top))

    def at(self, x: Floats, y: Floats, margin: float = 0.0) -> Floats:
        """The same at px anywhere; NaN where the image does not hold them."""
        inside = self.holds(x, y, margin)
        out = np.full(inside.shape, np.nan)
        out[inside] = self.between(x[inside], y[inside])
        return out


Pyramid = list[Level]


def transform_points(H: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Eq. (2): where H (3, 3) carries points x, y."""
    w = 1.0 / (H[2, 0] * x + H[2, 1] * y + H[2, 2])
    return (H[0, 0] * x + H[0, 1] * y + H[0, 2]) * w, (H[1, 0] * x + H[1, 1] * y + H[1, 2]) * w


def homography_derivatives(H: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """The derivatives dx'/dx, dx'/dy, dy'/dx, dy'/dy of eq. (2) at points x, y."""
    w = 1.0 / (H[2, 0] * x + H[2, 1] * y + H[2, 2])
    u, v = transform_points(H, x, y)
    return (
        (H[0, 0] - H[2, 0] * u) * w,
        (H[0, 1] - H[2, 1] * u) * w,
        (H[1, 0] - H[2, 0] * v) * w,
        (H[1, 1] - H[2, 1] * v) * w,
    )


def levels_through(pyramid: Pyramid, H: Floats, x: Floats, y: Floats, stride: float) -> Ints:
    """The level for samples at x, y, `stride` apart in the plane that H carries to the image.

    The one on which their steps are nearest to a pixel and never much more: pixels are averaged over, not skipped.
    """
    a, b, c, d = homography_derivatives(H, x, y)
    step = stride * np.sqrt(np.abs(a * d - b * c))
    which = np.zeros(np.shape(step), dtype=np.int64)
    for _ in pyramid[1:]:
        coarse = step > STEP
        which += coarse
        step = np.where(coarse, 0.5 * step, step)
    return which


def level_through(pyramid: Pyramid, H: Floats, at: Floats, stride: float) -> tuple[Level, Floats]:
    """One level for samples round a place (2,), and the homography (3, 3) that leads to its pixels."""
    k = int(levels_through(pyramid, H, at[0], at[1], stride))
    reduced = H.copy()
    reduced[:2] *= 0.5**k
    return pyramid[k], reduced


def inverse_homography(H: Floats) -> Floats | None:
    """The inverse (3, 3) of H (3, 3); None where it has none."""
    rows = np.stack([np.cross(H[1], H[2]), np.cross(H[2], H[0]), np.cross(H[0], H[1])])
    det = H[0] @ rows[0]
    if not abs(det) > 1e-300 or not np.isfinite(det):
        return None
    return np.asarray(rows.T * (1.0 / det))


def inverse_definite(A: Floats) -> Floats | None:
    """The inverse (n, n) of a symmetric positive definite matrix by Cholesky; None where it is not one."""
    try:
        lower = np.linalg.cholesky(A)
        if not np.isfinite(lower).all():
            return None
        inverse = np.linalg.inv(lower)
    except np.linalg.LinAlgError:
        return None
    return np.asarray(inverse.T @ inverse)


def upper_median(values: Floats) -> np.float64:
    """The value of rank n // 2, the upper median of an even count. NaN counts as larger than any number."""
    return np.float64(np.sort(values)[len(values) // 2])


def clamp_to_int(value: float, low: int, high: int) -> int:
    """A number without its fraction, within bounds; the lower one where it is none."""
    return int(min(max(value, low), high)) if value == value else low
