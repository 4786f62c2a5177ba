# SPDX-License-Identifier: Apache-2.0
"""What a surface usually shows of the reference, and whether it moves along with the object."""

from __future__ import annotations

import math
from collections.abc import Sequence

from grasptrack.observation.posed import GROUND, INSIDE, Fused, Posed

FADED = 0.15
"""A surface shows less than usual where its correlation is less by so much, ..."""
LACKING, LACKING_ALSO = 3.0, 0.03
"""... or where it lacks, of perfect correlation, so many times as much as usual and this besides."""
LEAST_ALIKE, ALIKE = 0.5, 0.8
"""Correlations below which a surface is none that moves along; from which on one that did not is looked at again."""
FORGETTING = 0.01
"""By how much less a correlation may get from image to image and still be usual."""
NEVER = -1.0
"""The usual correlation of what was not yet believed."""


class Trust:
    """Remembers correlations of the object's surface and of the ground round it, from image to image.

    Args:
        levels: by how many times images are shrunk in which surfaces are compared; each has its own usual correlation.

    Attributes:
        use: whether the outline, the surface and the ground are asked in the next image.
    """

    def __init__(self, levels: Sequence[int]) -> None:
        self.use = [True, True, True]
        self._usual = {by: [NEVER] * 3 for by in levels}

    def usual(self, by: int, row: int) -> float:
        """The correlation of a surface in images shrunk so many times, as of late; below 0 if it was never believed."""
        return self._usual[by][row]

    @property
    def textured(self) -> bool:
        """Whether a surface bears poses out."""
        return any(self.use[1:])

    @property
    def telling(self) -> bool:
        """Whether the object's surface is one that can be known again."""
        return self._best(INSIDE) >= ALIKE

    @property
    def on_ground(self) -> bool:
        """Whether the ground moved along in the last image that was believed."""
        return self.use[GROUND] and self._best(GROUND) > 0.0

    def _best(self, row: int) -> float:
        return max(usual[row] for usual in self._usual.values())

    def believe(self, fused: Fused) -> None:
        """The verdict accepted this one: from now on only what moved along is used."""
        usual = self._usual[fused.by]
        for row, correlation in ((INSIDE, fused.surface), (GROUND, fused.ground)):
            if math.isfinite(correlation):
                self.use[row] = fused.used[row] or correlation >= max(ALIKE, usual[row] - FADED)
                if self.use[row]:
                    usual[row] = max(correlation, usual[row] - FORGETTING)

    def weak(self, state: Posed, row: int) -> bool:
        """Whether a surface that is used shows less of the reference than usual: it is off, or something else."""
        usual = self._usual[state.by][row]
        least = max(LEAST_ALIKE, usual - FADED, 1.0 - LACKING * (1.0 - usual) - LACKING_ALSO)
        return state.told(row) and state.alike(row) < least

    def lacking(self, state: Posed) -> bool:
        """Whether a surface shows less than usual: the pose may be too far off to feel where it belongs."""
        return any(self.weak(state, row) for row in (INSIDE, GROUND))

    def lack(self, state: Posed) -> float:
        """How much the surfaces lack of their usual correlations."""
        usual = self._usual[state.by]
        return float(sum(max(usual[row] - state.alike(row), 0.0) for row in (INSIDE, GROUND) if state.told(row)))
