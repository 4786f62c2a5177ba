# SPDX-License-Identifier: Apache-2.0
"""Contacts: their normals, the friction that closing takes, and pairs and triples that close ([10], [12], [14])."""

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.results import Closure, JudgedContacts, StablePairs, StableTriples
from grasptrack.typing import Floats
from reference.checks import check_outline, check_size
from reference.geometry import find_place, project_to_contour
from reference.homography import carry_normals

__all__ = ["carried_angles", "closing_triples", "contact_frames", "force_closure", "judge_contacts", "opposed_pairs"]


# --- Normal and flatness of an outline over the width of a finger -----

# Relative difference of the two variances below which no direction stands out.
ROUND = 1e-12


def _segments_around_place(contour: Floats, i: int, f: float, half: float) -> tuple[list[tuple[Floats, Floats]], float]:
    """Directed pieces of segments within `half` px of arc length on either side of a place, and their length."""
    n = len(contour)
    pieces: list[tuple[Floats, Floats]] = []
    place = contour[i] + f * (contour[(i + 1) % n] - contour[i])
    total = 0.0
    for way in (1, -1):
        left, here = half, place
        j = (i + 1) % n if way == 1 else i
        for _ in range(n + 1):
            there = contour[j]
            length = math.hypot(*(there - here))
            if length >= left:
                there = here + (left / length) * (there - here) if length > 0 else here
                length = left
            pieces.append((here, there) if way == 1 else (there, here))
            total += length
            left -= length
            if left <= 0:
                break
            here, j = there, (j + way) % n
    return pieces, total


def contact_frames(points: Floats, offsets: NDArray[np.int64], places: Floats, width: float) -> Floats:
    if not (width > 0 and math.isfinite(width)):
        raise ValueError(f"width must be above 0, not {width:g}")
    check_outline(points, offsets)
    if places.ndim != 2 or places.shape[1] < 2:
        raise ValueError("a place is a contour and a position")
    out = np.empty((len(places), 4))
    lengths: dict[int, float] = {}
    for row, where in zip(out, places, strict=True):
        first, n, i, f = find_place(offsets, where)
        contour = points[first : first + n]
        if first not in lengths:
            lengths[first] = sum(math.dist(contour[j], contour[(j + 1) % n]) for j in range(n))
        length = lengths[first]
        pieces, used = _segments_around_place(contour, i, f, min(width, length) / 2)
        # Coordinates about the place, x along its segment: a straight stretch then has exactly no variance across.
        side = contour[(i + 1) % n] - contour[i]
        reach = math.hypot(*side)
        tx, ty = side / reach if reach > 0 else (1.0, 0.0)
        origin = contour[i] + f * side
        turn = np.array([[tx, ty], [-ty, tx]])
        p = np.array([turn @ (a - origin) for a, _ in pieces])
        q = np.array([turn @ (b - origin) for _, b in pieces])
        span = np.hypot(*(q - p).T)
        total = float(span.sum())
        if total <= 0:
            raise ValueError("a contour without length has no normal")
        mx, my = (span[:, None] * (p + q)).sum(axis=0) / (2 * total)
        (px, py), (qx, qy) = p.T, q.T
        a = float((span * (px * px + px * qx + qx * qx)).sum()) / (3 * total) - mx * mx
        c = float((span * (py * py + py * qy + qy * qy)).sum()) / (3 * total) - my * my
        b = float((span * (2 * px * py + px * qy + qx * py + 2 * qx * qy)).sum()) / (6 * total) - mx * my
        dx, dy = (q - p).sum(axis=0)
        if used >= length * (1 - 1e-12) or math.hypot(dx, dy) <= 1e-12 * total:
            dx, dy = 1.0, 0.0
        radius = math.hypot((a - c) / 2, b)
        major = (a + c) / 2 + radius
        if 2 * radius <= ROUND * (a + c):
            ex, ey = dx / math.hypot(dx, dy), dy / math.hypot(dx, dy)
        else:
            angle = 0.5 * math.atan2(b, (a - c) / 2)
            ex, ey = math.cos(angle), math.sin(angle)
            lean = ex * dx + ey * dy
            # Across the chord neither sign is better: the segment at the place decides.
            if lean < -ROUND * total or (abs(lean) <= ROUND * total and ex < 0):
                ex, ey = -ex, -ey
        minor = max(a * c - b * b, 0.0) / major
        gx, gy = ex * tx - ey * ty, ex * ty + ey * tx
        row[:] = -gy, gx, math.sqrt(minor) / width, used / width
    return out


# --- Force closure: the convex hull of the contact wrenches, and the friction that it takes ([12], [14]) -----

# Relative to the largest wrench: distance from a plane that counts as on it, and a triple without a plane.
ON_PLANE = 1e-12
NO_PLANE = 1e-9
MAX_CONTACTS = 8


def cone_edges(arms: Floats, normals: Floats, along: float, across: float) -> Floats:
    """(n, 2, 3) wrenches of the edges of each friction cone: force n * along +- t * across, and torque / rho."""
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    forces = np.stack([along * normals + across * tangents, along * normals - across * tangents], axis=1)
    torque = arms[:, None, 0] * forces[..., 1] - arms[:, None, 1] * forces[..., 0]
    return np.concatenate([forces, torque[..., None]], axis=2)


def _epsilon_qualities(edges: Floats) -> Floats:
    """(t,) signed distance of the origin from the nearest facet of the hull of the wrenches of (t, k, 2, 3) cone edges.

    Positive inside; 0 where the hull is flat.
    """
    w = edges.transpose(0, 2, 1, 3).reshape(len(edges), -1, 3)
    scale = np.abs(w).max(axis=(1, 2), initial=0.0)
    depth, flat = np.full(len(w), np.inf), np.zeros(len(w), dtype=np.bool_)
    for i, j, k in itertools.combinations(range(w.shape[1]), 3):
        m = np.cross(w[:, j] - w[:, i], w[:, k] - w[:, i])
        size = np.sqrt(np.einsum("ti,ti->t", m, m))
        plane = size > NO_PLANE * scale * scale
        m = m / np.where(plane, size, 1.0)[:, None]
        heights = np.einsum("tki,ti->tk", w - w[:, i : i + 1], m)
        at = np.einsum("ti,ti->t", w[:, i], m)
        above = (heights > (ON_PLANE * scale)[:, None]).any(axis=1)
        below = (heights < -(ON_PLANE * scale)[:, None]).any(axis=1)
        flat |= plane & ~above & ~below
        depth = np.where(plane & ~above, np.minimum(depth, at), depth)
        depth = np.where(plane & ~below & above, np.minimum(depth, -at), depth)
    return np.where(flat | ~np.isfinite(depth), 0.0, depth)


def _angle_between(a: Floats, b: Floats) -> float:
    return abs(math.atan2(a[0] * b[1] - a[1] * b[0], a @ b))


def _friction_angle(contacts: Floats, normals: Floats, arms: Floats) -> float:
    if len(contacts) == 2:
        d = contacts[1] - contacts[0]
        if not d.any():
            return math.pi / 2
        squeeze = max(_angle_between(normals[0], d), _angle_between(normals[1], -d))
        spread = max(_angle_between(normals[0], -d), _angle_between(normals[1], d))
        return min(squeeze, spread, math.pi / 2)

    def closes(angle: float) -> bool:
        edges = cone_edges(arms, normals, math.cos(angle), math.sin(angle))
        return bool(_epsilon_qualities(edges[None])[0] > ON_PLANE)

    low, high = 0.0, math.pi / 2 - 1e-9
    if closes(low):
        return 0.0
    if not closes(high):
        return math.pi / 2
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if closes(middle) else (middle, high)
    return high


def force_closure(contacts: Floats, normals: Floats, cx: float, cy: float, rho: float, friction: float) -> Closure:
    k = len(contacts)
    if not 2 <= k <= MAX_CONTACTS or len(normals) != k:
        raise ValueError(f"force closure takes 2 to {MAX_CONTACTS} contacts, each with its normal, not {k}")
    if not rho > 0 or not friction >= 0:
        raise ValueError(f"rho must be above 0 and friction at least 0, not {rho:g} and {friction:g}")
    arms = (contacts - (cx, cy)) / rho
    (epsilon,) = _epsilon_qualities(cone_edges(arms, normals, 1.0, friction)[None]).tolist()
    return Closure(epsilon, _friction_angle(contacts, normals, arms))


def judge_contacts(
    points: Floats,
    offsets: NDArray[np.int64],
    contacts: Floats,
    width: float,
    cx: float,
    cy: float,
    rho: float,
    friction: float,
) -> JudgedContacts:
    places = project_to_contour(points, offsets, contacts)
    frames = contact_frames(points, offsets, places, width)
    closure = force_closure(contacts, frames[:, :2], cx, cy, rho, friction)
    return JudgedContacts(frames[:, :2], frames[:, 2], places[:, 2].tolist(), *closure)


def carried_angles(maps: Floats, contacts: Floats, normals: Floats, rho: float) -> Floats:
    moved = [carry_normals(H, contacts, normals) for H in maps]
    return np.array([force_closure(a[:, :2], a[:, 2:4], *a[0, :2], rho, 0.0).friction_angle for a in moved])


# --- Triples of contacts that close while all fingers push toward their mean, or all away from it ([14]) -----

# Below this a grasp lies too near the edge of closing to be called closed.
LEAST_EPSILON = 1e-6
# Triples looked at together.
CHUNK = 20_000
# Candidates of pairs and triples: what takes seconds.
MOST_TRIPLED, MOST_PAIRED = 256, 20_000


def closing_triples(
    contacts: Floats, normals: Floats, cx: float, cy: float, rho: float, friction: float
) -> StableTriples:
    if len(normals) != len(contacts):
        raise ValueError("each candidate needs its normal")
    check_size(len(contacts), MOST_TRIPLED, "candidates")
    if not rho > 0 or not (friction > 0 and math.isfinite(friction)):
        raise ValueError(f"rho and friction must be above 0, not {rho:g} and {friction:g}")
    every = np.array(list(itertools.combinations(range(len(contacts)), 3)), dtype=np.int64).reshape(-1, 3)
    mean = contacts[every].mean(axis=1, keepdims=True)
    way, n = mean - contacts[every], normals[every]
    straight = friction * (n[..., 0] * way[..., 0] + n[..., 1] * way[..., 1])
    aside = np.abs(n[..., 0] * way[..., 1] - n[..., 1] * way[..., 0])
    toward, away = (aside < straight).all(axis=1), (aside < -straight).all(axis=1)
    every, sense = every[toward | away], np.where(toward, 1.0, -1.0)[toward | away]
    epsilon, edges = np.empty(len(every)), cone_edges((contacts - (cx, cy)) / rho, normals, 1.0, friction)
    for start in range(0, len(every), CHUNK):
        part = every[start : start + CHUNK]
        epsilon[start : start + CHUNK] = _epsilon_qualities(edges[part])
    closed = epsilon > LEAST_EPSILON
    return StableTriples(every[closed], sense[closed], epsilon[closed])


# --- Pairs of contacts whose friction cones hold the line between them ([10], [12]) -----

# Of the friction: a contact on the edge of its cone is not stable.
STRICTLY = 1 - 1e-6


def opposed_pairs(contacts: Floats, normals: Floats, worth: Floats, group: int, friction: float) -> StablePairs:
    m = len(contacts)
    if len(normals) != m or len(worth) != m:
        raise ValueError("each candidate needs its normal and its worth")
    check_size(m, MOST_PAIRED, "candidates")
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
        return StablePairs(np.empty((0, 2), dtype=np.int64), np.empty(0), np.empty(0))
    return StablePairs(np.concatenate(pairs).astype(np.int64), np.concatenate(senses), np.concatenate(needs))
