# SPDX-License-Identifier: Apache-2.0
"""The terms of a grasp's quality that follow from its contacts alone; `kernels:rank_grasps` adds the room."""

from __future__ import annotations

import numpy as np

from grasptrack import kernels
from grasptrack.grasp.synthesis.candidates import GROUP, Candidates, thin_candidates
from grasptrack.typing import Floats, Ints

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
        contacts: (g, k, 2) px.
        directions: (g, k, 2) unit vectors in which the fingers push: along the line for two, toward the contacts'
            mean or away from it for three.
        opening: (g,) px: distance of two contacts, twice the largest distance of three from their mean.
        roughness: (g,) of the worst contact.
        terms: (g, 4) closure, centre, flatness, span.
    """

    def __init__(self, at: Candidates, index: Ints, sense: Floats, strength: Floats, friction: float) -> None:
        self.index, self.sense, self.strength = index, sense, strength
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
    return Stable(at, index, sense, need, friction)


def stable_triples(at: Candidates, friction: float, count: int) -> Stable:
    """All stable triples of some `count` candidates."""
    few = thin_candidates(at, count)
    cx, cy = at.centroid.tolist()
    index, sense, epsilon = kernels.closing_triples(at.contacts[few], at.normals[few], cx, cy, 0.5 * at.size, friction)
    return Stable(at, few[index], sense, epsilon, friction)
