# SPDX-License-Identifier: Apache-2.0
"""From an outline to its list of grasps: candidates, what the hand refuses, the order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.geometry.contours import Outline, View
from grasptrack.grasp.contacts import GraspList, RankedGrasp, Terms
from grasptrack.grasp.force_closure import ForceClosure
from grasptrack.grasp.hand import Hand, HandPx
from grasptrack.grasp.synthesis.candidates import Candidates, Stable, sample_candidates, stable_pairs, stable_triples
from grasptrack.grasp.synthesis.limits import Tried, UnevennessLimits, finger_rectangles, reject_infeasible, why_none
from grasptrack.kernels.results import RankedCandidates, RankingLimits, WrenchSpace
from grasptrack.typing import Floats, Ints

DISTINCT = 0.12
"""Grasps whose contacts all lie within this fraction of sqrt(area), or a finger's width, of a better one's are alike."""

FIRST_LOOK, SECOND_LOOK = 48, 144
"""Candidates for triples, of which there are n^3 / 6; more of them where the first leave nothing."""
SCARCE = 2000
"""So many stable triples that a second look would hardly find what a hand refused of all of them."""


class _Look(NamedTuple):
    """What a search for one hand found."""

    at: Candidates
    found: Stable
    left: Ints
    refused: dict[str, int]


class AskedGrasps(NamedTuple):
    """What is asked for: the hand's fingers, the friction, how many grasps at most."""

    fingers: int
    friction: float
    top: int


def find_grasps(
    view: View, asked: AskedGrasps, hand: Hand, neighbours: Sequence[Outline], limits: UnevennessLimits
) -> GraspList:
    """As `synthesize`, with the limits on how uneven the outline under a finger may be."""
    fingers, friction, top = asked
    area, cx, cy, *_ = kernels.polygon_moments(view.points, view.offsets)
    px = hand.in_px(math.sqrt(area))

    def search_at_size(size: HandPx) -> _Look:
        at = sample_candidates(view, area, np.array([cx, cy]), size.finger_width)
        found = _stable_candidates(at, fingers, friction)
        left, refused = reject_infeasible(found, at, view, size, neighbours, limits)
        if fingers == 3 and not len(left) and len(found) < SCARCE:
            found = stable_triples(at, friction, SECOND_LOOK)
            left, refused = reject_infeasible(found, at, view, size, neighbours, limits)
        return _Look(at, found, left, refused)

    at, found, left, refused = search_at_size(px)
    if not len(found):
        return GraspList([], _nothing_closes(view, at, fingers, friction))
    if not len(left):
        reason = why_none(
            Tried(found.opening, refused, px, hand.px_per_mm),
            lambda other: reject_infeasible(found, at, view, other, neighbours, limits)[0],
            lambda other: bool(len(search_at_size(other).left)),
        )
        return GraspList([], reason, refused)
    chosen, quality, regions = kernels.rank_grasps(
        RankedCandidates(at.contacts, at.normals, at.usable, at.starts, at.steps),
        found.index[left],
        found.strength[left],
        found.terms[left].prod(axis=1),
        WrenchSpace(friction, cx, cy, 0.5 * at.size),
        RankingLimits(far_enough(at.size, px.finger_width), duplicate_radius(at.size, px.finger_width), max(top, 0)),
    )
    return GraspList(_ranked_grasps(found, at, left[chosen], quality, regions, px), "", refused)


def duplicate_radius(size: float, width: float) -> float:
    """Px within which the contacts of grasps that are alike lie, for an object of sqrt(area) and a finger's width."""
    return max(DISTINCT * size, width)


def far_enough(size: float, width: float) -> float:
    """Px by which contacts may slip where the room is 1; farther is not looked."""
    return min(DISTINCT * size, width)


def _stable_candidates(at: Candidates, fingers: int, friction: float) -> Stable:
    return stable_pairs(at, friction) if fingers == 2 else stable_triples(at, friction, FIRST_LOOK)


def _nothing_closes(view: View, at: Candidates, fingers: int, friction: float) -> str:
    """Why no candidates are stable."""
    anywhere = at._replace(usable=np.ones_like(at.usable))
    if view.is_clipped and len(_stable_candidates(anywhere, fingers, friction)):
        return "the object is cut by the border where the fingers would have to stand"
    contacts = "no pair of contacts closes" if fingers == 2 else "no three contacts close"
    return f"{contacts} with friction {friction:g}"


def _ranked_grasps(
    found: Stable, at: Candidates, rows: Ints, quality: Floats, regions: Floats, hand: HandPx
) -> list[RankedGrasp]:
    """The chosen grasps with all that is said of them."""
    contacts, directions, index = found.contacts[rows], found.directions[rows], found.index[rows]
    standing = finger_rectangles(contacts, directions, hand.finger_width, hand.finger_thickness)
    swept = finger_rectangles(contacts, directions, hand.finger_width, hand.finger_thickness + hand.clearance)
    most = far_enough(at.size, hand.finger_width)
    room = 0.2 + 0.8 * np.sqrt(np.minimum(regions.min(axis=1, initial=math.inf) / most, 1.0))
    cx, cy = at.centroid.tolist()
    closure, centre, flat, span = found.terms[rows].T.tolist()
    grasps = []
    for i, row in enumerate(rows.tolist()):
        if index.shape[1] == 2:
            margin = math.atan(found.friction) - math.atan(found.strength[row])
        else:
            normals = at.normals[index[i]]
            margin = ForceClosure.of(contacts[i], normals, (cx, cy), 0.5 * at.size, found.friction).margin
        grasps.append(
            RankedGrasp(
                contacts[i],
                float(quality[i]),
                Terms(closure[i], centre[i], flat[i], float(room[i]), span[i]),
                spread=bool(found.sense[row] < 0.0),
                margin=margin,
                directions=directions[i],
                regions=regions[i],
                fingers=standing[i],
                swept=swept[i],
            )
        )
    return grasps
