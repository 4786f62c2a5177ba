# SPDX-License-Identifier: Apache-2.0
"""Which of the objects in a first view is meant, and which grasp on it."""

from __future__ import annotations

import math

from grasptrack.analysis import ON_OUTLINE
from grasptrack.contour import View
from grasptrack.errors import GraspError
from grasptrack.grasp import Grasp
from grasptrack.hand import Hand
from grasptrack.observation.candidate import Candidate
from grasptrack.reference import AUTO, describable
from grasptrack.synthesis import synthesize

NEARLY_AS_GOOD = 0.7
"""Share of the best quality that a grasp needs to be preferred for being easier to carry."""
SAME_OUTLINE = 1.5
"""px by which outlines may differ that two candidates share."""
APART = 0.3
"""Outlines whose mean points lie within this fraction of sqrt(area) belong to one object."""


def holding(found: list[Candidate], grasp: Grasp) -> Candidate:
    """The object whose outline is nearest to all given contacts.

    Raises:
        GraspError: a contact is too far from it.
    """
    distances = [float(grasp.on(c.view)[:, 2].max()) for c in found]
    # a hole may be an object of its own, and its outline that of the part round it as well: the part is rated higher
    index = next(i for i, d in enumerate(distances) if d <= min(distances) + SAME_OUTLINE)
    distance = distances[index]
    limit = ON_OUTLINE * math.sqrt(found[index].view.outer.area)
    if distance > limit:
        raise GraspError(
            f"a contact is {distance:.1f} px from the nearest object's outline; at most {limit:.1f} px are allowed",
            distance=distance,
        )
    return found[index]


def same(found: list[Candidate], view: View) -> Candidate | None:
    """The object where an outline was in the image before, or None when none is near."""
    return min((c for c in found if _gap(c.view, view) <= 1.0), key=lambda c: _gap(c.view, view), default=None)


def others(found: list[Candidate], chosen: Candidate) -> list[Candidate]:
    """What else lies in the view."""
    return [c for c in found if _gap(c.view, chosen.view) > APART]


def grasps(
    view: View, strategy: str, fingers: int, friction: float, hand: Hand | None, beside: list[View]
) -> tuple[list[Grasp], str]:
    """Synthesised grasps in the order in which they are to be tried, and why there is none.

    Args:
        view: the object.
        strategy: that will carry the grasp.
        fingers, friction, hand: as in synthesis.
        beside: outlines of what lies beside the object.
    """
    found = synthesize(view, fingers, friction, top=10, hand=hand, neighbours=beside)
    ranked: list[Grasp] = [*found]
    if strategy == AUTO and ranked:
        # among grasps that are nearly as good, the first that most descriptions can carry
        good = [g for g in ranked if g.quality >= NEARLY_AS_GOOD * ranked[0].quality]
        ranked = sorted(good, key=lambda g: -describable(g, view))
    return ranked, found.reason


def _gap(one: View, other: View) -> float:
    """Distance of two outlines' mean points in sqrt(area) of the second."""
    away = one.outer.points.mean(axis=0) - other.outer.points.mean(axis=0)
    return math.hypot(*away.tolist()) / math.sqrt(other.outer.area)
