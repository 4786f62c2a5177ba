# SPDX-License-Identifier: Apache-2.0
"""The recordings that people begin and end on the page, one after another, each written in a thread of its own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from grasptrack.io.base import Frame
from grasptrack.io.recording import Recording, WriterThread, create_recording
from grasptrack.io.video import VideoWriter
from grasptrack.tracking.result import TrackResult
from grasptrack.view.draw import draw_overlay

VIDEO = ".mp4"


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


class Recordings:
    """The recordings of a run: recording-001, recording-002 and so on, with `figures` for run.json of each that has ended."""

    def __init__(
        self, folder: Path, suffix: str, fps: float | None, waits: bool, ended: Callable[[WriterThread], None]
    ) -> None:
        self._folder, self._suffix, self._fps, self._waits, self._ended = folder, suffix, fps, waits, ended
        self._count = 0
        self._how: list[str] = []  # options, known with a recording's first image, which is later than its file is made
        self._present: WriterThread | None = None
        self._ending: list[WriterThread] = []
        self.figures: list[dict[str, Any]] = []

    @property
    def name(self) -> str:
        """Of the file that is recorded; empty where none is."""
        return "" if self._present is None else self._present.path.name

    @property
    def counts(self) -> tuple[int, int]:
        """Images of it that were written, and dropped."""
        return (0, 0) if self._present is None else (self._present.written, self._present.dropped)

    def start(self) -> None:
        """Begin one, unless one is going on."""
        if self._present is not None:
            return
        self._how = how = list[str]()
        while (path := self._folder / f"recording-{self._count + 1:03d}{self._suffix}").exists():
            self._count += 1  # of an earlier session
        recording: Recording
        if self._suffix == VIDEO:
            recording = OverlayVideo(path, self._fps)
        else:
            recording = create_recording(path, options=lambda: "".join(how))
        self._count += 1
        self._present = WriterThread(recording, waits=self._waits, ended=self._ended)

    def add(self, frame: Frame, result: TrackResult, options: Callable[[], str]) -> None:
        """Have one image written, where one is going on; `options` gives what a recording that begins with it keeps."""
        if self._present is not None:
            if not self._how:
                self._how.append(options())
            self._present.add(frame, result)

    def stop(self) -> None:
        """End the present one; `ended` tells when its file is whole."""
        if self._present is not None:
            self._present.end()
            self._ending.append(self._present)
            self._present = None

    def forget_recorder(self, recorder: WriterThread) -> None:
        """Of one that has ended."""
        self._present = None if self._present is recorder else self._present
        self._ending = [other for other in self._ending if other is not recorder]
        figures = {"name": recorder.path.name, "images": recorder.written, "dropped": recorder.dropped}
        self.figures.append(figures)

    def close(self) -> None:
        """End the present one, and wait until all files are whole."""
        self.stop()
        for recorder in self._ending:
            recorder.join()
            self.forget_recorder(recorder)


def describe_recording(recorder: WriterThread) -> str:
    """What became of a recording that has ended, in one line."""
    name, error = recorder.path.name, recorder.error
    if error is not None:
        said = error.strerror if isinstance(error, OSError) and error.strerror else " ".join(str(error).split())
        kept = "" if recorder.path.suffix == VIDEO else f"; {recorder.written} images of it can be read"
        return f'"{name}" cannot be written: {said}{kept}'
    lost = f", {recorder.dropped} dropped because the encoder was busy" if recorder.dropped else ""
    return f"{name}: {recorder.written} images{lost}"
