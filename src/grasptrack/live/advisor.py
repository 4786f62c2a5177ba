# SPDX-License-Identifier: Apache-2.0
"""What takes too long for a session's thread: the first look, the verdict, live wires, a segmenter; in a thread of its own."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grasptrack.errors import GraspTrackError, InputError
from grasptrack.first_image import FirstImage
from grasptrack.images import to_bgr
from grasptrack.live.commands import Hover, Wire
from grasptrack.live.inbox import Arrival
from grasptrack.live.settings import Settings
from grasptrack.segmentation.candidate import Candidate
from grasptrack.segmentation.live_wire import LiveWire
from grasptrack.segmentation.segmenters import asked_regions
from grasptrack.segmentation.silhouettes import trace_silhouettes
from grasptrack.trackability import inspect_scene
from grasptrack.trackability.report import describe_expectation, describe_reasons
from grasptrack.tracking.initialization import FirstScene
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import Floats

HOVER_POINTS = 400
"""Points of the outline that is shown under a pointer, about."""
LEAST_HOVER = 16.0
"""px^2 of a segmenter's answer; less is not shown."""


@dataclass(frozen=True)
class Proposal:
    """What a tracker made of an image in which an object is to be chosen.

    Attributes:
        question: number of the question that it answers.
        image: number of the image.
        meant: what a person had said.
        tracker: that has seen the image; None with an error.
        result: of it.
        candidates: up to three, the likeliest first.
        scene: what the tracker chose in, for a verdict; None where it chose nothing.
        error: why there is none, in one line.
    """

    question: int
    image: int
    meant: FirstImage
    tracker: GraspTracker | None = None
    result: TrackResult | None = None
    candidates: tuple[Candidate, ...] = ()
    scene: FirstScene | None = None
    error: str = ""

    def is_sure(self, sure: float) -> bool:
        """Whether the first candidate is meant with so large a probability."""
        return bool(self.candidates) and self.candidates[0].probability >= sure


@dataclass(frozen=True)
class Verdict:
    """How well the object can be tracked: "good", "fair", "poor" or "none", in sentences."""

    question: int
    level: str
    expectation: str
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True)
class WireState:
    """A live wire: its clicks and the path through them, px; `hover` goes on to the pointer."""

    image: int
    points: tuple[tuple[float, float], ...] = ()
    path: Floats | None = None
    hover: Floats | None = None
    closed: bool = False
    error: str = ""


@dataclass(frozen=True)
class HoverOutline:
    """What a segmenter takes for the object under the pointer: (n, 2) px, or None."""

    image: int
    outline: Floats | None


@dataclass(frozen=True)
class Failure:
    """Work that broke off by a defect of ours, in one line."""

    line: str


class Advisor:
    """Does one thing after another in a thread of its own, and calls `answer` there with what each returns, or a `Failure`."""

    def __init__(self, answer: Callable[[Any], None]) -> None:
        self._answer = answer
        self._changed = threading.Condition()
        self._jobs: deque[tuple[str, Callable[[], Any]]] = deque()  # each with its key
        self._closed = False
        self._thread = threading.Thread(target=self._do_jobs, name="grasptrack-advisor", daemon=True)
        self._thread.start()

    def add_job(self, work: Callable[[], Any], key: str = "") -> None:
        """Add work; what waits under the same key, unless that is empty, is not done any more."""
        with self._changed:
            if key:
                self._jobs = deque(job for job in self._jobs if job[0] != key)
            self._jobs.append((key, work))
            self._changed.notify_all()

    def close(self, seconds: float) -> None:
        """End after the present piece of work; wait s at most."""
        with self._changed:
            self._closed = True
            self._jobs.clear()
            self._changed.notify_all()
        self._thread.join(seconds)

    def _do_jobs(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._jobs)
                if self._closed:
                    return
                _, work = self._jobs.popleft()
            try:
                found = work()
            except Exception as error:  # the next piece of work may do
                found = Failure(f"internal error, {type(error).__name__}: {error}")
            if found is not None and not self._closed:
                self._answer(found)


def propose_object(question: int, number: int, arrival: Arrival, meant: FirstImage, settings: Settings) -> Proposal:
    """A tracker that has seen an image with what was said of it; errors are told in the answer."""
    asked = Proposal(question, number, meant)
    try:
        tracker = settings.make_tracker(meant)
        result = tracker.update(arrival.frame.image, time=arrival.frame.time)
    except GraspTrackError as error:
        return replace(asked, error=str(error))
    candidates = tuple(tracker.candidates)
    return replace(asked, tracker=tracker, result=result, candidates=candidates, scene=tracker.first_scene)


def judge_object(question: int, scene: FirstScene) -> Verdict:
    """How well the object that was chosen can be tracked; where that cannot be told, why."""
    try:
        found = inspect_scene(scene)
    except GraspTrackError as error:
        return Verdict(question, "none", str(error))
    return Verdict(question, found.level, describe_expectation(found), tuple(describe_reasons(found)))


class WireDesk:
    """Live wires, one image's at a time; for the advisor's thread."""

    def __init__(self) -> None:
        self._image: int | None = None
        self._wire: LiveWire | None = None

    def take_step(self, command: Wire, arrival: Arrival) -> WireState:
        """The wire after a step; what cannot be done is told in the answer, and the wire stays as it was."""
        hover, error = None, ""
        if self._wire is None or self._image != command.image:
            self._image, self._wire = command.image, LiveWire(arrival.frame.image)
        wire = self._wire
        try:
            if command.step == "add" and wire.points:
                wire.add(command.x, command.y)
            elif command.step == "add":  # the first click: who clicks fast cannot know yet which it is
                wire.start(command.x, command.y)
            elif command.step == "close":
                wire.close()
            elif command.step == "move":
                wire.move(command.point, command.x, command.y)
            elif command.step == "hover":
                hover = wire.path_to(command.x, command.y)
            elif command.step == "back" and len(wire.points) > 1:
                wire.take_back()
            else:
                self._wire = None
                return WireState(command.image)
        except InputError as problem:
            error = "" if command.step == "hover" else str(problem)
        path = wire.path if wire.points else None
        return WireState(command.image, tuple(wire.points), path, hover, wire.is_closed, error)


def outline_under(command: Hover, arrival: Arrival, settings: Settings) -> HoverOutline:
    """The outline of what a segmenter answers to one pixel."""
    empty = HoverOutline(command.image, None)
    if settings.segmenter is None:
        return empty
    image = to_bgr(arrival.frame.image)
    try:
        hints = FirstImage.of((command.x, command.y)).within(image.shape)
        regions = asked_regions(settings.segmenter, image, hints)
    except GraspTrackError:
        return empty
    if not regions:
        return empty
    inside = (np.asarray(regions[0].mask) > 0.5).astype(np.uint8)
    shapes = trace_silhouettes(inside, LEAST_HOVER, holes=False)
    return HoverOutline(command.image, shapes[0].boundary_points(HOVER_POINTS)) if shapes else empty
