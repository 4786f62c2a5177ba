# SPDX-License-Identifier: Apache-2.0
"""One run over one source: track every frame, write grasps.csv, run.json, overlay.mp4 and summary.png, and sum up."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Protocol, cast

from grasptrack import kernels
from grasptrack.errors import InputError
from grasptrack.files import hold_folder, keep_inputs, prepare_folder, write_json, written_before
from grasptrack.geometry.contours import View
from grasptrack.io.base import Frame, Source
from grasptrack.io.columns import UNITS
from grasptrack.io.masks import Masks
from grasptrack.io.recording import Recording
from grasptrack.io.results import GraspsCsv, RunSummary, Tally, software_versions
from grasptrack.io.video import VideoWriter
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.scene import SceneResult
from grasptrack.view.draw import draw_overlay
from grasptrack.view.instances import draw_scene
from grasptrack.view.summary import Filmstrip

FILES = ("grasps.csv", "run.json", "overlay.mp4", "summary.png")


class Tracker(Protocol):
    """What a run needs of a tracker; `GraspTracker` and `SceneTracker` are."""

    @property
    def fingers(self) -> int:
        """Number of contacts of its grasp, k."""

    def update(self, image: Any, time: float | None = None) -> TrackResult | SceneResult:
        """The answer for the next image; of one object, `mask` may stand for the image."""


def run_track(
    source: Source,
    tracker: Tracker,
    output: Path,
    *,
    video: bool = True,
    options: Mapping[str, Any] | None = None,
    masks: Masks | None = None,
    recordings: Sequence[Recording] = (),
    publish: Callable[[Frame, Any, float], None] | None = None,
    on_frame: Callable[[Frame, Any], None] | None = None,
) -> RunSummary:
    """Track a grasp through a source and write the results to a folder.

    Whatever ends the run, the files hold what was computed until then and can be read: after Ctrl-C (KeyboardInterrupt,
    also when `on_frame` raises it), after a frame that cannot be used, when the disk is full, after any other error, which are
    raised again.

    Args:
        source: where the frames come from.
        tracker: a tracker that has seen no frame yet.
        output: folder, made when missing; files of an earlier run in it are replaced.
        video: write overlay.mp4.
        options: what the user asked for, for run.json.
        masks: the user's segmentation of the frames.
        recordings: each is given every frame and its result, after its row is written, and closed at the end.
        publish: called with each frame, its result and when the image came, s of `time.perf_counter`, before that row.
        on_frame: called with each frame and its result after its row is written.

    Returns:
        Counts, figures and the files written.

    Raises:
        InputError: a file of the run would be written over one that is read, the folder cannot be written, another run writes
            to it, the disk is full, or a frame or mask cannot be used; then
            the rows before it are kept.
    """
    with contextlib.ExitStack() as held:
        for recording in recordings:
            held.callback(_close_after_all, recording)
        keep_inputs((output / name for name in FILES), source.files)
        held.enter_context(hold_folder(output))
        prepare_output(output)
        run = Run(output, tracker.fingers, source, video, dict(options or {}), scene=hasattr(tracker, "look"))
        ended, error = "failed", ""
        try:
            for frame in source:
                came = time.perf_counter() - source.waited
                masked = {} if masks is None else {"mask": masks.mask_for(frame)}
                told = tracker.update(frame.image, time=frame.time, **masked)
                if publish is not None:
                    publish(frame, told, came)
                run.write_frame(frame, told)
                for recording in recordings:
                    for result in results_of(told):
                        recording.write(frame, result)
                if on_frame is not None:
                    on_frame(frame, told)
            for recording in recordings:
                recording.close()
            ended = "finished"
        except KeyboardInterrupt:
            ended = "interrupted"
            raise
        except Exception as problem:
            error = " ".join(str(problem).split())
            raise
        finally:
            source.close()
            try:
                summary = run.close_files(ended, error)
            except OSError:
                if not error:  # else what came first is to be told
                    raise
    return summary


def results_of(told: TrackResult | SceneResult) -> list[TrackResult]:
    """What is told of a frame: of one object, or of each instance of a scene."""
    many = getattr(told, "results", None)
    return [cast("TrackResult", told)] if many is None else list(many.values())


def _close_after_all(recording: Recording) -> None:
    """Close what may be closed already; where that fails, what came first is to be told."""
    with contextlib.suppress(Exception):
        recording.close()


def prepare_output(output: Path) -> None:
    """Make the folder of a run and remove an earlier run's files from it."""
    keep_inputs((output / name for name in FILES), ())
    prepare_folder(output)
    pictures = {"candidates.png"} & written_before(output)
    for name in (*pictures, *sorted(FILES, key="run.json".__eq__)):  # that last: it says whose the others are
        try:
            (output / name).unlink(missing_ok=True)
        except OSError as error:
            raise InputError(f'"{output / name}" cannot be replaced: {error.strerror or error}') from None


class Run:
    """The files of a run while it goes on; `run_track` drives one, a program with a loop of its own may too.

    `prepare_output` has prepared its folder, `hold_folder` holds it; grasps.csv has columns for as many contacts as `fingers`,
    and of a scene those of its instances.
    """

    def __init__(
        self, output: Path, fingers: int, source: Source, video: bool, options: dict[str, Any], *, scene: bool = False
    ) -> None:
        self._output, self._source = output, source
        self._head: dict[str, Any] = {
            "options": options,
            "versions": software_versions(),
            "backend": kernels.BACKEND,
            "source": {"name": source.spec, "kind": source.kind, "frames": source.count, "fps": source.fps},
            "units": UNITS,
        }
        # A run that is killed leaves this; one that ends writes over it.
        write_json(output / "run.json", {"ended": "running", **self._head, "files": FILES})
        self._start = time.perf_counter()
        self._tally = Tally()
        self._last: dict[int | None, View] = {}
        self._instances: dict[int, dict[str, Any]] | None = {} if scene else None
        self._rows = GraspsCsv(output / "grasps.csv", fingers, scene=scene)
        self._strip: Filmstrip = Filmstrip()
        self._video: VideoWriter | None = None
        if video:
            self._video = VideoWriter(output / "overlay.mp4", source.fps)

    def write_frame(self, frame: Frame, told: TrackResult | SceneResult) -> None:
        """Write one frame's row, or one for each instance, and its picture."""
        for result in results_of(told):
            if result.located and result.view is not None:
                self._last[result.instance_id] = result.view
            self._rows.write(result, frame.index, frame.time)
            self._tally.add(result)
            self._count_instance(frame, result)
        wanted = self._instances is None and self._strip.wants_frame(frame.index)
        if self._video is None and not wanted:
            return
        if self._instances is None:
            drawn = draw_overlay(frame.image, cast("TrackResult", told), number=frame.index, last=self._last.get(None))
        else:
            drawn = draw_scene(frame.image, cast("SceneResult", told), self._last)
        if wanted:
            self._strip.add_frame(frame.index, drawn)
        if self._video is not None:
            self._video.write(drawn)

    def _count_instance(self, frame: Frame, result: TrackResult) -> None:
        if self._instances is None or result.instance_id is None:
            return
        start = {"part_id": result.part_id, "first_frame": frame.index, "last_frame": frame.index}
        known = self._instances.setdefault(
            result.instance_id, start | dict.fromkeys(("tracked", "unstable", "lost"), 0)
        )
        known["last_frame"] = frame.index
        known[result.status] += 1

    def close_files(self, ended: str, error: str, recordings: Sequence[Mapping[str, Any]] = ()) -> RunSummary:
        """Close every file, the fastest first: whoever pressed Ctrl-C may press it again.

        Args:
            ended: as of `RunSummary`.
            error: why it failed, in one line; empty where it did not.
            recordings: for run.json, of each its name and how many images were written and dropped.

        Raises:
            OSError: one of them could not be written, as on a full disk; the others are there.
        """
        self._rows.close()
        seconds = time.perf_counter() - self._start
        problems = []
        if self._video is not None:
            try:
                self._video.close()
            except OSError as problem:  # such a video cannot be played, and takes the room of what can be read
                problems.append(problem)
                (self._output / "overlay.mp4").unlink(missing_ok=True)
        files = {name: self._output / name for name in FILES[:-1] if (self._output / name).exists()}
        summary = self._tally.summary(seconds, "failed" if problems else ended, files)
        page = FILES[-1:] if summary.frames and self._instances is None else ()
        said = {"error": error or " ".join(map(str, problems)), "shortfall": self._source.shortfall}
        if self._source.live:
            self._head["source"] |= {"dropped": self._source.dropped, "reconnected": self._source.reconnected}
        more: dict[str, Any] = {"recordings": list(recordings)} if recordings else {}
        if self._instances is not None:
            more["instances"] = [{"instance_id": number, **told} for number, told in self._instances.items()]
        content = {
            "ended": summary.ended,
            **{k: v for k, v in said.items() if v},
            **self._head,
            **summary.figures(),
            "files": [*files, *page],
            **more,
        }
        writers = [partial(write_json, self._output / "run.json", content)]
        writers += [partial(self._write_summary, summary)] if page else []
        for write in writers:
            try:
                write()
            except OSError as problem:
                problems.append(problem)
        if problems:
            raise problems[0]
        return summary

    def _write_summary(self, summary: RunSummary) -> None:
        from grasptrack.view.summary import write_summary

        picture = self._output / "summary.png"
        strategy = self._head["options"].get("strategy")  # the demonstration, for one, writes a page for each
        title = Path(str(self._head["source"]["name"])).name + (f", by {strategy}" if strategy else "")
        write_summary(picture, self._output / "grasps.csv", self._strip, summary, title=title)
        summary.files[picture.name] = picture
