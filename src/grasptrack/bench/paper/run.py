# SPDX-License-Identifier: Apache-2.0
"""All tables of Section V in one run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.metrics.errors import ErrorMeasure
from grasptrack.bench.paper import contexts
from grasptrack.bench.paper.contours import KINDS, Footage, ideal_footage
from grasptrack.bench.paper.correspondences import Correspondences, find_correspondences, table_five, table_two
from grasptrack.bench.paper.descriptions import table_four, table_one, table_three
from grasptrack.bench.paper.error_tables import at_a_glance, table_seven, table_six
from grasptrack.bench.paper.images import middle_frame, rendered_footage
from grasptrack.bench.paper.objects import MOTIONS, OBJECTS, make_part
from grasptrack.bench.paper.pictures import table_pictures
from grasptrack.bench.paper.printed import STRATEGIES
from grasptrack.bench.paper.transfers import Course, transfer_and_measure
from grasptrack.bench.report.table import Table
from grasptrack.errors import InputError

Progress = Callable[[str, int, int], None]
"""Called with the name of the step, how much of it is done, and how much there is."""
Picture = tuple[str, NDArray[np.uint8]]
"""A caption and a BGR image."""

LEAST_FRAMES = 4


@dataclass(frozen=True, slots=True)
class Series:
    """The errors of one strategy on one object along one trajectory, for a figure.

    Attributes:
        object: its name.
        strategy: its name.
        kind: how the contours came about, see `contours.KINDS`.
        motion: "4 DoF" or "6 DoF".
        carried_on: from each frame to the next, else from the first view to each frame.
        average_px, maximum_px: by frame from frame 1 on; None where the strategy refused.
        reasons: by frame; empty where it answered.
    """

    object: str
    strategy: str
    kind: str
    motion: str
    carried_on: bool
    average_px: tuple[float | None, ...]
    maximum_px: tuple[float | None, ...]
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class PaperRun:
    """What a run gives.

    Attributes:
        frames, seed: as asked for.
        tables: in the order in which they are to be read.
        series: by object, motion, contours, strategy.
        pictures: captions and BGR images (H, W, 3).
    """

    frames: int
    seed: int
    tables: tuple[Table, ...]
    series: tuple[Series, ...]
    pictures: tuple[Picture, ...]


def run_paper(*, frames: int = 100, seed: int = 0, progress: Progress | None = None) -> PaperRun:
    """Rerun Tables I to VII of the paper on three objects; the same arguments give the same run.

    The strategies are the paper's own, without the tracker's judgement: what they refuse they refuse themselves.

    Args:
        frames: of each trajectory, at least 4; the reference error is that of the frame in the middle.
        seed: of trajectories, textures, noise and the starts of contours.
        progress: see `Progress`.

    Raises:
        InputError: too few frames.
        ObservationError: an object has no grasp that every strategy can describe, or is not found in its first image.
    """
    if frames < LEAST_FRAMES:
        raise InputError(f"the paper's tables need at least {LEAST_FRAMES} frames, not {frames}", frames=frames)
    parts = [make_part(name, seed) for name in OBJECTS]
    tick = _Ticker(progress, "images", len(parts) * len(MOTIONS) * frames)
    footage: list[Footage] = []
    images: dict[tuple[str, str], list[NDArray[np.uint8]]] = {}
    for motion in MOTIONS:
        for kind in KINDS:
            for p in parts:
                if kind == "rendered":
                    seen, images[p.name, motion] = rendered_footage(p, motion, frames, seed, tick)
                    footage.append(seen)
                else:
                    footage.append(ideal_footage(p, kind, motion, frames, seed))
    tell = _Ticker(progress, "transfers", len(footage) * len(STRATEGIES) * 2)
    courses = []
    for f in footage:
        for strategy in STRATEGIES:
            for carried_on in (False, True):
                courses.append(transfer_and_measure(f, strategy, carried_on))
                tell()
    scenes = _Ticker(progress, "contexts", 2 * contexts.FRAMES)
    half = middle_frame(frames)
    examples = [f for f in footage if f.motion == "4 DoF" and f.kind in ("resampled", "rendered")]
    tilted = [f for f in footage if f.motion == "6 DoF" and f.kind == "rendered"]
    found = [_name_if_refused(f, find_correspondences(f, half)) for f in tilted]
    tables = [
        table_one(parts),
        table_two(found),
        table_three(examples, half),
        table_four(examples, half),
        table_five(found),
        *(table_six(footage, half, motion) for motion in MOTIONS),
        at_a_glance(courses),
        *_tables_by_setting(courses, half),
        contexts.table_of_contexts(courses, parts[0], seed, scenes),
    ]
    series = tuple(_course_series(c) for c in courses)
    return PaperRun(frames, seed, tuple(tables), series, tuple(table_pictures(examples, tilted, found, images, half)))


def _tables_by_setting(courses: list[Course], half: int) -> list[Table]:
    """One table VII for each motion and kind of contours."""
    groups: dict[tuple[str, str], list[Course]] = {}
    for c in courses:
        groups.setdefault((c.footage.motion, c.footage.kind), []).append(c)
    return [table_seven(number, group, half) for number, group in enumerate(groups.values(), start=1)]


def _name_if_refused(footage: Footage, found: Correspondences | str) -> Correspondences | tuple[str, str]:
    return (footage.part.name, found) if isinstance(found, str) else found


def _course_series(c: Course) -> Series:
    answered = [e if isinstance(e, ErrorMeasure) else None for e in c.errors]
    return Series(
        c.footage.part.name,
        c.strategy,
        c.footage.kind,
        c.footage.motion,
        c.carried_on,
        tuple(None if e is None else e.average_px for e in answered),
        tuple(None if e is None else e.maximum_px for e in answered),
        tuple(e if isinstance(e, str) else "" for e in c.errors),
    )


class _Ticker:
    """Counts the steps done and tells of them."""

    def __init__(self, progress: Progress | None, step: str, total: int) -> None:
        self._progress, self._step, self._total, self._done = progress, step, total, 0

    def __call__(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(self._step, self._done, self._total)
