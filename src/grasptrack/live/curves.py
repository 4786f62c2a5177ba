# SPDX-License-Identifier: Apache-2.0
"""Margin, confidence and latency of the last images that were tracked, for pages that come late, or again."""

from __future__ import annotations

import threading
from collections import deque
from itertools import islice
from typing import NamedTuple

from grasptrack.io.columns import NAMED
from grasptrack.presentation import plain_value
from grasptrack.tracking.result import TrackResult

KEPT = 240
"""Images; as many as the page draws."""


class CurvePoint(NamedTuple):
    """One image's; None where there is no number."""

    margin_deg: float | None
    confidence: float | None
    latency_ms: float | None
    status: str


_DRAWN = ("margin", "confidence", "latency_ms", "status")
"""Columns, in the order of `CurvePoint`."""


class Curves:
    """The last `KEPT` points. One thread adds, any may look."""

    def __init__(self) -> None:
        self._points: deque[CurvePoint] = deque(maxlen=KEPT)
        self._count = 0
        self._turn = threading.Lock()

    def add(self, result: TrackResult) -> None:
        """Add an image's."""
        point = CurvePoint(*(plain_value(NAMED[name].shown_value(result)) for name in _DRAWN))
        with self._turn:
            self._points.append(point)
            self._count += 1

    def points_since(self, count: int) -> tuple[int, list[CurvePoint]]:
        """How many were added so far, and those after the first `count` that are kept."""
        with self._turn:
            new = min(self._count - count, len(self._points))
            return self._count, list(islice(self._points, len(self._points) - new, None))
