# SPDX-License-Identifier: Apache-2.0
"""How well the edges along a registered outline agree with each other, and with what they did before.

A pose that is right leaves the same small residual in image after image. One that fits the edge of a cover for a side, or
a body that is not flat, leaves more, though each edge is near enough; and where two poses fit, the one on which more of the
outline agrees is right.
"""

from __future__ import annotations

import math

from grasptrack.carriers import Carried
from grasptrack.observation.posed import Fused
from grasptrack.verdict import RIGHT, RIGHT_PX

LEAST = 0.4
"""Of the outline, at least so much must agree."""
BETTER = 0.04
"""A pose on which so much more of the outline agrees makes another one unbelievable."""
MOST_NOISE = 0.8
"""px that edges of a flat part may scatter, in the poorest light."""
HELD = 2.0
"""So many times as much where surfaces hold the pose: the edges are blurred then, and nothing depends on them alone."""
WHOLE = 0.75
"""Where so much of the outline agrees, little can be covered."""
RISE, RISE_COVERED = 2.5, 1.5
"""How many times as much as of late they may scatter then, and where less agrees: a cover's edge lies near the outline
for a while, and draws it away, ..."""
CALM = 0.2
"""... or so many px, whichever is more."""
LEEWAY = 0.25
"""... or so far that they could move no contact by more than this share of what makes it wrong, if all of them were off to
the same effect. A part that is not quite flat shows its sides; where the outline fixes it well, that does no harm."""
LEARNING = 0.2
"""Share of a new image in what they did of late."""
SLOW = 1.1
"""How many times more that may become from image to image: what grows steadily is no noise."""


class Agreement:
    """Judges registrations of one object, image after image."""

    def __init__(self) -> None:
        self._noise = math.nan
        self._best = 0.0

    def begin(self) -> None:
        """A new image."""
        self._best = 0.0

    def refuse(self, carried: Carried) -> str:
        """Why a registration is not believed; empty when it may be, and of other transfers."""
        fused = carried.fused
        if fused is None:
            return ""
        best, self._best = self._best, max(self._best, fused.agreement)
        if fused.agreement < best - BETTER:
            return "another pose, which is refused, fits the edges better"
        if fused.agreement < LEAST:
            return f"only {100 * fused.agreement:.0f} % of the outline's edges agree on one motion"
        rise = RISE if fused.agreement >= WHOLE else RISE_COVERED
        most = MOST_NOISE * (HELD if fused.held else 1.0)
        limit = most if math.isnan(self._noise) else min(most, max(CALM, rise * self._noise))
        scatter = self._scatter(fused)
        if scatter > limit and not (scatter <= most and self._harmless(carried, scatter)):
            return f"the outline's edges scatter by {scatter:.2f} px, more than before: it may be covered, or not flat"
        return ""

    @staticmethod
    def _harmless(carried: Carried, scatter: float) -> bool:
        """Whether edges that scatter so far, little of the outline being covered, can hardly make a contact wrong."""
        fused = carried.fused
        if fused is None or fused.agreement < WHOLE:
            return False
        wrong = max(RIGHT_PX, RIGHT * math.sqrt(carried.view.outer.area))
        return fused.leverage * scatter <= LEEWAY * wrong

    @staticmethod
    def _scatter(fused: Fused) -> float:
        """px, of all edges, or of those that agree where a cover cannot draw the pose away, as surfaces hold it."""
        return fused.noise if fused.held else fused.scatter

    def believe(self, carried: Carried) -> None:
        """The verdict accepted this one."""
        if carried.fused is None:
            return
        scatter = self._scatter(carried.fused)
        if math.isnan(self._noise):
            self._noise = scatter
        self._noise = min(self._noise + LEARNING * (scatter - self._noise), SLOW * self._noise)
