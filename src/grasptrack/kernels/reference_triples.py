# SPDX-License-Identifier: Apache-2.0
"""Triples of contacts that close while all fingers push toward their mean, or all away from it ([14])."""

from __future__ import annotations

import itertools
import math

import numpy as np

from grasptrack.kernels.reference_wrench import NO_PLANE, ON_PLANE
from grasptrack.typing import Floats, Ints

# Below this a grasp lies too near the edge of closing to be called closed.
LEAST_EPSILON = 1e-6
# Triples looked at together.
CHUNK = 20_000


def closing_triples(
    contacts: Floats, normals: Floats, cx: float, cy: float, rho: float, friction: float
) -> tuple[Ints, Floats, Floats]:
    """All triples in force closure whose friction cones hold the way to the contacts' mean, or all the way from it.

    Args:
        contacts: (n, 2) px.
        normals: (n, 2) unit, into the material.
        cx: px, the point about which torques are taken.
        cy: px.
        rho: px by which torques are divided, above 0.
        friction: coefficient, above 0.

    Returns:
        triples (t, 3), rising; sense (t,), 1 where the fingers push toward the mean (squeeze) and -1 where they
        push away from it (spread); (t,) epsilon as in `force_closure`, above 1e-6.

    Raises:
        ValueError: arrays of different lengths, rho or friction not above 0.
    """
    if len(normals) != len(contacts):
        raise ValueError("each candidate needs its normal")
    if not rho > 0 or not (friction > 0 and math.isfinite(friction)):
        raise ValueError(f"rho and friction must be above 0, not {rho:g} and {friction:g}")
    every = np.array(list(itertools.combinations(range(len(contacts)), 3)), dtype=np.int64).reshape(-1, 3)
    mean = contacts[every].mean(axis=1, keepdims=True)
    way, n = mean - contacts[every], normals[every]
    straight = friction * (n[..., 0] * way[..., 0] + n[..., 1] * way[..., 1])
    aside = np.abs(n[..., 0] * way[..., 1] - n[..., 1] * way[..., 0])
    toward, away = (aside < straight).all(axis=1), (aside < -straight).all(axis=1)
    every, sense = every[toward | away], np.where(toward, 1.0, -1.0)[toward | away]
    epsilon = np.empty(len(every))
    for start in range(0, len(every), CHUNK):
        part = every[start : start + CHUNK]
        epsilon[start : start + CHUNK] = _epsilon_qualities(
            _cone_edge_wrenches((contacts - (cx, cy)) / rho, normals, friction)[part]
        )
    closed = epsilon > LEAST_EPSILON
    return every[closed], sense[closed], epsilon[closed]


def _cone_edge_wrenches(arms: Floats, normals: Floats, friction: float) -> Floats:
    """(n, 2, 3) wrenches of the edges of each contact's friction cone."""
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    forces = np.stack([normals + friction * tangents, normals - friction * tangents], axis=1)
    torque = arms[:, None, 0] * forces[..., 1] - arms[:, None, 1] * forces[..., 0]
    return np.concatenate([forces, torque[..., None]], axis=2)


def _epsilon_qualities(edges: Floats) -> Floats:
    """(t,) what `force_closure` calls epsilon, of grasps given as (t, 3, 2, 3) cone edges."""
    w = edges.transpose(0, 2, 1, 3).reshape(-1, 6, 3)
    scale = np.abs(w).max(axis=(1, 2), initial=0.0)
    depth, flat = np.full(len(w), np.inf), np.zeros(len(w), dtype=np.bool_)
    for i, j, k in itertools.combinations(range(6), 3):
        m = np.cross(w[:, j] - w[:, i], w[:, k] - w[:, i])
        size = np.sqrt(np.einsum("ti,ti->t", m, m))
        plane = size > NO_PLANE * scale * scale
        m = m / np.where(plane, size, 1.0)[:, None]
        heights = np.einsum("tki,ti->tk", w - w[:, i : i + 1], m)
        at = np.einsum("ti,ti->t", w[:, i], m)
        above = (heights > (ON_PLANE * scale)[:, None]).any(axis=1)
        below = (heights < -(ON_PLANE * scale)[:, None]).any(axis=1)
        flat |= plane & ~above & ~below
        depth = np.where(plane & ~above, np.minimum(depth, at), depth)
        depth = np.where(plane & ~below & above, np.minimum(depth, -at), depth)
    return np.where(flat | ~np.isfinite(depth), 0.0, depth)
