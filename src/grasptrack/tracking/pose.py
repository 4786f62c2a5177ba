# SPDX-License-Identifier: Apache-2.0
"""Poses: where the object may be, what an image makes of that, and how far apart two of them are."""

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.equality import compared_by_value
from grasptrack.geometry.homographies import HORIZON, MOTIONS, homography_jacobian, similarity_transform
from grasptrack.kernels import PoseEstimate as PoseEstimate
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.target import Grey, Target
from grasptrack.typing import Floats

CONTINUOUS = ("texture", "background", "at rest", "moving on")
"""Origins of hypotheses that continue what was."""
TURNED, TRIED = "turned", "tried turn"
"""Origins of a hypothesis that lays the outline on itself in another way, and of one that holes may tell from it."""
SMALLEST_AREA, LARGEST_AREA = 0.02, 30.0
"""Areas relative to the first view's between which an object is looked for: seven times as far, five times as near."""
STEP = 1e-6
"""Of what a similarity changes, for its derivatives."""
PLACE_FREEDOMS = 4.0
"""Of an object in its plane: place, turn and size."""
SAME_PLACE = 0.5
"""Share of sqrt(area) within which two poses lie in one place."""


@dataclass(frozen=True)
class Look:
    """An image in which the object was located, or looked for.

    Attributes:
        levels: the image and its halves.
        G: (3, 3) work px -> px.
    """

    levels: list[Grey]
    G: Floats


@compared_by_value
@dataclass(frozen=True)
class Hypothesis:
    """Where the object may be.

    Attributes:
        origin: what proposed it, one of `CONTINUOUS` or of redetection.
        G: (3, 3) work px -> px.
        P: (8, 8) covariance of its error, work px^2.
        reach: work px within which edges are looked for; 0: by the covariance.
    """

    origin: str
    G: Floats
    P: Floats
    reach: float = 0.0


def changed_estimate(estimate: PoseEstimate, *, origin: str | None = None, confirmed: bool = False) -> PoseEstimate:
    """The same from elsewhere, or confirmed."""
    other = copy.copy(estimate)
    other.origin = origin or other.origin
    other.confirmed |= confirmed
    return other


def mixed_estimate(target: Target, estimates: Sequence[PoseEstimate], evidence: Sequence[float]) -> PoseEstimate:
    """The one of some estimates for which there is most evidence, nats, with the covariances of the mixture of all."""
    weights = np.exp(np.array(evidence) - max(evidence))
    best, P = estimates[int(weights.argmax())], np.zeros((8, 8))
    for e, weight in zip(estimates, weights / weights.sum(), strict=True):
        d = target.pose_difference(best.G, e.G)
        P += weight * (e.P + np.outer(d, d))
    found: PoseEstimate = target.handle.known_by(best, P, best.beforehand)
    return found


def image_information(estimate: PoseEstimate) -> Floats:
    """(8, 8) what the image alone tells of a pose's error, 1 / work px^2, without what was known beforehand."""
    told, axes = np.linalg.eigh(np.linalg.inv(estimate.P) - estimate.beforehand)
    return np.asarray((axes * told.clip(0.0)) @ axes.T)


def known_by_image(target: Target, estimate: PoseEstimate, instead: Floats) -> PoseEstimate:
    """An estimate as exact as the image makes it beside what is known instead (8, 8) of what was known beforehand."""
    beforehand = np.linalg.inv(instead) + target.agreed
    P = np.linalg.inv(image_information(estimate) + beforehand)
    found: PoseEstimate = target.handle.known_by(estimate, P, beforehand)
    return found


def is_at(estimate: PoseEstimate, place: tuple[float, float], share: float = SAME_PLACE) -> bool:
    """Whether an estimate lies within a share of sqrt(area) of a place (x, y) px."""
    return math.dist(estimate.middle, place) < share * math.sqrt(estimate.area)


class FixedMarks(NamedTuple):
    """What may be fixed in the image, as a crosshair or dirt on the lens, and was taken for an object's surface.

    Attributes:
        G: (3, 3) the pose at which they show that surface.
        object_pose: (3, 3) where the object itself is, by its outline or the ground; None where neither tells it.
        still: they stood still while the object moved on.
        left: (x, y) px by which the ground has moved on there since.
    """

    G: Floats
    object_pose: Floats | None
    still: bool
    left: tuple[float, float] = (0.0, 0.0)


def lead_alike(target: Target, one: Hypothesis | PoseEstimate, other: Hypothesis | PoseEstimate) -> bool:
    """Whether one of two poses lies within the uncertainty of the other, so that both lead to the same answer."""
    d = target.pose_difference(other.G, one.G)
    return bool(np.isfinite(d).all()) and min(float(d @ np.linalg.solve(P, d)) for P in (other.P, one.P)) < 1.0


def similarity_is_enough(target: Target, start: Floats, G: Floats, P: Floats) -> bool:
    """Whether the motion from one pose to another is of 4 DoF, as far as the second is known.

    What the similarity that comes nearest misses is no more than noise makes of a similarity but for the risk: chi-squared with
    the four freedoms that a homography has beyond it.

    Args:
        target: the object.
        start: (3, 3) the pose from which it moved.
        G: (3, 3) the pose to which it did.
        P: (8, 8) covariance of the error of G, work px^2.
    """
    H, before = G @ np.linalg.inv(start), mean_point(carried_in_front(start, target.centre[None]))
    a, b, c, d = homography_jacobian(H, *before)
    after = mean_point(carried_in_front(H, np.array([before])))
    near = similarity_transform(0.5 * math.hypot(a + d, c - b), math.atan2(c - b, a + d), before, after)
    missed = target.pose_difference(near @ start, G)
    freedoms = [target.pose_difference(near @ start, (np.eye(3) + STEP * M) @ near @ start) for M in MOTIONS[:4]]
    J = np.column_stack([missed, *freedoms])
    A = J.T @ np.linalg.solve(P, J)
    squared = float(A[0, 0] - A[0, 1:] @ np.linalg.solve(A[1:, 1:], A[1:, 0]))
    return math.exp(-0.5 * squared) * (1.0 + 0.5 * squared) >= target.numbers.risk


def distinct_hypotheses(target: Target, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
    """Those that lead elsewhere than the ones before them."""
    kept: list[Hypothesis] = []
    for hypothesis in hypotheses:
        if not any(lead_alike(target, hypothesis, other) for other in kept):
            kept.append(hypothesis)
    return kept


def sane_area(target: Target, G: Floats) -> float:
    """px^2 of the outline; 0 unless G is a view of the plane's front, before the camera, at a size to be seen."""
    area = kernels.seen_area(G, target.outline)
    return area if SMALLEST_AREA < area / target.area < LARGEST_AREA else 0.0


def carried_in_front(G: Floats, points: Floats) -> Floats:
    """(n, 2) px where a pose G (3, 3) has points (n, 2) work px; NaN of those that are not before the camera."""
    w = points @ G[2, :2] + G[2, 2]
    scale = np.where(w > HORIZON, w, np.nan)
    return np.asarray((points @ G[:2, :2].T + G[:2, 2]) / scale[:, None], dtype=np.float64)


def share_in_view(G: Floats, points: Floats, grey: Grey) -> float:
    """Share of points (n, 2) work px that lie in an image (H, W), seen through a pose G (3, 3)."""
    height, width = grey.shape
    x, y = carried_in_front(G, points).T
    return float(((x >= 0.0) & (x <= width - 1.0) & (y >= 0.0) & (y <= height - 1.0)).mean())


def mean_point(points: Floats) -> tuple[float, float]:
    """(x, y) of points (k, 2), number by number: of so few NumPy's calls would cost more."""
    x = y = 0.0
    for u, v in points.tolist():
        x, y = x + u, y + v
    return x / len(points), y / len(points)


def max_contact_distance(contacts: Floats, others: Floats) -> float:
    """px between contacts (k, 2) where they are farthest apart."""
    return max(math.hypot(x, y) for x, y in (contacts - others).tolist())


def worst_variance(covariance: Floats) -> float:
    """px^2 of the worst of some places in its worst direction, of their covariances (k, 2, 2)."""
    axes = [0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy) for (xx, xy), (_, yy) in covariance.tolist()]
    return float(max(axes))


def contact_tolerance(area: float, numbers: Numbers) -> float:
    """px by which a contact may be off, for an object of `area` px^2."""
    return max(numbers.tolerance_px, numbers.tolerance * math.sqrt(area))


def largest_sigma(area: float, numbers: Numbers) -> float:
    """px, the standard deviation from which on a contact of an object of `area` px^2 is not believed."""
    return contact_tolerance(area, numbers) / math.sqrt(-2.0 * math.log(numbers.risk))
