# SPDX-License-Identifier: Apache-2.0
"""What a disturbance starts from: a part, a number of frames, a seed, an image size."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from grasptrack.bench.simulation.camera import Camera
from grasptrack.bench.simulation.courses import bounded_path
from grasptrack.bench.simulation.outlines import Shape
from grasptrack.bench.simulation.paths import Path


@dataclass(frozen=True)
class Setting:
    """What a disturbance starts from.

    Attributes:
        shape: the part.
        frames: number of frames.
        seed: of the path.
        rng: for everything else.
        size: px, sqrt(area) of the part in the first frame, where it fits.
        width, height: px of the image.
        start: rad, of the part in the first image.
        level: mean grey level of the part.
        table_level: mean grey level of the table.
    """

    shape: Shape
    frames: int
    seed: int
    rng: np.random.Generator
    size: float
    width: int
    height: int
    start: float
    level: float
    table_level: float = 150.0

    def course(self, camera: Camera | None = None, **options: Any) -> Path:
        """A gentle path with some tilt, its options as in `courses.course`; speeds are those of a 640 px wide image."""
        scale = self.width / 640.0
        given: dict[str, Any] = {"tilt": math.radians(15.0), "speed": 4.0, **options}
        given["speed"] *= scale
        return bounded_path(
            self.shape,
            self.frames,
            self.seed,
            camera=camera if camera is not None else Camera(self.width, self.height),
            size=self.size,
            start=self.start,
            **given,
        )

    def at(self, *shares: float) -> tuple[float, ...]:
        """Frames at shares of the sequence."""
        return tuple(share * self.frames for share in shares)

    def view(self, path: Path) -> float:
        """Table units from the middle of the image to its corner, where the camera is farthest."""
        focal = float(Camera(self.width, self.height).matrix[0, 0])
        return 0.5 * math.hypot(self.width, self.height) / focal * float(path.distance.max()) + 0.5


Parts = dict[str, Any]
"""Arguments of a `Scene` that a disturbance sets; `light` are changes of its conditions. A `table` or a `surface` gives way
to the user's own."""
