# SPDX-License-Identifier: Apache-2.0
"""The best of many grasps, none near another."""

from __future__ import annotations

import heapq
import itertools
import math

import numpy as np

from grasptrack.kernels.reference_regions import Along
from grasptrack.typing import Bools, Floats, Ints


def rank_grasps(
    contacts: Floats,
    normals: Floats,
    usable: Bools,
    starts: Ints,
    steps: Floats,
    grasps: Ints,
    strength: Floats,
    bound: Floats,
    friction: float,
    cx: float,
    cy: float,
    rho: float,
    most: float,
    gap: float,
    top: int,
) -> tuple[Ints, Floats, Floats]:
    """The best grasps, each unlike all better ones, with the regions in which their contacts may slip.

    A grasp's quality is its bound times its room, 0.2 + 0.8 sqrt(r / most) for the least half-length r of its regions.
    Regions are found in the order of the bounds and only as long as they can matter, which leaves the order exact.
    Grasps are alike when, in some order, each contact of one lies nearer than `gap` to one of the other.

    Args:
        contacts: (m, 2) px, evenly spaced along closed contours.
        normals: (m, 2) unit, into the material.
        usable: (m,) False where no contact may slip to.
        starts: (C + 1,) contour c holds the candidates ``starts[c]:starts[c + 1]``.
        steps: (C,) px of arc length between them.
        grasps: (g, 2) or (g, 3) indices of contacts; each grasp closes.
        strength: (g,) the friction that a pair needs, the epsilon of a triple.
        bound: (g,) at least 0.
        friction: coefficient.
        cx: px, the point about which torques are taken.
        cy: px.
        rho: px by which torques are divided.
        most: px, the largest half-length.
        gap: px.
        top: at most so many.

    Returns:
        indices (n,) of the chosen grasps, best first; their quality (n,); half-lengths (n, fingers) in px.

    Raises:
        ValueError: arrays that do not belong together, indices out of range, or a quantity out of range.
    """
    m, (count, fingers) = len(contacts), grasps.shape
    if len(normals) != m or len(usable) != m:
        raise ValueError("each candidate needs its normal and its flag")
    if len(starts) < 2 or starts[0] != 0 or starts[-1] != m or (np.diff(starts) <= 0).any():
        raise ValueError("offsets must rise from 0 to the number of points")
    if len(steps) + 1 != len(starts):
        raise ValueError("each contour needs its step")
    if fingers not in (2, 3) or len(strength) != count or len(bound) != count:
        raise ValueError("grasps have 2 or 3 contacts, each grasp its strength and its bound")
    if count and (grasps.min() < 0 or grasps.max() >= m):
        raise ValueError("index out of range")
    if not (friction > 0 and rho > 0 and most > 0 and gap >= 0 and top >= 0):
        raise ValueError("friction, rho and most must be above 0, gap and top at least 0")
    along = Along(contacts, normals, usable, starts, steps, friction, (cx, cy), rho)
    queue: list[tuple[float, bool, int, list[float]]] = [(-float(b), False, g, []) for g, b in enumerate(bound)]
    heapq.heapify(queue)
    chosen: list[tuple[int, float, list[float]]] = []
    held = np.empty((0, fingers, 2))
    orders = [list(order) for order in itertools.permutations(range(fingers))]
    while queue and len(chosen) < top:
        lost, exact, g, regions = heapq.heappop(queue)
        at = contacts[grasps[g]]
        away = [np.hypot(*(held[:, order] - at).T).max(axis=0, initial=0.0) for order in orders]
        if any((far < gap).any() for far in away):
            continue
        if exact:
            chosen.append((g, -lost, regions))
            held = np.concatenate([held, at[None]])
            continue
        if fingers == 2:
            regions = [along.pair(int(grasps[g, 0]), int(grasps[g, 1]), float(strength[g]), most)] * 2
        else:
            regions = [along.one_of_three(int(i), float(strength[g]), most) for i in grasps[g]]
        quality = -lost * (0.2 + 0.8 * math.sqrt(min(min(regions) / most, 1.0)))
        heapq.heappush(queue, (-quality, True, g, regions))
    return (
        np.array([g for g, _, _ in chosen], dtype=np.int64),
        np.array([q for _, q, _ in chosen], dtype=np.float64),
        np.array([r for _, _, r in chosen], dtype=np.float64).reshape(-1, fingers),
    )
