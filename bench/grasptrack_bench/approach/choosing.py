# SPDX-License-Identifier: Apache-2.0
"""The first look: which grasp the hand shall go for, or why there is none."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.hand import Hand, Length
from grasptrack.grasp.synthesis import synthesize
from grasptrack.grasp.synthesis.candidates import Candidates, Stable, sample_candidates
from grasptrack.grasp.synthesis.limits import UnevennessLimits, reject_infeasible
from grasptrack.grasp.synthesis.search import duplicate_radius, far_enough
from grasptrack.kernels.results import RankedCandidates, RankingLimits, WrenchSpace
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import Floats, Ints
from grasptrack_bench.physics.gripper import BESIDE, MAX_OPENING, PAD_THICKNESS, PAD_WIDTH

FRICTION = 0.5
"""Coefficient for which grasps are chosen; that of the pads is higher."""
SIDEWAYS = 0.006
"""m that a finger stands back from its contact before it closes: as far as it may be off, and then some."""
EVEN = 0.001
"""m by which the third of three contacts may be off its place. Fingers that move alike shove a part by two thirds of that until
all touch: no more than the hand may be beside the grasp anyway."""
NEARLY_AS_GOOD = 0.7
"""Share of the best quality that a grasp needs to be preferred for asking less of a turn."""


class Choice(NamedTuple):
    """Grasps, best first, or the reason why there are none; it is empty where there are."""

    grasps: list[Grasp]
    reason: str


def hand_for(size: float, unsure: float = 0.0) -> Hand:
    """The hand's limits as shares of an object of sqrt(area) = `size` m, since the scale of the image is not known.

    Args:
        size: m, as it is known beforehand.
        unsure: share by which that may be off. A hand that opens no wider than the part would come down on it, so that however
            large it is the fingers have room beside it.
    """
    opening = min(MAX_OPENING - 2.0 * SIDEWAYS, (MAX_OPENING - 2.0 * BESIDE) * (1.0 - unsure))
    return Hand(
        max_opening=Length(opening / size, "size"),
        finger_width=Length(PAD_WIDTH / size, "size"),
        finger_thickness=Length(PAD_THICKNESS / size, "size"),
        clearance=Length(SIDEWAYS / size, "size"),
    )


def first_look(
    image: NDArray[Any],
    time: float,
    ignore: NDArray[Any],
    hand: Hand,
    tips: Floats,
    strategy: str = "auto",
    risk: float = DEFAULT_RISK,
    sure: float = 0.0,
) -> tuple[GraspTracker, TrackResult]:
    """A tracker that has chosen its grasp, and what it says of the first image; `searching` where it has none.

    Of grasps that squeeze from outside and are nearly as good as the best, the one is taken that asks for the least turn.

    Args:
        image: of the hand's camera.
        time: s.
        ignore: (H, W), where the hand is in the image.
        hand: its limits.
        tips: (k, 2) px of the fingertips.
        strategy, risk, sure: of the tracker. It takes the likeliest object without a question where nothing else is asked:
            the bench holds one part, and who looks for it again compares its outline.
    """
    fingers, told = len(tips), ""

    def choose_grasps(view: View) -> list[Grasp]:
        nonlocal told
        found, told = closing_grasps(view, fingers, hand)
        good = [g for g in found if g.quality >= NEARLY_AS_GOOD * found[0].quality]
        return sorted(good, key=lambda g: turn_between(g.contacts, tips))

    tracker = GraspTracker(
        fingers=fingers, strategy=strategy, ignore=ignore, friction=FRICTION, choose=choose_grasps, risk=risk, sure=sure
    )
    result = tracker.update(image, time)
    if result.contacts is None and result.view is not None and told:
        result = replace(result, reason=told)
    return tracker, result


def closing_grasps(view: View, fingers: int, hand: Hand) -> Choice:
    """Grasps that the hand closes on from outside, best first, and why there is none."""
    if fingers == 2:
        ranked = synthesize(view, fingers, FRICTION, hand=hand)
        squeezing: list[Grasp] = [g for g in ranked if not g.spread]
        only = "no stable grasp: only inside holes, where closing fingers cannot push"
        return Choice(squeezing, "" if squeezing else only if ranked else f"no stable grasp: {ranked.reason}")
    return radial_grasps(view, hand, FRICTION, EVEN / PAD_WIDTH)


def turn_between(contacts: Floats, tips: Floats) -> float:
    """rad, the least turn from fingertips to contacts, both evenly round their middles, where fingers can change places."""
    (ax, ay), (bx, by) = contacts[-1] - _direction_origin(contacts), tips[-1] - _direction_origin(tips)
    angle, half = math.atan2(ay, ax) - math.atan2(by, bx), math.pi / len(tips)
    return abs((angle + half) % (2.0 * half) - half)


def width_in_m(contacts: Floats, tips: Floats, opening: float) -> float:
    """m that the hand is open where it touches contacts (k, 2) px that are seen at the depth of the fingertips (k, 2) px.

    `opening` is m of the hand as the tips are seen: their distance, of three twice that from their middle.
    """
    return float(opening * _contact_span(contacts) / _contact_span(tips))


def _direction_origin(points: Floats) -> Floats:
    """Where the direction to the last point counts from: the other one, or the middle of three."""
    return points[0] if len(points) == 2 else np.asarray(points.mean(axis=0))


def _contact_span(points: Floats) -> float:
    """The distance of two points; of three twice the mean one from their middle."""
    if len(points) == 2:
        return float(np.hypot(*(points[1] - points[0])))
    return 2.0 * float(np.hypot(*(points - points.mean(axis=0)).T).mean())


TOP = 50
MOST = 20_000
"""Triples that are looked at, evenly spread over those that were found: a disc has one for every two of its points."""


def radial_grasps(view: View, hand: Hand, friction: float, even: float) -> Choice:
    """Grasps for three fingers on one drive, a third of a turn apart, that squeeze from outside, ranked as `synthesize` ranks.

    What `synthesize` finds lies at any angles. Here any two contacts, taken as neighbours, say where the hand's middle is,
    the apex over them with 120 degrees, and where the third has to be, at nearly the same distance.

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
        return Choice([], f"no three contacts at equal angles and distances close with friction {friction:g}")
    if len(index) > MOST:
        index = index[np.linspace(0, len(index) - 1, MOST).astype(np.int64)]
    rho = 0.5 * at.size
    closure = np.array(
        [kernels.force_closure(at.contacts[i], at.normals[i], cx, cy, rho, friction).epsilon for i in index]
    )
    index, closure = index[closure > 0.0], closure[closure > 0.0]
    found = Stable(at, index, np.ones(len(index)), closure, friction)
    left, refused = reject_infeasible(found, at, view, px, (), UnevennessLimits())
    if not len(left):
        return Choice([], f"no three contacts for this hand: {next(iter(refused), 'none closes')}")
    chosen, quality, _ = kernels.rank_grasps(
        RankedCandidates(at.contacts, at.normals, at.usable, at.starts, at.steps),
        found.index[left],
        found.strength[left],
        found.terms[left].prod(axis=1),
        WrenchSpace(friction, cx, cy, rho),
        RankingLimits(far_enough(at.size, px.finger_width), duplicate_radius(at.size, px.finger_width), TOP),
    )
    contacts = found.contacts[left[chosen]]
    return Choice([Grasp(c, float(q)) for c, q in zip(contacts, quality, strict=True)], "")


def even_triples(at: Candidates, friction: float, even: float, reach: float) -> Ints:
    """(g, 3) indices of candidates that three such fingers touch from outside, each within its friction cone."""
    usable = np.flatnonzero(at.usable & (at.roughness <= UnevennessLimits().roughness))
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
