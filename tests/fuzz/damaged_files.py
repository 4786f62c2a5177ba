# SPDX-License-Identifier: Apache-2.0
"""Damaged files: bits flipped, pieces cut, doubled or spliced, numbers replaced. Asked is one line, status 0 or 2.

Images, videos, masks and calibrations go through the command line; tables and indices of evaluations through what reads
them, as the commands that do so would take seconds for each.

    python tests/fuzz/damaged_files.py --seconds 600 --seed 1

The same seed damages alike.
"""

import contextlib
import io
import json
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

import harness
from grasptrack.cli.main import main as command_line
from grasptrack.errors import InputError
from grasptrack.io.base import Frame
from grasptrack.io.recording import open_recording
from grasptrack.io.video import VideoWriter
from grasptrack.tracking.result import TrackResult
from grasptrack_bench.metrics.score import FrameScore
from grasptrack_bench.real import RealCase, Truths, read_scenes, videos_of
from grasptrack_bench.records import read_homographies, read_records, write_records
from grasptrack_bench.run_folder import read_run
from harness import Finding
from scores import write_homographies

IMAGES = (".png", ".jpg", ".bmp", ".tif", ".pgm")
VIDEOS = (".mp4", ".avi", ".mkv")
BAGS = (".bag", ".mcap")
LENSES = {
    "ros.yaml": "image_width: 160\nimage_height: 120\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
    "  data: [180, 0, 80, 0, 180, 60, 0, 0, 1]\ndistortion_model: plumb_bob\n"
    "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.1, 0.01, 0, 0, 0]\n",
    "opencv.yml": "%YAML:1.0\n---\nimage_width: 160\nimage_height: 120\ncamera_matrix: !!opencv-matrix\n   rows: 3\n"
    "   cols: 3\n   dt: d\n   data: [ 180., 0., 80., 0., 180., 60., 0., 0., 1. ]\n"
    "distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.1, 0.01, 0., 0., 0. ]\n",
    "kalibr.yaml": "cam0:\n  camera_model: pinhole\n  intrinsics: [180.0, 180.0, 80.0, 60.0]\n  distortion_model: radtan\n"
    "  distortion_coeffs: [-0.1, 0.01, 0.0, 0.0]\n  resolution: [160, 120]\n",
    "lens.json": json.dumps(
        {"K": [180, 0, 80, 0, 180, 60, 0, 0, 1], "D": [-0.1, 0.01, 0, 0], "width": 160, "height": 120}
    ),
}
TABLE, SCENES, INDEX, SCORES = "film.homographies.csv", "scenes.csv", "evaluation.json", "bracket-noise-0.csv"
ODD = (*b'nan inf -1e999 1e308 1e-320 0 -1 \xff " \0 null true'.split(b" "), b"9" * 5000, b"[" * 5000)
"""What a number of a text is replaced by."""
NUMBER = re.compile(rb"-?\d+(\.\d+)?")


def whole_files(folder: Path) -> list[Path]:
    """Files of all kinds as they should be, in a folder."""
    at = np.array([[40, 30], [115, 35], [112, 62], [70, 60], [68, 92], [37, 90]], np.int32)
    frames: list[NDArray[np.uint8]] = []
    for k in range(4):
        frame = np.full((120, 160, 3), 200, np.uint8)
        cv2.fillPoly(frame, [at + np.array([2 * k, k], np.int32)], (60, 70, 80), cv2.LINE_AA)
        frames.append(np.asarray(cv2.GaussianBlur(frame, (0, 0), 0.8), dtype=np.uint8))
    files = []
    for suffix in IMAGES:
        files.append(folder / f"whole{suffix}")
        cv2.imwrite(str(files[-1]), frames[0][:, :, 0] if suffix == ".pgm" else frames[0])
    for suffix in VIDEOS:
        files.append(folder / f"whole{suffix}")
        writer = VideoWriter(files[-1])
        for frame in frames:
            writer.write(frame)
        writer.close()
    for suffix, write in zip(BAGS, (write_ros_bag, write_recording), strict=True):
        files.append(folder / f"whole{suffix}")
        write(files[-1], frames)
    for name, text in LENSES.items():
        files.append(folder / name)
        files[-1].write_text(text)
    files += _evaluated_files(folder)
    mask = np.zeros((120, 160), np.uint8)
    cv2.fillPoly(mask, [at], 255)
    files.append(folder / "mask.png")
    cv2.imwrite(str(files[-1]), mask)
    return files


def _evaluated_files(folder: Path) -> list[Path]:
    """Tables and the index of an evaluation."""
    truths = {k: np.array([[1.0, 0.01 * k, 2.0 * k], [-0.01 * k, 1.0, k], [1e-5 * k, 0.0, 1.0]]) for k in range(4)}
    write_homographies(folder / TABLE, truths)
    (folder / SCENES).write_text('name,object,quad\nfilm,"80,60","40,30 115,35 112,62 37,90"\n')
    case = {
        "name": Path(SCORES).stem,
        "frames": 12,
        "shape": "bracket",
        "disturbance": "noise",
        "group": "image",
        "seed": 3,
    }
    index = {"format": 1, "kind": "scenes", "options": {"methods": ["auto"]}, "ended": "finished", "cases": [case]}
    (folder / INDEX).write_text(json.dumps(index, indent=2))
    contacts = np.array([[10.0, 20.0], [30.5, 40.25]])
    tracked = [FrameScore(k, "tracked", "", np.full(2, 0.1 * k), 4.0, 2.0, contacts=contacts) for k in range(11)]
    lost = FrameScore(11, "lost", 'only 40 % seen, of "it"', None, 4.0, 2.5)
    write_records(folder / SCORES, {"auto": [*tracked, lost], "klt": tracked})
    return [folder / name for name in (TABLE, SCENES, INDEX, SCORES)]


def write_ros_bag(path: Path, frames: list[NDArray[np.uint8]]) -> None:
    """A bag of ROS 1 with compressed images."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    name = "sensor_msgs/msg/CompressedImage"
    with Writer(path) as writer:
        connection = writer.add_connection("/image", name, typestore=store)
        for k, frame in enumerate(frames):
            time = store.types["builtin_interfaces/msg/Time"](sec=1, nanosec=40_000_000 * k)
            header = store.types["std_msgs/msg/Header"](seq=k, stamp=time, frame_id="")
            message = store.types[name](header=header, format="png", data=cv2.imencode(".png", frame)[1].ravel())
            writer.write(connection, 10**9 + 40_000_000 * k, store.serialize_ros1(message, name))


def write_recording(path: Path, frames: list[NDArray[np.uint8]]) -> None:
    """A recording as `--record` writes it."""
    recording = open_recording(path)
    for k, frame in enumerate(frames):
        recording.write(Frame(k, 0.04 * k, frame, "x"), TrackResult(k, 0.04 * k, "searching", "no object"))
    recording.close()


def damaged(data: bytes, rng: np.random.Generator, others: list[bytes]) -> bytes:
    """A file's bytes with one to four kinds of damage."""
    for _ in range(int(rng.integers(1, 5))):
        size = len(data)
        if size < 2:
            break
        first, last = sorted(int(i) for i in rng.integers(0, size, 2))
        numbers = list(NUMBER.finditer(data)) if data.isascii() else []
        match int(rng.integers(0, 12 if numbers else 6)):
            case 0:  # bits, most often in the header
                at = int(rng.integers(0, min(size, 64) if rng.random() < 0.5 else size))
                data = data[:at] + bytes([data[at] ^ (1 << int(rng.integers(0, 8)))]) + data[at + 1 :]
            case 1:
                data = data[: last or 1]
            case 2:
                data = data[:first] + data[last:]
            case 3:
                data = data[:last] + data[first:]
            case 4:
                data = data[:first] + bytes(rng.integers(0, 256, min(last - first, 16), dtype=np.uint8)) + data[last:]
            case k if k > 5:
                one = numbers[int(rng.integers(0, len(numbers)))]
                data = data[: one.start()] + ODD[int(rng.integers(0, len(ODD)))] + data[one.end() :]
            case _:
                other = others[int(rng.integers(0, len(others)))]
                data = data[:first] + other[int(rng.integers(0, len(other))) :]
    return data


def commands(file: Path, folder: Path, rng: np.random.Generator) -> tuple[str, ...]:
    """A command that reads a damaged file."""
    out, image = str(folder / "out"), str(folder / "whole.png")
    if file.name in LENSES:
        return "synthesize", image, "--camera", str(file), "--output", out
    if file.suffix in VIDEOS + BAGS:
        return "track", str(file), "--no-video", "--output", out
    if file.stem == "mask":
        return "synthesize", image, str(rng.choice(["--mask", "--ignore", "--background"])), str(file), "--output", out
    return "synthesize", str(file), "--output", out


def called(arguments: tuple[str, ...]) -> tuple[int, str]:
    """Exit status of a command, and what it said on stderr."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        status = command_line([*arguments, "--quiet"])
    return status, said.getvalue()


def _read_table(file: Path) -> None:
    read_homographies(file)
    truths = RealCase(file.with_name("film.mp4"), file).truths((160, 120))
    for frame in range(5):
        truths.of(frame)


def _read_scenes(file: Path) -> None:
    for name in (TABLE, "whole.mp4"):
        shutil.copy(file.parents[1] / name, file.with_name(name.replace("whole", "film")))
    table = {k: np.eye(3) for k in range(3)}
    for known in read_scenes(file).values():
        Truths(table, known, (160, 120)).of(1)
    videos_of(file.parent)


def _read_index(file: Path) -> None:
    run = read_run(file.parent)
    assert run.factor and run.methods is not None and run.failed is not None


READERS: dict[str, Callable[[Path], object]] = {
    TABLE: _read_table,
    SCENES: _read_scenes,
    INDEX: _read_index,
    SCORES: read_records,
}


def read(file: Path) -> tuple[int, str]:
    """As a command that reads such a file would end."""
    try:
        READERS[file.name](file)
    except InputError as error:
        return 2, f"grasptrack: {' '.join(str(error).split())}\n"
    except Exception as error:
        return 1, f"{type(error).__name__}: {error}\n"
    return 0, ""


def fuzz(folder: Path, seed: int) -> Iterator[tuple[str, Finding | None]]:
    """Damaged files without end, and what was found with each; the same seed gives the same."""
    files = whole_files(folder)
    contents = [file.read_bytes() for file in files]
    case = 0
    while True:
        rng = np.random.default_rng((seed, case))
        kind = int(rng.integers(0, len(files)))
        file = folder / files[kind].name.replace(".", "-") / files[kind].name
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(damaged(contents[kind], rng, contents))
        if file.name in READERS:
            command: tuple[str, ...] = ("read", file.name)
            status, said = read(file)
        else:
            command = commands(file, folder, rng)
            status, said = called(command)
        lines = said.count("\n")
        good = (status == 0 and lines == 0) or (status == 2 and lines == 1 and said.startswith("grasptrack: "))
        kind_of = file.suffix[1:] if file.stem == "whole" else file.name
        yield kind_of, None if good else Finding(case, " ".join(command[:2]), f"status {status}: {said!r}")
        case += 1


def main() -> int:
    """Fuzz for a while, print counts and findings; status 1 where there is a finding."""
    asked = harness.options(__doc__, count=(10**9, "files at most"))
    with tempfile.TemporaryDirectory() as folder:
        return harness.tell(fuzz(Path(folder), asked.seed), asked, "damaged files")


if __name__ == "__main__":
    raise SystemExit(main())
