# SPDX-License-Identifier: Apache-2.0
"""Grasps for three fingers on one drive, a third of a turn apart: all three must touch at nearly the same distance.

What `synthesize` finds for three fingers lies at any angles. Here any two contacts, taken as neighbours, say where the hand's
middle is, the apex over them with 120 degrees, and where the third has to be. What is there, if anything, is held against
the same limits and ranked by the same quality as all grasps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.hand import Hand
from grasptrack.grasp.synthesis.candidates import Candidates, sample_candidates
from grasptrack.grasp.synthesis.limits import Limits, reject_infeasible
from grasptrack.grasp.synthesis.search import duplicate_radius, far_enough
from grasptrack.grasp.synthesis.terms import Stable
from grasptrack.kernels.results import RankedCandidates, RankingLimits, WrenchSpace
from grasptrack.typing import Floats, Ints

TOP = 50
MOST = 20_000
"""Triples that are looked at, evenly spread over those that were found: a disc has one for every two of its points."""


class Radial(NamedTuple):
    """What was found.

    Attributes:
        grasps: best first.
        reason: empty where there are grasps, else why not.
    """

    grasps: list[Grasp]
    reason: str


def radial_grasps(view: View, hand: Hand, friction: float, even: float) -> Radial:
    """Grasps that squeeze from outside with three fingers at equal distances and equal angles, ranked as `synthesize` ranks.

    Args:
        view: the object's outline.
        hand: limits; an opening is twice the distance from the middle.
        friction: Coulomb coefficient.
        even: finger widths by which the third contact may be off its place; more finds more grasps that close less evenly.
    """
    area, cx, cy, *_ = kernels.polygon_moments(view.points, view.offsets)
    px = hand.in_px(math.sqrt(area))
    at = sample_candidates(view, area, np.array([cx, cy]), px.finger_width)
    index = even_triples(at, friction, even * px.finger_width, 0.5 * px.max_opening)
    if not len(index):
        return Radial([], f"no three contacts at equal angles and distances close with friction {friction:g}")
    if len(index) > MOST:
        index = index[np.linspace(0, len(index) - 1, MOST).astype(np.int64)]
    rho = 0.5 * at.size
    closure = np.array(
        [kernels.force_closure(at.contacts[i], at.normals[i], cx, cy, rho, friction).epsilon for i in index]
    )
    index, closure = index[closure > 0.0], closure[closure > 0.0]
    found = Stable(at, index, np.ones(len(index)), closure, friction)
    left, refused = reject_infeasible(found, at, view, px, (), Limits())
    if not len(left):
        return Radial([], f"no three contacts for this hand: {next(iter(refused), 'none closes')}")
    chosen, quality, _ = kernels.rank_grasps(
        RankedCandidates(at.contacts, at.normals, at.usable, at.starts, at.steps),
        found.index[left],
        found.strength[left],
        found.terms[left].prod(axis=1),
        WrenchSpace(friction, cx, cy, rho),
        RankingLimits(far_enough(at.size, px.finger_width), duplicate_radius(at.size, px.finger_width), TOP),
    )
    contacts = found.contacts[left[chosen]]
    return Radial([Grasp(c, float(q)) for c, q in zip(contacts, quality, strict=True)], "")


def even_triples(at: Candidates, friction: float, even: float, reach: float) -> Ints:
    """(g, 3) indices of candidates that three such fingers touch from outside, each within its friction cone.

    Args:
        at: the candidates.
        friction: Coulomb coefficient.
        even: px between the third contact and its place, at most.
        reach: px from the middle, at most.
    """
    usable = np.flatnonzero(at.usable & (at.roughness <= Limits().roughness))
    p, n = at.contacts[usable], at.normals[usable]
    if not len(usable):
        return np.zeros((0, 3), dtype=np.int64)
    cone = math.cos(math.atan(friction))
    near, corner, cell = _nearest_point_map(p, even)
    found = []
    for i in range(len(usable)):
        # i, then j a third of a turn further, from x toward y: the middle lies to the left of the way from i to j
        way = p - p[i]
        middle = p[i] + 0.5 * way + np.column_stack([-way[:, 1], way[:, 0]]) / (2.0 * math.sqrt(3.0))
        into = middle - p[i]
        radius = np.hypot(into[:, 0], into[:, 1])
        fits = (radius > 0.0) & (radius <= reach)
        fits &= into @ n[i] > cone * radius
        fits &= ((middle - p) * n).sum(axis=1) > cone * radius
        j = np.flatnonzero(fits)
        if not len(j):
            continue
        third = 3.0 * middle[j] - p[i] - p[j]  # the mean of all three is the middle
        where = np.rint((third - corner) / cell).astype(np.int64)
        inside = ((where >= 0) & (where < near.shape)).all(axis=1)
        j, third, where = j[inside], third[inside], where[inside]
        k = near[where[:, 0], where[:, 1]]
        into = middle[j] - p[k]
        ok = (k >= 0) & (np.hypot(*(third - p[k]).T) <= even)
        ok &= (into * n[k]).sum(axis=1) > cone * np.hypot(into[:, 0], into[:, 1])
        found.append(np.column_stack([np.full(int(ok.sum()), i), j[ok], k[ok]]))
    if not found:
        return np.zeros((0, 3), dtype=np.int64)
    triples = np.unique(np.sort(np.concatenate(found), axis=1), axis=0)
    return np.asarray(usable[triples], dtype=np.int64)


def _nearest_point_map(points: Floats, within: float) -> tuple[Ints, Floats, float]:
    """A map of which point is nearest, -1 where none is within reach; the place of its first cell, and a cell's side in px."""
    cell, steps = within / 4.0, 5
    corner = points.min(axis=0) - (steps + 1) * cell
    home = np.rint((points - corner) / cell).astype(np.int64)
    around = np.stack(np.meshgrid(*2 * [np.arange(-steps, steps + 1)], indexing="ij"), axis=-1).reshape(-1, 2)
    cells = (home[:, None] + around[None]).reshape(-1, 2)
    owner = np.repeat(np.arange(len(points)), len(around))
    off = np.hypot(*(corner + cell * cells - points[owner]).T)
    order = np.argsort(-off, kind="stable")  # the nearest is written last
    near = np.full(home.max(axis=0) + steps + 2, -1, dtype=np.int64)
    near[cells[order, 0], cells[order, 1]] = owner[order]
    return near, corner, cell
