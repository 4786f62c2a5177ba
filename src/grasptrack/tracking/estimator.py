# SPDX-License-Identifier: Apache-2.0
"""One hypothesis of the pose made exact, with its covariance and the evidence for it (`kernels.PoseTarget.solve`)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Grey, Target

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Hypothesis:
    """Where the object may be.

    Attributes:
        origin: what proposed it, see `ORIGINS` of hypotheses and redetection.
        G: (3, 3) work px -> px.
        P: (8, 8) covariance of its error, work px^2.
        reach: work px within which edges are looked for; 0: by the covariance.
    """

    origin: str
    G: Floats
    P: Floats
    reach: float = 0.0


@dataclass(frozen=True)
class PoseEstimate:
    """A hypothesis made exact.

    Attributes:
        origin: of the hypothesis.
        G, P: pose and covariance.
        contacts: (k, 2) px.
        covariance: (k, 2, 2) px^2 of them, by the model alone.
        area: px^2 of the outline in the image.
        nuisance, nuisance_covariance: (4,), (4, 4) as of `TrackState`.
        sides: likewise; NaN where nothing tells.
        edge_width: work px, standard deviation of an edge at rest; NaN where too few are seen.
        blur_share: half of an edge's blur, of what moved across it since the last image; NaN where too few moved.
        blur: work px, half of what blurs all but a quarter of the edges; NaN where too few are seen.
        edge_share: of the outline's samples whose edge was found; edge_sigma: work px, of their residuals.
        look: grey levels by which the inner side differs from the first view's, median.
        light: gain and bias of the surface's grey levels since the first view.
        correlation: of each patch of the three finest levels; NaN outside the image.
        texture_agreeing: share of the patches that agree with the pose; texture_spread: their errors in predicted sd.
        visible, occluded, other: of each sample of the outline, probabilities.
        log_odds: of the outline, this object against none.
        elsewhere: share of the outline whose edge lies elsewhere.
        other_shape: log-likelihood ratio of another shape; differs: of each sample, probability that the shape differs there.
        middle: (x, y) px of the contacts.
        hidden: share of the outline that is hidden; covered: that, or has its edge elsewhere.
        confirmed: a second solution, from farther away, was no better.
    """

    origin: str
    G: Floats
    P: Floats
    contacts: Floats
    covariance: Floats
    area: float
    nuisance: Floats
    nuisance_covariance: Floats
    sides: float
    edge_width: float
    blur_share: float
    blur: float
    edge_share: float
    edge_sigma: float
    look: float
    light: tuple[float, float]
    correlation: list[Floats]
    texture_agreeing: float
    texture_spread: float
    visible: Floats
    occluded: Floats
    other: Floats
    log_odds: float
    elsewhere: float
    other_shape: float
    differs: Floats
    middle: tuple[float, float]
    hidden: float
    covered: float
    confirmed: bool = False


def middle(points: Floats) -> tuple[float, float]:
    """(x, y) of points (k, 2), number by number: of so few NumPy's calls would cost more."""
    listed = points.tolist()
    return sum(x for x, _ in listed) / len(listed), sum(y for _, y in listed) / len(listed)


UNKNOWN = np.full((3, 3), np.nan)
"""The last pose, where none tells what moved."""
BEGAN = 1.0
"""Half the blur of what began to move since the last image, while the shutter was open all the time: as far as it went."""


def estimate_pose(
    target: Target,
    state: TrackState,
    levels: list[Grey],
    hypothesis: Hypothesis,
    *,
    again: bool = False,
    still: bool = False,
) -> PoseEstimate | None:
    """The pose near a hypothesis that image, prior and camera model agree on; None where there is none.

    Args:
        target, state: of the object.
        levels: the image's pyramid.
        hypothesis: where it may be.
        again: edges may be blurred by all that moved since the last image.
        still: the last pose does not tell what moved since.
    """
    if not is_sane(target, hypothesis.G):
        return None
    found = target.handle.solve(
        levels,
        hypothesis.G,
        hypothesis.P,
        UNKNOWN if still else state.G,
        state.nuisance,
        state.nuisance_covariance,
        state.sides,
        state.inner_spread,
        *state.light,
        hypothesis.reach,
        state.edge_width,
        BEGAN if again else state.blur_share,
    )
    if not found["valid"] or not is_sane(target, found["G"]):
        return None
    G, P = found["G"], found["P"]
    contacts, covariance = target.handle.placed(G, P)
    occluded = found["occluded"]
    hidden = float(occluded.sum()) / len(occluded) if len(occluded) else 0.0
    return PoseEstimate(
        hypothesis.origin,
        G,
        P,
        contacts,
        covariance,
        abs(kernels.seen_area(G, target.outline)),
        found["nuisance"],
        found["nuisance_covariance"],
        found["sides"],
        found["edge_width"],
        found["blur_share"],
        found["blur"],
        found["edge_share"],
        found["edge_sigma"],
        found["look"],
        (found["gain"], found["bias"]),
        found["correlation"],
        found["texture_agreeing"],
        found["texture_spread"],
        found["visible"],
        occluded,
        found["other"],
        found["log_odds"],
        found["elsewhere"],
        found["other_shape"],
        found["differs"],
        middle(contacts),
        hidden,
        hidden + found["elsewhere"],
    )


def lead_alike(target: Target, one: Hypothesis | PoseEstimate, other: Hypothesis | PoseEstimate) -> bool:
    """Whether one of two poses lies within the uncertainty of the other, so that both lead to the same answer."""
    d = target.difference(other.G, one.G)
    return bool(np.isfinite(d).all()) and min(float(d @ np.linalg.solve(P, d)) for P in (other.P, one.P)) < 1.0


def apart(target: Target, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
    """Those that lead elsewhere than the ones before them."""
    kept: list[Hypothesis] = []
    for hypothesis in hypotheses:
        if not any(lead_alike(target, hypothesis, other) for other in kept):
            kept.append(hypothesis)
    return kept


def renamed(estimate: PoseEstimate, origin: str) -> PoseEstimate:
    """The same from elsewhere."""
    return replace(estimate, origin=origin)


SMALLEST, LARGEST = 0.02, 30.0
"""Areas relative to the first view's between which an object is looked for: seven times as far, five times as near."""


def is_sane(target: Target, G: Floats) -> bool:
    """Whether G is a view of the plane's front that keeps the object in front of the camera, at a size to be seen."""
    return SMALLEST < kernels.seen_area(G, target.outline) / target.area < LARGEST
