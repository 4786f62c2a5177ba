# SPDX-License-Identifier: Apache-2.0
"""What is expected of the pose and allowed by a camera, as normal equations.

Priors, bounded perspective, a pinhole's view of a rigid plane, and what is not known of part and camera.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from grasptrack.typing import Floats
from reference.registration.camera import pinhole_rows
from reference.registration.edges import Light
from reference.registration.pyramid import inverse_definite
from reference.registration.target import Target

NUISANCES = 4
"""What is not known of part and camera: the part's thickness, and theta."""
MOST_THETA = 1.2
"""Of the log of the focal length, and of the normal's slopes: a view beyond it is not believable."""


@dataclass(frozen=True)
class Start:
    """A hypothesis, and what else is known when it is tried.

    Attributes:
        G, P: (3, 3) pose, and (8, 8) covariance of its error, work px^2.
        last: (3, 3) the pose in the image before, for the speed.
        bend: (3, 8) as of `bent`.
        readout: share of the time between two images in which rows are read out, as it is believed.
        nuisance, nuisance_covariance: (4,), (4, 4): the part's thickness in work px, and theta, see `Pinhole`.
        sides: see `EdgeNumbers`.
        inner_spread: grey levels, see `EdgeNumbers`.
        light: of the surface, where it was located last.
        reach: work px within which edges are looked for first; 0: by the covariance.
        edge_width: work px, standard deviation of an edge at rest.
        blur_share: of what moved across an edge since the last image: half of its blur.
    """

    G: Floats
    P: Floats
    last: Floats
    bend: Floats
    readout: float
    nuisance: Floats
    nuisance_covariance: Floats
    sides: float
    inner_spread: np.float64
    light: Light
    reach: float
    edge_width: float
    blur_share: float


@dataclass
class Solution:
    """The pose and its evidence; see `PoseTarget.solve`, which returns the same."""

    valid: bool = False
    G: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    P: Floats = field(default_factory=lambda: np.zeros((8, 8)))
    nuisance: Floats = field(default_factory=lambda: np.zeros(NUISANCES))
    nuisance_covariance: Floats = field(default_factory=lambda: np.zeros((NUISANCES, NUISANCES)))
    readout: float = 0.0
    readout_variance: float = np.inf
    by_readout: Floats = field(default_factory=lambda: np.zeros(8))
    sides: float = np.nan
    light: Light = field(default_factory=lambda: Light(1.0, 0.0))
    edge_width: float = np.nan
    blur_share: float = np.nan
    blur: float = np.nan
    edge_share: float = 0.0
    edge_sigma: float = 0.0
    look: float = 0.0
    texture_used: int = 0
    texture_agreeing: float = 0.0
    texture_spread: float = 0.0
    correlation: list[Floats] = field(default_factory=list)
    visible: Floats = field(default_factory=lambda: np.zeros(0))
    occluded: Floats = field(default_factory=lambda: np.zeros(0))
    other: Floats = field(default_factory=lambda: np.zeros(0))
    log_odds: float = 0.0
    elsewhere: float = 0.0
    astray: float = 0.0
    other_shape: float = 0.0
    differs: Floats = field(default_factory=lambda: np.zeros(0))


@dataclass
class System:
    """Normal equations of the pose's error and of the nuisances, the latter as they are, not their error.

    Attributes:
        A, b: (12, 12), (12,).
        prior, expected: (8, 8), (8,) of them, what was expected of the pose.
    """

    A: Floats
    b: Floats
    prior: Floats
    expected: Floats

    def reduced(self, count: int) -> tuple[Floats, Floats]:
        """The equations of the leading unknowns, the others eliminated: whatever these may be is allowed for."""
        share = np.linalg.solve(self.A[count:, count:], np.column_stack([self.A[count:, :count], self.b[count:]]))
        off = self.A[:count, count:]
        return self.A[:count, :count] - off @ share[:, :-1], self.b[:count] - off @ share[:, -1]

    def add(self, A: Floats, b: Floats) -> None:
        """Rows of the leading unknowns."""
        self.A[: len(b), : len(b)] += A
        self.b[: len(b)] += b


class Beliefs(NamedTuple):
    """What was believed before an image, as information: of the pose (8, 8), and of the nuisances (4, 4)."""

    pose: Floats
    nuisance: Floats


def system_about(
    target: Target,
    start: Start,
    numbers: dict[str, np.float64],
    beliefs: Beliefs,
    size: tuple[float, float],
    G: Floats,
    nuisance: Floats,
) -> System | None:
    """Priors, bounded perspective and pinhole about the pose G and what is taken for the nuisances there."""
    n = numbers
    d = target.difference(start.G, G)
    if d is None:
        return None
    distance = float(d @ beliefs.pose @ d)
    prior = (n["prior_freedom"] + 8.0) / (n["prior_freedom"] + max(8.0, distance)) * beliefs.pose
    A, b = np.zeros((8 + NUISANCES, 8 + NUISANCES)), np.zeros(8 + NUISANCES)
    out = System(A, b, prior, -prior @ d)
    out.add(prior, out.expected)
    A[8:, 8:] += beliefs.nuisance
    b[8:] += beliefs.nuisance @ start.nuisance
    # perspective against the first view, in work px at the half size
    r = target.radius
    z = -(G[2, :2] * r) / (G[2, :2] @ target.centre + G[2, 2]) * r
    information = 1.0 / (n["perspective"] * r) ** 2
    A[[6, 7], [6, 7]] += information
    b[6:8] -= information * z
    # what a readout makes of the pose, no camera that sees all rows at once would show
    pin = pinhole_rows(target, target.moved(G, start.readout * start.bend[0]), nuisance[1:], *size)
    if not pin.valid:
        return out
    # by all unknowns, with the misfit where the nuisances are 0, and where they are as they were believed
    J = np.column_stack([pin.by_pose, np.zeros(2), pin.by_camera])
    rest = pin.misfit - pin.by_camera @ nuisance[1:]
    off = rest + pin.by_camera @ start.nuisance[1:]
    own = n["pinhole_sd"] ** 2
    C = own * np.eye(2) + pin.by_camera @ start.nuisance_covariance[1:, 1:] @ pin.by_camera.T
    (c0, c1), (c2, c3) = C
    far = (off[0] * (c3 * off[0] - c1 * off[1]) + off[1] * (c0 * off[1] - c2 * off[0])) / (c0 * c3 - c1 * c2)
    weight = (n["pinhole_freedom"] + 2.0) / (n["pinhole_freedom"] + max(2.0, float(far))) / own
    A += weight * J.T @ J
    b -= weight * J.T @ rest
    return out


def bounded_nuisance(x: Floats) -> Floats:
    """Thickness and theta (4,) as far as they are believable."""
    return np.concatenate([np.maximum(x[:1], 0.0), np.clip(x[1:], -MOST_THETA, MOST_THETA)])


def beyond_noise(own: Floats, along: Floats, noise: float) -> Floats:
    """(9, 9) by which rows of the edges are to be multiplied from the right, transposed.

    Along a motion under which the outline stays on itself, as a disc turned, exact normals tell nothing; noise in them seems to
    tell all the same (errors in variables). Of information that is so many times that of noise alone, what is beyond counts.

    Args:
        own: (9, 9) the edges' information, of the pose and of the thickness.
        along: (8, 8) the same of motions along the outline.
        noise: rad^2, variance of the normals' directions.
    """
    out = np.eye(9)
    if not (noise > 0.0 and np.isfinite(noise * along).all() and np.isfinite(own).all()):
        return out
    try:
        L = np.linalg.cholesky(noise * along)
    except np.linalg.LinAlgError:
        return out
    inverse = np.linalg.inv(L)
    values, Q = np.linalg.eigh(inverse @ own[:8, :8] @ inverse.T)
    beyond = np.maximum(0.0, 1.0 - 1.0 / np.maximum(values, 1e-12))
    out[:8, :8] = L @ (Q * beyond) @ Q.T @ inverse
    return out


def scatter_of(scores: Floats) -> Floats:
    """(k, k) of scores (n, k) that are correlated with their neighbours along the outline (Newey and West 1987)."""
    lags = max(3, int(0.06 * len(scores)))
    near = sum((1.0 - q / lags) * np.roll(scores, q, axis=0) for q in range(1, lags))
    cross = scores.T @ near
    return np.asarray(scores.T @ scores + cross + cross.T)


def with_correlated(P: Floats, scatter: Floats) -> Floats:
    """A covariance (12, 12) with what correlated residuals of the edges add to it."""
    more = P + P[:, :9] @ scatter @ P[:9]
    return 0.5 * (more + more.T)


def learned_nuisances(system: System, scatter: Floats, radius: float) -> tuple[Floats, Floats] | None:
    """What the image itself tells of the nuisances (4,), and its covariance (4, 4); None where it tells nothing.

    A pose that was expected has what was believed of them in it, which must not confirm itself.
    """
    A, b = system.A.copy(), system.b.copy()
    A[:8, :8] -= system.prior - np.eye(8) / radius**2
    b[:8] -= system.expected
    inverse = inverse_definite(A)
    if inverse is None:
        return None
    return bounded_nuisance((inverse @ b)[8:]), with_correlated(inverse, scatter)[8:, 8:]
