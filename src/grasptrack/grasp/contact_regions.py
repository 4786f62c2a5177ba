# SPDX-License-Identifier: Apache-2.0
"""Independent contact regions ([13]): how far each contact may slip along the outline while the grasp still closes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.geometry.contours import Outline
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.force_closure import DEFAULT_FRICTION, FINGER_WIDTH, analyze
from grasptrack.typing import Bools, Floats

Ends = Sequence[Sequence[int]]
"""For each contact, how many places back and ahead the box reaches."""


def grow_box(contacts: int, most: int, closes: Callable[[int, int, Ends], bool]) -> list[tuple[int, int]]:
    """The box when no side can grow any farther; it grows evenly, where it can.

    Args:
        contacts: their number, k.
        most: places that a side may lie from the middle.
        closes: whether the box may get a new side: the contact that slips, to which place (negative: back), and the
            present ends, within which the others stay.
    """
    ends = [[0, 0] for _ in range(contacts)]
    growing = {(contact, way) for contact in range(contacts) for way in (0, 1)}
    while growing:
        contact, way = min(growing, key=lambda side: (ends[side[0]][side[1]], side))
        far = ends[contact][way] + 1
        if far <= most and closes(contact, far if way else -far, ends):
            ends[contact][way] = far
        else:
            growing.discard((contact, way))
    return [(back, ahead) for back, ahead in ends]


SAMPLES = 60
"""BoundarySamples to each side that are looked at, close together near the contact and wider apart away from it."""


class BoundarySamples:
    """Where one contact may slip to: places on both sides of it, its own in the middle."""

    def __init__(self, outline: Outline, contour: int, position: float, reach: float, width: float) -> None:
        line = outline.contours[contour]
        s = line.arc_length
        here = float(np.interp(position, np.arange(len(s)), s))
        steps = min(reach, 0.5 * line.length) * (np.arange(SAMPLES + 1) / SAMPLES) ** 2
        self.at: Floats = np.concatenate([-steps[:0:-1], steps])
        along = np.mod(here + self.at, line.length)
        position_of = np.interp(along, s, np.arange(len(s), dtype=np.float64)) % len(line)
        places = np.column_stack([np.full(len(along), float(contour)), position_of])
        self.contacts: Floats = kernels.point_at(outline.points, outline.offsets, places)
        frames = kernels.contact_frames(outline.points, outline.offsets, places, width)
        self.normals: Floats = np.ascontiguousarray(frames[:, :2])
        self.usable: Bools = np.ones(len(along), dtype=np.bool_)
        if line.clipped is not None:
            cut = (
                line.clipped[np.floor(position_of).astype(np.int64)]
                | line.clipped[np.ceil(position_of).astype(np.int64) % len(line)]
            )
            self.usable = ~cut
        n = self.normals
        # by what the normal turns from one place to the next
        between = np.arctan2(np.abs(n[:-1, 0] * n[1:, 1] - n[:-1, 1] * n[1:, 0]), (n[:-1] * n[1:]).sum(axis=1))
        self.turn: Floats = np.maximum(np.append(between, 0.0), np.insert(between, 0, 0.0))
        gaps = np.diff(self.at)
        self.gap: Floats = 0.5 * np.maximum(np.append(gaps, 0.0), np.insert(gaps, 0, 0.0))

    def cone_edges(self, centre: Floats, rho: float, friction: float) -> Floats:
        """(m, 2, 3) both edges of the friction cone at each place, as wrenches."""
        n = self.normals
        t = np.column_stack([-n[:, 1], n[:, 0]])
        forces = np.stack([n + friction * t, n - friction * t], axis=1)
        arms = (self.contacts - centre) / rho
        torque = arms[:, None, 0] * forces[..., 1] - arms[:, None, 1] * forces[..., 0]
        return np.concatenate([forces, torque[..., None]], axis=2)


COARSE = 6
"""Every so many places are tried together with those of the other contacts."""
_FACETS = np.array(list(itertools.combinations(range(6), 3)))
_FLAT = 1e-12


def of_more(edges: list[Floats], usable: list[Bools]) -> list[tuple[int, int]] | None:
    """Places back and ahead of each contact, or None where the grasp itself does not close.

    Of each contact: (m, 2, 3) the edges of its cone at each place, its own in the middle, and (m,) where it may be.
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

    def all_close(contact: int, at: int, ends: Ends) -> bool:
        spans = [np.arange(middle - back, middle + ahead + 1) for back, ahead in ends]
        spans[contact] = np.array([middle + at])
        i, j, k = (axis.ravel() for axis in np.meshgrid(*spans, indexing="ij"))
        most = np.maximum(np.maximum(room[0][i], room[1][j]), room[2][k])
        if not np.isfinite(most).all():
            return False
        return bool((epsilon_quality(np.concatenate([few[0][i], few[1][j], few[2][k]], axis=1)) > most).all())

    if not all_close(0, 0, [(0, 0)] * 3):
        return [(0, 0)] * 3
    return grow_box(3, middle, all_close)


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


REACH = 0.3
"""BoundarySamples are looked at up to this share of sqrt(area), and no farther than half round a contour."""


class Regions(NamedTuple):
    """Independent regions of contact ([13]): each contact may lie anywhere in its own, and the grasp closes.

    Attributes:
        contacts: (k, 2) px, on the outline.
        tangents: (k, 2) unit, along the direction of the contour.
        back: (k,) px of arc length by which each contact may slip against its tangent.
        ahead: (k,) px along it.
    """

    contacts: Floats
    tangents: Floats
    back: Floats
    ahead: Floats


def regions_of(
    grasp: Grasp, outline: Outline, friction: float = DEFAULT_FRICTION, finger_width: float | None = None
) -> Regions:
    """The regions of a grasp's contacts, both ways along the outline; once for a grasp, in the view of its choice.

    Two fingers: a rectangle of slips grows from the contacts, side by side, as long as every pair on its new side closes
    with room for what lies between samples. Three: a box grows in the same way, as long as the hull of the wrenches holds
    a ball about the origin that is larger than what any cone's edge moves by between samples. More: as long as no edge
    moves by epsilon from where it is. All of these are parts of what closes, so that a chance worked out from them is too
    small rather than too large. A contact may not slip to where the image border cuts the object. Regions are empty, of length
    0, where the grasp itself does not close.

    Args:
        grasp: contacts, each within 5 % of sqrt(area) of the outline; they are moved onto it.
        outline: a Contour or View.
        friction: Coulomb coefficient.
        finger_width: px over which normals are averaged; default 10 % of sqrt(area).

    Raises:
        GraspError: a contact is not on the outline.
        InputError: friction or finger_width not positive.
    """
    analysis = analyze(grasp, outline, friction, finger_width)
    size = 2.0 * analysis.rho
    width = finger_width or FINGER_WIDTH * size
    places = grasp.on(outline)
    contacts = kernels.point_at(outline.points, outline.offsets, places)
    slips = [BoundarySamples(outline, int(c), p, REACH * size, width) for c, p, _ in places.tolist()]
    tangents = np.array([[n[1], -n[0]] for n in (s.normals[SAMPLES] for s in slips)])
    if len(grasp) == 2:
        ends = _of_pair(slips, friction)
    else:
        _, cx, cy, *_ = kernels.polygon_moments(outline.points, outline.offsets)
        edges = [s.cone_edges(np.array([cx, cy]), analysis.rho, friction) for s in slips]
        ends = of_more(edges, [s.usable for s in slips])
    if ends is None:
        return Regions(contacts, tangents, np.zeros(len(grasp)), np.zeros(len(grasp)))
    back = np.array([-s.at[SAMPLES - low] for s, (low, _) in zip(slips, ends, strict=True)])
    ahead = np.array([s.at[SAMPLES + high] for s, (_, high) in zip(slips, ends, strict=True)])
    return Regions(contacts, tangents, back, ahead)


def _of_pair(slips: list[BoundarySamples], friction: float) -> list[tuple[int, int]] | None:
    good = _closing_pairs(slips[0], slips[1], math.atan(friction))
    if not good[SAMPLES, SAMPLES]:
        return None

    def all_close(contact: int, at: int, ends: Ends) -> bool:
        back, ahead = ends[1 - contact]
        others = slice(SAMPLES - back, SAMPLES + ahead + 1)
        return bool((good[SAMPLES + at, others] if contact == 0 else good[others, SAMPLES + at]).all())

    return grow_box(2, SAMPLES, all_close)


def _closing_pairs(first: BoundarySamples, second: BoundarySamples, angle: float) -> Bools:
    """(m, m) which pairs of places close, with room for what lies between them."""
    d = second.contacts[None] - first.contacts[:, None]
    away = np.hypot(d[..., 0], d[..., 1])
    sense = 1.0 if float(first.normals[SAMPLES] @ d[SAMPLES, SAMPLES]) > 0.0 else -1.0
    lean = (first.gap[:, None] + second.gap[None]) / np.maximum(away, 1e-300)
    good = first.usable[:, None] & second.usable[None] & (away > 0.0)
    for normals, way, turn in (
        (first.normals[:, None], sense, first.turn[:, None]),
        (second.normals[None], -sense, second.turn[None]),
    ):
        across = np.abs(normals[..., 0] * d[..., 1] - normals[..., 1] * d[..., 0])
        along = way * (normals[..., 0] * d[..., 0] + normals[..., 1] * d[..., 1])
        good &= np.arctan2(across, along) + turn + lean < angle
    return np.asarray(good)
