# SPDX-License-Identifier: Apache-2.0
"""The moving picture of README: a grasp is tracked, a hand covers the part, it is lost and says why, and it is found again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
from PIL import Image

import grasptrack as gt
from grasptrack.view.draw import draw_overlay
from grasptrack.view.style import Picture
from grasptrack_bench.simulation import bracket_scene
from grasptrack_bench.simulation.occluders import hand_over
from grasptrack_bench.simulation.scene import Scene
from research.studies import common

SECONDS = 6.0


def covered_scene(frames: int) -> Scene:
    """The scene of `grasptrack demo`, with a hand that comes after a third of it and covers as much of the part as it can."""
    plain = bracket_scene(frames)
    times = (0.3 * frames, 0.42 * frames, 0.6 * frames, 0.75 * frames)
    hand = hand_over(plain.shape, times, share=1.0, side=0.0, seed=3)
    return Scene(
        plain.shape,
        plain.path,
        camera=plain.camera,
        table=plain.table,
        surface=plain.surface,
        covers=(hand,),
        conditions=plain.conditions,
        colour=True,
        fps=frames / SECONDS,
        seed=plain.seed,
    )


def track_overlays(frames: int) -> tuple[list[Picture], list[gt.TrackResult]]:
    """The program's own overlay of each frame, and its results."""
    tracker = gt.GraspTracker(fingers=2)
    pictures, results, last = [], list[gt.TrackResult](), None
    for frame in covered_scene(frames):
        result = tracker.update(frame.image, time=frame.time)
        last = result.view if result.located else last
        results.append(result)
        pictures.append(draw_overlay(frame.image, result, last=last))
    return pictures, results


def write_webp(path: Path, pictures: Sequence[Picture], quality: int) -> None:
    """Write pictures (H, W, 3) BGR as one that moves for `SECONDS` and begins again."""
    first, *others = [Image.fromarray(cv2.cvtColor(p, cv2.COLOR_BGR2RGB)) for p in pictures]
    each = round(1000.0 * SECONDS / len(pictures))
    first.save(path, "WEBP", save_all=True, append_images=others, duration=each, loop=0, quality=quality, method=6)


def main() -> None:
    """Run the study."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--frames", type=int, default=90, help="of the picture, which always lasts 6 s")
    parser.add_argument("--quality", type=int, default=60, help="of WebP, 1 to 100")
    parser.add_argument("--picture", type=Path, default=Path("demo.webp"), help="file to write [demo.webp]")
    given = parser.parse_args()
    pictures, results = track_overlays(given.frames)
    write_webp(given.picture, pictures, given.quality)
    rows, before = [], ""
    for result in results:
        said = f"{result.status} {result.reason_code}".strip()
        if said != before:
            rows.append([str(result.frame), result.status, result.reason])
            before = said
    common.begin_section("The moving picture of README")
    common.add_table(["from frame", "status", "reason"], rows)
    common.write_sections(given.output)


if __name__ == "__main__":
    main()
