# SPDX-License-Identifier: Apache-2.0
"""What the tracker's own evidence says before a run: what fixes contacts, symmetry, lookalikes, and who can carry a grasp."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.equality import compared_by_value
from grasptrack.errors import GraspTrackError
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import rotation_at
from grasptrack.grasp.contacts import Grasp
from grasptrack.matching import Sampled, find_symmetries
from grasptrack.trackability.first import InspectedView
from grasptrack.trackability.prediction import Looked
from grasptrack.trackability.synthetic_view import REST, Stage
from grasptrack.tracking.estimator import first_state
from grasptrack.tracking.evidence import texture_evidence
from grasptrack.tracking.follower import AUTO
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.pose import Hypothesis, PoseEstimate
from grasptrack.tracking.selection import make_target
from grasptrack.tracking.single import pose_hypothesis, same_place, single_estimate, told_apart, turned_hypotheses
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.strategies import Silhouettes, Snakes
from grasptrack.tracking.target import Grey, Target, build_pyramid
from grasptrack.transfer.alignment import as_similarity, find_alignments
from grasptrack.transfer.homography import PROMINENCE, SEPARATION, SMOOTHING
from grasptrack.typing import Floats

By = Literal["outline", "surface", "ground", "nothing"]

VIEWS = 3
"""Images of a drawn run, its first, in which it is looked at."""
MORE = 0.5
"""A surface settles a motion only where it leaves less than this share of the error that the outline leaves."""
LOOSE = 0.25
"""Share of sqrt(area), standard deviation of a contact that nothing fixes."""
BACKGROUND = "background"
"""Origin of an estimate that rests on the motion of the ground."""
UNTEXTURED = replace(NUMBERS, texture_contrast=math.inf)
"""The core's numbers for a target that is looked at by its outline alone."""


@compared_by_value
class Settled(NamedTuple):
    """How far the tracker's evidence fixes the contacts.

    Attributes:
        covariances: (3, k, 2, 2) px^2 of each contact: by the outline alone, with the surface, and with the ground too.
        by: the least of these that fixes every contact as the tracker asks for; "outline" only where it shows all motions.
    """

    covariances: Floats
    by: By

    @property
    def contact_deviations(self) -> tuple[float, float, float]:
        """px, the largest standard deviation of a contact by each of the three."""
        outline, surface, ground = (largest_deviation(C) for C in self.covariances)
        return outline, surface, ground

    @property
    def covariance(self) -> Floats:
        """(k, 2, 2) px^2 of each contact by what fixes them, or by all there is."""
        return np.asarray(self.covariances[{"outline": 0, "surface": 1}.get(self.by, 2)])


def contact_evidence(
    first: InspectedView, target: Target, looked: Sequence[Looked], limit: float, shown: bool
) -> Settled:
    """What fixes the contacts, as the tracker itself counts it, in small motions of the first view.

    Args:
        first: the first view.
        target: made of it.
        looked: at least `VIEWS` images of a drawn run, from its beginning.
        limit: px, the standard deviation of a contact from which on it is not believed.
        shown: the outline shows all motions.
    """
    levels = build_pyramid(first.grey)
    bare = make_target(levels, first.candidate.view, first.held_grasp.contacts, UNTEXTURED, first.ignore_mask)
    by_outline, by_surface = (first_state(each, levels) for each in (bare, target))
    alone, surface, ground = list[PoseEstimate](), list[PoseEstimate](), list[PoseEstimate]()
    for grey, step, decision in looked[:VIEWS]:
        image = build_pyramid(grey)
        outlined = _estimate_pose(by_outline, image, step.H)
        if outlined is not None:
            alone.append(outlined)
        textured = _estimate_pose(by_surface, image, step.H)
        if textured is not None and texture_evidence(by_surface, textured) > 0.0:  # else there is only noise
            surface.append(textured)
        followed = decision.estimate
        if followed is not None and followed.origin == BACKGROUND:
            ground.append(followed)
    # noisy directions of the edges seem to show what the shape does not
    free = unfixed_covariance(first)
    least = _median_covariance(alone, free) if shown else free
    more = _smaller_covariance(_median_covariance(surface, least), least)
    most = _smaller_covariance(_median_covariance(ground, more), more)
    deviation = [largest_deviation(C) for C in (least, more, most)]
    by: By = "nothing"
    if shown and deviation[0] <= limit:
        by = "outline"
    elif deviation[1] <= min(limit, MORE * deviation[0]):
        by = "surface"
    elif deviation[2] <= min(limit, MORE * deviation[0]):
        by = "ground"
    return Settled(np.stack([least, more, most]), by)


def unfixed_covariance(first: InspectedView) -> Floats:
    """(k, 2, 2) px^2 of each contact where nothing fixes it."""
    return np.tile(LOOSE**2 * first.candidate.view.outer.area * np.eye(2), (len(first.held_grasp), 1, 1))


def _median_covariance(found: Sequence[PoseEstimate], without: Floats) -> Floats:
    """(k, 2, 2) px^2 of the contacts in the median view, as the decision takes it; `without` where half have no estimate."""
    if 2 * len(found) < VIEWS:
        return without
    return sorted((e.covariance * NUMBERS.inflate**2 for e in found), key=largest_deviation)[len(found) // 2]


def _estimate_pose(state: TrackState, image: list[Grey], H: Floats) -> PoseEstimate | None:
    """The target laid on an image, of which this is the pyramid, that shows it under a homography (3, 3)."""
    return single_estimate(state, image, pose_hypothesis(state.target, "staged", H))


def largest_deviation(covariance: Floats) -> float:
    """px, the largest standard deviation in any direction of contacts with covariances (k, 2, 2) px^2."""
    return math.sqrt(float(np.linalg.eigvalsh(covariance)[:, -1].max()))


def _smaller_covariance(one: Floats, other: Floats) -> Floats:
    """The smaller of two covariances (k, 2, 2) px^2: what tells more can be left out of account."""
    return one if largest_deviation(one) < largest_deviation(other) else other


EQUAL = 0.03
"""Share of sqrt(area), rms, by which outlines may differ under the best similarity to be looked at as equals."""


@compared_by_value
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
    """The object laid elsewhere, and whether the image tells that from where it is."""

    def __init__(self, first: InspectedView, target: Target, stage: Stage) -> None:
        self._first = first
        self._levels = build_pyramid(first.grey)
        self.target = target
        self._state = first_state(self.target, self._levels)
        self._again = build_pyramid(stage.render_grey(REST))
        here = Hypothesis("first", self.target.A, self._state.P)
        self._own = single_estimate(self._state, self._again, here)

    def indistinct_turns(self) -> list[float]:
        """Degrees, the turns of the outline into itself that its surface does not tell from none."""
        own = self._own
        if own is None:
            return []
        found = []
        for hypothesis in turned_hypotheses(self.target, own):
            other = single_estimate(self._state, self._again, hypothesis)
            if other is None or same_place(own, other, self.target.numbers):
                continue
            if told_apart(self._state, own, other, NUMBERS.risk):
                continue
            x, y = self.target.outline.mean(axis=0).tolist()
            found.append(math.degrees(rotation_at(np.linalg.inv(own.G) @ other.G, x, y)) % 360.0)
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
            hypothesis = pose_hypothesis(self.target, "equal", as_similarity(way, outer, other.outer))
            there = single_estimate(self._state, self._levels, hypothesis)
            if self._own is None or (there is not None and not told_apart(self._state, self._own, there, NUMBERS.risk)):
                return True
        return False


def symmetry_of(first: InspectedView, likeness: Likeness, turn_shown: bool = True) -> Symmetry:
    """Turns of an outline into itself, holes included, that its image bears out."""
    view = first.candidate.view
    if view.is_clipped:
        return Symmetry((), False, False)
    if not turn_shown or find_symmetries(Sampled(view)).continuous:
        return Symmetry((), True, True)
    return Symmetry(tuple(likeness.indistinct_turns()), False, True)


def equals_of(first: InspectedView, likeness: Likeness) -> list[View]:
    """Outlines of the objects beside it that look just like it."""
    if first.candidate.view.is_clipped:
        return []
    polarity = first.candidate.polarity
    beside = [c.view for c in first.others if c.polarity * polarity >= 0 and not c.view.is_clipped]
    return [view for view in beside if likeness.is_equal(view)]


ORDER = ("homography", "grasp-line", "rrp")
"""The strategies of the paper, those that need most first."""
PEAKS = 4
"""That a homography needs."""


class Usable(NamedTuple):
    """Whether a strategy can carry the grasp: the reason why not is empty when it can.

    "auto" stands for the registration of all that is seen.
    """

    name: str
    reason: str


def peaks_of(view: View) -> Floats:
    """(n, 2) px, peaks of curvature of the outer contour that a homography may rest on."""
    outer = view.outer
    arc, curvature = kernels.curvature_vector(outer.points, outer.clipped, SMOOTHING)
    peaks, _ = kernels.select_points(outer.points, arc, curvature, SEPARATION * arc.item(-1), PROMINENCE)
    return outer.points[peaks].reshape(-1, 2)


def strategies_of(
    grasp: Grasp, view: View, grey: Grey, refusal: str = "", tried: Sequence[str] = (AUTO, *ORDER)
) -> tuple[Usable, ...]:
    """`auto`'s registration and the three strategies, each tried on the view of the choice itself."""

    def explain_refusal(name: str) -> str:
        try:
            if name == "rrp":
                Snakes(grasp, view, grey).carry(grey, None, np.eye(3))
            elif name != AUTO:
                Silhouettes(name, grasp, view)
        except GraspTrackError as error:
            return str(error)
        return refusal

    return tuple(Usable(name, explain_refusal(name)) for name in tried)


def recommended_strategy(usable: tuple[Usable, ...]) -> str:
    """The strategy to take: `auto` where anything can carry the grasp, for it asks all of them; else none, empty."""
    return AUTO if any(not u.reason for u in usable) else ""
