# SPDX-License-Identifier: Apache-2.0
"""Evidence -> status, confidence, reason: the only place where that is decided."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.analysis import GraspAnalysis
from grasptrack.observation.support import Support
from grasptrack.result import Status

Floats = NDArray[np.float64]

MIN_SHARE = 0.75
"""Of the outline inside the image, at least so much must show its edge where the transfer says it is."""
MIN_VISIBLE = 0.4
"""Of the whole outline, at least so much must lie inside the image."""
MAX_RMS = 0.0075
"""The edges may deviate from the carried outline by this fraction of sqrt(area), rms, ..."""
MAX_RMS_PX = 1.0
"""... or by so many px, whichever is more."""
MAX_SIGMA = 0.02
"""A contact whose standard deviation exceeds this fraction of sqrt(area) is not fixed by the evidence, ..."""
MAX_SIGMA_PX = 1.5
"""... unless it is below so many px."""


class Verdict(NamedTuple):
    """What is said of one frame.

    Attributes:
        status: tracked, unstable or lost.
        reason: empty when tracked.
        confidence: 0 to 1. It orders answers; it is not yet a probability.
    """

    status: Status
    reason: str
    confidence: float

    @property
    def believed(self) -> bool:
        """Whether the contacts may be given out."""
        return self.status in ("tracked", "unstable")


def lost(reason: str) -> Verdict:
    """Nothing was found, or it is not believed."""
    return Verdict("lost", reason, 0.0)


def judge(support: Support, analysis: GraspAnalysis | None, covariance: Floats | None = None) -> Verdict:
    """Decide what to say of a transfer.

    Args:
        support: the edges found along the outline as the transfer carries it.
        analysis: of the transferred grasp.
        covariance: (k, 2, 2) px^2 of the contacts where the transfer has one.
    """
    refusal = refuse(support, covariance)
    if refusal:
        return lost(refusal)
    tolerance = max(MAX_RMS_PX, MAX_RMS * support.size)
    fit = math.exp(-0.5 * (support.rms / tolerance) ** 2)
    confidence = min(1.0, support.share * (0.5 + 0.5 * support.visible)) * fit
    if analysis is None:
        return lost("the grasp could not be analysed")
    if not analysis.stable:
        return Verdict("unstable", analysis.reason, confidence)
    return Verdict("tracked", "", confidence)


def refuse(support: Support, covariance: Floats | None = None) -> str:
    """Why a transfer is not believed; empty when it is."""
    if support.visible < MIN_VISIBLE:
        return f"only {100 * support.visible:.0f} % of the outline is inside the image"
    if support.share < MIN_SHARE:
        return f"only {100 * support.share:.0f} % of the outline shows its edge where the grasp's view says it is"
    if support.rms > max(MAX_RMS_PX, MAX_RMS * support.size):
        return f"the outline's shape no longer fits the reference ({support.rms:.1f} px off)"
    if covariance is not None:
        limit = max(MAX_SIGMA_PX, MAX_SIGMA * support.size)
        for i, worst in enumerate(np.sqrt(np.linalg.eigvalsh(covariance)[:, -1]).tolist()):
            if not worst <= limit:
                return f"the outline in view does not fix contact {i + 1} (uncertain by {worst:.0f} px)"
    return ""
