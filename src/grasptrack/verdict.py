# SPDX-License-Identifier: Apache-2.0
"""Evidence -> status, confidence, reason: the only place where that is decided."""

from __future__ import annotations

import math
from typing import NamedTuple

from grasptrack.analysis import GraspAnalysis
from grasptrack.closing import CHANCE
from grasptrack.observation.support import Support
from grasptrack.tracking.result import Status

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


RIGHT, RIGHT_PX = 0.04, 3.0
"""Contacts are right within this fraction of sqrt(area), or so many px, whichever is more: of this the confidence is the
probability."""
EXPLAINED = 0.9
"""Of the outline, so much shows its edge or lies under a cover where hardly anything is left that could tell another object."""
RISKS = {
    (True, True): 0.0005,
    (True, False): 0.002,
    (False, True): 0.004,
    (False, False): 0.01,
}
"""How often what was believed was another object, another turn or another place, by whether the outline was explained and
whether a surface bore it out: upper bounds of 84 % (one sigma) from the counts of `benchmarks/confidence.py`."""
RISK_PLAIN = 0.008
"""The same of the paper's strategies by themselves."""


class Verdict(NamedTuple):
    """What is said of one frame.

    Attributes:
        status: tracked, unstable or lost.
        reason: empty when tracked.
        confidence: the probability that every contact is within RIGHT of its true place on the object that is meant.
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


def judge(support: Support, analysis: GraspAnalysis, risk: float = RISK_PLAIN, chance: float = math.nan) -> Verdict:
    """What to say of a transfer that `refuse` has let pass.

    Args:
        support: the edges found along the outline as the transfer carries it.
        analysis: of the transferred grasp.
        risk: as `risk` has it.
        chance: that it closes, 0 to 1; NaN where that is not known.
    """
    sure = confidence(support, risk)
    if not analysis.stable:
        return Verdict("unstable", analysis.reason, sure)
    if chance < CHANCE:
        return Verdict("unstable", f"the chance that the grasp closes is only {100 * chance:.0f} %", sure)
    return Verdict("tracked", "", sure)


def risk(explained: float, borne_out: bool) -> float:
    """The probability that what was believed is not the object where it was said to be.

    Args:
        explained: share of the outline that shows its edge or lies under a cover, 0 to 1.
        borne_out: the object's surface, or the ground round it, is as in the reference.
    """
    return RISKS[explained >= EXPLAINED, borne_out]


def confidence(support: Support, risk: float) -> float:
    """The probability that every contact is right: it is the object, and the covariances are as said.

    Args:
        support: with the covariances of the contacts.
        risk: that it is not the object.
    """
    limit = max(RIGHT_PX, RIGHT * support.size) - error(support)
    if limit <= 0.0:
        return 0.0
    within = 1.0 - risk
    for (xx, xy), (_, yy) in support.covariance.tolist():
        # the larger variance in every direction: a bound, and exact for a round one
        most = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)
        within *= 1.0 - math.exp(-0.5 * limit * limit / max(most, 1e-12))
    return within


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
