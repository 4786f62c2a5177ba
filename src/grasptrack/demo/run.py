# SPDX-License-Identifier: Apache-2.0
"""The demonstration: one rendered scene with known truth, tracked by every strategy, and what each got right."""

from __future__ import annotations

import csv
import math
from collections.abc import Generator, Sequence
from contextlib import closing, nullcontext
from pathlib import Path

import numpy as np

from grasptrack.demo.scene import DemoFrame, DemoScene, demo_scene
from grasptrack.files import whole_file
from grasptrack.geometry.homographies import apply_homography
from grasptrack.io.base import Frame, Source
from grasptrack.io.run import prepare_output, run_track
from grasptrack.io.video import VideoWriter
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import Floats, Pixels, Progress

STRATEGIES = ("auto", "rrp", "grasp-line", "homography")


class RenderedSource(Source):
    """Frames that were rendered beforehand, so that rendering is no part of what is timed."""

    kind = "scene"

    def __init__(self, frames: Sequence[DemoFrame], fps: float) -> None:
        super().__init__(DemoScene.name, fps)
        self.count = len(frames)
        self._frames = frames

    def _read_images(self) -> Generator[tuple[Pixels, float | None, str], None, None]:
        for frame in self._frames:
            yield frame.image, frame.time, frame.name


def accept_limit(area: float) -> float:
    """px: contacts given further than this from the truth are wrong; area of the object in px^2."""
    return max(3.0, 0.04 * math.sqrt(area))


def contact_errors(results: Sequence[TrackResult], frames: Sequence[DemoFrame]) -> tuple[list[float], int]:
    """How far contacts are off; the truth of a grasp is its first contacts, moved by the true motion.

    Returns:
        px of every contact of every located frame but those in which a grasp began, and the number of frames with a contact
        off by more than `accept_limit`.
    """
    distances: list[float] = []
    wrong, first = 0, dict[int | None, Floats]()
    for result, truth in zip(results, frames, strict=True):
        if result.contacts is not None and result.grasp_id in first:
            off = np.hypot(*(result.contacts - truth.true_contacts(first[result.grasp_id])).T)
            distances += off.tolist()
            wrong += bool(off.max() > accept_limit(truth.area))
        elif result.contacts is not None:
            back = np.linalg.inv(truth.H_current_reference)
            first[result.grasp_id] = apply_homography(back, result.contacts)
    return distances, wrong


def run_demo(
    output: Path,
    *,
    frames: int = 120,
    video: bool = True,
    progress: Progress | None = None,
    strategies: Sequence[str] = STRATEGIES,
    risk: float = DEFAULT_RISK,
) -> list[dict[str, float | int | str]]:
    """Render a scene, track it with every strategy, and compare each run with the truth.

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
        A row for each strategy: counts of frames by status, the main reason of loss, contact errors in px, frames with
        wrong contacts (`false_accepts`), latency in ms.

    Raises:
        InputError: the folder cannot be written.
    """
    prepare_output(output)
    tell: Progress = progress if progress is not None else lambda step, done, total: None
    scene = demo_scene(frames)
    rendered: list[DemoFrame] = []
    with closing(VideoWriter(output / "scene.mp4", scene.fps)) if video else nullcontext() as writer:
        for frame in scene:
            rendered.append(frame)
            if writer is not None:
                writer.write(frame.image)
            tell("render", len(rendered), frames)
    _write_truth(output / "truth.csv", rendered)
    return [
        _track_scene(GraspTracker(strategy=name, risk=risk), rendered, scene.fps, output / name, video, tell)
        for name in strategies
    ]


def _track_scene(
    tracker: GraspTracker, frames: Sequence[DemoFrame], fps: float, output: Path, video: bool, tell: Progress
) -> dict[str, float | int | str]:
    results: list[TrackResult] = []

    def keep_result(frame: Frame, result: TrackResult) -> None:
        results.append(result)
        tell(tracker.strategy, frame.index + 1, len(frames))

    run = run_track(
        RenderedSource(frames, fps),
        tracker,
        output,
        video=video,
        options={"strategy": tracker.strategy, "risk": tracker.risk, "scene": "demo", "frames": len(frames)},
        on_frame=keep_result,
    )
    distances, wrong = contact_errors(results, frames)
    median, most, largest = np.percentile(distances or [math.nan], [50, 95, 100]).tolist()
    reasons = {reason: n for status in ("lost", "searching") for reason, n in run.reasons[status].items()}
    return {
        "strategy": tracker.strategy,
        "frames": run.frames,
        **run.counts,
        "reason": max(reasons, key=lambda reason: reasons[reason], default=""),
        "error_median_px": median,
        "error_p95_px": most,
        "error_max_px": largest,
        "false_accepts": wrong,
        "latency_median_ms": run.latency_median_ms,
        "latency_p99_ms": run.latency_p99_ms,
    }


def _write_truth(path: Path, frames: Sequence[DemoFrame]) -> None:
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        entries = [f"h{row}{column}" for row in "123" for column in "123"]
        writer.writerow(["frame", *entries, "time_s", "area_px2", "outline_visible"])
        for frame in frames:
            H = [repr(float(h)) for h in frame.H_current_reference.ravel()]
            told = (f"{frame.time:.6f}", f"{frame.area:.3f}", f"{frame.outline_visible:.4f}")
            writer.writerow([frame.index, *H, *told])
