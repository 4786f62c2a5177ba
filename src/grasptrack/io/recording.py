# SPDX-License-Identifier: Apache-2.0
"""Recordings of a run for the viewers of robotics: MCAP for Foxglove, RRD for rerun; the suffix says which."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from grasptrack.errors import InputError

if TYPE_CHECKING:
    from grasptrack.io.base import Frame
    from grasptrack.tracking.result import TrackResult

SUFFIXES = (".mcap", ".rrd")


class Recording(Protocol):
    """What a run writes every frame to."""

    path: Path

    def write(self, frame: Frame, result: TrackResult) -> None:
        """Add one frame and what the tracker said of it."""
        ...

    def close(self) -> None:
        """Make the file whole; may be called again."""
        ...


def open_recording(path: Path, *, quality: int | None = None, options: Callable[[], str] = str) -> Recording:
    """A recording that is written in a thread of its own, to be handed to `grasptrack.io.run.run_track`.

    Whoever writes waits only where as many images wait already as are held at most (`grasptrack.io.limits.most_held`); none
    is lost. What goes wrong in writing is raised by the next `write`, or by `close`.

    Args:
        path, quality, options: as of `create_recording`.

    Raises:
        InputError: as of `create_recording`.
    """
    from grasptrack.io.recorders.background import BackgroundRecording

    return BackgroundRecording(create_recording(path, quality=quality, options=options))


def create_recording(path: Path, *, quality: int | None = None, options: Callable[[], str] = str) -> Recording:
    """A recording of the kind that the file's suffix names; images are encoded as they are written.

    Args:
        path: the file, written over: .mcap (extra `foxglove`) or .rrd (extra `rerun`).
        quality: 1 to 100, of JPEG images; None keeps them as they are (PNG), so that tracking the recording again
            gives the same digits.
        options: gives those of `grasptrack track` that track it again alike (`grasptrack.io.recorders.again`); asked with the
            first image, and kept in an MCAP file.

    Raises:
        InputError: another suffix, a quality out of range, a file that cannot be written, or an extra that is not installed.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f'a recording is a file {" or ".join(SUFFIXES)}, not "{path}"', path=str(path))
    if quality is not None and not 1 <= quality <= 100:
        raise InputError(f"the quality of a recording is 1 to 100, not {quality}", quality=quality)
    if not path.parent.is_dir():
        raise InputError(f'"{path}" cannot be written: there is no folder "{path.parent}"', path=str(path))
    if suffix == ".mcap":
        from grasptrack.io.recorders.foxglove import FoxgloveRecording

        return FoxgloveRecording(path, quality, options)
    from grasptrack.io.recorders.rerun import RerunRecording

    return RerunRecording(path, quality)
