# SPDX-License-Identifier: Apache-2.0
"""One run over one source: track every frame, write grasps.csv, run.json, overlay.mp4 and summary.png."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from grasptrack.errors import InputError
from grasptrack.io.base import Frame, Source
from grasptrack.io.results import UNITS, GraspsCsv, software_versions, write_json
from grasptrack.io.tally import RunSummary, Tally

if TYPE_CHECKING:
    from grasptrack.io.masks import Masks
    from grasptrack.io.video import VideoWriter
    from grasptrack.tracking.result import TrackResult
    from grasptrack.view.summary import Filmstrip

__all__ = ["FILES", "RunSummary", "Tracker", "prepare_folder", "prepare_output", "run_track"]

FILES = ("grasps.csv", "run.json", "overlay.mp4", "summary.png")


class Tracker(Protocol):
    """What a run needs of a tracker; `GraspTracker` is one."""

    @property
    def fingers(self) -> int:
        """Number of contacts of its grasp, k."""
        ...

    def update(self, image: Any, time: float | None = None, mask: Any = None) -> TrackResult:
        """The answer for the next image."""
        ...


def run_track(
    source: Source,
    tracker: Tracker,
    output: Path,
    *,
    video: bool = True,
    options: Mapping[str, Any] | None = None,
    masks: Masks | None = None,
    on_frame: Callable[[Frame, TrackResult], None] | None = None,
) -> RunSummary:
    """Track a grasp through a source and write the results to a folder.

    Whatever ends the run, the files hold what was computed until then and can be read: after Ctrl-C (KeyboardInterrupt,
    also when `on_frame` raises it), after a frame that cannot be used, after any other error, which are raised again.

    Args:
        source: where the frames come from.
        tracker: a tracker that has seen no frame yet.
        output: folder, made when missing; files of an earlier run in it are replaced.
        video: write overlay.mp4.
        options: what the user asked for, for run.json.
        masks: the user's segmentation of the frames.
        on_frame: called with each frame and its result, after its row is written.

    Returns:
        Counts, figures and the files written.

    Raises:
        InputError: the folder cannot be written, or a frame or mask cannot be used; the rows before it are kept.
    """
    prepare_output(output)
    run = _Run(output, tracker.fingers, source, video, dict(options or {}))
    ended, error = "failed", ""
    try:
        for frame in source:
            mask = None if masks is None else masks.mask(frame)
            result = tracker.update(frame.image, time=frame.time, mask=mask)
            run.record(frame, result)
            if on_frame is not None:
                on_frame(frame, result)
        ended = "finished"
    except KeyboardInterrupt:
        ended = "interrupted"
        raise
    except Exception as problem:
        error = " ".join(str(problem).split())
        raise
    finally:
        source.close()
        summary = run.finish(ended, error)
    return summary


def prepare_output(output: Path) -> None:
    """Make the folder of a run and remove an earlier run's files from it.

    Raises:
        InputError: it cannot be made, or not be written to.
    """
    prepare_folder(output)
    for name in FILES:
        try:
            (output / name).unlink(missing_ok=True)
        except OSError as error:
            raise InputError(f'"{output / name}" cannot be replaced: {error.strerror or error}') from None


def prepare_folder(output: Path) -> None:
    """Make a folder and see that it can be written to.

    Raises:
        InputError: it cannot.
    """
    try:
        output.mkdir(parents=True, exist_ok=True)
        probe = output / ".grasptrack-probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(
            f'output folder "{output}" cannot be written: {error.strerror or error}', path=str(output)
        ) from None


class _Run:
    """The files of a run while it goes on."""

    def __init__(self, output: Path, fingers: int, source: Source, video: bool, options: dict[str, Any]) -> None:
        from grasptrack import kernels
        from grasptrack.view.summary import Filmstrip

        self._output = output
        self._head = {
            "options": options,
            "versions": software_versions(),
            "backend": kernels.BACKEND,
            "source": {"name": source.spec, "kind": source.kind, "frames": source.count, "fps": source.fps},
            "units": UNITS,
        }
        self._start = time.perf_counter()
        self._tally = Tally()
        self._rows = GraspsCsv(output / "grasps.csv", fingers)
        self._strip: Filmstrip = Filmstrip()
        self._video: VideoWriter | None = None
        if video:
            from grasptrack.io.video import VideoWriter

            self._video = VideoWriter(output / "overlay.mp4", source.fps)
        # A run that is killed leaves this; one that ends writes over it.
        write_json(output / "run.json", {"ended": "running", **self._head})

    def record(self, frame: Frame, result: TrackResult) -> None:
        """Write one frame's row and picture."""
        self._rows.write(result, frame.index, frame.time)
        self._tally.add(result)
        wanted = self._strip.wants(frame.index)
        if self._video is None and not wanted:
            return
        from grasptrack.view.draw import draw_overlay

        drawn = draw_overlay(frame.image, result, number=frame.index)
        if wanted:
            self._strip.add(frame.index, drawn)
        if self._video is not None:
            self._video.write(drawn)

    def finish(self, ended: str, error: str) -> RunSummary:
        """Close every file, the fastest first: whoever pressed Ctrl-C may press it again."""
        self._rows.close()
        seconds = time.perf_counter() - self._start
        if self._video is not None:
            self._video.close()
        files = {
            name: self._output / name for name in FILES if (self._output / name).exists() and name != "summary.png"
        }
        summary = self._tally.summary(seconds, ended, files)
        content = {"ended": ended, **({"error": error} if error else {}), **self._head, **summary.figures()}
        write_json(self._output / "run.json", content)
        if summary.frames:
            from grasptrack.view.summary import write_summary

            picture = self._output / "summary.png"
            title = Path(str(self._head["source"]["name"])).name  # type: ignore[index]
            write_summary(picture, self._output / "grasps.csv", self._strip, summary, title=title)
            files[picture.name] = picture
        return summary
