# SPDX-License-Identifier: Apache-2.0
"""Turns under which an outline fits itself, and objects beside it that look the same."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import homography_jacobian
from grasptrack.matching import Sampled, find_symmetries
from grasptrack.trackability.first import FirstView
from grasptrack.trackability.synthetic_view import REST, Stage
from grasptrack.tracking.estimator import Hypothesis
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.single import (
    first_state,
    pose_hypothesis,
    same_place,
    single_estimate,
    told_apart,
    turned_hypotheses,
)
from grasptrack.tracking.target import Target, build_pyramid
from grasptrack.transfer.alignment import as_similarity, find_alignments

EQUAL = 0.03
"""Share of sqrt(area), rms, by which outlines may differ under the best similarity to be looked at as equals."""


class Symmetry(NamedTuple):
    """How often an object fits itself.

    Attributes:
        turns: degrees, ascending, other than none; the image shows the object again when it is turned so.
        every: the outline fits itself in every turn, as a disc does.
        known: False where the border cuts the object, so that nobody can tell.
    """

    turns: tuple[float, ...]
    every: bool
    known: bool

    @property
    def order(self) -> int:
        """In how many ways it fits itself; 0 for every turn."""
        return 0 if self.every else len(self.turns) + 1


class Likeness:
    """The object laid elsewhere, and whether the image tells that from where it is.

    Args:
        first: the first view.
        target: made of it.
        stage: the same, to be seen again with other noise.
    """

    def __init__(self, first: FirstView, target: Target, stage: Stage) -> None:
        self._first = first
        self._levels = build_pyramid(first.grey)
        self.target = target
        self._state = first_state(self.target, self._levels, NUMBERS)
        self._again = build_pyramid(stage.seen(REST))
        here = Hypothesis("first", self.target.A, self._state.P)
        self._own = single_estimate(self.target, self._state, self._again, here, NUMBERS)

    def turns(self) -> list[float]:
        """Degrees, the turns of the outline into itself that its surface does not tell from none."""
        own = self._own
        if own is None:
            return []
        found = []
        for hypothesis in turned_hypotheses(self.target, own, NUMBERS):
            other = single_estimate(self.target, self._state, self._again, hypothesis, NUMBERS)
            if other is None or same_place(own, other, NUMBERS) or told_apart(self._state, own, other, NUMBERS):
                continue
            x, y = self.target.outline.mean(axis=0).tolist()
            a, b, c, d = homography_jacobian(np.linalg.inv(own.G) @ other.G, x, y)
            found.append(math.degrees(math.atan2(c - b, a + d)) % 360.0)
        return sorted(found)

    def is_equal(self, other: View) -> bool:
        """Whether another object of the image looks just like this one: it has its outline, and no other surface."""
        outer = self._first.candidate.view.outer
        ways = find_alignments(outer, other.outer)
        if not ways:
            return self._own is not None
        if ways[0].residual > EQUAL * math.sqrt(other.outer.area):
            return False
        for way in ways:
            hypothesis = pose_hypothesis(self.target, "equal", as_similarity(way, outer, other.outer), NUMBERS)
            there = single_estimate(self.target, self._state, self._levels, hypothesis, NUMBERS)
            if self._own is None or (there is not None and not told_apart(self._state, self._own, there, NUMBERS)):
                return True
        return False


def symmetry_of(first: FirstView, likeness: Likeness, turn_shown: bool = True) -> Symmetry:
    """Turns of an outline into itself, holes included, that its image bears out.

    Args:
        first: the first view.
        likeness: of its object.
        turn_shown: False where a turn moves the outline along itself throughout.
    """
    view = first.candidate.view
    if view.is_clipped:
        return Symmetry((), False, False)
    if not turn_shown or find_symmetries(Sampled(view)).continuous:
        return Symmetry((), True, True)
    return Symmetry(tuple(likeness.turns()), False, True)


def equals_of(first: FirstView, likeness: Likeness) -> list[View]:
    """Outlines of the objects beside it that look just like it."""
    if first.candidate.view.is_clipped:
        return []
    polarity = first.candidate.polarity
    beside = [c.view for c in first.others if c.polarity * polarity >= 0 and not c.view.is_clipped]
    return [view for view in beside if likeness.is_equal(view)]
