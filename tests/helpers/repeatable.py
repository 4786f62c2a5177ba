# SPDX-License-Identifier: Apache-2.0
"""What the program computes of the same input, as a digest for each part of it: run as a script by processes of other settings.

python tests/helpers/repeatable.py OPENCV_THREADS main|thread
"""

import csv
import hashlib
import json
import sys
import tempfile
import threading
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import cv2
import numpy as np

from grasptrack import GraspTracker
from grasptrack.cli.main import main
from grasptrack.demo import demo_scene
from grasptrack_bench import suites
from grasptrack_bench.records import write_records

FRAMES = 9


def _images(folder: Path) -> Path:
    """A part that moves, and is gone for two of the images."""
    folder.mkdir()
    for frame in demo_scene(FRAMES):
        image = frame.image.copy()
        if frame.index in (5, 6):
            image[:] = 128
        cv2.imwrite(str(folder / f"{frame.index:03d}.png"), image)
    return folder


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return [{k: v for k, v in row.items() if k != "latency_ms"} for row in csv.DictReader(file)]


def _track(folder: Path, images: Path) -> object:
    assert main(["track", str(images), "--no-video", "--quiet", "--output", str(folder)]) == 0
    return _rows(folder / "grasps.csv")


def _synthesize(folder: Path, images: Path) -> object:
    found = []
    for fingers in ("2", "3"):
        asked = ["synthesize", str(images / "000.png"), "--fingers", fingers, "--quiet", "--output", str(folder)]
        assert main(asked) == 0
        found.append(json.loads((folder / "grasps.json").read_text())["objects"])
    return found


def _inspect(folder: Path, images: Path) -> object:
    assert main(["inspect", str(images / "000.png"), "--runs", "1", "--quiet", "--output", str(folder)]) == 0
    told = json.loads((folder / "inspect.json").read_text())
    return {key: value for key, value in told.items() if key not in ("options", "image")}


def _evaluate(folder: Path, images: Path) -> object:
    asked = suites.SceneOptions(
        shapes=("bracket",),
        disturbances=("bar", "noise"),
        methods=suites.method_names((), peers=False),
        frames=6,
        seed=3,
    )
    work = suites.scene_suite(asked)
    folder.mkdir()
    found = []
    for job in work.jobs:
        write_records(folder / "scores.csv", work.function(job.task))
        found.append(_rows(folder / "scores.csv"))
    return found


def _answers(folder: Path, images: Path) -> object:
    """Of the tracker, to the last bit."""
    tracker, found = GraspTracker(), []
    for k, path in enumerate(sorted(images.iterdir())):
        result = tracker.update(cv2.imread(str(path)), time=k / 30.0)
        values = (getattr(result, field.name) for field in fields(result) if field.name not in ("latency_ms", "view"))
        found.append([value.tobytes() if isinstance(value, np.ndarray) else str(value) for value in values])
        found.append(None if result.view is None else [contour.points.tobytes() for contour in result.view.contours])
    return found


PARTS: dict[str, Callable[[Path, Path], object]] = {
    "answers": _answers,
    "track": _track,
    "synthesize": _synthesize,
    "inspect": _inspect,
    "evaluate": _evaluate,
}


def digests(parts: tuple[str, ...] = tuple(PARTS)) -> dict[str, str]:
    """Of each part of what is computed, hexadecimal."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        images = _images(folder / "images")
        return {part: hashlib.sha256(repr(PARTS[part](folder / part, images)).encode()).hexdigest() for part in parts}


def digests_in_thread(parts: tuple[str, ...] = tuple(PARTS)) -> dict[str, str]:
    """As above, in a thread of its own."""
    found: dict[str, str] = {}
    thread = threading.Thread(target=lambda: found.update(digests(parts)))
    thread.start()
    thread.join()
    return found


if __name__ == "__main__":
    cv2.setNumThreads(int(sys.argv[1]))
    print(json.dumps(digests() if sys.argv[2] == "main" else digests_in_thread()))
