# SPDX-License-Identifier: Apache-2.0
"""Recordings written in a thread of their own: encoding an image takes as long as tracking it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from grasptrack.io.limits import most_held

if TYPE_CHECKING:
    from pathlib import Path

    from grasptrack.io.base import Frame
    from grasptrack.io.recording import Recording
    from grasptrack.tracking.result import TrackResult


class WriterThread:
    """Writes one recording until it is ended. Of what waits, `grasptrack.io.limits.most_held` images are kept at most.

    Args:
        recording: where images go; from now on for this thread alone.
        waits: where as many wait already, `add` waits, too, and nothing is lost; else the image is dropped and counted.
        ended: called with this, in its own thread, when the file is whole, or writing has failed.

    Attributes:
        path: of the file.
        written, dropped: images that were written, and that were not because too many waited.
        error: why writing failed; None where it did not.
    """

    def __init__(
        self, recording: Recording, *, waits: bool, ended: Callable[[WriterThread], None] | None = None
    ) -> None:
        self._recording, self._waits, self._on_end = recording, waits, ended
        self.path: Path = recording.path
        self.written = self.dropped = 0
        self.error: Exception | None = None
        self._changed = threading.Condition()
        self._waiting: deque[tuple[Frame, TrackResult]] = deque()
        self._ending = False
        self._thread = threading.Thread(target=self._go, name="grasptrack-recorder", daemon=True)
        self._thread.start()

    def add(self, frame: Frame, result: TrackResult) -> None:
        """Have one image written. What comes after the end, or after an error, is left out."""
        most = most_held(frame.image)
        with self._changed:
            while self._waits and len(self._waiting) >= most and not self._ending:
                self._changed.wait()
            if self._ending:
                return
            if len(self._waiting) >= most:
                self.dropped += 1
                return
            self._waiting.append((frame, result))
            self._changed.notify_all()

    def end(self) -> None:
        """Take no more images; what waits is written."""
        with self._changed:
            self._ending = True
            self._changed.notify_all()

    def join(self) -> None:
        """Wait until the file is whole; where that is interrupted, what still waits is not written any more."""
        try:
            self._thread.join()
        except BaseException:
            with self._changed:
                self._waiting.clear()
            raise

    def _go(self) -> None:
        for work in (self._write, self._recording.close):
            try:
                work()
            except Exception as error:  # encoders' own errors share no class
                self.error = self.error or error
                self.end()
        if self._on_end is not None:
            self._on_end(self)

    def _write(self) -> None:
        while True:
            with self._changed:
                while not self._waiting and not self._ending:
                    self._changed.wait()
                if not self._waiting:
                    return
                frame, result = self._waiting.popleft()
                self._changed.notify_all()
            self._recording.write(frame, result)
            self.written += 1


class BackgroundRecording:
    """A recording that whoever writes to it does not wait for, but where too many images wait already; nothing is lost.

    Args:
        recording: as of `WriterThread`.
    """

    def __init__(self, recording: Recording) -> None:
        self.path = recording.path
        self._writer = WriterThread(recording, waits=True)
        self._told = False

    def write(self, frame: Frame, result: TrackResult) -> None:
        """Have one image written; it may be changed afterwards.

        Raises:
            Exception: whatever became of an earlier one, once.
        """
        self._tell_error()
        self._writer.add(replace(frame, image=frame.image.copy()), result)

    def close(self) -> None:
        """Write what waits and make the file whole; may be called again.

        Raises:
            Exception: what went wrong, where `write` has not raised it.
        """
        self._writer.end()
        self._writer.join()
        self._tell_error()

    def _tell_error(self) -> None:
        if self._writer.error is not None and not self._told:
            self._told = True
            raise self._writer.error
