# SPDX-License-Identifier: Apache-2.0
"""Regions of three contacts and more, from the hull of their wrenches (Ferrari and Canny's epsilon)."""

from __future__ import annotations

import itertools
import math

import numpy as np

from grasptrack.grasp.contact_regions.growth import Ends, grow_box
from grasptrack.grasp.contact_regions.slips import SAMPLES
from grasptrack.typing import Bools, Floats

COARSE = 6
"""Every so many places are tried together with those of the other contacts."""
_FACETS = np.array(list(itertools.combinations(range(6), 3)))
_FLAT = 1e-12


def of_more(edges: list[Floats], usable: list[Bools]) -> list[tuple[int, int]] | None:
    """Places back and ahead of each contact, or None where the grasp itself does not close.

    Args:
        edges: for each contact (m, 2, 3) the edges of its cone at each place, the contact's own in the middle.
        usable: for each (m,) where it may be.
    """
    here = np.concatenate([e[SAMPLES] for e in edges])
    epsilon = float(epsilon_quality(here[None])[0])
    if epsilon <= 0.0:
        return None
    alone = [_places_within_epsilon(e, u, epsilon) for e, u in zip(edges, usable, strict=True)]
    if len(edges) != 3:
        return alone
    box = [(COARSE * back, COARSE * ahead) for back, ahead in _grow_coarse_box(edges, usable)]
    return box if _box_volume(box) > _box_volume(alone) else alone


def _box_volume(box: list[tuple[int, int]]) -> float:
    """The volume of a box, its sides in units in which places lie as their squares."""
    return math.prod(back**2 + ahead**2 for back, ahead in box)


def epsilon_quality(wrenches: Floats) -> Floats:
    """(n,) radius of the largest ball about the origin in the hulls of wrenches (n, m, 3); 0 or less where it is outside."""
    m = wrenches.shape[1]
    facets = _FACETS if m == 6 else np.array(list(itertools.combinations(range(m), 3)))
    a, b, c = (wrenches[:, facets[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    length = np.sqrt((normal * normal).sum(axis=2))
    scale = np.abs(wrenches).max(axis=(1, 2))[:, None]
    good = length > 1e-9 * scale * scale
    normal /= np.where(good, length, 1.0)[..., None]
    at = (normal * a).sum(axis=2)
    heights = normal @ np.swapaxes(wrenches, 1, 2) - at[..., None]
    above, below = (heights > _FLAT * scale[..., None]).any(axis=2), (heights < -_FLAT * scale[..., None]).any(axis=2)
    far = np.where(above & below | ~good, np.inf, np.where(above, -at, at))
    far = np.where(good & ~above & ~below, 0.0, far)
    nearest = far.min(axis=1)
    return np.asarray(np.where(np.isfinite(nearest), nearest, 0.0))


def _places_within_epsilon(edges: Floats, usable: Bools, epsilon: float) -> tuple[int, int]:
    """How many places back and ahead no edge of the cone moves by epsilon."""
    moved = _cone_edge_distances(edges, edges[SAMPLES])
    step = _cone_edge_distances(edges[1:], edges[:-1])
    bad = ~usable
    bad[1:] |= moved[1:] + step >= epsilon
    bad[:-1] |= moved[:-1] + step >= epsilon
    return _count_leading_good(bad[SAMPLES - 1 :: -1]), _count_leading_good(bad[SAMPLES + 1 :])


def _grow_coarse_box(edges: list[Floats], usable: list[Bools]) -> list[tuple[int, int]]:
    """A box, in coarse places: at each corner of its grid the ball is larger than what moves half way to the next."""
    middle = SAMPLES // COARSE
    few = [e[::COARSE] for e in edges]
    room = [_edge_motion_bounds(e, u) for e, u in zip(edges, usable, strict=True)]

    def closes(contact: int, at: int, ends: Ends) -> bool:
        spans = [np.arange(middle - back, middle + ahead + 1) for back, ahead in ends]
        spans[contact] = np.array([middle + at])
        i, j, k = (axis.ravel() for axis in np.meshgrid(*spans, indexing="ij"))
        most = np.maximum(np.maximum(room[0][i], room[1][j]), room[2][k])
        if not np.isfinite(most).all():
            return False
        return bool((epsilon_quality(np.concatenate([few[0][i], few[1][j], few[2][k]], axis=1)) > most).all())

    if not closes(0, 0, [(0, 0)] * 3):
        return [(0, 0)] * 3
    return grow_box(3, middle, closes)


def _edge_motion_bounds(edges: Floats, usable: Bools) -> Floats:
    """By how much an edge moves at most half way to the next coarse places; infinite where one of these is not usable."""
    step = _cone_edge_distances(edges[1:], edges[:-1])
    half = COARSE // 2
    room = np.zeros(2 * (SAMPLES // COARSE) + 1)
    for c in range(len(room)):
        at = COARSE * c
        low, high = max(at - half, 0), min(at + half, len(edges) - 1)
        moved = _cone_edge_distances(edges[low : high + 1], edges[at])
        room[c] = float(moved.max()) + float(step[low:high].max()) if usable[low : high + 1].all() else math.inf
    return room


def _cone_edge_distances(a: Floats, b: Floats) -> Floats:
    """(m,) the larger distance between corresponding edges."""
    return np.asarray(np.sqrt(((a - b) ** 2).sum(axis=-1).max(axis=-1)))


def _count_leading_good(bad: Bools) -> int:
    return int(bad.argmax()) if bad.any() else len(bad)
