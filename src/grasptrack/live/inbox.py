# SPDX-License-Identifier: Apache-2.0
"""What waits for a session's thread: what it was told, in order, and images: the newest, or all since the one that is held.

The images come from a player, which reads the source in a thread of its own: a camera's newest, a file's at the file's rate.
"""

from __future__ import annotations

import contextvars
import threading
import time
from collections import OrderedDict, deque
from dataclasses import dataclass
from typing import Any

from grasptrack.errors import GraspTrackError, InputError
from grasptrack.io.base import Frame, Source
from grasptrack.io.limits import Backlog, most_held

MOST = 256
"""Commands that wait; a person gives a few in a second."""


@dataclass(frozen=True)
class Arrival:
    """An image, and the time of `time.perf_counter` at which it came out of its source, s."""

    frame: Frame
    at: float
    run: int
    """Which playing of the source it is from."""
    place: int = 0
    """Of the image in that source, from 0."""


class KeptImages:
    """The last images by their numbers: a click belongs to the image that was seen, which is not the newest any more."""

    def __init__(self) -> None:
        self._kept: OrderedDict[int, Arrival] = OrderedDict()

    def add(self, image: int, arrival: Arrival) -> None:
        """Keep one more, and forget the oldest where they are too many."""
        self._kept[image] = arrival
        while len(self._kept) > most_held(arrival.frame.image):
            self._kept.popitem(last=False)

    def get_image(self, image: int) -> Arrival:
        """An image that a person saw."""
        if image not in self._kept:
            raise InputError(f"image {image} is not kept any more: pause first, or try again")
        return self._kept[image]


class Inbox:
    """One reader of a source and any number of people on one side, the session's thread on the other."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._told: deque[Any] = deque()
        self._waiting: Backlog[Arrival] = Backlog()
        self._closed = False

    def tell(self, what: Any, *, bounded: bool = True) -> None:
        """Add what the session's thread shall do; its own helpers' answers are not bounded."""
        with self._changed:
            if bounded and len(self._told) >= MOST:
                raise InputError("too many commands at once: this one was dropped")
            self._told.append(what)
            self._changed.notify_all()

    def replace_image(self, arrival: Arrival) -> None:
        """An image of a live source: one that was not looked at yet is dropped, but after `keep_images`."""
        with self._changed:
            self._waiting.add(arrival, arrival.frame.image.nbytes)
            self._changed.notify_all()

    def keep_images(self) -> None:
        """An image is held, and what comes meanwhile is to be caught up with."""
        with self._changed:
            self._waiting.keep_all()

    def newest_only(self) -> None:
        """Nothing is held any more, and what came meanwhile does not matter."""
        with self._changed:
            self._waiting.newest_only()

    def hand_over(self, arrival: Arrival) -> bool:
        """An image of a file: waits until the one before it was taken. False where the inbox was closed meanwhile."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or not self._waiting)
            if self._closed:
                return False
            self._waiting.add(arrival, 0)
            self._changed.notify_all()
            return True

    def wait_taken(self) -> None:
        """Wait until no image waits: the end of a file is told after its last one."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or not self._waiting)

    def drop_frame(self) -> None:
        """Forget the images that wait."""
        with self._changed:
            self._waiting.clear()
            self._changed.notify_all()

    def take_next(self, wants_frame: bool, seconds: float) -> Any:
        """What was told, else an `Arrival` where one is wanted; None when `seconds` s have passed, or closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._told or (wants_frame and self._waiting), seconds)
            if self._closed:
                return None
            if self._told:
                return self._told.popleft()
            if not (wants_frame and self._waiting):
                return None
            arrival, _ = self._waiting.take()
            self._changed.notify_all()
            return arrival

    def close(self) -> None:
        """Nobody waits any more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


RATE = 25.0
"""Images/s of files that have no times."""
SLOWEST, FASTEST = 0.1, 10.0
"""Times as fast as a file's own rate that it is played at least, and at most."""
LONGEST = 2.0
"""s between two images of a file at most: a gap in its times is no reason to show nothing for longer."""


@dataclass(frozen=True)
class Ended:
    """A source has no more images; `error` is the one line of why, or empty, `note` what it lacks."""

    run: int
    error: str = ""
    note: str = ""


class Player:
    """Hands a source's images to an inbox until it is stopped; the source, which nobody else reads now, is closed at the end.

    Images and the end carry the number `run`, so that those of an earlier playing can be told. `pace` plays files at their own
    rate; without, as fast as they are taken.

    Attributes:
        speed: times as fast as its own rate that a file is played; any thread may set it.
    """

    def __init__(self, source: Source, inbox: Inbox, run: int, pace: bool = True) -> None:
        self._source, self._inbox, self._run, self._pace = source, inbox, run, pace
        self.speed = 1.0
        self._stopping = threading.Event()
        if hasattr(source, "on_wait"):  # a live source asks it while no image comes
            source.on_wait = self._raise_if_stopping
        inside = contextvars.copy_context().run  # limits of size hold in the thread, too
        self._thread = threading.Thread(target=inside, args=(self._read_frames,), name="grasptrack-player", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Read no more; a device that is waited for is left when it answers."""
        self._stopping.set()

    def join(self, seconds: float) -> None:
        """Wait until the source is closed, s at most."""
        self._thread.join(seconds)

    def _raise_if_stopping(self) -> None:
        if self._stopping.is_set():
            raise _StoppedError

    def _read_frames(self) -> None:
        error, note = "", ""
        try:
            with self._source as source:
                clock = _PlaybackClock(source)
                for frame in source:
                    if self._pace and not source.live:
                        self._stopping.wait(clock.wait_for(frame, self.speed))
                    if self._stopping.is_set():
                        return
                    arrival = Arrival(frame, time.perf_counter() - source.waited, self._run, frame.index)
                    if source.live:
                        self._inbox.replace_image(arrival)
                    elif not self._inbox.hand_over(arrival):
                        return
                self._inbox.wait_taken()
                note = source.shortfall
        except _StoppedError:
            return
        except GraspTrackError as problem:
            error = str(problem)
        except Exception as problem:
            error = f"the source failed: {type(problem).__name__}: {' '.join(str(problem).split())}"
        if not self._stopping.is_set():
            self._inbox.tell(Ended(self._run, error, note), bounded=False)


class _StoppedError(Exception):
    """Nobody wants to wait for a device any more."""


class _PlaybackClock:
    """When the next image of a file is due; one that comes late, as after a pause, moves those after it."""

    def __init__(self, source: Source) -> None:
        self._period = 1.0 / (source.fps or RATE)
        self._before: float | None = None
        self._due = time.monotonic()

    def wait_for(self, frame: Frame, speed: float = 1.0) -> float:
        """s to wait."""
        step = self._period
        if frame.time is not None:
            step = 0.0 if self._before is None else frame.time - self._before
            self._before = frame.time
        now = time.monotonic()
        self._due = max(self._due + min(max(step, 0.0), LONGEST) / speed, now)
        return self._due - now
