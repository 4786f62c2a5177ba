# SPDX-License-Identifier: Apache-2.0
"""What users see, kept as it is: grasps.csv of twelve sequences by four strategies, the public API, help pages, run.json.

    python tests/helpers/frozen.py            tells what differs from `tests/frozen`
    python tests/helpers/frozen.py --write    keeps what is found, for a change that means to change it

grasps.csv is compared to the byte, but for latency, where versions and processor are those that wrote it; elsewhere by the
status of each frame and its contacts, within `TOLERANCE` px.
"""

import argparse
import csv
import hashlib
import inspect
import itertools
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import grasptrack as gt
from datasets import DATA
from grasptrack.io.results import GraspsCsv
from grasptrack_bench.scenes import built_in, make_scene_cases

FROZEN = Path(__file__).resolve().parents[1] / "frozen"
STRATEGIES = ("auto", "rrp", "grasp-line", "homography")
SCENES = (
    "bracket.clean-6dof", "gasket.noise", "spanner.light", "blob.fast", "rectangle.belt",
    "hook.bar", "bracket.leave", "gasket.exchange", "spanner.twin",
)  # fmt: skip
VIDEOS = ("bruegel-62", "lego-square-99", "postcard-161")
FRAMES = 40
SEED = 17
TOLERANCE = 0.05
"""px by which processors and versions of OpenCV may differ."""
VERBS = (
    "", "track", "live", "demo", "synthesize", "inspect", "transfer", "servo", "evaluate", "evaluate scenes",
    "evaluate real", "evaluate pot", "compare", "cameras", "models", "doctor",
)  # fmt: skip

Rows = list[list[str]]


def machine() -> str:
    """Versions and processor, on which the last digits depend."""
    flags = next((line for line in _lines(Path("/proc/cpuinfo")) if line.startswith("flags")), platform.processor())
    processor = hashlib.sha256(flags.encode()).hexdigest()[:12]
    return f"Python {platform.python_version()}, NumPy {np.__version__}, OpenCV {cv2.__version__}, {processor}"


def _lines(path: Path) -> Iterator[str]:
    if path.exists():
        with path.open() as file:
            yield from file


def sequence_names() -> list[str]:
    """Rendered ones, and real ones where they are."""
    return [*SCENES, *(name for name in VIDEOS if (DATA / "videos" / f"{name}.mp4").exists())]


def images_of(name: str) -> Iterator[tuple[float | None, Any]]:
    """Time in s and image of each frame of a sequence."""
    if name in VIDEOS:
        with gt.open_source(DATA / "videos" / f"{name}.mp4") as source:
            for frame in itertools.islice(source, FRAMES):
                yield frame.time, frame.image
        return
    shape, disturbance = name.split(".")
    (case,) = make_scene_cases(built_in([shape]), [disturbance], frames=FRAMES, seed=SEED)
    for shown in case.scene():
        yield shown.time, shown.image


def grasps_csv(images: Iterable[tuple[float | None, Any]], strategy: str) -> Rows:
    """What `grasptrack track` writes of a sequence, without the latency."""
    tracker = gt.GraspTracker(strategy=strategy)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "grasps.csv"
        table = GraspsCsv(path, tracker.fingers)
        for index, (time, image) in enumerate(images):
            table.write(tracker.update(image, time=time), index, time)
        table.close()
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.reader(file))
    at = rows[0].index("latency_ms")
    return [row[:at] + row[at + 1 :] for row in rows]


def digest(rows: Rows) -> str:
    """Of all cells."""
    return hashlib.sha256(repr(rows).encode()).hexdigest()[:20]


def in_short(rows: Rows) -> list[str]:
    """Status and contacts of each frame, to be read by people and compared on other machines."""
    status, first = rows[0].index("status"), rows[0].index("x1")
    return [
        " ".join([row[status], *(f"{float(cell):.2f}" for cell in row[first : first + 4] if cell)]) for row in rows[1:]
    ]


def all_grasps() -> dict[str, Any]:
    """What is frozen of every sequence and strategy."""
    found: dict[str, Any] = {}
    for name in sequence_names():
        images = list(images_of(name))
        for strategy in STRATEGIES:
            rows = grasps_csv(images, strategy)
            found[f"{name} {strategy}"] = {"digest": digest(rows), "frames": in_short(rows)}
    return found


def differing(kept: list[str], found: list[str]) -> list[int]:
    """Frames of which the status, or a contact by more than the tolerance, differs."""
    if len(kept) != len(found):
        return list(range(max(len(kept), len(found))))
    return [k for k, (a, b) in enumerate(zip(kept, found, strict=True)) if not _alike(a.split(), b.split())]


def _alike(a: list[str], b: list[str]) -> bool:
    if a[0] != b[0] or len(a) != len(b):
        return False
    return all(abs(float(x) - float(y)) <= TOLERANCE for x, y in zip(a[1:], b[1:], strict=True))


def api() -> str:
    """The public API: each name, its parameters with defaults, and the public members of classes."""
    lines = []
    for name in sorted(gt.__all__):
        member = getattr(gt, name)
        lines.append(name + _signature(member))
        if inspect.isclass(member):
            lines += [
                f"    {name}.{key}{_signature(value)}"
                for key, value in sorted(vars(member).items())
                if not key.startswith("_")
            ]
    return "\n".join(lines) + "\n"


def _signature(member: Any) -> str:
    if not callable(member):
        return ""
    try:
        return str(inspect.signature(member))
    except (TypeError, ValueError):
        return "(...)"


def help_pages() -> str:
    """Of every verb, as wide as it is where the width is not known."""
    found = []
    for verb in VERBS:
        command = [sys.executable, "-m", "grasptrack.cli.main", *verb.split(), "--help"]
        told = subprocess.run(command, capture_output=True, text=True, check=True, env={**os.environ, "COLUMNS": "120"})
        found.append(f"## grasptrack {verb}".rstrip() + "\n" + told.stdout)
    return "\n".join(line.rstrip() for line in "\n".join(found).splitlines()) + "\n"


def run_schema() -> list[str]:
    """Keys of run.json with the types of their values."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "images").mkdir()
        for k, (_, image) in enumerate(itertools.islice(images_of(SCENES[0]), 3)):
            cv2.imwrite(str(folder / "images" / f"{k}.png"), image)
        command = [
            sys.executable,
            "-m",
            "grasptrack.cli.main",
            "track",
            str(folder / "images"),
            "--no-video",
            "--quiet",
        ]
        subprocess.run([*command, "--output", str(folder / "out")], check=True)
        told = json.loads((folder / "out" / "run.json").read_text())
    return sorted(_paths(told))


def _paths(value: Any, at: str = "") -> Iterator[str]:
    if isinstance(value, dict):
        for key, member in value.items():
            yield from _paths(member, f"{at}.{key}" if at else key)
    else:
        yield f"{at}: {type(value).__name__}"


TEXTS = {"api.txt": api, "help.txt": help_pages, "run_schema.txt": lambda: "\n".join(run_schema()) + "\n"}
"""What is kept as text, by the name of its file."""


def main() -> int:
    """Tell what differs, or keep what is found; status 1 where anything differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="keep what is found")
    asked = parser.parse_args()
    grasps = all_grasps()
    if asked.write:
        FROZEN.mkdir(exist_ok=True)
        kept = {"machine": machine(), "grasps": grasps}
        (FROZEN / "grasps.json").write_text(json.dumps(kept, indent=1) + "\n")
        for name, make in TEXTS.items():
            (FROZEN / name).write_text(make())
        return 0
    kept = json.loads((FROZEN / "grasps.json").read_text())
    other = [name for name, make in TEXTS.items() if make() != (FROZEN / name).read_text()]
    other += [name for name, found in grasps.items() if found["digest"] != kept["grasps"][name]["digest"]]
    for name in other:
        frames = differing(kept["grasps"][name]["frames"], grasps[name]["frames"]) if name in grasps else []
        print(f"{name} differs" + (f", visibly in frames {frames}" if frames else ""))
    left_out = len(kept["grasps"]) - len(grasps)
    print(
        f"{len(other)} of {len(grasps) + len(TEXTS)} differ"
        + (f", {left_out} left out for want of the real videos" if left_out else "")
        + ("" if kept["machine"] == machine() else ", on another machine")
    )
    return int(bool(other))


if __name__ == "__main__":
    raise SystemExit(main())
