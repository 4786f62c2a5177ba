# SPDX-License-Identifier: Apache-2.0
"""Real videos with reference homographies: every method on the same frames, no parameter touched."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import GraspError, InputError
from grasptrack.evaluation.homographies import read_homographies
from grasptrack.evaluation.method import Start
from grasptrack.evaluation.methods import OURS, makers
from grasptrack.evaluation.score import FrameScore, Score
from grasptrack.evaluation.sequence import Shown, follow
from grasptrack.evaluation.truth import Truth
from grasptrack.io.sources import Frame, open_source
from grasptrack.tracker import GraspTracker

Floats = NDArray[np.float64]

TABLES = (".homographies.csv", ".derived_homographies.csv")
"""What the name of a table ends with, in the place of the video's suffix."""


@dataclass(frozen=True)
class RealCase:
    """One video and its table.

    Attributes:
        video: a video file, or a folder of images.
        table: H_current_reference by frame, reference being frame 0.
        fingers: of the grasp that is chosen in the first frame.
        friction: for choosing it.
    """

    video: Path
    table: Path
    fingers: int = 2
    friction: float = 0.5

    @property
    def name(self) -> str:
        """As in tables and names of files."""
        return self.video.stem


def videos_of(folder: Path, fingers: int = 2, friction: float = 0.5) -> list[RealCase]:
    """The videos and folders of images in a folder that have a table of homographies beside them, by name.

    Raises:
        InputError: no such folder, or none in it.
    """
    if not folder.is_dir():
        raise InputError(f'"{folder}" is no folder', path=str(folder))
    cases = []
    for table in sorted(path for end in TABLES for path in folder.glob(f"*{end}")):
        stem = next(table.name.removesuffix(end) for end in reversed(TABLES) if table.name.endswith(end))
        found = [path for path in sorted(folder.glob(f"{stem}*")) if path.stem == stem and path.suffix != ".csv"]
        cases += [RealCase(path, table, fingers, friction) for path in found[:1]]
    if not cases:
        raise InputError(
            f'no video in "{folder}" has a table of homographies beside it: for film.mp4, film.homographies.csv '
            "with the columns frame, h11 ... h33",
            path=str(folder),
        )
    return cases


def run_video(task: tuple[RealCase, tuple[str, ...]]) -> dict[str, list[FrameScore]]:
    """Scored frames by method of one video.

    The grasp is chosen by the tracker in the first frame and given to all methods.

    Args:
        task: the case, and names of methods.

    Raises:
        InputError: the video or the table cannot be read.
        GraspError: there is no object or no grasp in the first frame.
    """
    case, methods = task
    table = read_homographies(case.table)
    with open_source(case.video) as source:
        frames = iter(source)
        first = next(frames)
        chosen = GraspTracker(fingers=case.fingers, friction=case.friction).update(first.image)
        if chosen.contacts is None or chosen.view is None:
            raise GraspError(f'"{case.video}", first frame: {chosen.reason}')
        outline = tuple(np.asarray(c.points) for c in chosen.view.contours)
        height, width = first.image.shape[:2]
        area = chosen.view.outer.area - sum(c.area for c in chosen.view.contours[1:])
        shown = _shown(first, frames, table, area, outline[0].mean(axis=0))
        return follow(shown, makers(methods), Start(chosen.contacts, outline, (width, height)))


def score_video(video: Path, table: Path, methods: Sequence[str] = OURS) -> list[Score]:
    """Score methods on a video and its table of reference homographies.

    Raises:
        InputError, GraspError: as in `run_video`.
    """
    scored = run_video((RealCase(video, table), tuple(methods)))
    return [Score(name, frames) for name, frames in scored.items()]


def _shown(
    first: Frame, rest: Iterator[Frame], table: Mapping[int, Floats], area: float, centre: Floats
) -> Iterator[Shown]:
    """The frames with their truths; `area` px^2 and `centre` (2,) px of the object in the first."""
    for frame in _all(first, rest):
        H = table.get(frame.index)
        truth = None if H is None else Truth.of_homography(H)
        if truth is not None:
            growth = truth.growth(centre)
            truth = Truth.of_homography(table[frame.index], area * growth if math.isfinite(growth) else None)
        yield Shown(frame.image, frame.time, truth)


def _all(first: Frame, rest: Iterator[Frame]) -> Iterator[Frame]:
    yield first
    yield from rest
