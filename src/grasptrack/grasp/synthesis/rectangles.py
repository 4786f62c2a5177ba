# SPDX-License-Identifier: Apache-2.0
"""Fingers as rectangles: where they stand, and whether they are in each other's way."""

from __future__ import annotations

import itertools

import numpy as np

from grasptrack.typing import Bools, Floats


def finger_rectangles(contacts: Floats, directions: Floats, width: float, depth: float) -> Floats:
    """Corners of the rectangles of fingers.

    Args:
        contacts: (..., 2) px, the middle of each pad.
        directions: (..., 2) unit, in which each finger pushes.
        width: px along the pad.
        depth: px behind it.

    Returns:
        (..., 4, 2) px: both ends of the pad, then the far side, going round.
    """
    across = 0.5 * width * np.stack([-directions[..., 1], directions[..., 0]], axis=-1)
    back = contacts - depth * directions
    corners: Floats = np.stack([contacts + across, contacts - across, back - across, back + across], axis=-2)
    return corners


def fingers_overlap(contacts: Floats, directions: Floats, width: float, depth: float) -> Bools:
    """(g,) whether any two fingers of a grasp overlap, by the axes that would separate their rectangles.

    Args:
        contacts: (g, k, 2) px.
        directions: (g, k, 2) unit.
        width: px.
        depth: px.
    """
    clash = np.zeros(len(contacts), dtype=np.bool_)
    middles = contacts - 0.5 * depth * directions
    for i, j in itertools.combinations(range(contacts.shape[1]), 2):
        gap = middles[:, j] - middles[:, i]
        # only what is nearer than two circles round the rectangles can overlap
        near = np.flatnonzero((gap**2).sum(axis=1) < width**2 + depth**2)
        between, u, v = gap[near], directions[near, i], directions[near, j]
        along = np.abs((u * v).sum(axis=1))
        aslant = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        apart = np.zeros(len(near), dtype=np.bool_)
        for axis in (u, v):
            deep = np.abs((between * axis).sum(axis=1))
            wide = np.abs(between[:, 0] * axis[:, 1] - between[:, 1] * axis[:, 0])
            apart |= deep >= 0.5 * (depth + depth * along + width * aslant)
            apart |= wide >= 0.5 * (width + width * along + depth * aslant)
        clash[near] |= ~apart
    return clash
