# SPDX-License-Identifier: Apache-2.0
"""Real videos against their reference homographies, no parameter touched; and a hand that covers a part."""

from __future__ import annotations

import common

# isort: split
import os
import tempfile
from pathlib import Path

import cv2
import numpy as np

from grasptrack import GraspTracker, open_source
from grasptrack.bench.methods import OURS
from grasptrack.bench.real import score_video

VIDEOS = ("postcard-161", "bruegel-62")
STILL = 55  # frames of lego-square-99 before the hand comes


def data_folder() -> Path:
    """Where the videos lie: GRASPTRACK_DATA, or ../shared/data beside the repository."""
    given = os.environ.get("GRASPTRACK_DATA")
    return Path(given) if given else Path(__file__).resolve().parents[2] / "shared" / "data"


def table_of(name: str, folder: Path) -> None:
    """One row for each strategy."""
    rows, reasons = [], []
    for score in score_video(folder / f"{name}.mp4", folder / f"{name}.derived_homographies.csv"):
        errors = [score.error_percentile(p) for p in (50, 95, 100)]
        shares = [100.0 * score.share("tracked"), 100.0 * score.located]
        times = [score.latency_percentile(50), score.latency_percentile(99)]
        rows.append([score.name, *shares, *errors, score.false_accepts, *times])
        reasons += [[score.name, count, reason] for reason, count in score.reasons("lost", "searching", "unstable")[:4]]
    common.say(f"{name}.")
    head = ["strategy", "tracked %", "located %", "median px", "95 %", "max px", "false accepts", "median ms", "p99 ms"]
    common.table(head, rows)
    if reasons:
        common.table(["strategy", "frames", "reason"], reasons)


def covered_part(video: Path, output: Path) -> None:
    """Tracks the part that a hand pushes from frame 55 on; writes pictures of the answers to look at."""
    frames = list(open_source(video))
    rows = []
    for strategy in OURS:
        tracker, first, still, answers, tiles = GraspTracker(strategy=strategy), None, 0.0, [], []
        for frame in frames:
            result = tracker.update(frame.image, time=frame.time)
            if result.contacts is not None:
                first = result.contacts if first is None else first
                if frame.index < STILL:
                    still = max(still, float(np.hypot(*(result.contacts - first).T).max()))
                elif result.status == "tracked":
                    answers.append(frame.index)
            if frame.index >= STILL - 3 and frame.index % 3 == 0:
                tiles.append(tile(frame.image, f"{frame.index} {result.status}", result.contacts))
        sheet = output / f"lego-square-{strategy}.png"
        blank = [np.zeros_like(tiles[0])] * (-len(tiles) % 5)
        tiles += blank
        cv2.imwrite(str(sheet), np.vstack([np.hstack(tiles[i : i + 5]) for i in range(0, len(tiles), 5)]))
        rows.append([strategy, still, len(answers), spans(answers), sheet.name])
    common.say(f"lego-square-99: {STILL} frames at rest, then a hand covers and pushes the part.")
    common.table(["strategy", "moved at rest px", "tracked after", "frames", "pictures"], rows)


def tile(image: np.ndarray, label: str, contacts: np.ndarray | None) -> np.ndarray:
    """Half the image with the answer drawn."""
    shown = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy()
    if contacts is not None:
        cv2.polylines(shown, [np.rint(contacts).astype(np.int32)], False, (0, 220, 255), 1, cv2.LINE_AA)
        for x, y in np.rint(contacts).astype(int).tolist():
            cv2.circle(shown, (x, y), 5, (0, 0, 255), -1, cv2.LINE_AA)
    cv2.putText(shown, label, (10, 34), cv2.FONT_HERSHEY_SIMPLEX, 1.0, (255, 255, 255), 2, cv2.LINE_AA)
    return cv2.resize(shown, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)


def spans(frames: list[int]) -> str:
    """Numbers as ranges: 55-60 63."""
    parts: list[list[int]] = []
    for f in frames:
        if parts and f == parts[-1][1] + 1:
            parts[-1][1] = f
        else:
            parts.append([f, f])
    return " ".join(f"{a}-{b}" if b > a else str(a) for a, b in parts)


def main() -> None:
    parser = common.parser(__doc__)
    parser.add_argument("--data", type=Path, default=data_folder(), help="folder with videos/")
    parser.add_argument("--pictures", type=Path, help="folder for pictures; a temporary one where not given")
    args = parser.parse_args()
    folder = args.data / "videos"
    if not folder.is_dir():
        raise SystemExit(f"no videos in {folder}: give --data or set GRASPTRACK_DATA")
    output = args.pictures or Path(tempfile.mkdtemp(prefix="grasptrack-"))
    output.mkdir(parents=True, exist_ok=True)
    common.heading("Real videos")
    common.say("Contacts against reference homographies, each contact for itself.")
    for name in VIDEOS:
        table_of(name, folder)
    covered_part(folder / "lego-square-99.mp4", output)
    print(f"pictures in {output}")
    common.finish(args.output)


if __name__ == "__main__":
    main()
