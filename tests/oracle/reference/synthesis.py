# SPDX-License-Identifier: Apache-2.0
"""What is in a finger's way, how far contacts may slip, and the best grasps."""

import heapq
import itertools
import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.results import RankedCandidates, RankedGrasps, RankingLimits, WrenchSpace
from grasptrack.typing import Bools, Floats, Ints
from reference.checks import check_finite, check_indices, check_outline
from reference.geometry import find_place, segment_end_indices
from reference.grasp import cone_edges

__all__ = ["finger_clearance", "rank_grasps"]


# --- What of an outline lies in the rectangle that a finger sweeps -----

# Of half the width: what only touches a finger's side is not in its way.
WITHIN_PAD = 1 - 1e-9


def finger_clearance(
    points: Floats,
    offsets: Ints,
    contacts: Floats,
    directions: Floats,
    places: Floats | None,
    width: float,
    depth: float,
    reach: float,
) -> Floats:
    count = len(contacts)
    if len(directions) != count or (places is not None and len(places) != count):
        raise ValueError("each contact needs its direction and its place")
    if not (width > 0 and math.isfinite(width)) or not 0 <= depth < math.inf or not 0 <= reach < math.inf:
        raise ValueError(f"width must be above 0, depth and reach at least 0, not {width:g}, {depth:g} and {reach:g}")
    check_outline(points, offsets)
    ends = points[segment_end_indices(offsets, len(points))]
    out = np.empty((count, 2))
    for k, (row, contact, direction) in enumerate(zip(out, contacts, directions, strict=True)):
        under = np.zeros(len(points), dtype=np.bool_)
        if places is not None:
            under = _segments_under_pad(points, offsets, places[k], reach)
        row[:] = _finger_clearance(points, ends, contact, direction, under, width, depth)
    return out


def _segments_under_pad(points: Floats, offsets: Ints, place: Floats, reach: float) -> NDArray[np.bool_]:
    """(N,) which segments begin within `reach` px of arc length of a place, the place's own among them."""
    first, n, i, f = find_place(offsets, place)
    contour = points[first : first + n]
    under = np.zeros(len(points), dtype=np.bool_)
    under[first + i] = True

    def side(j: int) -> float:
        return math.dist(contour[j], contour[(j + 1) % n])

    for way, left in ((1, reach - (1 - f) * side(i)), (-1, reach - f * side(i))):
        j = (i + way) % n
        for _ in range(n - 1):
            if not left > 0:
                break
            under[first + j] = True
            left -= side(j)
            j = (j + way) % n
    return under


def _finger_clearance(
    points: Floats,
    ends: Floats,
    contact: Floats,
    direction: Floats,
    under: NDArray[np.bool_],
    width: float,
    depth: float,
) -> tuple[float, float]:
    """Protrusion under the pad, and distance of what else lies in the rectangle."""
    least = 1e-9 * width  # of a rectangle, and of what lies in it: less is rounding
    if not depth > least:
        return 0.0, math.inf
    half = width / 2 * WITHIN_PAD
    frame = np.array([[-direction[1], direction[0]], [-direction[0], -direction[1]]])
    (px, py), (qx, qy) = frame @ (points - contact).T, frame @ (ends - contact).T
    with np.errstate(divide="ignore", invalid="ignore"):
        t, u = (-half - px) / (qx - px), (half - px) / (qx - px)
    level = px == qx
    start = np.where(level, 0.0, np.clip(np.minimum(t, u), 0.0, None))
    end = np.where(level, 1.0, np.clip(np.maximum(t, u), None, 1.0))
    y0, y1 = py + start * (qy - py), py + end * (qy - py)
    low, high = np.minimum(y0, y1), np.maximum(y0, y1)
    beside = ((px >= half) & (qx >= half)) | ((px <= -half) & (qx <= -half))
    there = ~beside & (high > least) & (low < depth)
    protrusion = float(high[there & under].max(initial=0.0))
    nearest = float(np.maximum(low[there & ~under], 0.0).min(initial=math.inf))
    if nearest == math.inf and _contains_point(points, ends, contact - depth * direction):
        nearest = 0.0
    return protrusion, nearest


def _contains_point(points: Floats, ends: Floats, at: Floats) -> bool:
    """Even-odd, so that holes are outside."""
    astride = (points[:, 1] > at[1]) != (ends[:, 1] > at[1])
    p, q = points[astride], ends[astride]
    crossing = p[:, 0] + (at[1] - p[:, 1]) / (q[:, 1] - p[:, 1]) * (q[:, 0] - p[:, 0])
    return bool((at[0] < crossing).sum() % 2)


# --- Independent regions of contact: how far contacts may slip along the outline, each as it likes ([13]) -----


class Along:
    """Candidates along closed contours, evenly spaced, and what `rank_grasps` asks of them.

    Args:
        contacts: (m, 2) px.
        normals: (m, 2) unit, into the material.
        usable: (m,) False where no contact may slip to.
        starts: (C + 1,) contour c holds the candidates ``starts[c]:starts[c + 1]``.
        steps: (C,) px of arc length between them.
        friction: coefficient.
        centre: px, the point about which torques are taken.
        rho: px by which torques are divided.
    """

    def __init__(
        self,
        contacts: Floats,
        normals: Floats,
        usable: Bools,
        starts: Ints,
        steps: Floats,
        friction: float,
        centre: tuple[float, float],
        rho: float,
    ) -> None:
        self.contacts, self.normals, self.usable = contacts, normals, usable
        self.starts, self.steps, self.friction = starts, steps, friction
        self.home = np.repeat(np.arange(len(steps)), np.diff(starts))
        angle = math.atan(friction)
        every = np.arange(len(contacts))
        self.turn = np.zeros(len(contacts))
        for way in (-1, 1):
            other = np.array([self.moved(int(i), way) for i in every], dtype=np.int64)
            n, m = normals, normals[other]
            between = np.arctan2(np.abs(n[:, 0] * m[:, 1] - n[:, 1] * m[:, 0]), (n * m).sum(axis=1))
            self.turn = np.maximum(self.turn, between)
        self.cone = np.where(usable & (self.turn < angle), np.tan(np.clip(angle - self.turn, 0.0, None)), -1.0)
        self.edges = cone_edges((contacts - centre) / rho, normals, 1.0, friction)

    def step(self, i: int) -> float:
        """Px of arc length from a candidate to the next."""
        return float(self.steps[self.home[i]])

    def count(self, i: int) -> int:
        """Candidates on the contour of one of them."""
        c = self.home[i]
        return int(self.starts[c + 1] - self.starts[c])

    def moved(self, i: int, by: int) -> int:
        """The candidate so many steps farther along the same contour."""
        first = int(self.starts[self.home[i]])
        return first + (i - first + by) % self.count(i)

    def pair(self, a: int, b: int, needed: float, most: float) -> float:
        """Half-length in px of the regions of two contacts, at most `most`.

        Squares of pairs are tried ring by ring. Each is held to a narrower cone, by what a normal turns to the next
        candidate and the line with half a step at either end, so that what lies between candidates closes as well.
        Where not even the nearest candidates close so, the regions are a share of a step, from the friction to spare.
        """
        step_a, step_b = self.step(a), self.step(b)
        step, slip = min(step_a, step_b), (step_a + step_b) / 2
        limit = min(math.ceil(most / step - 1e-9), self.count(a) // 2, self.count(b) // 2)
        sense = 1.0 if self.normals[a] @ (self.contacts[b] - self.contacts[a]) > 0 else -1.0
        k = 0
        distance = math.dist(self.contacts[a], self.contacts[b])
        slant = slip * (1 + self.friction**2)
        if self._all_pairs_close([a], [b], sense, slant, 0.0):
            for k in range(1, limit + 2):
                if k > limit:
                    break
                around = range(-k, k + 1)
                near = distance - k * (step_a + step_b)
                lean = slant / near if near > 0.75 * distance else 0.0
                at_a = [self.moved(a, e) for e in around]
                at_b = [self.moved(b, e) for e in around]
                if not (
                    self._all_pairs_close([at_a[0], at_a[-1]], at_b, sense, slant, lean)
                    and self._all_pairs_close(at_a, [at_b[0], at_b[-1]], sense, slant, lean)
                ):
                    break
            k -= 1
        if k > 0:
            return min(k * step, most)
        spare = math.atan(self.friction) - math.atan(needed)
        swing = 2 * slip / distance if distance > 0 else math.inf
        change = max(float(self.turn[a]), float(self.turn[b])) + swing
        return min(step, most, step * spare / (2 * change))

    def _all_pairs_close(self, first: list[int], second: list[int], sense: float, slant: float, lean: float) -> bool:
        """Whether every pair of one of `first` and one of `second` closes with room to spare.

        The line's slant by half a step at either end adds `lean` to the friction needed, slant / distance where it is 0.
        """
        d = self.contacts[second][None] - self.contacts[first][:, None]
        n, m = self.normals[first][:, None], self.normals[second][None]
        p = sense * (n[..., 0] * d[..., 0] + n[..., 1] * d[..., 1])
        q = -sense * (m[..., 0] * d[..., 0] + m[..., 1] * d[..., 1])
        cone_a, cone_b = self.cone[first][:, None], self.cone[second][None]
        if not ((p > 0) & (q > 0) & (cone_a > 0) & (cone_b > 0)).all():
            return False
        leans = lean or slant / np.hypot(d[..., 0], d[..., 1])
        at_a = np.abs(n[..., 0] * d[..., 1] - n[..., 1] * d[..., 0]) < (cone_a - leans) * p
        at_b = np.abs(m[..., 0] * d[..., 1] - m[..., 1] * d[..., 0]) < (cone_b - leans) * q
        return bool((at_a & at_b).all())

    def one_of_three(self, i: int, epsilon: float, most: float) -> float:
        """Half-length in px of the region of one contact of a grasp, at most `most`.

        As long as no edge of any cone moves by epsilon, in wrenches, the hull still holds the origin. What the next
        step would add counts too, for what lies between candidates.
        """
        step = self.step(i)
        limit = max(min(math.ceil(most / step - 1e-9), self.count(i) // 2), 1)
        first, k = 0.0, 0
        for far in range(1, limit + 1):
            good = True
            for way in (-1, 1):
                here, before = self.moved(i, way * far), self.moved(i, way * (far - 1))
                between = self._cone_edge_distance(here, before)
                if far == 1:
                    first = max(first, between)
                good &= bool(self.usable[here]) and self._cone_edge_distance(here, i) + between < epsilon
            if not good:
                break
            k = far
        if k > 0:
            return min(k * step, most)
        return min(step, most, step * epsilon / (2 * max(first, 1e-12)))

    def _cone_edge_distance(self, i: int, j: int) -> float:
        """The larger distance between corresponding edges of two candidates' cones, in wrenches."""
        return float(np.sqrt(((self.edges[i] - self.edges[j]) ** 2).sum(axis=1).max()))


# --- The best of many grasps, none near another -----


def rank_grasps(
    candidates: RankedCandidates,
    grasps: Ints,
    strength: Floats,
    bound: Floats,
    space: WrenchSpace,
    limits: RankingLimits,
) -> RankedGrasps:
    (contacts, normals, usable, starts, steps), (friction, cx, cy, rho), (most, gap, top) = candidates, space, limits
    m, (count, fingers) = len(contacts), grasps.shape
    if len(normals) != m or len(usable) != m:
        raise ValueError("each candidate needs its normal and its flag")
    check_outline(contacts, starts)
    if len(steps) + 1 != len(starts):
        raise ValueError("each contour needs its step")
    if fingers not in (2, 3) or len(strength) != count or len(bound) != count:
        raise ValueError("grasps have 2 or 3 contacts, each grasp its strength and its bound")
    check_indices(grasps, m)
    if not (friction > 0 and rho > 0 and 0 < most < math.inf and gap >= 0 and top >= 0):
        raise ValueError("friction, rho and most must be above 0, gap and top at least 0")
    if not ((steps > 0) & (steps < math.inf)).all():
        raise ValueError("steps must be above 0")
    check_finite(strength, "strength")
    check_finite(bound, "bound")
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
    return RankedGrasps(
        np.array([g for g, _, _ in chosen], dtype=np.int64),
        np.array([q for _, q, _ in chosen], dtype=np.float64),
        np.array([r for _, _, r in chosen], dtype=np.float64).reshape(-1, fingers),
    )
