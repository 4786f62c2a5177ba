# SPDX-License-Identifier: Apache-2.0
"""What a session shows at a moment: the image, what the tracker said of it, what waits for a person's word; and how it went."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass, field
from itertools import islice
from typing import Literal, NamedTuple

from grasptrack.first_image import FirstImage
from grasptrack.io.columns import NAMED
from grasptrack.live.advisor import HoverOutline, Proposal, Verdict, WireState
from grasptrack.live.inbox import Arrival
from grasptrack.presentation import plain_value
from grasptrack.tracking.result import TrackResult

Phase = Literal["opening", "looking", "choosing", "tracking", "ended", "failed"]
"""opening: no image yet, or none with an object; looking: an object is looked for in the image that is held; choosing: it waits
for a word; tracking: it follows; ended: the source has no more images; failed: it broke off."""


@dataclass(frozen=True)
class Shown:
    """A moment of a session; immutable, so that any thread may show it.

    Attributes:
        number: of the moment, from 1.
        phase: see `Phase`.
        paused: no image is taken.
        image: number of the image, from 1; 0 before the first.
        arrival: the image; None before the first.
        result: what the tracker said of it; None where none did.
        proposal: what may be followed, while choosing.
        verdict: how well that can be tracked; None until it is known.
        meant: what was said of the object.
        friction, fingers: of the settings.
        wire, hover: for those who draw.
        notice: the last line for people, and its number, by which a page knows whether it has shown it.
        recording: name of the file that is recorded; empty where none is.
        recorded, dropped: images in it, and that were not written in time.
        files: what can be fetched from the run's folder.
        live: whether the source gives its newest image only.
    """

    number: int = 0
    phase: Phase = "opening"
    paused: bool = False
    image: int = 0
    arrival: Arrival | None = None
    result: TrackResult | None = None
    proposal: Proposal | None = None
    verdict: Verdict | None = None
    meant: FirstImage = field(default_factory=FirstImage)
    friction: float = 0.5
    fingers: int = 2
    wire: WireState | None = None
    hover: HoverOutline | None = None
    notice: tuple[int, str] = (0, "")
    recording: str = ""
    recorded: int = 0
    dropped: int = 0
    files: tuple[str, ...] = ()
    live: bool = False


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
