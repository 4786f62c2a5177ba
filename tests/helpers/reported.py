# SPDX-License-Identifier: Apache-2.0
"""Small run folders made up at random: a few parts, disturbances and methods, without a tracker."""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from grasptrack.files import write_json
from grasptrack_bench.metrics.score import FrameScore
from grasptrack_bench.records import read_records, write_records
from grasptrack_bench.run_folder import CASES, FORMAT, INDEX, Case

SHAPES = ("bracket", "blob", "disc", "spanner", "gasket")
DISTURBANCES = {"clean": "motion", "bar": "hidden", "away": "hidden"}
METHODS = ("auto", "ecc", "stranger")
ABOUT: dict[str, Any] = {
    "options": {"methods": list(METHODS), "frames": 30, "seed": 0},
    "versions": {"grasptrack": "0.1.0", "numpy": "2.0"},
    "machine": "a machine, 2 cores",
    "backend": "native",
    "command": "grasptrack evaluate scenes --output here",
    "started": "2026-01-02T03:04:05+00:00",
    "seconds": 123.4,
}


def write_index(path: Path, kind: str, cases: Iterable[Case], **content: Any) -> None:
    """Write `evaluation.json` of a folder, which is made when missing.

    Args:
        path: the folder.
        kind: "scenes" or "real".
        cases: whose frames are, or will be, in `cases/NAME.csv`.
        **content: what else to tell: options, versions, machine, command, started, seconds.
    """
    (path / CASES).mkdir(parents=True, exist_ok=True)
    listed = [{key: getattr(c, key) for key in _TOLD[kind]} for c in cases]
    write_json(path / INDEX, {"format": FORMAT, "kind": kind, **content, "cases": listed})


_TOLD = {
    "scenes": ("name", "frames", "shape", "disturbance", "group", "seed", "error"),
    "real": ("name", "frames", "error"),
}


def made_up(rng: np.random.Generator, disturbance: str, method: str, frames: int = 30) -> list[FrameScore]:
    """A run of one method: errors of its own size, hidden in the middle where the disturbance says so."""
    size = {"auto": 0.1, "ecc": 0.4}.get(method, 1.5)
    run = []
    for i in range(frames):
        hidden = disturbance != "clean" and 10 <= i < 18
        visible = (0.0 if disturbance == "away" else 0.8) if hidden else 1.0
        answered = i == 0 or (rng.random() < (0.5 if hidden else 0.95) and not (method == "auto" and visible == 0.0))
        distances = np.abs(rng.normal(0.0, size, 2)) if i else np.zeros(2)
        run.append(
            FrameScore(
                frame=i,
                status="tracked" if answered else "lost",
                reason="" if answered else f'only {rng.integers(100)} % seen, of <"it"> & more',
                distances=distances if answered else None,
                limit=4.0,
                latency_ms=float(rng.lognormal(1.0, 0.1)),
                defining=i == 0,
                strategy="homography" if answered else "",
                contacts=np.array([[10.0, 20.0], [60.5, 40.25]]) + distances[:, None] if answered else None,
                spread=distances**2 if answered and method == "auto" else None,
                opening=55.0,
                area=1e4,
                visible=visible,
                seen=visible >= 1.0,
                confidence=math.nan if method == "stranger" else float(rng.random()) if answered else 0.0,
            )
        )
    return run


def scenes(folder: Path, seed: int = 0, shapes: Iterable[str] = SHAPES, **about: Any) -> Path:
    """A folder of kind "scenes"."""
    cases = []
    for shape in shapes:
        for disturbance, group in DISTURBANCES.items():
            case = Case(f"{shape}.{disturbance}", 30, shape, disturbance, group, seed)
            cases.append(case)
    write_index(folder, "scenes", cases, **{**ABOUT, **about})
    for k, case in enumerate(cases):
        runs = {m: made_up(np.random.default_rng((seed, k, i)), case.disturbance, m) for i, m in enumerate(METHODS)}
        write_records(folder / CASES / f"{case.name}.csv", runs)
    return folder


def real(folder: Path, videos: Iterable[str] = ("box", "card"), **about: Any) -> Path:
    """A folder of kind "real"."""
    cases = [Case(name, 80, disturbance=name) for name in videos]
    write_index(folder, "real", cases, **{**ABOUT, **about})
    for k, case in enumerate(cases):
        runs = {m: made_up(np.random.default_rng((k, i)), "clean", m, 80) for i, m in enumerate(METHODS)}
        write_records(folder / CASES / f"{case.name}.csv", runs)
    return folder


def changed(
    before: Path, after: Path, method: str, change: Callable[[FrameScore], FrameScore], where: str = ""
) -> Path:
    """A copy of a run in which the frames of one method are changed, in cases whose name holds `where`."""
    (after / CASES).mkdir(parents=True)
    (after / "evaluation.json").write_bytes((before / "evaluation.json").read_bytes())
    for path in (before / CASES).iterdir():
        scores = read_records(path)
        if where in path.stem:
            scores[method] = [f if f.defining else change(f) for f in scores[method]]
        write_records(after / CASES / path.name, scores)
    return after


def lost(f: FrameScore) -> FrameScore:
    """The frame without its contacts."""
    return replace(f, status="lost", reason="gave up", contacts=None, distances=None, spread=None)
