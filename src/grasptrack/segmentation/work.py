# SPDX-License-Identifier: Apache-2.0
"""How much a first look, or the search for a lost object, may do: steps are counted at what they cost on one machine.

That is the machine of the benchmarks. A clock would let the load of a machine decide what is found. So the same image and bound
give the same answer everywhere, and a machine that is half as fast takes twice as long.
"""

from __future__ import annotations

import math


class AreaCost(float):
    """ms for each million px."""

    def of(self, pixels: float) -> float:
        """ms for so many px."""
        return self * pixels / 1_000_000


PREPARED, GRADIENTS = AreaCost(8.0), AreaCost(35.0)
"""Of the image in its colours' planes, and of the reduced image in gradients."""
THRESHOLDED, CLOSING = AreaCost(2.5), AreaCost(4.5)
"""Of the image, one threshold; of the reduced image, one closing of edges."""
QUADRANGLES = AreaCost(100.0)
"""Of the reduced image, its quadrangles."""
CUT = AreaCost(3400.0)
"""Of the image that is cut at contacts, first on one side of them and then on the other."""
RATED = 0.06
"""ms for each region that is rated."""
CONTOUR, CONTOUR_AREA = 1.0, AreaCost(3.0)
"""ms of a contour, and for each million px of the image besides."""
SEARCH_SHARE = 0.6
"""Of the bound, what proposals may take; the rest is kept for their contours."""


class WorkBudget:
    """Counts what was done, against a limit in ms; None is no bound."""

    def __init__(self, limit_ms: float | None = None) -> None:
        self.limit_ms = math.inf if limit_ms is None else limit_ms
        self.spent_ms = 0.0

    def spend(self, ms: float) -> None:
        """Count a step."""
        self.spent_ms += ms

    def allows(self, ms: float, share: float = 1.0) -> bool:
        """Whether a step fits within a share of the bound."""
        return self.spent_ms + ms <= share * self.limit_ms
