# SPDX-License-Identifier: Apache-2.0
"""The same grasp in two images, by every strategy, each judged by the edges of the second image."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.analysis import GraspAnalysis
from grasptrack.contour import View
from grasptrack.errors import AmbiguousError, GraspTrackError
from grasptrack.grasp import Grasp
from grasptrack.observation.candidate import Candidate
from grasptrack.observation.images import Grey, to_bgr, to_mask
from grasptrack.observation.segmentation import candidates, grow
from grasptrack.reference import Reference
from grasptrack.transfer import STRATEGIES
from grasptrack.transfer.alignment import alignments, as_similarity, choose
from grasptrack.verdict import error, refuse

Floats = NDArray[np.float64]


class Outcome(NamedTuple):
    """What one strategy makes of a pair of images.

    Attributes:
        strategy: its name.
        contacts: (k, 2) px in the second image as transferred, also when they are not believed; None when refused.
        homography: (3, 3) from the first image to the second, or None.
        analysis: of the transferred grasp, in the first view; None when there is none.
        off: px by which the second image's edges say that the worst contact is off; NaN when refused.
        reason: empty when believed, else why not.
    """

    strategy: str
    contacts: Floats | None
    homography: Floats | None
    analysis: GraspAnalysis | None
    off: float
    reason: str


class Pair(NamedTuple):
    """A grasp in two images.

    Attributes:
        outcomes: one for each strategy.
        current: the outline in the second image.
        turns: degrees of the other turns by which the outline would fit as well; empty where it has no symmetry.
    """

    outcomes: list[Outcome]
    current: View
    turns: list[float]


def carry_to(
    grasp: Grasp,
    reference: View,
    first: NDArray[Any],
    second: NDArray[Any],
    friction: float,
    object_at: tuple[float, float] | None = None,
    ignore: NDArray[Any] | None = None,
) -> Pair:
    """Carry a grasp to a second image by every strategy.

    One pair of views cannot tell a symmetric object from its turned twin: the smallest turn is taken, or where none is
    clearly the smallest the one that fits best, and the others are told.

    Args:
        grasp, reference: in the first image.
        first, second: the images.
        friction: Coulomb coefficient.
        object_at: (x, y) px of the object in the second image.
        ignore: (H, W) nonzero where nothing belongs to either scene.

    Raises:
        ObservationError: no object in the second image.
        SourceError, InputError: an image or mask that cannot be used.
        AmbiguousError: the outline fits itself in every turn, as a disc does.
    """
    colours = to_bgr(second)
    hidden = None if ignore is None else grow(to_mask(ignore, colours.shape[:2], "ignore mask"))
    found = _most_alike(candidates(colours, object_at, hidden), reference)
    grey_a, grey_b = found.channel.grey(to_bgr(first)), found.channel.grey(colours)
    outer = found.view.outer
    ways = alignments(reference.outer, outer)
    try:
        chosen = choose(ways, 0.0)
    except AmbiguousError:
        if not ways:
            raise
        chosen = ways[0]  # none is clearly the smallest turn; the others are told
    prior = as_similarity(chosen, reference.outer, outer)
    turns = [np.degrees(a.angle) for a in ways if a is not chosen]
    outcomes = [_by(name, grasp, reference, grey_a, grey_b, found, prior, friction) for name in STRATEGIES]
    return Pair(outcomes, found.view, turns)


def _by(
    name: str,
    grasp: Grasp,
    reference: View,
    grey_a: Grey,
    grey_b: Grey,
    found: Candidate,
    prior: Floats,
    friction: float,
) -> Outcome:
    try:
        start = Reference(grasp, reference, grey_a, name, found.polarity, friction)
        moved = start.carriers[0].carry(grey_b, found.view, prior).transfer
        contacts, H = moved.grasp.contacts, moved.homography
        if H is None:
            return Outcome(name, contacts, None, None, np.nan, "the transfer has no homography to judge it by")
        support = start.samples.support(grey_b, H, contacts)
    except GraspTrackError as problem:
        return Outcome(name, None, None, None, np.nan, str(problem))
    reason, analysis = refuse(support), None
    try:
        analysis = start.carried_back(contacts, H)
    except GraspTrackError as problem:
        reason = reason or str(problem)
    return Outcome(name, contacts, H, analysis, error(support), reason)


def _most_alike(found: list[Candidate], reference: View) -> Candidate:
    """Among what stands out, the outline that the reference's fits best under a similarity."""

    def misfit(candidate: Candidate) -> float:
        c = alignments(reference.outer, candidate.view.outer)
        relative = c[0].residual / np.sqrt(candidate.view.outer.area) if c else 0.0
        return float(relative)

    return min(found[:6], key=misfit)
