# SPDX-License-Identifier: Apache-2.0
"""Recordings, each written in a thread of its own: where the disk or the encoder is slow, images are dropped and counted."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path

from grasptrack.io.base import Frame
from grasptrack.io.recording import Recording, open_recording
from grasptrack.io.video import VideoWriter
from grasptrack.tracking.result import TrackResult
from grasptrack.view.draw import draw_overlay

VIDEO = ".mp4"
WAITING = 32
"""Images that wait for the encoder at most."""


class OverlayVideo:
    """A recording as a video of what is seen, drawn as overlay.mp4 of `track` is."""

    def __init__(self, path: Path, fps: float | None) -> None:
        self.path = path
        self._writer = VideoWriter(path, fps)

    def write(self, frame: Frame, result: TrackResult) -> None:
        """Add one image with what is known of it."""
        self._writer.write(draw_overlay(frame.image, result, number=frame.index))

    def close(self) -> None:
        """Make the file whole."""
        self._writer.close()


class Recorder:
    """Writes one recording until it is ended.

    Args:
        recording: where images go.
        ended: called with this recorder, in its own thread, when the file is whole, or writing has failed.

    Attributes:
        path: of the file.
        written, dropped: images that were written, and that were not because too many waited.
        error: why writing failed, in one line; empty where it did not.
    """

    def __init__(self, recording: Recording, ended: Callable[[Recorder], None]) -> None:
        self._recording, self._on_end = recording, ended
        self.path, self.written, self.dropped, self.error = recording.path, 0, 0, ""
        self._changed = threading.Condition()
        self._waiting: deque[tuple[Frame, TrackResult]] = deque()
        self._ending = False
        self._thread = threading.Thread(target=self._go, name="grasptrack-recorder", daemon=True)
        self._thread.start()

    def add(self, frame: Frame, result: TrackResult) -> None:
        """Have one image written; never waits."""
        with self._changed:
            if len(self._waiting) >= WAITING:
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
        """Wait until the file is whole."""
        self._thread.join()

    def describe(self) -> str:
        """What became of it, in one line."""
        lost = f", {self.dropped} dropped because the encoder was busy" if self.dropped else ""
        return self.error or f"{self.path.name}: {self.written} images{lost}"

    def _go(self) -> None:
        for work in (self._write, self._recording.close):
            try:
                work()
            except Exception as error:  # encoders' own errors share no class
                self.error = self.error or f'"{self.path.name}" cannot be written: {" ".join(str(error).split())}'
        self._on_end(self)

    def _write(self) -> None:
        while True:
            with self._changed:
                while not self._waiting and not self._ending:
                    self._changed.wait()
                if not self._waiting:
                    return
                frame, result = self._waiting.popleft()
            self._recording.write(frame, result)
            self.written += 1


class Recordings:
    """The recordings of a run, one after another: recording-001, recording-002 and so on.

    Args:
        folder: of the run.
        suffix: ".mp4", or one of `grasptrack.io.recording.SUFFIXES`.
        fps: images/s of a video.
        ended: as of `Recorder`.
    """

    def __init__(self, folder: Path, suffix: str, fps: float | None, ended: Callable[[Recorder], None]) -> None:
        self._folder, self._suffix, self._fps, self._ended = folder, suffix, fps, ended
        self._count = 0
        self._present: Recorder | None = None
        self._ending: list[Recorder] = []

    @property
    def name(self) -> str:
        """Of the file that is recorded; empty where none is."""
        return "" if self._present is None else self._present.path.name

    @property
    def counts(self) -> tuple[int, int]:
        """Images of it that were written, and dropped."""
        return (0, 0) if self._present is None else (self._present.written, self._present.dropped)

    def start(self) -> None:
        """Begin one, unless one is going on.

        Raises:
            InputError: it cannot be written.
        """
        if self._present is not None:
            return
        path = self._folder / f"recording-{self._count + 1:03d}{self._suffix}"
        recording = OverlayVideo(path, self._fps) if self._suffix == VIDEO else open_recording(path)
        self._count += 1
        self._present = Recorder(recording, self._ended)

    def add(self, frame: Frame, result: TrackResult) -> None:
        """Have one image written, where one is going on."""
        if self._present is not None:
            self._present.add(frame, result)

    def stop(self) -> None:
        """End the present one; `ended` tells when its file is whole."""
        if self._present is not None:
            self._present.end()
            self._ending.append(self._present)
            self._present = None

    def forget(self, recorder: Recorder) -> None:
        """Of one that has ended."""
        self._present = None if self._present is recorder else self._present
        self._ending = [other for other in self._ending if other is not recorder]

    def close(self) -> None:
        """End the present one, and wait until all files are whole."""
        self.stop()
        for recorder in self._ending:
            recorder.join()
