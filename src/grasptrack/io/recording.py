# SPDX-License-Identifier: Apache-2.0
"""What a run is recorded as: files for the viewers of robotics, written in threads of their own, and lines of JSON."""

from __future__ import annotations

import json
import shlex
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol, TextIO

import numpy as np

from grasptrack.errors import InputError
from grasptrack.io.base import Frame
from grasptrack.io.columns import result_fields
from grasptrack.io.limits import most_held
from grasptrack.plugins import load_plugin, plugin_names
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats

STANDARD_OUTPUT = "-"
HALF = 0.5
"""px from our coordinates, with (0, 0) in the centre of the first pixel, to those that count from its corner."""
_INSIDE_95 = 2.4477
"""Standard deviations within which 95 % of a normal distribution in the plane lie: sqrt(-2 ln 0.05)."""
OPTIONS = (
    *("strategy", "fingers", "friction", "risk", "grasp", "object", "not", "box", "outline", "choose", "sure", "wait"),
    *("masks", "first_look_ms", "segmenter", "background", "ignore", "camera", "length", "pixel_aspect", "tolerance"),
    *("min_opening", "max_opening", "finger_width", "finger_thickness", "clearance", "scale", "resynthesize", "next"),
    *("belt", "search_ms"),
)
"""Those of `grasptrack track` that decide what is tracked and how. The rate and the source's settings do not: a recording keeps
the times."""


class Recording(Protocol):
    """What a run writes every frame to."""

    path: Path

    def write(self, frame: Frame, result: TrackResult) -> None:
        """Add one frame and what the tracker said of it."""

    def close(self) -> None:
        """Make the file whole; may be called again."""


def open_recording(path: Path, *, quality: int | None = None, options: Callable[[], str] = str) -> Recording:
    """A recording that is written in a thread of its own, to be handed to `grasptrack.io.run.run_track`.

    Whoever writes waits only where as many images wait already as are held at most (`grasptrack.io.limits.most_held`); none
    is lost. What goes wrong in writing is raised by the next `write`, or by `close`.
    """
    return BackgroundRecording(create_recording(path, quality=quality, options=options))


def create_recording(path: Path, *, quality: int | None = None, options: Callable[[], str] = str) -> Recording:
    """A recording of the kind that the file's suffix names; images are encoded as they are written.

    Args:
        path: the file, written over; its suffix is that of a recorder (entry points "grasptrack.recorders"): .mcap (extra
            `foxglove`), .rrd (extra `rerun`).
        quality: 1 to 100, of JPEG images; None keeps them as they are (PNG), so that tracking the recording again
            gives the same digits.
        options: gives those of `grasptrack track` that track it again alike (`tracking_options`); asked with the first image,
            and kept in an MCAP file.

    Raises:
        InputError: another suffix, a quality out of range, a file that cannot be written, or an extra that is not installed.
    """
    suffix, known = path.suffix.lower(), [f".{name}" for name in plugin_names("grasptrack.recorders")]
    if suffix not in known:
        raise InputError(f'a recording is a file {" or ".join(known)}, not "{path}"', path=str(path))
    if quality is not None and not 1 <= quality <= 100:
        raise InputError(f"the quality of a recording is 1 to 100, not {quality}", quality=quality)
    if not path.parent.is_dir():
        raise InputError(f'"{path}" cannot be written: there is no folder "{path.parent}"', path=str(path))
    recording: Recording = load_plugin("grasptrack.recorders", suffix[1:])(path, quality, options)
    return recording


def try_recorder(suffix: str) -> None:
    """Raise what `create_recording` would, before there is anything to record: a page's Record comes late."""
    with TemporaryDirectory() as folder:
        create_recording(Path(folder) / f"tried{suffix}").close()


# --- options for tracking a recording again -------------------------------------------------------


def tracking_options(asked: Mapping[str, Any]) -> str:
    """Words for a shell, in one order whatever the mapping's.

    Args:
        asked: what was asked for, by the options' names with underscores, as in run.json; what is None or False is left out,
            and so are other names. Pixels of "object" and "not" are one text, a space between two.
    """
    words: list[str] = []
    for name in OPTIONS:
        value, option = asked.get(name), "--" + name.replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            words.append(option)
            continue
        for text in str(value).split() if name in ("object", "not") else [str(value)]:
            words += [f"{option}={text}"] if text.startswith("-") else [option, text]
    return shlex.join(words)


def points_text(points: Iterable[Iterable[float]] | None) -> str | None:
    """Pixels as options take them, "x,y x,y", with all digits; None for none."""
    pairs = [",".join(repr(float(v)) for v in point) for point in (() if points is None else points)]
    return " ".join(pairs) or None


# --- lines of JSON --------------------------------------------------------------------------------


def json_line(fields: Mapping[str, Any]) -> str:
    """A line with its newline."""
    return json.dumps(fields, allow_nan=False, separators=(",", ":")) + "\n"


class JsonLines:
    """Writes a line for every frame, and passes it on at once; ``-`` is the standard output.

    `outline` tells the outline, too: some 300 points a line.
    """

    def __init__(self, path: Path, *, outline: bool = False) -> None:
        self.path, self._outline = path, outline
        self._own: TextIO | None = None
        if str(path) != STANDARD_OUTPUT:
            check_writable(path)
            self._own = path.open("w", encoding="utf-8")

    def write(self, frame: Frame, result: TrackResult) -> None:
        """Add a frame."""
        file = self._own or sys.stdout
        file.write(json_line(result_fields(frame, result, outline=self._outline)))
        file.flush()

    def close(self) -> None:
        """Close the file, if it is one; may be called again."""
        if self._own is not None:
            self._own.close()


def check_writable(path: Path) -> None:
    """Make a file empty."""
    try:
        path.open("wb").close()
    except OSError as error:
        raise InputError(f'"{path}" cannot be written: {error.strerror or error}', path=str(path)) from None


# --- what viewers draw ----------------------------------------------------------------------------


def status_line(result: TrackResult) -> str:
    """Status, and why where it is not tracked."""
    return f"{result.status}: {result.reason}" if result.reason else result.status


def covariance_ellipses(result: TrackResult, points: int = 24) -> list[Floats]:
    """(points, 2) px on the 95 % ellipse of each contact; none where no covariance is known."""
    if result.contacts is None or result.covariance is None:
        return []
    turn = np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)
    circle = np.column_stack([np.cos(turn), np.sin(turn)]) * _INSIDE_95
    found = []
    for contact, covariance in zip(result.contacts, result.covariance, strict=True):
        if np.isfinite(covariance).all():
            values, axes = np.linalg.eigh(covariance)
            found.append(contact + circle * np.sqrt(np.maximum(values, 0.0)) @ axes.T)
    return found


# --- in a thread of its own -----------------------------------------------------------------------


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
        self._waiting: deque[tuple[Frame, Any]] = deque()
        self._ending = False
        self._thread = threading.Thread(target=self._write_and_close, name="grasptrack-recorder", daemon=True)
        self._thread.start()

    def add(self, frame: Frame, result: Any) -> None:
        """Have one image written, with what its recording takes. What comes after the end, or after an error, is left out."""
        most = most_held(frame.image)
        with self._changed:
            self._changed.wait_for(lambda: self._ending or not self._waits or len(self._waiting) < most)
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

    def _write_and_close(self) -> None:
        for work in (self._write_frames, self._recording.close):
            try:
                work()
            except Exception as error:  # encoders' own errors share no class
                self.error = self.error or error
                self.end()
        if self._on_end is not None:
            self._on_end(self)

    def _write_frames(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._ending or self._waiting)
                if not self._waiting:
                    return
                frame, result = self._waiting.popleft()
                self._changed.notify_all()
            self._recording.write(frame, result)
            self.written += 1


class BackgroundRecording:
    """A recording that whoever writes to it does not wait for, but where too many images wait already; nothing is lost."""

    def __init__(self, recording: Recording) -> None:
        self.path = recording.path
        self._writer = WriterThread(recording, waits=True)
        self._told = False

    def write(self, frame: Frame, result: TrackResult) -> None:
        """Have one image written, which may be changed afterwards; whatever became of an earlier one is raised, once."""
        self._tell_error()
        self._writer.add(replace(frame, image=frame.image.copy()), result)

    def close(self) -> None:
        """Write what waits and make the file whole; may be called again. What went wrong is raised where `write` has not."""
        self._writer.end()
        self._writer.join()
        self._tell_error()

    def _tell_error(self) -> None:
        if self._writer.error is not None and not self._told:
            self._told = True
            raise self._writer.error
