# SPDX-License-Identifier: Apache-2.0
"""Track a grasp in each video of a folder; one CSV row a video, also of one that cannot be read.

    python examples/09_folder_of_videos.py                        two rendered videos and a file that is none
    python examples/09_folder_of_videos.py FOLDER > videos.csv    your own

Lines "name.mp4,x,y" in FOLDER/objects.csv tell a pixel on the object in the first image; elsewhere a first look chooses it.
"""

import csv
import math
import sys
import tempfile
from collections import Counter
from contextlib import closing
from pathlib import Path

import grasptrack as gt
from grasptrack.demo import demo_scene
from grasptrack.io.video import VideoWriter

VIDEOS, STATES = (".avi", ".mkv", ".mov", ".mp4", ".webm"), ("tracked", "unstable", "lost", "searching")


def summarise(video: Path, object_at: list[float] | None) -> list[str | int]:
    """The row of one video; of one that breaks off, of the frames before."""
    said, error = list[tuple[str, str, float]](), ""
    tracker = gt.GraspTracker(fingers=2, object_at=object_at)
    try:
        with gt.open_source(video) as source:
            for frame in source:
                result = tracker.update(frame.image, time=frame.time)
                said.append((result.status, result.reason_code, result.margin_deg))
            error = source.shortfall
    except gt.GraspTrackError as reason:
        error = str(reason)
    counts = [[status for status, _, _ in said].count(state) for state in STATES]
    worst = min((margin for _, _, margin in said if math.isfinite(margin)), default=math.nan)
    losses = Counter(code for status, code, _ in said if status == "lost").most_common(1)
    return [video.name, len(said), *counts, f"{worst:.1f}", losses[0][0] if losses else "", error]


def main(folder: Path) -> None:
    """Write the rows of all videos."""
    told, out = folder / "objects.csv", csv.writer(sys.stdout, lineterminator="\n")
    lines = told.read_text().splitlines() if told.exists() else ()
    objects = {name: [float(x), float(y)] for name, x, y in csv.reader(lines)}
    out.writerow(("video", "frames", *STATES, "worst_margin_deg", "most_frequent_loss", "error"))
    for video in sorted(path for path in folder.iterdir() if path.suffix.lower() in VIDEOS):
        out.writerow(summarise(video, objects.get(video.name)))


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        for seed in () if sys.argv[1:] else (3, 8):
            with closing(VideoWriter(Path(made, f"bracket-{seed}.mp4"), 30.0)) as writer:
                for frame in demo_scene(40, seed):
                    writer.write(frame.image)
            Path(made, "broken.mp4").write_bytes(b"no video")
        main(Path(*sys.argv[1:] or [made]))
