# SPDX-License-Identifier: Apache-2.0
"""Equal parts in view: which of them lies where one was found, by the way that each went and by where the others lie now."""

import math
import sys
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.pose import PLACE_FREEDOMS, PoseEstimate, carried_in_front, share_in_view, worst_variance
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Target
from grasptrack.typing import Floats

NOTICED = 0.1
"""Share of the risk from which on the image is asked."""
SHOWN_RIGHT = 0.95
"""Probability that a place shows a part where one lies, and none where none does."""
MOST = 24
"""Equals that are known of at most."""
ONE_PLACE = 0.25
"""Share of the object's size within which two places are one."""

Shows = Callable[[Floats], bool]
"""Whether an image shows a part at a pose (3, 3)."""


class Way(NamedTuple):
    """Where an object would be that moved as is expected.

    Attributes:
        G: (3, 3) its pose.
        last: (3, 3) that in which it was, or would be if it rested.
        spread: mean square, a freedom, of how far it is from there, as a share of its area; None where nothing is known of it.
        rests: (3, 3) where it would be if it rested on the ground, and the same of that; None where the ground tells nothing.
    """

    G: Floats
    last: Floats
    spread: float | None
    rests: tuple[Floats, float] | None = None


def alias_probability(state: TrackState, estimate: PoseEstimate, way: Way, shows: Shows) -> float:
    """Probability that this is an equal of the object which came to its place, all of them having moved together.

    Before its motion is known a way is as probable as one over its square: of hands and belts, and of how often an image is
    taken, not even the order of magnitude is known. A row that ends in view shows by how much it went.

    Args:
        state: of the object, before it has learned from the image.
        estimate: of what was found in the image.
        way: where the object would be.
        shows: whether the image shows a part at a pose.
    """
    target, numbers, first, last = state.target, state.numbers, state.target.A, way.last
    near = ONE_PLACE * target.size
    known = [np.zeros(2), *state.equals]
    # a row goes on where the first view did not show it
    parts = np.array(
        [*known, *(-e for e in state.equals if not _is_near(-e, known, near) and not _is_in_view(state, first, -e))]
    )
    middles = parts + target.work_contacts.mean(axis=0)
    before = carried_in_front(way.G, middles)
    parts, before, middles = parts[(seen := np.isfinite(before[:, 0]))], before[seen], middles[seen]
    if not seen[0]:  # the object itself would lie behind the camera
        return 0.0

    def ways_from(before: Floats) -> Floats:
        away: Floats = np.hypot(*(np.array(estimate.middle) - before).T)
        return np.asarray((away**2).clip(worst_variance(estimate.covariance)) / estimate.area, dtype=np.float64)

    ways = ways_from(before)
    density = 1.0 / ways if way.spread is None else way_density(ways, way.spread, numbers)
    if way.rests is not None:  # all of them may have stopped on the ground, whatever they did before
        ground, spread = way.rests
        density = density + way_density(ways_from(carried_in_front(ground, middles)), spread, numbers)
    if density[1:].sum() < NOTICED * numbers.risk * density[0]:
        return float(density[1:].sum() / density.sum())
    # what is still seen where it was went nowhere: nearer than an edge is looked for that cannot be told
    far = ways[0] > (2.0 * numbers.wide) ** 2
    stays = [e for e in known[1:] if far and _is_in_view(state, last, e) and shows(_shifted_pose(last, e))]
    odds = np.log(density)
    odds[1:] += len(stays) * math.log(1.0 - SHOWN_RIGHT)
    for place in _distinct_places((parts[:, None] - parts[None]).reshape(-1, 2), near):
        if np.hypot(*place) < near or not _is_in_view(state, estimate.G, place):
            continue
        shown = shows(_shifted_pose(estimate.G, place))
        for k, part in enumerate(parts):  # if that is what was found, this lay there before
            if k == 0 and _is_near(place, stays, near):
                continue
            there = _is_near(part + place, known, near)
            told = there or _is_in_view(state, first, part + place)
            odds[k] += math.log((SHOWN_RIGHT if there == shown else 1.0 - SHOWN_RIGHT) if told else 0.5)
    share = np.exp(odds - odds.max())
    return float(share[1:].sum() / share.sum())


def way_density(ways: Floats, spread: float, numbers: Numbers, freedoms: float = 2.0) -> Floats:
    """(n,) of squared ways (n,) of a mean a freedom; now and then a way is as probable as one over its square."""
    nu = numbers.prior_freedom
    found = (1.0 + ways / (nu * spread)) ** (-0.5 * (nu + freedoms)) / spread + numbers.hazard / ways
    return np.asarray(found, dtype=np.float64)


def log_density(
    state: TrackState, G: Floats, estimate: PoseEstimate, even: Floats | None, background: Floats | None
) -> float:
    """Log of the density of a pose G (3, 3) that is known as an estimate is, up to a constant, by what moves the object.

    It drifts, goes on evenly, or rests on the ground as it did of late. How far drift and even motion are off grows with the
    time in which no image was seen; `even` as for `alias_probability`, `background`: where the ground has it, or None.
    """
    target, numbers, density = state.target, state.numbers, sys.float_info.min
    motions, least = [(state.last.G, state.drifted)], worst_variance(estimate.covariance) / estimate.area
    if even is not None:
        motions.append((even, state.agility * state.drifted))
    if background is not None:
        motions.append((background, (numbers.travel * state.wander) ** 2))
    for start, spread in motions:
        off = target.pose_difference(start, G)[:6]  # that an image tilts it by noise says nothing of its way
        way = float(off**2 @ target.precision_of_motion[:6]) * numbers.drift**2
        if math.isfinite(way):
            density += float(way_density(np.array(max(way, least)), spread, numbers, PLACE_FREEDOMS))
    return math.log(density)


def complete_row(target: Target, G: Floats, middles: list[tuple[float, float]], shows: Shows) -> Floats:
    """(n, 2) work px from the object to its equals: those that were found, and those as far from one another as these are.

    Args:
        target: the object.
        G: (3, 3) its pose.
        middles: of its contacts (x, y) px, as they would be on those that were found.
        shows: whether the image shows a part at a pose.
    """
    found = carried_in_front(np.asarray(np.linalg.inv(G), np.float64), np.array(middles)) - target.work_contacts.mean(
        axis=0
    )
    found = found[np.isfinite(found[:, 0])]  # others lie in another plane
    row, apart = [np.zeros(2), *found], ONE_PLACE * target.size
    for step in [s for other in found for s in (other, -other)]:
        for start in list(row):
            place = start + step
            while len(row) <= MOST and not _is_near(place, row, apart):
                if not shows(_shifted_pose(G, place)):
                    break
                row.append(place)
                place = place + step
    return np.array(row[1:])


def _shifted_pose(G: Floats, place: Floats) -> Floats:
    """(3, 3) the pose of what lies beside the object in its plane, (2,) work px away."""
    return np.asarray(G @ np.array([[1.0, 0.0, place[0]], [0.0, 1.0, place[1]], [0.0, 0.0, 1.0]]), dtype=np.float64)


def _distinct_places(places: Floats, apart: float) -> list[Floats]:
    """Those of (n, 2) that lie so far from all before them."""
    found: list[Floats] = []
    for place in places:
        if not _is_near(place, found, apart):
            found.append(place)
    return found


def _is_near(place: Floats, others: list[Floats], near: float) -> bool:
    """Whether a place lies so near to another one."""
    return any(float(np.hypot(*(place - other))) < near for other in others)


def _is_in_view(state: TrackState, G: Floats, place: Floats) -> bool:
    """Whether an image would show all of a part that lies (2,) work px beside an object at a pose."""
    return share_in_view(G, state.target.outline + place, state.last.levels[0]) == 1.0
