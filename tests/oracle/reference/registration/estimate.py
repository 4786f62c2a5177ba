# SPDX-License-Identifier: Apache-2.0
"""What is told of a pose and its covariance."""

from collections.abc import Sequence

import numpy as np

from grasptrack.kernels.results import FusedPose, PlacedContacts, SurfaceEvidence
from grasptrack.typing import Floats
from reference.registration.pyramid import homography_derivatives, inverse_definite, transform_points
from reference.registration.target import Target

BEFORE = 1e-6
"""Of eq. (2)'s lambda: from here on a point lies before the camera."""


def seen_area(G: Floats, points: Floats) -> float:
    G, points = np.asarray(G, dtype=np.float64).reshape(3, 3), np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError("points are of shape (N, 2)")
    if not np.isfinite(G).all() or not (points @ G[2, :2] + G[2, 2] > BEFORE).all():
        return float("nan")
    if not len(points):
        return 0.0
    x, y = transform_points(G, *points.T)
    x, y = x - x[0], y - y[0]
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def surface_evidence(
    correlation: Sequence[Floats],
    usual: Sequence[Floats],
    shares: Floats,
    log_prior: Floats,
    match_spread: float,
    chance_spread: float,
    independent: float,
) -> SurfaceEvidence:
    if len(log_prior) != len(shares):
        raise ValueError("each share needs its prior")
    if [len(r) for r in correlation] != [len(u) for u in usual]:
        raise ValueError("each correlation needs what is usual")
    odds, by_share = 0.0, np.zeros(len(shares))
    for r, u in zip(correlation, usual, strict=True):
        seen = np.isfinite(r)
        if not len(shares) or not seen.any():  # tells nothing at all, not what rounding leaves of a sum of 1
            continue
        level = _level_evidence(r[seen], u[seen], shares, match_spread, chance_spread) / independent
        by_share += level
        odds += float(np.logaddexp.reduce(level + log_prior))
    return SurfaceEvidence(odds, by_share)


def surface_probability(
    correlation: Sequence[Floats], usual: Sequence[Floats], match_spread: float, chance_spread: float
) -> list[Floats]:
    if [len(r) for r in correlation] != [len(u) for u in usual]:
        raise ValueError("each correlation needs what is usual")
    return [_own_probability(r, u, match_spread, chance_spread) for r, u in zip(correlation, usual, strict=True)]


def _own_probability(r: Floats, usual: Floats, match_spread: float, chance_spread: float) -> Floats:
    u = np.clip(usual, 0.0, 1.0)
    variance = u**2 * match_spread**2 + (1.0 - u**2) * chance_spread**2
    odds = chance_spread / np.sqrt(variance) * np.exp(0.5 * (r**2 / chance_spread**2 - (r - u) ** 2 / variance))
    seen, share = odds[np.isfinite(odds)], 0.5
    for _ in range(4 if len(seen) else 0):
        share = float((share * seen / (share * seen + 1.0 - share)).mean())
    return np.asarray(share * odds / (share * odds + 1.0 - share))


def _level_evidence(r: Floats, usual: Floats, shares: Floats, match_spread: float, chance_spread: float) -> Floats:
    """(m,) of one level, all of whose patches are seen, each counting."""
    usual = np.clip(usual, 0.0, 1.0)
    # what usually agrees little may agree by chance today, and not tomorrow
    spread = np.sqrt(usual**2 * match_spread * match_spread + (1.0 - usual**2) * chance_spread * chance_spread)
    ratio = (chance_spread / spread) * np.exp(0.5 * ((r / chance_spread) ** 2 - ((r - usual) / spread) ** 2))
    return np.asarray(np.log((1.0 - shares[:, None]) * ratio + shares[:, None]).sum(axis=1))


def project_contacts(target: Target, G: Floats, P: Floats) -> PlacedContacts:
    """(k, 2) px, the contacts seen through G (3, 3), (k, 2, 2) px^2 by its error's covariance P (8, 8), and their middle."""
    x, y = target.contacts.T
    D = np.stack(homography_derivatives(G, x, y), axis=1).reshape(-1, 2, 2)
    K = D @ target.jacobian(target.contacts)
    at = np.column_stack(transform_points(G, x, y))
    u, v = at.mean(axis=0).tolist()
    return PlacedContacts(at, K @ P @ K.transpose(0, 2, 1), (u, v))


def fuse_predictions(target: Target, G: Floats, P: Floats, other: Floats, Q: Floats) -> FusedPose:
    """Two independent predictions of a pose, (3, 3) and (8, 8) each, as one.

    Returns:
        Their squared Mahalanobis distance, infinite where they have none; pose and covariance, the first ones then.
    """
    d, inverse = target.difference(G, other), inverse_definite(P + Q)
    if d is None or inverse is None:
        return FusedPose(float("inf"), G, P)
    gain = P @ inverse
    less = P - gain @ P
    return FusedPose(float(d @ inverse @ d), target.moved(G, gain @ d), 0.5 * (less + less.T))
