# SPDX-License-Identifier: Apache-2.0
"""Reads a source in a thread of its own: a camera's newest image, a file's images one after another at the file's rate."""

from __future__ import annotations

import contextvars
import threading
import time
from dataclasses import dataclass

from grasptrack.errors import GraspTrackError
from grasptrack.io.base import Frame, Source
from grasptrack.live.inbox import Arrival, Inbox

RATE = 25.0
"""Images/s of files that have no times."""
LONGEST = 2.0
"""s between two images of a file at most: a gap in its times is no reason to show nothing for longer."""


@dataclass(frozen=True)
class Ended:
    """A source has no more images; `error` is the one line of why, or empty, `note` what it lacks."""

    run: int
    error: str = ""
    note: str = ""


class Player:
    """Hands a source's images to an inbox until it is stopped.

    Args:
        source: that nobody else reads now; it is closed at the end.
        inbox: that takes them.
        run: a number that images and the end carry, so that those of an earlier playing can be told.
        pace: play files at their own rate; without, as fast as they are taken.
    """

    def __init__(self, source: Source, inbox: Inbox, run: int, pace: bool = True) -> None:
        self._source, self._inbox, self._run, self._pace = source, inbox, run, pace
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
                        self._stopping.wait(clock.wait_for(frame))
                    if self._stopping.is_set():
                        return
                    arrival = Arrival(frame, time.perf_counter(), self._run)
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

    def wait_for(self, frame: Frame) -> float:
        """s to wait."""
        step = self._period
        if frame.time is not None:
            step = 0.0 if self._before is None else frame.time - self._before
            self._before = frame.time
        now = time.monotonic()
        self._due = max(self._due + min(max(step, 0.0), LONGEST), now)
        return self._due - now
