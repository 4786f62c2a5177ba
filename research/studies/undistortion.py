# SPDX-License-Identifier: Apache-2.0
"""What a calibration is worth: the suite's `lens` scenes, with and without the camera told, and what telling costs."""

from __future__ import annotations

import math
import statistics
import time
from functools import partial

import numpy as np

import grasptrack as gt
from grasptrack.undistortion import Undistortion
from grasptrack_bench.method import MethodStart, score_sequence
from grasptrack_bench.metrics.score import FrameScore
from grasptrack_bench.scenes import SceneCase, ScenePart, show_scene
from grasptrack_bench.simulation import SHAPES
from research.studies import common

METHODS = ("`lens`, camera not told", "`lens`, camera told", "`clean-6dof`, to compare")


def tracker_with(camera: gt.Camera | None, start: MethodStart) -> gt.GraspTracker:
    """The tracker with a camera, or without."""
    return gt.GraspTracker(grasp=start.contacts, camera=camera)


def score_part(task: tuple[str, int]) -> dict[str, list[FrameScore]]:
    """A part's scored frames by method."""
    name, frames = task
    lens = SceneCase(ScenePart(SHAPES[name]()), "lens", 0, frames).scene()
    lensless = SceneCase(ScenePart(SHAPES[name]()), "clean-6dof", 0, frames).scene()
    seen = lens.camera
    camera = gt.Camera(seen.matrix, (seen.k1, seen.k2, 0.0, 0.0), size=(seen.width, seen.height))
    found: dict[str, list[FrameScore]] = {}
    for scene, methods in ((lens, METHODS[:2]), (lensless, METHODS[2:])):
        try:
            start, shown = show_scene(scene)
        except gt.GraspError:
            return {}
        makers = {m: partial(tracker_with, camera if m == METHODS[1] else None) for m in methods}
        found |= score_sequence(shown, makers, start)
    return found


def time_undistortion() -> list[str]:
    """ms to straighten an image, grey and colour, and to prepare for it."""
    camera = gt.Camera(
        [[704.0, 0.0, 319.5], [0.0, 704.0, 239.5], [0.0, 0.0, 1.0]], (-0.15, 0.02, 0, 0), size=(640, 480)
    )
    began = time.perf_counter()
    lens = Undistortion(camera, 640, 480)
    first = 1e3 * (time.perf_counter() - began)
    cells = []
    for shape in ((480, 640), (480, 640, 3)):
        image = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
        times = []
        for _ in range(100):
            began = time.perf_counter()
            lens.straight_image(image)
            times.append(1e3 * (time.perf_counter() - began))
        cells.append(f"{statistics.median(times):.2f}")
    return [*cells, f"{first:.0f}"]


def score_row(method: str, frames: list[FrameScore]) -> list[str]:
    """The figures of a method over all parts."""
    off = [f.distances for f in frames if f.distances is not None and not f.defining and not f.gone]
    errors = np.concatenate(off)
    return [
        method,
        str(len(frames)),
        f"{100 * sum(f.distances is not None for f in frames) / len(frames):.1f}",
        str(sum(f.is_false_accept for f in frames)),
        f"{np.median(errors):.3f}",
        f"{np.percentile(errors, 95):.3f}",
        f"{math.sqrt(float((errors**2).mean())):.3f}",
        f"{statistics.median(f.latency_ms for f in frames):.1f}",
    ]


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__, frames=40, shapes=",".join(SHAPES), workers=2)
    asked = parser.parse_args()
    common.begin_section("A calibrated camera")
    common.add_table(["640x480 grey, ms", "BGR, ms", "once, ms"], [time_undistortion()])
    runs = common.run_all(score_part, [(name, asked.frames) for name in asked.shapes.split(",")], asked.workers)
    rows = [score_row(m, [f for run in runs for f in run.get(m, [])]) for m in METHODS]
    common.add_table(["scenes", "frames", "located %", "wrong", "median px", "95 %", "RMS", "ms"], rows)
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()
