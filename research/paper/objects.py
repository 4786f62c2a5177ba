# SPDX-License-Identifier: Apache-2.0
"""What Section V asks of the three objects: contours, transfers, there and back, correspondences; Tables I to VII."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from grasptrack.images import Grey
from grasptrack.typing import Progress
from grasptrack_bench.report.table import Table
from research.paper.correspondences import (
    Correspondences,
    RefusedPair,
    find_correspondences,
    find_literal_correspondences,
    table_five,
    table_two,
)
from research.paper.descriptions import table_four, table_one, table_three
from research.paper.error_tables import at_a_glance, table_seven, table_six
from research.paper.footage import (
    IN_IMAGES,
    KINDS,
    MOTIONS,
    OBJECTS,
    FilmedPart,
    Footage,
    Images,
    ideal_footage,
    make_part,
    middle_frame,
    rendered_footage,
)
from research.paper.transfers import COMPARED, Course, Return, transfer_and_measure, transfer_and_return, ways_of


@dataclass(frozen=True)
class ObjectRuns:
    """All that Tables I to VII are made of.

    Attributes:
        parts: the three objects.
        footage: each along every trajectory, as every kind of contours.
        images: the first image of the rendered footage and that of `frame`, by object and motion.
        frame: of the reference error, and the second view of every pair.
        courses: every transfer along all of it, in every way.
        returns: there and back.
        pairs: correspondences of the rendered views of 6 DoF, ours and then to the letter, or why there are none.
    """

    parts: tuple[FilmedPart, ...]
    footage: tuple[Footage, ...]
    images: Images
    frame: int
    courses: tuple[Course, ...]
    returns: tuple[Return, ...]
    pairs: tuple[Correspondences | RefusedPair, ...]

    @property
    def examples(self) -> list[Footage]:
        """Footage of 4 DoF of which Tables III and IV show a pair of views."""
        return [f for f in self.footage if f.motion == "4 DoF" and f.kind in ("resampled", "rendered")]


def run_objects(frames: int, seed: int, progress: Progress | None = None) -> ObjectRuns:
    """Film the three objects and transfer their grasps."""
    parts = [make_part(name, seed) for name in OBJECTS]
    footage, images = _all_footage(parts, frames, seed, progress)
    tick = Ticker(progress, "transfers", sum(len(ways_of(s)) for s in COMPARED) * len(footage))
    courses = []
    for f in footage:
        for strategy in COMPARED:
            for way in ways_of(strategy):
                courses.append(transfer_and_measure(f, strategy, way))
                tick()
    half = middle_frame(frames)
    returns = [transfer_and_return(f, strategy, half) for f in footage for strategy in COMPARED]
    pairs = [
        (f.part.name, transfer, found) if isinstance(found, str) else found
        for f in footage
        if f.motion == "6 DoF" and f.kind == "rendered"
        for transfer, found in (
            ("ours", find_correspondences(f, half)),
            ("to the letter", find_literal_correspondences(f, half)),
        )
    ]
    return ObjectRuns(tuple(parts), tuple(footage), images, half, tuple(courses), tuple(returns), tuple(pairs))


def tables_of_objects(told: ObjectRuns) -> list[Table]:
    """Tables I to VII, one VI for each motion, one VII for each motion and kind of contours, and VII at a glance."""
    half = told.frame
    return [
        table_one(told.parts),
        table_two(told.pairs),
        table_three(told.examples, half),
        table_four(told.examples, half),
        table_five(told.pairs),
        *(table_six(n, [r for r in told.returns if r.footage.motion == m]) for n, m in enumerate(MOTIONS, start=1)),
        at_a_glance(told.courses),
        *_tables_seven(told.courses, half),
    ]


def _all_footage(
    parts: Sequence[FilmedPart], frames: int, seed: int, progress: Progress | None
) -> tuple[list[Footage], Images]:
    """All contours of the three objects, and the images of which there are pictures."""
    tick = Ticker(progress, "images", len(parts) * len(IN_IMAGES) * frames)
    footage: list[Footage] = []
    images: dict[tuple[str, str], list[Grey]] = {}
    for motion in MOTIONS:
        for kind in KINDS:
            for p in parts:
                if kind != "rendered":
                    footage.append(ideal_footage(p, kind, motion, frames, seed))
                elif motion in IN_IMAGES:
                    seen, images[p.name, motion] = rendered_footage(p, motion, frames, seed, tick)
                    footage.append(seen)
    return footage, images


def _tables_seven(courses: Sequence[Course], half: int) -> list[Table]:
    """One table VII for each motion and kind of contours."""
    groups: dict[tuple[str, str], list[Course]] = {}
    for c in courses:
        groups.setdefault((c.footage.motion, c.footage.kind), []).append(c)
    return [table_seven(number, group, half) for number, group in enumerate(groups.values(), start=1)]


class Ticker:
    """Counts the steps done and tells of them."""

    def __init__(self, progress: Progress | None, step: str, total: int) -> None:
        self._progress, self._step, self._total, self._done = progress, step, total, 0

    def __call__(self) -> None:
        """Another step is done."""
        self._done += 1
        if self._progress is not None:
            self._progress(self._step, self._done, self._total)
