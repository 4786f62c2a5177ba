# SPDX-License-Identifier: Apache-2.0
"""What fixes the contacts: the outline alone, the surface of the object as well, or only the ground round it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from grasptrack.trackability.first import FirstView
from grasptrack.trackability.prediction import Looked
from grasptrack.tracking.decision import texture_evidence
from grasptrack.tracking.estimator import PoseEstimate
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.selection import make_target
from grasptrack.tracking.single import first_state, pose_hypothesis, single_estimate
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Grey, Target, build_pyramid
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


class Settled(NamedTuple):
    """How far the tracker's evidence fixes the contacts.

    Attributes:
        covariances: (3, k, 2, 2) px^2 of each contact: by the outline alone, with the surface, and with the ground too.
        by: the least of these that fixes every contact as the tracker asks for; "outline" only where it shows all motions.
    """

    covariances: Floats
    by: By

    @property
    def deviations(self) -> tuple[float, float, float]:
        """px, the largest standard deviation of a contact by each of the three."""
        outline, surface, ground = (_largest_deviation(C) for C in self.covariances)
        return outline, surface, ground

    @property
    def covariance(self) -> Floats:
        """(k, 2, 2) px^2 of each contact by what fixes them, or by all there is."""
        return np.asarray(self.covariances[{"outline": 0, "surface": 1}.get(self.by, 2)])


def contact_evidence(first: FirstView, target: Target, looked: Sequence[Looked], limit: float, shown: bool) -> Settled:
    """What fixes the contacts, as the tracker itself counts it, in small motions of the first view.

    Args:
        first: the first view.
        target: made of it.
        looked: at least `VIEWS` images of a drawn run, from its beginning.
        limit: px, the standard deviation of a contact from which on it is not believed.
        shown: the outline shows all motions.
    """
    levels = build_pyramid(first.grey)
    bare = make_target(levels, first.candidate.view, first.held.contacts, UNTEXTURED, first.hidden)
    by_outline, by_surface = (first_state(each, levels, NUMBERS) for each in (bare, target))
    alone, surface, ground = _Covariances(), _Covariances(), _Covariances()
    for grey, step, decision in looked[:VIEWS]:
        image = build_pyramid(grey)
        alone.add(_estimate_pose(bare, by_outline, image, step.H))
        textured = _estimate_pose(target, by_surface, image, step.H)
        if (
            textured is not None and texture_evidence(textured, by_surface.usual, NUMBERS) > 0.0
        ):  # else there is only noise
            surface.add(textured)
        followed = decision.estimate
        if followed is not None and followed.origin == BACKGROUND:
            ground.add(followed)
    # noisy directions of the edges seem to show what the shape does not
    free = loose(first)
    least = alone.median(free) if shown else free
    more = _smaller_covariance(surface.median(least), least)
    most = _smaller_covariance(ground.median(more), more)
    deviation = [_largest_deviation(C) for C in (least, more, most)]
    by: By = "nothing"
    if shown and deviation[0] <= limit:
        by = "outline"
    elif deviation[1] <= min(limit, MORE * deviation[0]):
        by = "surface"
    elif deviation[2] <= min(limit, MORE * deviation[0]):
        by = "ground"
    return Settled(np.stack([least, more, most]), by)


def loose(first: FirstView) -> Floats:
    """(k, 2, 2) px^2 of each contact where nothing fixes it."""
    return np.tile(LOOSE**2 * first.candidate.view.outer.area * np.eye(2), (len(first.held), 1, 1))


class _Covariances:
    """Covariances (k, 2, 2) px^2 of the contacts in some views, as the decision takes them."""

    def __init__(self) -> None:
        self._found: list[Floats] = []

    def add(self, estimate: PoseEstimate | None) -> None:
        """Those of one view."""
        if estimate is not None:
            self._found.append(estimate.covariance * NUMBERS.inflate**2)

    def median(self, without: Floats) -> Floats:
        """Those of the median view; `without` where fewer than half of the views have any."""
        if 2 * len(self._found) < VIEWS:
            return without
        return sorted(self._found, key=_largest_deviation)[len(self._found) // 2]


def _estimate_pose(target: Target, state: TrackState, image: list[Grey], H: Floats) -> PoseEstimate | None:
    """The target laid on an image, of which this is the pyramid, that shows it under a homography (3, 3)."""
    return single_estimate(target, state, image, pose_hypothesis(target, "staged", H, NUMBERS), NUMBERS)


def _largest_deviation(covariance: Floats) -> float:
    """px, the largest standard deviation of a contact in any direction."""
    return math.sqrt(float(np.linalg.eigvalsh(covariance)[:, -1].max()))


def _smaller_covariance(one: Floats, other: Floats) -> Floats:
    """The smaller of two covariances (k, 2, 2) px^2: what tells more can be left out of account."""
    return one if _largest_deviation(one) < _largest_deviation(other) else other
