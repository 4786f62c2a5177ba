# SPDX-License-Identifier: Apache-2.0
"""Scored frames, made up at random or of a scene; and tables of homographies as users would write them."""

import csv
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from grasptrack_bench.metrics.score import FrameScore
from grasptrack_bench.scenes import built_in, make_scene_cases, parts_from_silhouettes, run_case


def frame(
    index: int,
    error: float | None = None,
    *,
    present: bool = True,
    visible: float = 1.0,
    confidence: float = 0.9,
    defining: bool = False,
    reason: str = "",
) -> FrameScore:
    """One frame with two contacts, both off by `error` px; None gives no contacts."""
    given = error is not None
    return FrameScore(
        frame=index,
        status="tracked" if given else "lost",
        reason=reason if given else (reason or "covered"),
        distances=np.full(2, error) if given else None,
        limit=4.0,
        latency_ms=2.0 + 0.01 * index,
        defining=defining,
        strategy="homography" if given else "",
        contacts=np.array([[10.0, 20.0], [30.5, 40.25]]) if given else None,
        spread=np.array([0.5, 7.0]) if given else None,
        opening=50.0,
        area=10000.0,
        present=present,
        visible=visible,
        seen=visible >= 1.0,
        confidence=confidence if given else 0.0,
        alignment=math.inf if error is None else 2.0 * error,
    )


def random_run(rng: np.random.Generator, frames: int = 60) -> list[FrameScore]:
    """A run in which anything may happen."""
    run = [frame(0, 0.0, defining=True)]
    for i in range(1, frames):
        answered = rng.random() < 0.8
        run.append(
            frame(
                i,
                float(rng.exponential(1.5)) if answered else None,
                present=bool(rng.random() < 0.9),
                visible=float(rng.choice([0.0, 0.5, 0.8, 1.0])),
                confidence=float(rng.choice([math.nan, 0.25, rng.random()])),
                reason="" if answered else f'only {rng.integers(100)} % seen, of "it"',
            )
        )
    return run


def never_wrong(shape: str, disturbance: str, repeat: int = 0, **scenes: int) -> list[FrameScore]:
    """What `auto` makes of a rendered scene, one of its repeats, in which no contacts are wrong.

    A shape is built in, or a file of a silhouette.
    """
    parts = parts_from_silhouettes(shape) if Path(shape).is_file() else built_in([shape])
    case = make_scene_cases(parts, [disturbance], repeats=repeat + 1, **scenes)[repeat]
    frames = run_case((case, ("auto",)))["auto"]
    assert [f.frame for f in frames if f.is_false_accept] == []
    return frames


def write_homographies(path: Path, table: Mapping[int, np.ndarray]) -> None:
    """What `read_homographies` reads, digits and all: H_current_reference (3, 3) by frame, and a column that it passes over."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["frame", *(f"h{row}{column}" for row in "123" for column in "123"), "visible"])
        writer.writerows([frame, *(repr(float(h)) for h in H.ravel()), "0.5"] for frame, H in sorted(table.items()))
