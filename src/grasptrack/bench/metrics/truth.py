# SPDX-License-Identifier: Apache-2.0
"""What is known to be true of one frame, whatever told it: a rendered scene, or a table of homographies."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.simulation import SceneFrame
from grasptrack.errors import ConditioningError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.typing import Floats


@dataclass(frozen=True)
class Truth:
    """Where points of frame 0 are in one frame, and how much of the object can be seen there.

    Attributes:
        carry: px (k, 2) of frame 0 to px of this frame.
        back: the inverse.
        area: px^2 of the object in this frame; NaN where it is not known.
        present: whether the object is there at all; contacts given while it is not are wrong wherever they lie.
        visible: share of its outline that can be seen, 0 to 1.
        sees: which points (k, 2) px of this frame can be seen; None where it is not known.
    """

    carry: Callable[[Floats], Floats]
    back: Callable[[Floats], Floats]
    area: float = math.nan
    present: bool = True
    visible: float = 1.0
    sees: Callable[[Floats], NDArray[np.bool_]] | None = None

    @classmethod
    def of_homography(cls, H: Floats, area: float | None = None) -> Truth:
        """From H_current_reference (3, 3), reference being frame 0, and the object's area in px^2 where it is known.

        Raises:
            numpy.linalg.LinAlgError: H cannot be inverted.
        """
        inverse = np.asarray(np.linalg.inv(H), dtype=np.float64)
        return cls(
            lambda points: apply_homography(H, points),
            lambda points: apply_homography(inverse, points),
            math.nan if area is None else area,
        )

    @classmethod
    def of_scene(cls, frame: SceneFrame) -> Truth:
        """All that a rendered frame knows of itself."""
        return cls(frame.carry, frame.back, frame.area, frame.present, frame.outline_visible, frame.visible)

    def carried(self, points: Floats) -> Floats:
        """(k, 2) px of this frame; infinite where the motion sends a point behind the camera."""
        try:
            return self.carry(points)
        except ConditioningError:
            return np.full_like(points, np.inf)

    def growth(self, centre: Floats) -> float:
        """By how much an area round a point (2,) of frame 0 is larger in this frame: the Jacobian's determinant."""
        step = 0.5
        around = centre + step * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        right, left, down, up = self.carried(around)
        (a, c), (b, d) = (right - left) / (2.0 * step), (down - up) / (2.0 * step)
        return float(abs(a * d - b * c))
