# SPDX-License-Identifier: Apache-2.0
"""Force closure: the convex hull of the contact wrenches, and the friction that it takes ([12], [14])."""

from __future__ import annotations

import itertools
import math

import numpy as np

from grasptrack.typing import Floats

# Relative to the largest wrench: distance from a plane that counts as on it, and a triple without a plane.
ON_PLANE = 1e-12
NO_PLANE = 1e-9
MAX_CONTACTS = 8


def _cone_edge_wrenches(arms: Floats, normals: Floats, along: float, across: float) -> Floats:
    """(2k, 3) edges of the friction cones, force n * along +- t * across, and torque / rho."""
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    forces = np.concatenate([along * normals + across * tangents, along * normals - across * tangents])
    both = np.concatenate([arms, arms])
    return np.column_stack([forces, both[:, 0] * forces[:, 1] - both[:, 1] * forces[:, 0]])


def _epsilon_quality(w: Floats) -> float:
    """Signed distance of the origin from the nearest facet of the hull of w, positive inside; 0 where it is flat."""
    scale = float(np.abs(w).max())
    if scale == 0:
        return 0.0
    depth = math.inf
    for i, j, k in itertools.combinations(range(len(w)), 3):
        m = np.cross(w[j] - w[i], w[k] - w[i])
        size = float(np.sqrt(m @ m))
        if size <= NO_PLANE * scale * scale:
            continue
        m = m / size
        heights = (w - w[i]) @ m
        at = float(w[i] @ m)
        above, below = bool((heights > ON_PLANE * scale).any()), bool((heights < -ON_PLANE * scale).any())
        if not above and not below:
            return 0.0
        if not above:
            depth = min(depth, at)
        elif not below:
            depth = min(depth, -at)
    return depth if math.isfinite(depth) else 0.0


def _angle_between(a: Floats, b: Floats) -> float:
    return abs(math.atan2(a[0] * b[1] - a[1] * b[0], a @ b))


def _friction_angle(contacts: Floats, normals: Floats, arms: Floats) -> float:
    if len(contacts) == 2:
        d = contacts[1] - contacts[0]
        if not d.any():
            return math.pi / 2
        squeeze = max(_angle_between(normals[0], d), _angle_between(normals[1], -d))
        spread = max(_angle_between(normals[0], -d), _angle_between(normals[1], d))
        return min(squeeze, spread, math.pi / 2)

    def closes(angle: float) -> bool:
        return _epsilon_quality(_cone_edge_wrenches(arms, normals, math.cos(angle), math.sin(angle))) > ON_PLANE

    low, high = 0.0, math.pi / 2 - 1e-9
    if closes(low):
        return 0.0
    if not closes(high):
        return math.pi / 2
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if closes(middle) else (middle, high)
    return high


def force_closure(
    contacts: Floats, normals: Floats, cx: float, cy: float, rho: float, friction: float
) -> tuple[float, float]:
    """Ferrari and Canny's epsilon of a grasp, and the smallest friction angle with which it closes.

    The edges of the cones are n +- friction * t with a normal component of 1, so that the hull grows with friction.

    Args:
        contacts: (k, 2) px, 2 <= k <= 8.
        normals: (k, 2) unit, into the material.
        cx: px, the point about which torques are taken.
        cy: px.
        rho: px by which torques are divided, above 0.
        friction: coefficient, at least 0.

    Returns:
        epsilon, the radius of the largest ball about the origin in the hull of the wrenches (L1), negative where the
        origin is outside (the most violated facet) and 0 where the hull is flat; friction_angle in rad, pi/2 where no
        friction closes the grasp. Two contacts close when both cones strictly hold the line between them, the
        normals facing each other or facing away.

    Raises:
        ValueError: fewer than 2 or more than 8 contacts, rho not above 0 or friction below 0.
    """
    k = len(contacts)
    if not 2 <= k <= MAX_CONTACTS or len(normals) != k:
        raise ValueError(f"force closure takes 2 to {MAX_CONTACTS} contacts, each with its normal, not {k}")
    if not rho > 0 or not friction >= 0:
        raise ValueError(f"rho must be above 0 and friction at least 0, not {rho:g} and {friction:g}")
    arms = (contacts - (cx, cy)) / rho
    return _epsilon_quality(_cone_edge_wrenches(arms, normals, 1.0, friction)), _friction_angle(contacts, normals, arms)
