# SPDX-License-Identifier: Apache-2.0
"""What a session is without a tracker: a source that is played into one thread, a run's files, recordings, what is shown."""

from __future__ import annotations

import contextvars
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from grasptrack.errors import GraspTrackError, InputError
from grasptrack.files import keep_inputs
from grasptrack.io.base import Frame, Source
from grasptrack.io.recording import Recording, WriterThread, create_recording
from grasptrack.io.results import RunSummary
from grasptrack.io.run import FILES, Run, prepare_output
from grasptrack.io.video import VideoWriter
from grasptrack.live import commands as told
from grasptrack.live.advisor import Advisor
from grasptrack.live.inbox import Arrival, Ended, Inbox, KeptImages, Player
from grasptrack.live.servo_desk import ServoDesk
from grasptrack.live.state import Curves, Shown
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.scene import SceneResult
from grasptrack.view.draw import draw_overlay
from grasptrack.view.instances import draw_scene

VIDEO = ".mp4"


class OverlayVideo:
    """A recording as a video of what is seen, drawn as overlay.mp4 of `track` is."""

    def __init__(self, path: Path, fps: float | None) -> None:
        self.path = path
        self._writer = VideoWriter(path, fps)

    def write(self, frame: Frame, result: TrackResult | SceneResult) -> None:
        """Add one image with what is known of it, or of each part."""
        if isinstance(result, SceneResult):
            self._writer.write(draw_scene(frame.image, result))
        else:
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

    def add(self, frame: Frame, result: TrackResult | SceneResult, options: Callable[[], str]) -> None:
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


PATIENCE = 3.0
"""s that a device is waited for when its source is closed."""

Listener = Callable[[Shown], None]


class SessionLoop(ABC):
    """Plays a source into a thread that takes images, helpers' answers and people's words one after another.

    Args:
        source, output, options, record_as, pace: as of `LiveSession`.
        fingers: contacts that grasps.csv has columns for.
        shown: the moment before the first.

        scene: every part is followed, and grasps.csv has the columns for that.

    Attributes:
        curves: of the last images.
        summary: of the run, once it has ended; None where it could not be written.
        servo: moves an arm by what is followed; None moves none.
        can_hover: a segmenter answers a pointer that hovers.
        has_parts: parts on file are followed, one of them chosen.
    """

    servo: ServoDesk | None = None
    can_hover = False
    has_parts = False

    def __init__(
        self,
        source: Source,
        output: Path,
        fingers: int,
        shown: Shown,
        options: Mapping[str, Any],
        record_as: str,
        pace: bool,
    ) -> None:
        keep_inputs((output / name for name in FILES), source.files)
        prepare_output(output)
        self._source, self._output, self._pace = source, output, pace
        self._run = Run(output, fingers, source, False, dict(options), scene=self.has_parts)
        self._files = list(FILES[:2])
        self._inbox = Inbox()
        self._listeners: list[Listener] = []
        self._stopping = threading.Event()
        run = contextvars.copy_context().run  # limits of size hold in the thread, too
        self._thread = threading.Thread(target=run, args=(self._run_session,), name="grasptrack-session", daemon=True)
        self._advisor = Advisor(lambda found: self._inbox.tell(found, bounded=False))
        self._player: Player | None = None
        # Where the source waits, so does the tracker, and a recording misses nothing; a camera's images would be missed.
        self._recordings = Recordings(
            output, record_as, source.fps, not source.live, lambda recorder: self._inbox.tell(recorder, bounded=False)
        )
        self._playing = 0  # number of the present playing of the source
        self._over = False  # it has no more images
        self._ended = False
        self._images = 0
        self._first_image = 0  # of the present playing
        self._recorded = 0  # number of the last image with a row
        self._steps = 0  # images that are taken although paused
        self._kept = KeptImages()
        self.curves = Curves()
        self._shown = shown
        self._changed = threading.Condition()
        self.summary: RunSummary | None = None

    # --- for other threads -----------------------------------------------------------------------

    @property
    def shown(self) -> Shown:
        """The present moment."""
        return self._shown

    @property
    def source_name(self) -> str:
        """What the source is called: the last part of a path."""
        return Path(self._source.spec).name or self._source.spec

    @property
    def is_running(self) -> bool:
        """Whether its thread goes on."""
        return self._thread.is_alive()

    def add_listener(self, listener: Listener) -> Callable[[], None]:
        """Have something called with every moment, in the session's thread: it must not wait. Returns what ends it."""
        self._listeners = [*self._listeners, listener]

        def remove_listener() -> None:
            self._listeners = [other for other in self._listeners if other is not listener]

        return remove_listener

    def send_command(self, command: told.Command) -> None:
        """Say something; what cannot be done is told in `Shown.notice`."""
        self._inbox.tell(command)

    def written_file(self, name: str) -> Path | None:
        """A file of the run by its name; None for anything that this session did not write."""
        path = self._output / name if name in self._shown.files else None
        return path if path is not None and path.is_file() else None

    def start(self) -> None:
        """Begin, in a thread of its own."""
        self._thread.start()

    def stop(self) -> RunSummary | None:
        """End, and make the files whole; may be called again."""
        self._stopping.set()
        self._inbox.close()
        if self._thread.ident is not None:
            self._thread.join()
        elif not self._ended:
            self._end_session("interrupted", "")
        return self.summary

    def wait_for(self, wanted: Callable[[Shown], bool], seconds: float) -> bool:
        """Wait until a moment is as wanted; False where s have passed."""
        with self._changed:
            return self._changed.wait_for(lambda: wanted(self._shown), seconds)

    # --- the thread ------------------------------------------------------------------------------

    def _run_session(self) -> None:
        ended, error = "interrupted", ""
        try:
            self._start_player()
            while not self._stopping.is_set():
                what = self._inbox.take_next(self._wants_image, 1.0)
                if what is not None:
                    self._handle_input(what)
            if self._shown.phase in ("ended", "failed"):
                ended = "finished" if self._shown.phase == "ended" else "failed"
                error = self._shown.notice[1] if self._shown.phase == "failed" else ""
        except OSError as problem:
            ended, error = "failed", f'"{self._output}" cannot be written: {problem.strerror or problem}'
            self._set_shown(phase="failed", notice=self._note(error))
        except Exception as problem:  # a defect of ours: the page says so, and what was computed stays
            ended, error = "failed", f"internal error, {type(problem).__name__}: {' '.join(str(problem).split())}"
            self._set_shown(phase="failed", notice=self._note(error))
        finally:
            self._end_session(ended, error)

    def _end_session(self, ended: str, error: str) -> None:
        self._ended = True
        if self._player is not None:
            self._player.stop()
        self._inbox.close()
        self._recordings.close()
        self._advisor.close(PATIENCE)
        if self._player is not None:
            self._player.join(PATIENCE)
        try:
            self.summary = self._run.close_files(ended, error, self._recordings.figures)
        except OSError as problem:
            if not error:  # else what came first is to be told
                line = f'"{self._output}" cannot be written: {problem.strerror or problem}'
                self._set_shown(phase="failed", notice=self._note(line))

    @property
    def _wants_image(self) -> bool:
        """Whether the next image is to be taken."""
        return self._shown.phase in ("opening", "tracking") and (self._steps > 0 or not self._shown.paused)

    def _handle_input(self, what: Any) -> None:
        """What came: an image, a helper's answer, or a person's word."""
        if isinstance(what, (Arrival, Ended)):
            if what.run != self._playing:
                return  # of a playing that was given up
            if isinstance(what, Ended):
                self._on_end(what)
            else:
                self._images += 1
                self._steps = max(self._steps - 1, 0)
                arrival = replace(what, frame=replace(what.frame, index=self._images - 1))
                self._kept.add(self._images, arrival)
                self._look_at(self._images, arrival)
        elif isinstance(what, WriterThread):
            self._on_recorded(what)
        elif not self._take_answer(what):
            try:
                self._obey_command(what)
            except GraspTrackError as error:
                self._set_shown(notice=self._note(str(error)))

    @abstractmethod
    def _look_at(self, image: int, arrival: Arrival) -> None:
        """The next image, with its number."""

    @abstractmethod
    def _on_end(self, end: Ended) -> None:
        """The present playing has no more images."""

    def _take_answer(self, what: Any) -> bool:
        """Take what a helper answered; False where it is none."""
        return False

    def _obey_command(self, command: told.Command) -> None:
        """Do what a person said.

        Raises:
            GraspTrackError: it cannot be done.
        """
        match command:
            case told.Pause(paused):
                if self._source.live:
                    self._inbox.newest_only()
                self._steps = 0
                self._set_shown(paused=paused)
            case told.Forward():
                if not self._shown.paused:
                    raise InputError("pause first: a step is for an image that stands")
                self._steps += 1
            case told.Tempo(factor):
                if self._player is not None:
                    self._player.speed = factor
                self._set_shown(speed=factor)
            case told.Record(on):
                self._toggle_recording(on)
            case _:
                raise InputError(f"{type(command).__name__.lower()} is not for following parts on file")

    def _start_player(self) -> None:
        """Read the source from its start."""
        if self._player is not None:
            self._player.stop()
            self._inbox.drop_frame()
            self._player.join(PATIENCE)
        self._playing, self._over = self._playing + 1, False
        self._first_image = self._images + 1
        self._player = Player(self._source, self._inbox, self._playing, self._pace)
        self._player.speed = self._shown.speed

    # --- files, and what is shown ----------------------------------------------------------------

    def _toggle_recording(self, on: bool) -> None:
        if on:
            self._recordings.start()
        else:
            self._recordings.stop()
        self._set_shown()

    def _on_recorded(self, recorder: WriterThread) -> None:
        self._recordings.forget_recorder(recorder)
        if recorder.path.is_file():
            self._add_file(recorder.path.name)
        self._set_shown(notice=self._note(describe_recording(recorder)))

    def _add_file(self, name: str) -> None:
        if name not in self._files:
            self._files.append(name)

    def _note(self, text: str) -> tuple[int, str]:
        return self._shown.notice[0] + 1, " ".join(text.split())

    def _set_shown(self, **changed: Any) -> None:
        written, dropped = self._recordings.counts
        now = {"recording": self._recordings.name, "recorded": written, "dropped": dropped, "files": tuple(self._files)}
        with self._changed:
            self._shown = replace(self._shown, number=self._shown.number + 1, **{**now, **changed})
            self._changed.notify_all()
        for listener in self._listeners:
            listener(self._shown)
