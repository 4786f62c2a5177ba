# SPDX-License-Identifier: Apache-2.0
"""What a session shows at a moment: the image, what the tracker said of it, what waits for a person's word; and how it went."""

from __future__ import annotations

import re
import threading
from collections import deque
from dataclasses import dataclass, field
from itertools import islice
from typing import Literal, NamedTuple

from grasptrack.first_image import FirstImage
from grasptrack.io.columns import NAMED
from grasptrack.live.advisor import HoverOutline, Proposal, Verdict, WireState
from grasptrack.live.inbox import Arrival
from grasptrack.presentation import REMEDIES, plain_value
from grasptrack.tracking.messages import SENTENCES
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.scene import SceneResult
from grasptrack.typing import Status

Phase = Literal["opening", "looking", "choosing", "tracking", "ended", "failed"]
"""opening: no image yet, or none with an object; looking: an object is looked for in the image that is held; choosing: it waits
for a word; tracking: it follows; ended: the source has no more images; failed: it broke off."""


@dataclass(frozen=True)
class ServoMoment:
    """A moment of the servo, for people.

    Attributes:
        word, tone, why: as of `Headline`.
        held: somebody holds the button.
        goal: there is a goal.
        over: the approach is over: another one has to be begun.
        error_px, height_m: the farthest contact from its goal, and what is left along the approach; 0 where not known.
    """

    word: str = "Idle"
    tone: Status = "searching"
    why: str = ""
    held: bool = False
    goal: bool = False
    over: bool = False
    error_px: float = 0.0
    height_m: float = 0.0


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
        last: in which the object was located last.
        proposal: what may be followed, while choosing.
        verdict: how well that can be tracked; None until it is known.
        meant: what was said of the object.
        friction, fingers, unit: of the settings.
        wire, hover: for those who draw.
        notice: the last line for people, and its number, by which a page knows whether it has shown it.
        recording: name of the file that is recorded; empty where none is.
        recorded, dropped: images in it, and that were not written in time.
        files: what can be fetched from the run's folder.
        live: whether the source gives its newest image only.
        count: images of a file, where known.
        speed: times as fast as its own rate that a file is played.
        servo: of the arm; None where there is none.
        scene: what is told of every part, where parts on file are followed.
        chosen: id of the one of them that `result` is of; None where none is chosen.
    """

    number: int = 0
    phase: Phase = "opening"
    paused: bool = False
    image: int = 0
    arrival: Arrival | None = None
    result: TrackResult | None = None
    last: TrackResult | None = None
    proposal: Proposal | None = None
    verdict: Verdict | None = None
    meant: FirstImage = field(default_factory=FirstImage)
    friction: float = 0.5
    fingers: int = 2
    unit: str = ""
    wire: WireState | None = None
    hover: HoverOutline | None = None
    notice: tuple[int, str] = (0, "")
    recording: str = ""
    recorded: int = 0
    dropped: int = 0
    files: tuple[str, ...] = ()
    live: bool = False
    count: int | None = None
    speed: float = 1.0
    servo: ServoMoment | None = None
    scene: SceneResult | None = None
    chosen: int | None = None


class Headline(NamedTuple):
    """A moment for who looks from afar.

    Attributes:
        word: one or few; the four in capitals say whether fingers may close.
        tone: status whose colour it has; that of "tracked" means that they may, now.
        why: a sentence.
        remedy: what to try; empty where nothing is to be done.
    """

    word: str
    tone: Status
    why: str
    remedy: str = ""


WRONG = ("not-closing", "not-flat", "not-pinhole")
"""Codes of located frames that further views do not settle."""
OPTIONS = r" \(--[^)]*\)"
"""What of a remedy is for a terminal; the page has tools."""
AGAIN = "choose again and take its number, or draw its outline"


def headline_of(shown: Shown) -> Headline:
    """The moment in a word, why, and what to try."""
    result = shown.result
    code = (result.reason_code or result.notice) if result else ""
    told = (result.reason or SENTENCES[code]) if result and code else ""
    remedy = re.sub(OPTIONS, "", REMEDIES.get(code, ""))
    if shown.phase == "looking":
        return Headline("Looking", "searching", "for what is meant in this image")
    if shown.phase == "choosing":
        return _question_of(shown, told, remedy)
    if shown.phase == "failed":
        return Headline("Broken off", "lost", shown.notice[1])
    if shown.scene is not None and result is None:
        return Headline(
            "Which part?", "searching", "the one that was chosen has left", "click another one, or take its number"
        )
    if result is None:
        waits = shown.phase == "opening"
        return Headline(
            "Waiting" if waits else "Ended", "searching", "for the first image" if waits else "no more images"
        )
    if result.status == "searching":
        return Headline("Searching", "searching", told or "no object yet", remedy)
    if result.status == "lost":
        return Headline("LOST", "lost", told, remedy)
    if not result.object_sure:
        why = "; ".join(part for part in ("which object is meant is not sure", told) if part)
        return Headline("NOT SURE YET", "unstable", f"Do not close yet: {why}", AGAIN)
    if code in WRONG:
        return Headline("TRACKED", "unstable", f"Do not close: {told}", remedy)
    if code:
        return Headline("NOT SURE YET", "unstable", f"Do not close yet: {told}", remedy)
    if result.repeated:
        return Headline("NOT SURE YET", "unstable", "the camera gave the same image again", "look whether it hangs")
    if result.last_seen is not None and (result.last_seen < result.frame).any():
        why = "Do not close yet: a contact is not seen, something may lie where a finger closes"
        return Headline("NOT SURE YET", "unstable", why, re.sub(OPTIONS, "", REMEDIES["contact-unseen"]))
    if shown.paused or shown.phase == "ended":
        why = (
            "paused: the object may have moved since"
            if shown.paused
            else "the source has ended: this is its last image"
        )
        return Headline("TRACKED", "unstable", why)
    return Headline("OK TO CLOSE", "tracked", "the grasp is located and stable")


def _question_of(shown: Shown, told: str, remedy: str) -> Headline:
    """Of a moment that waits for a person's choice."""
    found = shown.proposal and shown.proposal.candidates
    if not shown.proposal or not found:
        return Headline("No object", "searching", shown.notice[1] or told or "click it, or draw its outline", remedy)
    if shown.proposal.is_sure(shown.meant.sure):
        return Headline("Object found", "searching", "Start follows the grasp that is shown")
    if len(found) == 1 and shown.meant.is_pointed_at:
        return Headline("This one?", "unstable", "press Start if its outline is right; else click again, or draw it")
    return Headline("Which object?", "unstable", "take a number, or click the object")


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
