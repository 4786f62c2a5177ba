# SPDX-License-Identifier: Apache-2.0
"""Equal parts in view: which of them lies where one was found, by the way that each went and by where the others lie now."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.pose import PoseEstimate, worst_variance
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


def alias_probability(state: TrackState, estimate: PoseEstimate, even: Floats | None, shows: Shows) -> float:
    """Probability that this is an equal of the object which came to its place, all of them having moved together.

    Most steps go on evenly, as far as the object does so of late; now and then, and at first, a way is as probable as one over
    its square: of hands and belts, and of how often an image is taken, not even the order of magnitude is known. A row that
    ends in view shows by how much it went.

    Args:
        state: of the object, before it has learned from the image.
        estimate: of what was found in the image.
        even: (3, 3) where even motion has the object; None while its motion is not known.
        shows: whether the image shows a part at a pose.
    """
    target, numbers, first, last = state.target, state.numbers, state.target.A, state.last.G
    near = ONE_PLACE * target.size
    known = [np.zeros(2), *state.equals]
    # a row goes on where the first view did not show it
    parts = np.array(
        [*known, *(-e for e in state.equals if not _is_near(-e, known, near) and not _is_in_view(state, first, -e))]
    )
    before = apply_homography(last if even is None else even, parts + target.work_contacts.mean(axis=0))
    ways = (np.hypot(*(np.array(estimate.middle) - before).T) ** 2).clip(
        worst_variance(estimate.covariance)
    ) / estimate.area
    density = (1.0 if even is None else numbers.hazard) / ways
    if even is not None:
        spread, nu = (numbers.drift * max(1.0, state.steps)) ** 2 * state.agility, numbers.prior_freedom
        density += (1.0 + ways / (nu * spread)) ** (-0.5 * (nu + 2.0)) / spread
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


def complete_row(target: Target, G: Floats, middles: list[tuple[float, float]], shows: Shows) -> Floats:
    """(n, 2) work px from the object to its equals: those that were found, and those as far from one another as these are.

    Args:
        target: the object.
        G: (3, 3) its pose.
        middles: of its contacts (x, y) px, as they would be on those that were found.
        shows: whether the image shows a part at a pose.
    """
    found = apply_homography(np.linalg.inv(G), np.array(middles)) - target.work_contacts.mean(axis=0)
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
    height, width = state.last.levels[0].shape
    x, y = apply_homography(G, state.target.outline + place).T
    return bool(((x >= 0.0) & (x <= width - 1.0) & (y >= 0.0) & (y <= height - 1.0)).all())
