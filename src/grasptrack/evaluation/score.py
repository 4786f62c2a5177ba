# SPDX-License-Identifier: Apache-2.0
"""The score of one run over a sequence whose true motion is known."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import ConditioningError
from grasptrack.evaluation.errors import contact_distances
from grasptrack.projective import apply_homography
from grasptrack.result import TrackResult

Floats = NDArray[np.float64]

STATUSES = ("tracked", "unstable", "lost", "searching")


def accept_limit(area: float) -> float:
    """px: contacts given further than this from the truth are a false accept; area in px^2."""
    return max(3.0, 0.04 * math.sqrt(area))


@dataclass(frozen=True, slots=True)
class FrameScore:
    """One frame: what was said, and how far each contact was off.

    Attributes:
        frame: index.
        status: of the result.
        reason: of the result.
        distances: (k,) px from each contact to its true place; None where no contacts were given or no truth is known.
        limit: px, of a false accept.
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

    @property
    def is_false_accept(self) -> bool:
        """Contacts were given and at least one was wrong."""
        return self.distances is not None and float(self.distances.max()) > self.limit


@dataclass
class Score:
    """Collects the frames of one run; the truth of a grasp is its first contacts, moved by the true homographies.

    Attributes:
        name: of the run, for tables.
        frames: what was collected.
    """

    name: str
    frames: list[FrameScore] = field(default_factory=list)
    _grasp: int | None = None
    _first: tuple[Floats, Floats, float] | None = None

    def add(self, result: TrackResult, H: Floats | None, area: float | None = None) -> FrameScore:
        """One more frame.

        Args:
            result: the tracker's answer.
            H: (3, 3) true H_current_reference, reference being frame 0; None where it is not known.
            area: px^2 of the object in this image; None measures it on the outline of the grasp's first frame.
        """
        distances, limit, defining = None, math.nan, False
        if result.contacts is not None and H is not None:
            if self._first is None or result.grasp_id != self._grasp:
                self._grasp = result.grasp_id
                size = area or (result.view.outer.area if result.view is not None else 0.0)
                self._first = (result.contacts.copy(), np.asarray(np.linalg.inv(H), dtype=np.float64), size)
                defining = True
            contacts, H_reference_first, size = self._first
            since = H @ H_reference_first
            try:
                distances = contact_distances(result.contacts, apply_homography(since, contacts))
            except ConditioningError:
                distances = np.full(len(contacts), np.inf)
            limit = accept_limit(area if area is not None else size * _growth(since, contacts.mean(axis=0)))
        scored = FrameScore(result.frame, result.status, result.reason, distances, limit, result.latency_ms, defining)
        self.frames.append(scored)
        return scored

    def share(self, *statuses: str) -> float:
        """Share of the frames with one of these statuses, 0 to 1."""
        return sum(f.status in statuses for f in self.frames) / len(self.frames) if self.frames else 0.0

    @property
    def located(self) -> float:
        """Share of the frames with contacts, 0 to 1."""
        return self.share("tracked", "unstable")

    @property
    def errors(self) -> Floats:
        """(n,) px, of every contact of every located frame with truth, each contact for itself.

        The frame that defines a grasp is left out: it is right by definition.
        """
        known = [f.distances for f in self.frames if f.distances is not None and not f.defining]
        return np.concatenate(known) if known else np.empty(0)

    @property
    def false_accepts(self) -> int:
        """Frames with contacts given and wrong."""
        return sum(f.is_false_accept for f in self.frames)

    def error_percentile(self, percent: float) -> float:
        """px; NaN where there is nothing to measure."""
        return float(np.percentile(self.errors, percent)) if len(self.errors) else math.nan

    def latency_percentile(self, percent: float) -> float:
        """ms; NaN where there is nothing to measure."""
        times = np.array([f.latency_ms for f in self.frames])
        times = times[np.isfinite(times)]
        return float(np.percentile(times, percent)) if len(times) else math.nan

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

    def row(self) -> dict[str, float | int | str]:
        """The figures of a closing table: counts of frames, errors in px, latency in ms."""
        counts = Counter(f.status for f in self.frames)
        main = self.reasons()
        return {
            "strategy": self.name,
            "frames": len(self.frames),
            **{status: counts.get(status, 0) for status in STATUSES},
            "reason": main[0][0] if main else "",
            "error_median_px": self.error_percentile(50),
            "error_p95_px": self.error_percentile(95),
            "error_max_px": self.error_percentile(100),
            "false_accepts": self.false_accepts,
            "latency_median_ms": self.latency_percentile(50),
            "latency_p99_ms": self.latency_percentile(99),
        }


def _growth(H: Floats, point: Floats) -> float:
    """How much H enlarges areas at a point: the determinant of eq. (2)'s Jacobian."""
    w = float(H[2, 0] * point[0] + H[2, 1] * point[1] + H[2, 2])
    return abs(float(np.linalg.det(H))) / max(1e-12, abs(w) ** 3)
