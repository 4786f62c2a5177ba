# SPDX-License-Identifier: Apache-2.0
"""Where contacts may lie, which of them close together, and the terms of a grasp's quality that follow from them alone."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.geometry.contours import View
from grasptrack.typing import Floats, Ints

GROUPS = 120
"""Stretches of outline of which each two give at most one pair."""
GROUP = 6
"""Candidates in each of them: a pair that closes only in a narrow place needs them close together."""
LEAST_GROUPS = 4
"""On each contour, however short."""


class Candidates(NamedTuple):
    """Places on an outline at which a finger may stand.

    Attributes:
        places: (m, 2) contour, position.
        contacts: (m, 2) px.
        normals: (m, 2) unit, into the material, over the width of a finger.
        roughness: (m,) rms distance of the outline from a straight line in finger widths: under the pad, or half of
            that over twice the width where this is more, for a finger that slips should still stand on something flat.
        usable: (m,) False within a finger's width of where the image border cuts the object, and where the outline touches
            itself.
        starts: (C + 1,) contour c has the candidates ``starts[c]:starts[c + 1]``.
        steps: (C,) px of arc length between neighbours.
        size: px, sqrt(area).
        centroid: (2,) px.
    """

    places: Floats
    contacts: Floats
    normals: Floats
    roughness: Floats
    usable: NDArray[np.bool_]
    starts: NDArray[np.int64]
    steps: Floats
    size: float
    centroid: Floats


def sample_candidates(view: View, area: float, centroid: Floats, width: float) -> Candidates:
    """Candidates on all contours of a view, for fingers of a width in px."""
    total = sum(c.length for c in view.contours)
    rows, usable, starts, steps = [], [], [0], []
    for index, contour in enumerate(view.contours):
        n = GROUP * max(round(GROUPS * contour.length / total), LEAST_GROUPS)
        s = np.arange(n) * (contour.length / n)
        rows.append(np.empty((n, 2)))
        rows[-1][:, 0] = index
        rows[-1][:, 1] = np.interp(s, contour.arc_length, np.arange(len(contour) + 1, dtype=np.float64))
        usable.append(np.ones(n, dtype=np.bool_))
        if contour.clipped is not None:
            cut = contour.arc_length[:-1][contour.clipped]
            gap = np.abs(s[:, None] - cut[None, :])
            between = (contour.clipped & np.roll(contour.clipped, -1))[rows[-1][:, 1].astype(np.int64)]
            usable[-1] = (np.minimum(gap, contour.length - gap).min(axis=1) > width) & ~between
        starts.append(starts[-1] + n)
        steps.append(contour.length / n)
    places = np.concatenate(rows)
    contacts = kernels.point_at(view.points, view.offsets, places)
    clear = ~_is_doubled(view, places, contacts, np.array(steps))
    frames = kernels.contact_frames(view.points, view.offsets, places, width)
    beside = kernels.contact_frames(view.points, view.offsets, places, 2.0 * width)[:, 2]
    return Candidates(
        places,
        contacts,
        np.ascontiguousarray(frames[:, :2]),
        np.maximum(frames[:, 2], 0.5 * beside),
        np.concatenate(usable) & clear,
        np.array(starts, dtype=np.int64),
        np.array(steps),
        math.sqrt(area),
        centroid,
    )


MOST_OF_TRIPLES = 256
"""Candidates that triples are made of, however many holes an object has: as many as the kernel takes."""

SAME_PLACE = 1e-6
"""Of a contour's length, or of the object's size: places that are no farther apart are one, wherever their points lie."""


def _is_doubled(view: View, places: Floats, contacts: Floats, steps: Floats) -> NDArray[np.bool_]:
    """(m,) where the outline lies on itself, as on a way out and back of no width: nobody can tell the side of a contact."""
    lengths = np.array([c.length for c in view.contours])

    def arc_positions(at: Floats) -> Floats:
        s = np.empty(len(at))
        for c, contour in enumerate(view.contours):
            own = at[:, 0] == c
            s[own] = np.interp(at[own, 1], np.arange(len(contour) + 1.0), contour.arc_length)
        return s

    found = kernels.project_to_contour(view.points, view.offsets, contacts)
    home, there = places[:, 0].astype(np.int64), found[:, 0].astype(np.int64)
    s, t = arc_positions(places), arc_positions(found)
    gap = np.abs(s - t)
    doubled: NDArray[np.bool_] = (home != there) | (np.minimum(gap, lengths[home] - gap) > SAME_PLACE * lengths[home])
    for c, at in zip(there[doubled].tolist(), t[doubled].tolist(), strict=True):  # the other side, which is found first
        far = np.abs(s - at)
        doubled |= (home == c) & (np.minimum(far, lengths[c] - far) <= steps[c])
    return doubled


def thin_candidates(at: Candidates, count: int) -> NDArray[np.int64]:
    """Indices of about so many usable candidates, evenly spread, at least two for each of a contour's least groups."""
    lengths = np.diff(at.starts) * at.steps
    rows = []
    for start, end, length in zip(at.starts[:-1], at.starts[1:], lengths, strict=True):
        n = int(end - start)
        few = min(max(round(count * float(length / lengths.sum())), 2 * LEAST_GROUPS), n)
        rows.append(start + np.arange(few) * n // few)
    chosen: NDArray[np.int64] = np.concatenate(rows)
    return chosen[at.usable[chosen]]


ROUGH = 0.01
"""Roughness, in finger widths, at which flatness is one half."""
LINE_OFF = 0.3
"""Distance of the grasp line (two fingers) or of the contacts' mean (three) from the centroid, as a fraction of
sqrt(area), at which the term of the centre is 1 / e."""
MIDDLE_OFF = 1.0
"""The same for the middle of two contacts, along the line."""
WIDE = 2.5
"""Opening in sqrt(area) at which the term of the span is one half."""
ENOUGH_EPSILON = 0.15
"""Epsilon of three fingers at which the term of the closure is 1 - 1 / e."""


class Stable:
    """Stable candidates, one for each row, not yet held against a hand.

    Attributes:
        index: (g, k) of their contacts among the candidates.
        sense: (g,) 1 squeeze, -1 spread.
        strength: (g,) the friction that a pair needs, the epsilon of a triple.
        friction: Coulomb coefficient.
        contacts: (g, k, 2) px.
        directions: (g, k, 2) unit vectors in which the fingers push: along the line for two, toward the contacts'
            mean or away from it for three.
        opening: (g,) px: distance of two contacts, twice the largest distance of three from their mean.
        roughness: (g,) of the worst contact.
        terms: (g, 4) closure, centre, flatness, span.
    """

    def __init__(self, at: Candidates, index: Ints, sense: Floats, strength: Floats, friction: float) -> None:
        self.index, self.sense, self.strength, self.friction = index, sense, strength, friction
        self.contacts: Floats = at.contacts[index]
        self.roughness: Floats = at.roughness[index].max(axis=1)
        mean = self.contacts.mean(axis=1)
        arms = mean[:, None] - self.contacts
        reach = np.hypot(arms[..., 0], arms[..., 1])
        self.opening: Floats = 2.0 * reach.max(axis=1)
        self.directions: Floats = arms * (sense[:, None] / reach)[..., None]
        off = (mean - at.centroid) / at.size
        if index.shape[1] == 2:
            along = self.directions[:, 0]
            across = off[:, 0] * along[:, 1] - off[:, 1] * along[:, 0]
            distance = (across / LINE_OFF) ** 2 + (off**2).sum(axis=1) / MIDDLE_OFF**2
            closure = np.sqrt(1.0 - strength / friction)
        else:
            distance = (off**2).sum(axis=1) / LINE_OFF**2
            closure = 1.0 - np.exp(-strength / ENOUGH_EPSILON)
        span = 1.0 / (1.0 + (self.opening / (WIDE * at.size)) ** 6)
        self.terms: Floats = np.column_stack([closure, np.exp(-distance), flatness_term(self.roughness), span])

    def __len__(self) -> int:
        return len(self.index)


def flatness_term(roughness: Floats) -> Floats:
    """1 on a straight edge, one half at ROUGH, near 0 at a corner."""
    return 1.0 / (1.0 + (roughness / ROUGH) ** 2)


def stable_pairs(at: Candidates, friction: float) -> Stable:
    """For every two stretches of candidates the best stable pair."""
    worth = np.where(at.usable, flatness_term(at.roughness), -1.0)
    index, sense, need = kernels.opposed_pairs(at.contacts, at.normals, worth, GROUP, friction)
    way = np.abs(at.contacts[index[:, 0]] - at.contacts[index[:, 1]]).max(axis=1, initial=0.0)
    apart = way > SAME_PLACE * at.size  # an outline may touch itself
    return Stable(at, index[apart], sense[apart], need[apart], friction)


def stable_triples(at: Candidates, friction: float, count: int) -> Stable:
    """All stable triples of some `count` candidates."""
    few = thin_candidates(at, count)
    few = few[:: max(1, -(-len(few) // MOST_OF_TRIPLES))]
    cx, cy = at.centroid.tolist()
    index, sense, epsilon = kernels.closing_triples(at.contacts[few], at.normals[few], cx, cy, 0.5 * at.size, friction)
    return Stable(at, few[index], sense, epsilon, friction)
