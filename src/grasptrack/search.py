# SPDX-License-Identifier: Apache-2.0
"""Where the reference outline may lie in an image, the likeliest first: each hypothesis costs more than the one before."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.contour import Contour, View
from grasptrack.errors import AmbiguousError, ConditioningError, TransferError
from grasptrack.matching import Match, Sampled, judge, match
from grasptrack.matching.starts import BENDS
from grasptrack.observation.candidate import Candidate
from grasptrack.observation.images import Grey
from grasptrack.observation.observer import ANYWHERE, Observer
from grasptrack.observation.silhouettes import Silhouette
from grasptrack.reference import Reference
from grasptrack.transfer.alignment import Alignment, align, alignments, as_similarity
from grasptrack.whereabouts import Whereabouts

Floats = NDArray[np.float64]

EQUAL = 0.03
"""Outlines that a similarity brings within this fraction of sqrt(area), rms, of each other are equals."""
UNLIKE = 0.25
"""Outlines that differ by more are not the same, however they tilt."""
UNLIKE_WHITENED = 0.35
"""The same of whitened outlines, in shares of their norm, whatever the tilt: a perspective is what they differ by."""
COARSE, CHAIN = 64, 200
"""Samples of an outline, and of a chain of pixels, for that."""
SMALL, TWIN_PX = 50.0, 2.0
"""px, sqrt(area), below which edges are too coarse to show a notch or a tab: an outer contour that is off by more px anywhere
is that of a near twin. Of larger objects edges tell, and the silhouette may end at print."""
WHOLE = 0.93
"""Share of two outlines that lies on each other when the objects are equals."""


CUT = "what was found is cut by the image border or joined to something beyond it"


class Hypothesis(NamedTuple):
    """Where the object may be.

    Attributes:
        view: an outline; None for strategies that need none.
        prior: (3, 3) H_current_reference that it suggests.
        start: what the prior comes from: "expected" where the object should be, "near" it where a silhouette is, or "matched"
            with a whole outline, so that it is right but for a few px.
        rivals: (3, 3) each, other ways in which the outlines fit as well.
    """

    view: View | None
    prior: Floats | None
    start: Literal["expected", "near", "matched"] = "expected"
    rivals: tuple[Floats, ...] = ()


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
        self._outline: Sampled | None = None  # made at the first loss

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
            carried = motion.carried
            if carried is not None:
                yield Hypothesis(None, carried)
        if reference.registration is not None:
            yield from self._to_lay(grey, predicted, reasons)
            return
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

    def _to_lay(self, grey: Grey, predicted: Floats, reasons: list[str]) -> Iterator[Hypothesis]:
        """The same for a registration, which needs no description: outlines matched as wholes, under any tilt."""
        missed = self.whereabouts.motion.missed
        if not self.whereabouts.gone:  # else nothing is there
            with contextlib.suppress(ConditioningError):
                for view in self._observer.near(grey, *self._reference.expected(predicted)):
                    self._nearby = view
                    likely = self._reference.corrected(predicted, view)
                    if missed == 0:  # where it is cut off, the strategies may know more
                        yield Hypothesis(view if view.is_clipped else None, likely, "near")
                    if self._reference.view.is_clipped or view.is_clipped:
                        reasons.append(CUT)
                    else:
                        yield from self._ways(*self._match(view), reasons, likely)
        height, width = grey.shape

        def unlike(shape: Silhouette) -> float:
            x, y, w, h = shape.box
            if self._reference.view.is_clipped or min(x, y, width - x - w, height - y - h) <= 0:
                reasons.append(CUT)
                return math.inf
            share = _unlike(self._sampled, shape.ring(CHAIN))
            return share if share <= UNLIKE_WHITENED else math.inf

        for views in self._observer.anywhere(grey, self.whereabouts.area, missed, self._nearby, unlike):
            found = [self._match(view) for view in views if not view.is_clipped]
            if sum(_equal(ways) for _, ways in found) > 1:
                self.whereabouts.equals = True
            found.sort(key=lambda pair: pair[1][0].cost / pair[1][0].size if pair[1] else math.inf)
            for outline, ways in found:
                yield from self._ways(outline, ways, reasons)

    @property
    def _sampled(self) -> Sampled:
        if self._outline is None:
            self._outline = Sampled(self._reference.view)
        return self._outline

    def _match(self, view: View) -> tuple[Sampled, list[Match]]:
        outline = Sampled(view)
        if _unlike(self._sampled, outline.outer) > UNLIKE_WHITENED:
            return outline, []
        return outline, match(self._sampled, outline, thorough=False)

    def _ways(
        self, outline: Sampled, ways: list[Match], reasons: list[str], likely: Floats | None = None
    ) -> Iterator[Hypothesis]:
        """What a match amounts to; where the object is `likely` (3, 3) is the pose that suits the silhouette best."""
        told = judge(ways)
        if told.best is None:
            reasons.append(f"what was found is another object: {told.reason}")
            return
        if outline.size < SMALL and _farthest(told.best.homography, self._sampled, outline) > TWIN_PX:
            reasons.append("what was found is another object: a part of the outline is not where it should be")
            alike = []
        else:
            alike = [m.homography for m in (told.best, *told.others)]
        near = self.whereabouts.nearest(alike) if alike else None
        if near is not None:
            yield Hypothesis(None, near, "matched")
        elif len(alike) == 1 or (alike and self.whereabouts.telling):
            for H in alike:
                yield Hypothesis(None, H, "matched", tuple(other for other in alike if other is not H))
        elif likely is not None:
            yield Hypothesis(None, likely, "near")
        elif alike:
            reasons.append("found again, but its outline fits itself in more than one way: ambiguous")

    def _aligned(self, view: View, reasons: list[str]) -> Iterator[Hypothesis]:
        """The view with the similarity that lays the reference outline on it."""
        first, second = self._reference.view.outer, view.outer
        if self._reference.view.is_clipped or view.is_clipped:
            reasons.append(CUT)
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


def _unlike(a: Sampled, outline: Floats) -> float:
    """Share of the whitened outline's norm by which an outline (N, 2) differs at least, whatever the tilt: quick and coarse."""
    try:
        found = kernels.outline_starts(a.outer, outline, BENDS, COARSE, 0.1, 1)
    except ValueError:  # a hair, or a tangle: so few of its points enclose nothing
        return math.inf
    return float(found[0, 0]) if len(found) else 0.0


def _farthest(H: Floats, a: Sampled, b: Sampled) -> float:
    """px by which two outer contours part where they do most, up to a fifth of sqrt(area)."""
    n, m = int(a.offsets[1]), int(b.offsets[1])
    moved = kernels.carry_normals(H, a.points[:n] + a.centre, a.normals[:n])
    at, along = np.ascontiguousarray(moved[:, :2] - b.centre), np.ascontiguousarray(moved[:, 2:4])
    reach, there, normals = 0.2 * b.size, b.points[:m], b.normals[:m]
    forth = kernels.outline_gaps(at, along, there, normals, np.array([0, m]), reach)
    back = kernels.outline_gaps(there, normals, at, along, np.array([0, n]), reach)
    return float(max(forth.max(), back.max()))


def _equal(ways: list[Match]) -> bool:
    """Whether an outline is that of the object, or of its equal."""
    return bool(ways) and ways[0].share >= WHOLE and ways[0].misfit <= EQUAL * ways[0].size
