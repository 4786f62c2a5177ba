# SPDX-License-Identifier: Apache-2.0
"""Evidence -> status, confidence, reason: the only place where that is decided."""

from __future__ import annotations

import math
from typing import NamedTuple

from grasptrack.analysis import GraspAnalysis
from grasptrack.observation.support import Support
from grasptrack.result import Status

MIN_SHARE = 0.75
"""Of the outline inside the image, at least so much must show its edge where the transfer says it is."""
MIN_SHARE_REGISTERED = 0.6
"""The same where the outline was laid on the edges themselves and moved on from the image before: what agrees to a
fraction of a pixel is not there by chance."""
MIN_SHARE_AGAIN = 0.88
"""The same after a loss: what is covered then cannot tell the object from a near twin."""
MAX_CONTRADICTED = 0.005
"""At most so much of it may show another shape: ground where there should be material, or the reverse."""
MAX_CONTRADICTED_AGAIN = 0.005
"""The same after a loss."""
MIN_VISIBLE = 0.4
"""Of the whole outline, at least so much must lie inside the image."""
MAX_RMS = 0.0075
"""The edges may deviate from the carried outline by this fraction of sqrt(area), rms, ..."""
MAX_RMS_PX = 1.0
"""... or by so many px, whichever is more."""
MAX_SHIFT = 0.02
"""The edges may ask for a contact to move by this fraction of sqrt(area), ..."""
MAX_SHIFT_PX = 1.5
"""... or by so many px, whichever is more: half of what would make the answer wrong."""
MAX_SIGMA = 0.02
"""A contact whose standard deviation exceeds this fraction of sqrt(area) is not fixed by the evidence, ..."""
MAX_SIGMA_PX = 1.5
"""... unless it is below so many px."""
CHANCE = 0.9
"""A grasp that closes with less than this probability, its contacts being as uncertain as they are, is not stable."""


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


def judge(support: Support, analysis: GraspAnalysis, chance: float = math.nan) -> Verdict:
    """What to say of a transfer that `refuse` has let pass.

    Args:
        support: the edges found along the outline as the transfer carries it.
        analysis: of the transferred grasp.
        chance: that it closes, 0 to 1; NaN where that is not known.
    """
    fit = math.exp(-0.5 * (support.rms / max(MAX_RMS_PX, MAX_RMS * support.size)) ** 2)
    place = math.exp(-0.5 * (error(support) / max(MAX_SHIFT_PX, MAX_SHIFT * support.size)) ** 2)
    confidence = min(1.0, support.share * (0.5 + 0.5 * support.visible)) * fit * place
    if not analysis.stable:
        return Verdict("unstable", analysis.reason, confidence)
    if chance < CHANCE:
        return Verdict("unstable", f"the chance that the grasp closes is only {100 * chance:.0f} %", confidence)
    return Verdict("tracked", "", confidence)


def error(support: Support) -> float:
    """px by which the edges say that the worst contact is off."""
    return max(math.hypot(x, y) for x, y in support.shift.tolist())


def deviation(support: Support) -> tuple[float, int]:
    """px, the largest standard deviation of a contact in any direction, and which contact's it is."""
    variances = [0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy) for (xx, xy), (_, yy) in support.covariance.tolist()]
    worst = max(range(len(variances)), key=variances.__getitem__)
    return math.sqrt(variances[worst]), worst


def close(support: Support) -> bool:
    """Whether the edges bear a transfer out so well that no other strategy need be asked."""
    return error(support) <= 0.25 * max(MAX_SHIFT_PX, MAX_SHIFT * support.size)


def refuse(support: Support, *, again: bool = False, registered: bool = False) -> str:
    """Why a transfer is not believed; empty when it is.

    Args:
        support: the edges found along the outline as the transfer carries it.
        again: after a loss, more of the outline is asked for.
        registered: the outline was laid on the edges themselves.
    """
    least = MIN_SHARE_AGAIN if again else MIN_SHARE_REGISTERED if registered else MIN_SHARE
    if support.visible < MIN_VISIBLE:
        return f"only {100 * support.visible:.0f} % of the outline is inside the image"
    if support.share < least:
        return f"only {100 * support.share:.0f} % of the outline shows its edge where the grasp's view says it is"
    if support.rms > max(MAX_RMS_PX, MAX_RMS * support.size):
        return f"the outline's shape no longer fits the reference ({support.rms:.1f} px off)"
    if support.contradicted > (MAX_CONTRADICTED_AGAIN if again else MAX_CONTRADICTED):
        share = 100 * support.contradicted
        return f"another shape: {share:.0f} % of the outline ends elsewhere than in the grasp's view"
    sigma, worst = deviation(support)
    if not sigma <= max(MAX_SIGMA_PX, MAX_SIGMA * support.size):
        return f"the outline in view does not fix contact {worst + 1} (uncertain by {sigma:.0f} px)"
    off = error(support)
    if off > max(MAX_SHIFT_PX, MAX_SHIFT * support.size):
        return f"the outline's edges put a contact {off:.1f} px from where the transfer does"
    return ""
