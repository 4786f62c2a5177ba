# SPDX-License-Identifier: Apache-2.0
"""The demonstration: one rendered scene with known truth, tracked by every strategy, and what each got right."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.io.base import Frame, Source
from grasptrack.io.run import prepare_output, run_track
from grasptrack.io.video import VideoWriter
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.tracker import GraspTracker
from grasptrack_bench import Progress
from grasptrack_bench.metrics.score import Score, Truth
from grasptrack_bench.records import write_homographies
from grasptrack_bench.simulation import SceneFrame, demo_scene

STRATEGIES = ("auto", "rrp", "grasp-line", "homography")


class RenderedSource(Source):
    """Frames of a scene that was rendered beforehand, so that rendering is no part of what is timed.

    Args:
        frames: the scene's.
        fps: frames/s.
        name: for run.json.
    """

    kind = "scene"

    def __init__(self, frames: Sequence[SceneFrame], fps: float, name: str = "demo scene") -> None:
        super().__init__(name, fps)
        self.count = len(frames)
        self._frames = frames

    def _read(self) -> Generator[tuple[NDArray[Any], float | None, str], None, None]:
        for frame in self._frames:
            yield frame.image, frame.time, frame.name


def run_demo(
    output: Path,
    *,
    frames: int = 120,
    video: bool = True,
    progress: Progress | None = None,
    strategies: Sequence[str] = STRATEGIES,
    risk: float = DEFAULT_RISK,
) -> list[dict[str, float | int | str]]:
    """Render a scene, track it with every strategy, and score each run against the truth.

    Writes `scene.mp4` (with `video`), `truth.csv` (H_current_reference, area and visible share of the outline by frame)
    and a folder for each strategy as `grasptrack track` does.

    Args:
        output: folder, made when missing.
        frames: of the scene.
        video: write the scene and the overlays as videos.
        progress: see `Progress`.
        strategies: of the tracker, in the order of the rows.
        risk: of the tracker.

    Returns:
        A row for each strategy: counts of frames by status, the main reason of loss, contact errors in px, false
        accepts, latency in ms (`Score.row`).

    Raises:
        InputError: the folder cannot be written.
    """
    prepare_output(output)
    scene = demo_scene(frames)
    rendered: list[SceneFrame] = []
    writer = VideoWriter(output / "scene.mp4", scene.fps) if video else None
    try:
        for frame in scene:
            rendered.append(frame)
            if writer is not None:
                writer.write(frame.image)
            _report_progress(progress, "render", len(rendered), frames)
    finally:
        if writer is not None:
            writer.close()
    _write_truth(output / "truth.csv", rendered)
    return [
        _track_scene(strategy, risk, rendered, scene.fps, output / strategy, video, progress).row()
        for strategy in strategies
    ]


def _track_scene(
    strategy: str,
    risk: float,
    frames: Sequence[SceneFrame],
    fps: float,
    output: Path,
    video: bool,
    progress: Progress | None,
) -> Score:
    score = Score(strategy)

    def score_frame(frame: Frame, result: TrackResult) -> None:
        truth = frames[frame.index]
        score.add(result, Truth.of_scene(truth))
        _report_progress(progress, strategy, frame.index + 1, len(frames))

    source = RenderedSource(frames, fps)
    run_track(
        source,
        GraspTracker(strategy=strategy, risk=risk),
        output,
        video=video,
        options={"strategy": strategy, "risk": risk, "scene": "demo", "frames": len(frames)},
        on_frame=score_frame,
    )
    return score


def _write_truth(path: Path, frames: Sequence[SceneFrame]) -> None:
    write_homographies(
        path,
        {frame.index: np.asarray(frame.H_current_reference) for frame in frames},
        {
            "time_s": {frame.index: f"{frame.time:.6f}" for frame in frames},
            "area_px2": {frame.index: f"{frame.area:.3f}" for frame in frames},
            "outline_visible": {frame.index: f"{frame.outline_visible:.4f}" for frame in frames},
        },
    )


def _report_progress(progress: Progress | None, step: str, done: int, total: int) -> None:
    if progress is not None:
        progress(step, done, total)
