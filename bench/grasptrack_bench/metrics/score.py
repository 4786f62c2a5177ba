# SPDX-License-Identifier: Apache-2.0
"""What is true of a frame, and the score of one run over a sequence whose true motion is known."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from grasptrack.demo.run import accept_limit
from grasptrack.errors import ConditioningError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats
from grasptrack_bench.metrics.errors import alignment_error, contact_distances
from grasptrack_bench.simulation import SceneFrame


@dataclass(frozen=True)
class Truth:
    """Where points of frame 0 are in one frame, and how much of the object can be seen there.

    Attributes:
        carry: px (k, 2) of frame 0 to px of this frame.
        back: the inverse.
        area: px^2 of the object in this frame; NaN where it is not known.
        present: whether the object is there at all; contacts given while it is not are wrong wherever they lie.
        visible: share of its outline that can be seen, 0 to 1.
        sees: which points (k, 2) px of this frame can be seen; None where it is not known.
        corners: (4, 2) px of the object in frame 0; None where they are not known.
    """

    carry: Callable[[Floats], Floats]
    back: Callable[[Floats], Floats]
    area: float = math.nan
    present: bool = True
    visible: float = 1.0
    sees: Callable[[Floats], NDArray[np.bool_]] | None = None
    corners: Floats | None = None

    @classmethod
    def of_homography(cls, H: Floats, area: float | None = None) -> Truth:
        """From H_current_reference (3, 3), reference being frame 0, and the object's area in px^2 where it is known.

        Raises:
            numpy.linalg.LinAlgError: H cannot be inverted.
        """
        inverse = np.asarray(np.linalg.inv(H), dtype=np.float64)
        return cls(
            lambda points: apply_homography(H, points),
            lambda points: apply_homography(inverse, points),
            math.nan if area is None else area,
        )

    @classmethod
    def of_scene(cls, frame: SceneFrame) -> Truth:
        """All that a rendered frame knows of itself."""
        return cls(frame.carry, frame.back, frame.area, frame.present, frame.outline_visible, frame.visible)

    def carry_points(self, points: Floats) -> Floats:
        """(k, 2) px of this frame; infinite where the motion sends a point behind the camera."""
        try:
            return self.carry(points)
        except ConditioningError:
            return np.full_like(points, np.inf)

    def alignment_of(self, result: TrackResult) -> float:
        """px, how far a result's homography is off at the corners; infinite without one, NaN where they are not known."""
        if self.corners is None:
            return math.nan
        H = result.homography
        if result.contacts is None or H is None:
            return math.inf
        found = replace(self, carry=lambda points: apply_homography(H, points))
        return alignment_error(found.carry_points(self.corners), self.carry_points(self.corners))

    def area_growth(self, centre: Floats) -> float:
        """By how much an area round a point (2,) of frame 0 is larger in this frame: the Jacobian's determinant."""
        step = 0.5
        around = centre + step * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        right, left, down, up = self.carry_points(around)
        (a, c), (b, d) = (right - left) / (2.0 * step), (down - up) / (2.0 * step)
        return float(abs(a * d - b * c))


@dataclass(frozen=True, slots=True)
class FrameScore:
    """One frame: what was said, and how far each contact was off.

    Attributes:
        frame: index.
        status: of the result.
        reason: of the result.
        strategy: the transfer that gave the contacts, as the result names it.
        contacts: (k, 2) px as they were given; None where there were none.
        distances: (k,) px from each contact to its true place; None where no contacts were given or no truth is known.
        spread: (k,) squared Mahalanobis distances of the contacts from the truth; None without a covariance.
        limit: px, of a false accept.
        opening: px between the true places of the first two contacts.
        area: px^2 of the object in this frame.
        present: whether the object is there at all.
        visible: share of its outline that can be seen, 0 to 1; NaN where no truth is known.
        seen: whether the true places of all contacts can be seen.
        confidence: of the result.
        alignment: px, root mean square distance of the corners under its homography from the truth; infinite without an
            answer, NaN where they are not known.
        latency_ms: of the update.
        defining: the contacts of this frame are those that the grasp's truth is made from.
    """

    frame: int
    status: str
    reason: str
    distances: Floats | None
    limit: float
    latency_ms: float
    defining: bool = False
    strategy: str = ""
    contacts: Floats | None = None
    spread: Floats | None = None
    opening: float = math.nan
    area: float = math.nan
    present: bool = True
    visible: float = 1.0
    seen: bool = True
    confidence: float = math.nan
    alignment: float = math.nan

    @property
    def answered(self) -> bool:
        """Whether contacts were given."""
        return self.contacts is not None

    @property
    def measured(self) -> bool:
        """Whether there is a truth to measure an answer by, other than the answer itself."""
        return not self.defining and not math.isnan(self.visible)

    @property
    def gone(self) -> bool:
        """Nothing of the object can be seen, or it is not there."""
        return not self.present or self.visible <= 0.0

    @property
    def error(self) -> float:
        """px of the worst contact; NaN where nothing can be measured."""
        return math.nan if self.distances is None else float(self.distances.max())

    @property
    def is_false_accept(self) -> bool:
        """Contacts were given, and at least one was wrong or the object was gone."""
        return self.distances is not None and (self.gone or self.error > self.limit)


@dataclass
class Score:
    """Collects the frames of one run; the truth of a grasp is its first contacts, moved by the true motion.

    A method that is told the contacts may move them onto the edge that it sees. When it moves them so far that they are
    wrong, the contacts that it was told stay the truth.

    Attributes:
        name: of the run, for tables.
        frames: what was collected.
        given: (k, 2) px in frame 0, the contacts that the method was told, if it was.
    """

    name: str
    frames: list[FrameScore] = field(default_factory=list)
    given: Floats | None = None
    _grasp: int | None = None
    _first: tuple[Floats, float] | None = None  # contacts in frame 0, and the object's area there

    def add(self, result: TrackResult, truth: Truth | None) -> FrameScore:
        """One more frame; without a truth nothing is measured in it."""
        contacts, distances, spread, defining = result.contacts, None, None, False
        limit = opening = area = math.nan
        seen = True
        if truth is not None:
            area = truth.area
            if contacts is not None and (self._first is None or result.grasp_id != self._grasp):
                self._grasp = result.grasp_id
                start = truth.back(contacts)
                limit = accept_limit(area) if math.isfinite(area) else math.inf
                if self.given is not None and contact_distances(start, self.given).max() > limit:
                    start = self.given
                size = area if math.isfinite(area) else (result.view.outer.area if result.view is not None else 0.0)
                self._first = (start, size / max(1e-12, truth.area_growth(start.mean(axis=0))))
                defining = True
            if self._first is not None:
                start, size = self._first
                true = truth.carry_points(start)
                area = area if math.isfinite(area) else size * truth.area_growth(start.mean(axis=0))
                limit = accept_limit(area) if math.isfinite(area) else math.inf
                opening = float(np.hypot(*(true[1] - true[0])))
                seen = truth.present and (truth.sees is None or bool(truth.sees(true).all()))
                if contacts is not None:
                    distances = contact_distances(contacts, true)
                    spread = _squared_mahalanobis(contacts - true, result.covariance)
        scored = FrameScore(
            result.frame,
            result.status,
            result.reason,
            distances,
            limit,
            result.latency_ms,
            defining,
            result.strategy,
            contacts,
            spread,
            opening,
            area,
            truth is None or truth.present,
            math.nan if truth is None else truth.visible,
            seen,
            result.confidence,
            math.nan if truth is None else truth.alignment_of(result),
        )
        self.frames.append(scored)
        return scored

    def status_share(self, *statuses: str) -> float:
        """Share of the frames with one of these statuses, 0 to 1."""
        return sum(f.status in statuses for f in self.frames) / len(self.frames) if self.frames else 0.0

    @property
    def located(self) -> float:
        """Share of the frames with contacts, 0 to 1."""
        return self.status_share("tracked", "unstable")

    @property
    def contact_errors(self) -> Floats:
        """(n,) px, of every contact of every located frame with truth, each contact for itself.

        The frame that defines a grasp is left out: it is right by definition; so is what was given with no object there.
        """
        return errors_of(self.frames)

    @property
    def false_accepts(self) -> int:
        """Frames with contacts given and wrong."""
        return sum(f.is_false_accept for f in self.frames)

    def error_percentile(self, percent: float) -> float:
        """px; NaN where there is nothing to measure."""
        return float(np.percentile(self.contact_errors, percent)) if len(self.contact_errors) else math.nan

    def reasons(self, *statuses: str) -> list[tuple[str, int]]:
        """Reasons given with these statuses (lost and searching where none is named), the most frequent first.

        Reasons that differ in their numbers alone count as one, under the first that was met.
        """
        wanted = statuses or ("lost", "searching")
        first: dict[str, str] = {}
        counts: Counter[str] = Counter()
        for f in self.frames:
            if f.status in wanted:
                kind = re.sub(r"[-+]?\d+(\.\d+)?", "#", f.reason)
                counts[first.setdefault(kind, f.reason)] += 1
        return counts.most_common()


def errors_of(frames: Iterable[FrameScore]) -> Floats:
    """(n,) px of every contact of every frame that was answered with the object there, and does not define its truth."""
    known = [f.distances for f in frames if f.distances is not None and not f.defining and not f.gone]
    return np.concatenate(known) if known else np.empty(0)


def _squared_mahalanobis(offsets: Floats, covariance: Floats | None) -> Floats | None:
    """(k,) squared Mahalanobis distances of offsets (k, 2) px under covariances (k, 2, 2) px^2."""
    if covariance is None or not np.isfinite(offsets).all():
        return None
    return np.asarray(np.einsum("ki,kij,kj->k", offsets, np.linalg.pinv(covariance), offsets), dtype=np.float64)
