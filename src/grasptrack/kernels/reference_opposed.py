# SPDX-License-Identifier: Apache-2.0
"""Pairs of contacts whose friction cones hold the line between them ([10], [12])."""

from __future__ import annotations

import math

import numpy as np

from grasptrack.typing import Floats, Ints

# Of the friction: a contact on the edge of its cone is not stable.
STRICTLY = 1 - 1e-6


def opposed_pairs(
    contacts: Floats, normals: Floats, worth: Floats, group: int, friction: float
) -> tuple[Ints, Floats, Floats]:
    """For every two groups of candidates the best pair whose line lies strictly in both friction cones.

    Neighbouring candidates form a group, so that a pair that closes only in a narrow place is found, and yet no more
    pairs are returned than groups allow. The best has the largest share of friction left, times the squared lesser
    worth of its two contacts.

    Args:
        contacts: (m, 2) px, m a multiple of `group`.
        normals: (m, 2) unit, into the material.
        worth: (m,) above 0; a candidate without worth is left out.
        group: candidates in a group, those next to each other.
        friction: coefficient, above 0.

    Returns:
        pairs (p, 2), first below second, sorted by group; sense (p,), 1 where the normals face each other (squeeze)
        and -1 where they face away (spread); (p,) friction that each pair needs.

    Raises:
        ValueError: arrays of different lengths, groups that do not fit, or friction not above 0.
    """
    m = len(contacts)
    if len(normals) != m or len(worth) != m:
        raise ValueError("each candidate needs its normal and its worth")
    if group < 1 or m % group:
        raise ValueError("candidates must fill their groups")
    if not (friction > 0 and math.isfinite(friction)):
        raise ValueError(f"friction must be above 0, not {friction:g}")
    pairs, senses, needs = [], [], []
    order = np.arange(m)
    for start in range(0, m, group):
        own, rest = order[start : start + group], order[start:]
        d = contacts[rest][None] - contacts[own][:, None]
        na, nb = normals[own][:, None], normals[rest][None]
        p = na[..., 0] * d[..., 0] + na[..., 1] * d[..., 1]
        q = -(nb[..., 0] * d[..., 0] + nb[..., 1] * d[..., 1])
        facing = ((p > 0) & (q > 0)) | ((p < 0) & (q < 0))
        with np.errstate(divide="ignore", invalid="ignore"):
            at_a = np.abs((na[..., 0] * d[..., 1] - na[..., 1] * d[..., 0]) / p)
            at_b = np.abs((nb[..., 0] * d[..., 1] - nb[..., 1] * d[..., 0]) / q)
        need = np.where(facing, np.maximum(at_a, at_b), np.inf)
        least = np.minimum(worth[own][:, None], worth[rest][None])
        good = (need < friction * STRICTLY) & (least > 0) & (rest[None] > own[:, None])
        score = np.where(good, (1 - np.where(good, need, 0.0) / friction) * (least * least), 0.0)
        cells = score.reshape(group, -1, group).transpose(1, 0, 2).reshape(-1, group * group)
        best = cells.argmax(axis=1)
        hit = np.flatnonzero(cells[np.arange(len(cells)), best] > 0)
        i, j = best[hit] // group, hit * group + best[hit] % group
        pairs.append(np.column_stack([own[i], rest[j]]))
        senses.append(np.where(p[i, j] > 0, 1.0, -1.0))
        needs.append(need[i, j])
    if not pairs:
        return np.empty((0, 2), dtype=np.int64), np.empty(0), np.empty(0)
    return np.concatenate(pairs).astype(np.int64), np.concatenate(senses), np.concatenate(needs)
