# SPDX-License-Identifier: Apache-2.0
"""The probability that an answer is off, or another object: the only place where "located" is decided."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grasptrack.tracking.estimator import PoseEstimate
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.redetection import CONTINUOUS
from grasptrack.tracking.target import Target


@dataclass(frozen=True)
class Decision:
    """What is decided of one image.

    Attributes:
        estimate: the best pose.
        probability_off: that a contact is off by more than the tolerance, or that it is another object.
        presence: that the object is there and the pose is its own, in the coarse.
        sigma: px, of the worst contact.
        tolerance: px.
        accepted: by the risk that is allowed.
    """

    estimate: PoseEstimate
    probability_off: float
    presence: float
    sigma: float
    tolerance: float
    accepted: bool


def tolerance(area: float, numbers: Numbers) -> float:
    """px by which a contact may be off, for an object of `area` px^2."""
    return max(numbers.tolerance_px, numbers.tolerance * math.sqrt(area))


def evidence(target: Target, estimate: PoseEstimate, numbers: Numbers) -> float:
    """Log-likelihood ratio of an estimate: this object there, partly covered, against something else."""
    return numbers.temper * (texture_evidence(estimate, numbers) + estimate.log_odds)


def texture_evidence(estimate: PoseEstimate, numbers: Numbers) -> float:
    """Log-likelihood ratio of the patches' correlations."""
    r = estimate.correlation[np.isfinite(estimate.correlation)]
    if not len(r):
        return 0.0
    root = math.sqrt(2.0 * math.pi)
    same = np.exp(-0.5 * ((1.0 - r) / numbers.match_spread) ** 2) * 2.0 / (numbers.match_spread * root)
    chance = np.exp(-0.5 * (r / numbers.chance_spread) ** 2) / (numbers.chance_spread * root)
    ratio = np.log((1.0 - numbers.texture_occluded) * same / chance + numbers.texture_occluded)
    return float(ratio.sum()) / numbers.patch_share


def decide(target: Target, estimates: list[PoseEstimate], presence: float, numbers: Numbers) -> Decision | None:
    """The most probable estimate, against the others and against none of them; None where there is none.

    Args:
        target: the object.
        estimates: of one image.
        presence: prior probability that it is there.
        numbers: the core's.
    """
    if not estimates:
        return None
    scores = []
    for e in estimates:
        prior = presence * (1.0 if e.origin in CONTINUOUS else numbers.far)
        scores.append(evidence(target, e, numbers) + math.log(prior))
    best = int(np.argmax(scores))
    chosen = estimates[best]
    allowed = tolerance(chosen.area, numbers)
    others = [math.log(1.0 - presence)]
    for e, score in zip(estimates, scores, strict=True):
        if np.hypot(*(e.contacts - chosen.contacts).T).max() > allowed:
            others.append(score)
    top = max([*others, scores[best]])
    own = math.exp(scores[best] - top)
    p = own / (own + sum(math.exp(o - top) for o in others))
    variance = float(np.linalg.eigvalsh(chosen.covariance)[:, -1].max()) * numbers.inflate**2
    inside = 1.0 - math.exp(-0.5 * allowed**2 / max(variance, 1e-6))
    off = 1.0 - p * inside
    return Decision(chosen, off, p, math.sqrt(variance), allowed, off < numbers.risk)
