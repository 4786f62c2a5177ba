# SPDX-License-Identifier: Apache-2.0
"""Choose grasps on an outline: all good antipodal pairs, ranked (Fig. 3; references [10], [12])."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.analysis import DEFAULT_FRICTION, FINGER_WIDTH, check_friction, check_width
from grasptrack.contour import Contour, Outline, as_view
from grasptrack.errors import StrategyError
from grasptrack.grasp import Grasp

Floats = NDArray[np.float64]

CANDIDATES = 240
"""Contact candidates for pairs, spread evenly over the outline."""
CANDIDATES_3 = 48
"""Contact candidates for triples, of which there are n^3 / 6."""
MAX_FLATNESS = 0.04
"""Under a finger flatter than this the outline is straight or gently curved; a right-angled corner has 0.10."""
DISTINCT = 0.08
"""Grasps whose contacts all lie within this fraction of sqrt(area) of a better one's are the same grasp."""


def synthesize(
    outline: Outline,
    fingers: int = 2,
    friction: float = DEFAULT_FRICTION,
    finger_width: float | None = None,
    top: int = 50,
) -> list[Grasp]:
    """Ranked stable grasps, best first; empty where there is none. The same outline gives the same list.

    The quality is a product of terms between 0 and 1: the share of the friction angle left over; closeness of the
    grasp's centre to the centroid; flatness under the fingers and beside them.

    Args:
        outline: a Contour or View; contacts are not put where the image border cuts the object.
        fingers: 2 or 3.
        friction: Coulomb coefficient; less friction leaves fewer grasps.
        finger_width: px over which the outline must be flat; default 10 % of sqrt(area).
        top: at most so many grasps.

    Raises:
        StrategyError: a number of fingers that has no synthesis.
        InputError: friction or finger_width not positive.
    """
    check_friction(friction)
    check_width(finger_width)
    if fingers not in (2, 3):
        raise StrategyError(
            f"grasps are synthesised for 2 or 3 fingers, not {fingers}; give the contacts instead", fingers=fingers
        )
    view = as_view(outline)
    area, cx, cy, *_ = kernels.inertia(view.points, view.offsets)
    size = math.sqrt(area)
    width = finger_width or FINGER_WIDTH * size
    places = _candidates(view.contours, CANDIDATES if fingers == 2 else CANDIDATES_3, width)
    frames = kernels.contact_frames(view.points, view.offsets, places, width)
    flat = frames[:, 2] < MAX_FLATNESS
    contacts = kernels.point_at(view.points, view.offsets, places[flat])
    if len(contacts) < fingers:
        return []
    # a finger that slips by its own width should still stand on something flat
    beside = kernels.contact_frames(view.points, view.offsets, places, 2.0 * width)[flat, 2]
    roughness = np.maximum(frames[flat, 2], 0.5 * beside)
    rank = _pairs if fingers == 2 else _triples
    chosen, quality = rank(contacts, frames[flat, :2].copy(), roughness, np.array([cx, cy]), size, friction)
    return _distinct(contacts, chosen, quality, DISTINCT * size, top)


def _candidates(contours: tuple[Contour, ...], count: int, width: float) -> Floats:
    """(n, 2) contour and position of evenly spread points, none within a finger of where the border cuts."""
    total = sum(c.length for c in contours)
    rows = []
    for index, contour in enumerate(contours):
        n = max(round(count * contour.length / total), 4)
        s = np.arange(n) * (contour.length / n)
        position = np.interp(s, contour.arc_length, np.arange(len(contour) + 1, dtype=np.float64))
        if contour.clipped is not None:
            cut = contour.arc_length[:-1][contour.clipped]
            gap = np.abs(s[:, None] - cut[None, :])
            position = position[np.minimum(gap, contour.length - gap).min(axis=1) > width]
        rows.append(np.column_stack([np.full(len(position), float(index)), position]))
    return np.ascontiguousarray(np.concatenate(rows))


def _pairs(
    contacts: Floats, normals: Floats, roughness: Floats, centroid: Floats, size: float, friction: float
) -> tuple[NDArray[np.int64], Floats]:
    """All pairs whose line lies strictly in both friction cones, squeezed from outside."""
    first, second = np.triu_indices(len(contacts), 1)
    line = contacts[second] - contacts[first]
    opening = np.hypot(line[:, 0], line[:, 1])
    keep = opening > 0.02 * size
    first, second, line = first[keep], second[keep], line[keep] / opening[keep, None]
    # the inward normals look along the line from contact 1, and against it from contact 2
    worst = np.minimum(np.einsum("ij,ij->i", normals[first], line), -np.einsum("ij,ij->i", normals[second], line))
    phi = math.atan(friction)
    inside = worst > math.cos(phi) + 1e-12
    first, second, line, worst = first[inside], second[inside], line[inside], worst[inside]
    margin = (phi - np.arccos(np.clip(worst, -1.0, 1.0))) / phi
    arm = centroid - contacts[first]
    distance = np.abs(arm[:, 0] * line[:, 1] - arm[:, 1] * line[:, 0]) / size
    middle = 0.5 * (contacts[first] + contacts[second]) - centroid
    off_centre = np.hypot(middle[:, 0], middle[:, 1]) / size
    worst_pad = np.maximum(roughness[first], roughness[second])
    quality = (
        np.sqrt(margin) * np.exp(-((distance / 0.3) ** 2) - (off_centre / 1.0) ** 2) / (1.0 + (worst_pad / 0.01) ** 2)
    )
    return np.column_stack([first, second]), quality


def _triples(
    contacts: Floats, normals: Floats, roughness: Floats, centroid: Floats, size: float, friction: float
) -> tuple[NDArray[np.int64], Floats]:
    """All triples whose contact wrenches surround the origin."""
    rows, scores = [], []
    cx, cy = centroid.tolist()
    for triple in combinations(range(len(contacts)), 3):
        index = list(triple)
        facing = normals[index].sum(axis=0)
        if facing @ facing > 1.0:  # three nearly parallel pushes cannot balance
            continue
        epsilon, _ = kernels.force_closure(contacts[index], normals[index], cx, cy, 0.5 * size, friction)
        if epsilon <= 1e-9:
            continue
        middle = contacts[index].mean(axis=0) - centroid
        rows.append(index)
        scores.append(
            epsilon * math.exp(-float(middle @ middle) / (0.3 * size) ** 2) / (1 + (roughness[index].max() / 0.01) ** 2)
        )
    return np.array(rows, dtype=np.int64).reshape(-1, 3), np.array(scores, dtype=np.float64)


def _distinct(contacts: Floats, chosen: NDArray[np.int64], quality: Floats, gap: float, top: int) -> list[Grasp]:
    """The best first, near-duplicates left out."""
    order = np.lexsort((*chosen.T[::-1], -np.round(quality, 9)))
    pairs, worth = contacts[chosen[order]], quality[order]
    grasps: list[Grasp] = []
    while len(pairs) and len(grasps) < top:
        best = pairs[0]
        grasps.append(Grasp(best, float(worth[0])))
        away = np.minimum(_farthest(pairs, best), _farthest(pairs, best[::-1])) >= gap
        pairs, worth = pairs[away], worth[away]
    return grasps


def _farthest(grasps: Floats, one: Floats) -> Floats:
    """(n,) the largest distance between corresponding contacts."""
    apart: Floats = np.hypot(grasps[:, :, 0] - one[:, 0], grasps[:, :, 1] - one[:, 1]).max(axis=1)
    return apart
