# SPDX-License-Identifier: Apache-2.0
"""Where the reference outline may lie in an image, the likeliest first: each hypothesis costs more than the one before."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.contour import Contour, View
from grasptrack.errors import AmbiguousError, ConditioningError, TransferError
from grasptrack.observation.candidate import Candidate
from grasptrack.observation.images import Grey
from grasptrack.observation.observer import Observer
from grasptrack.reference import Reference
from grasptrack.transfer.alignment import Alignment, align, alignments, as_similarity
from grasptrack.whereabouts import Whereabouts

Floats = NDArray[np.float64]

ANYWHERE = 2
"""Objects in the whole image that are tried for each threshold after a loss, those most alike first."""
EQUAL = 0.03
"""Outlines that a similarity brings within this fraction of sqrt(area), rms, of each other are equals."""
UNLIKE = 0.25
"""Outlines that differ by more are not the same, however they tilt."""


class Hypothesis(NamedTuple):
    """An outline, None for strategies that need none, and (3, 3) H_current_reference that it suggests."""

    view: View | None
    prior: Floats | None


class Search:
    """Looks for one object in image after image.

    Args:
        observer: finds the outlines; it has been told which object is meant.
        reference: the reference view.
        others: further objects of the first image.
    """

    def __init__(self, observer: Observer, reference: Reference, others: list[Candidate]) -> None:
        self._observer, self._reference = observer, reference
        equals = any(c.polarity * observer.polarity >= 0 and _likeness(reference, c.view) <= EQUAL for c in others)
        self.whereabouts = Whereabouts(reference, equals)
        self._nearby: View | None = None

    def hypotheses(self, grey: Grey, reasons: list[str]) -> Iterator[Hypothesis]:
        """Outlines with the motion they suggest; notes the reason where there is none."""
        reference, motion = self._reference, self.whereabouts.motion
        predicted, missed = motion.predict(), motion.missed
        self._nearby = None
        if self.whereabouts.hopeless:
            reasons.append(self.whereabouts.hopeless)
            return
        if reference.registration is not None and motion.remembered:
            yield Hypothesis(None, predicted)
        on_silhouettes = any(c.needs_silhouette for c in reference.carriers)
        if not on_silhouettes:
            yield Hypothesis(None, None if missed == 0 else predicted)
        with contextlib.suppress(ConditioningError):
            expected = reference.expected(predicted)
            for view in self._observer.near(grey, *expected):
                self._nearby = view
                if on_silhouettes:
                    yield Hypothesis(view, reference.corrected(predicted, view))
                yield from self._aligned(view, reasons)
        for views in self._observer.anywhere(grey, self.whereabouts.area, missed, self._nearby):
            alike = sorted(
                (v for v in views if _likeness(reference, v) <= UNLIKE), key=lambda v: _likeness(reference, v)
            )
            if sum(_likeness(reference, v) <= EQUAL for v in alike) > 1:
                self.whereabouts.equals = True
            for view in alike[:ANYWHERE]:
                yield from self._aligned(view, reasons)

    def _aligned(self, view: View, reasons: list[str]) -> Iterator[Hypothesis]:
        """The view with the similarity that lays the reference outline on it."""
        first, second = self._reference.view.outer, view.outer
        if self._reference.view.is_clipped or view.is_clipped:
            reasons.append("what was found is cut by the image border or joined to something beyond it")
            return
        try:
            yield Hypothesis(view, as_similarity(self._alignment(first, second), first, second))
        except TransferError as error:
            reasons.append(str(error))

    def _alignment(self, first: Contour, second: Contour) -> Alignment:
        motion = self.whereabouts.motion
        if motion.remembered and not self.whereabouts.gone:
            return align(first, second, motion.angle(motion.predict()))
        alike = alignments(first, second)
        if self.whereabouts.telling:  # the surface tells them apart
            return alike[0] if alike else Alignment(0.0, 0.0, 0.0)
        if len(alike) != 1:
            raise AmbiguousError("found again, but its outline fits itself in more than one way: ambiguous")
        return alike[0]

    def doubt(self, H: Floats, grey: Grey, settled: Callable[[], bool]) -> str:
        """Why a pose that the image bears out is not believed to be the object's; empty when it is."""
        return self.whereabouts.doubt(H, grey, self._observer.levels, settled)

    def believe(self, view: View, H: Floats, levels: tuple[float, float]) -> None:
        """The verdict accepted this outline and pose (3, 3), at which the edges have these levels on either side."""
        self.whereabouts.found(H)
        self._observer.believe(view, levels)

    def lost(self, grey: Grey) -> None:
        """Nothing was accepted in this image."""
        self.whereabouts.lost(grey, self._nearby is not None, self._observer.levels)


def _likeness(reference: Reference, view: View) -> float:
    """How far a view's outline is from the reference's under the best similarity, rms in sqrt(area)."""
    if view.is_clipped or reference.view.is_clipped:
        return math.inf
    found = alignments(reference.view.outer, view.outer)
    return found[0].residual / math.sqrt(view.outer.area) if found else 0.0
