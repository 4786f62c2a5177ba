# SPDX-License-Identifier: Apache-2.0
"""Where the reference outline is expected next: the motion of the last two frames, carried on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasptrack.projective import normalised

Floats = NDArray[np.float64]

MEMORY = 25
"""Frames after a loss during which the last pose still says which way round a symmetric object lies."""


class Motion:
    """Constant velocity in the group of homographies, forgotten when the object is lost."""

    def __init__(self) -> None:
        self._pose: Floats = np.eye(3)
        self._step: Floats = np.eye(3)
        self.missed = 0

    def predict(self) -> Floats:
        """(3, 3) H_current_reference expected for the next frame."""
        return normalised(self._step @ self._pose) if self.missed == 0 else self._pose

    @property
    def remembered(self) -> bool:
        """Whether the last pose is recent enough to say anything."""
        return self.missed <= MEMORY

    def found(self, H: Floats) -> None:
        """Learn the pose (3, 3) of this frame."""
        self._step = H @ np.linalg.inv(self._pose) if self.missed == 0 else np.eye(3)
        self._pose = normalised(H)
        self.missed = 0

    def lost(self) -> None:
        """This frame gave none."""
        self.missed += 1
