# SPDX-License-Identifier: Apache-2.0
"""All tables of Section V in one run, with their pictures, and the folder that holds them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.bench import Progress
from grasptrack.bench.metrics.errors import ErrorMeasure
from grasptrack.bench.paper import error_tables
from grasptrack.bench.paper.correspondences import Correspondences, find_correspondences, table_five, table_two
from grasptrack.bench.paper.descriptions import table_four, table_one, table_three
from grasptrack.bench.paper.error_tables import at_a_glance, table_of_contexts, table_seven, table_six
from grasptrack.bench.paper.footage import (
    KINDS,
    MOTIONS,
    OBJECTS,
    Footage,
    ideal_footage,
    make_part,
    middle_frame,
    rendered_footage,
)
from grasptrack.bench.paper.printed import STRATEGIES
from grasptrack.bench.paper.transfers import Course, Refused, transfer_and_measure
from grasptrack.bench.report.paper_page import paper_report
from grasptrack.bench.report.table import Table, to_csv, to_json, to_markdown, to_text
from grasptrack.errors import InputError
from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import Grasp
from grasptrack.io.results import describe_machine, software_versions, write_json
from grasptrack.transfer import grasp_line, transfer
from grasptrack.transfer.rrp import INTERPOLATED
from grasptrack.typing import Floats
from grasptrack.view.paper import Panel, draw_panels

Picture = tuple[str, NDArray[np.uint8]]
"""A caption and a BGR image."""

LEAST_FRAMES = 4


@dataclass(frozen=True, slots=True)
class Series:
    """The errors of one strategy on one object along one trajectory, for a figure.

    Attributes:
        object: its name.
        strategy: its name.
        kind: how the contours came about, see `footage.KINDS`.
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
    scenes = _Ticker(progress, "contexts", 2 * error_tables.CONTEXT_FRAMES)
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
        table_of_contexts(courses, parts[0], seed, scenes),
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


Images = Mapping[tuple[str, str], list[NDArray[np.uint8]]]


def table_pictures(
    examples: Sequence[Footage],
    tilted: Sequence[Footage],
    found: Sequence[Correspondences | tuple[str, str]],
    images: Images,
    frame: int,
) -> Iterator[Picture]:
    """Captions and pictures.

    Args:
        examples: footage of 4 DoF for Tables III and IV; what is not rendered is left out.
        tilted: rendered footage of 6 DoF, one for each of `found`.
        found: the pairs of Tables II and V.
        images: the first image and that of `frame`, by object and motion.
        frame: of the second view.
    """
    pairs = [(f, c) for f, c in zip(tilted, found, strict=True) if isinstance(c, Correspondences)]
    for f, c in pairs:
        yield _correspondence_picture(f, c, images[f.part.name, f.motion])
    for strategy, drawn in (("rrp", _tracked_panel), ("grasp-line", _grasp_line_panel)):
        for f in examples:
            first, second = f.outlines(strategy)[0], f.outlines(strategy)[frame]
            if f.kind != "rendered" or not isinstance(first, View) or not isinstance(second, View):
                continue
            try:
                moved = transfer(Grasp(f.contacts(strategy)), first, second, strategy).grasp.contacts
            except Refused:
                continue
            panels = [
                drawn(images[f.part.name, f.motion][0], "frame 0", first, f.contacts(strategy)),
                drawn(images[f.part.name, f.motion][1], f"frame {frame}", second, moved, f.truth(strategy, frame)),
            ]
            yield _CAPTIONS[strategy].format(f.part.name), draw_panels(panels)
    for f, c in pairs:
        yield _refinement_picture(f, c, images[f.part.name, f.motion])


_CAPTIONS = {
    "rrp": "Table III, {}: the outline that the snake moved, its reference points, the grasp, true places crossed",
    "grasp-line": "Table IV, {}: the grasp line beside the axis I_min through the centroid, true places crossed",
}


def _correspondence_picture(f: Footage, c: Correspondences, images: Sequence[NDArray[np.uint8]]) -> Picture:
    panels = [
        Panel(image, title, _contour_points(view), points=points, curve=curve, marks=marks)
        for image, title, view, points, curve, marks in zip(
            images,
            ("frame 0: selected points", f"frame {c.frame}: correspondences"),
            (c.first, c.second),
            c.points,
            c.curvature,
            c.samples,
            strict=True,
        )
    ]
    caption = f"Table II, {f.part.name}: selected points and their correspondences, with the curvature of both contours"
    return caption, draw_panels(panels, "curvature along the outer contour, from its first point")


def _refinement_picture(f: Footage, c: Correspondences, images: Sequence[NDArray[np.uint8]]) -> Picture:
    truth = f.truth("homography", c.frame)
    panels = [
        Panel(images[0], "frame 0: the grasp and the selected points", _contour_points(c.first), c.points[0]),
        Panel(images[1], f"frame {c.frame}: H applied (rings), refined", _contour_points(c.second), c.points[1]),
    ]
    grasps = (f.on_silhouette, None, None), (c.refined, c.applied, truth)
    drawn = [
        Panel(p.image, p.title, p.outlines, p.points, before=before, contacts=contacts, truth=true)
        for p, (contacts, before, true) in zip(panels, grasps, strict=True)
    ]
    return f"Table V, {f.part.name}: the homography applied and refined, true places crossed", draw_panels(drawn)


def _tracked_panel(
    image: NDArray[np.uint8], title: str, view: View, contacts: Floats, truth: Floats | None = None
) -> Panel:
    dots = np.concatenate([c.points[::INTERPOLATED] for c in view.contours])
    return Panel(image, title, _contour_points(view), contacts=contacts, truth=truth, dots=dots)


def _grasp_line_panel(
    image: NDArray[np.uint8], title: str, view: View, contacts: Floats, truth: Floats | None = None
) -> Panel:
    described = grasp_line.describe(Grasp(contacts), view)
    area, *_ = kernels.polygon_moments(view.points, view.offsets)
    axis = (*described.centroid, described.theta, 1.1 * math.sqrt(area))
    return Panel(image, title, _contour_points(view), contacts=contacts, truth=truth, axis=axis)


def _contour_points(view: View) -> list[Floats]:
    return [c.points for c in view.contours]


LEAD = (
    "Tables I to VII of Recatalá et al. (2008), rerun with three other objects, on ideal contours and on rendered images. "
    "The printed values stand beside ours where there are any: **sizes compare, digits do not**, because the paper's "
    "objects are not at hand."
)


def write_paper(folder: Path, run: PaperRun, *, options: Mapping[str, Any], command: str = "") -> Path:
    """Write `tables.txt`, `tables.md`, `tables/*.csv`, `evaluation.json`, figures and `report.html`.

    Args:
        folder: that is there.
        run: of the tables.
        options: what was asked for.
        command: that repeats it.

    Returns:
        The path of the page.

    Raises:
        InputError: the folder cannot be written.
    """
    made = software_versions()
    head = {"format": 1, "kind": "paper", "options": dict(options), "versions": made, "backend": kernels.BACKEND}
    series = [
        {
            **{name: getattr(s, name) for name in ("object", "strategy", "kind", "motion", "carried_on")},
            "average_px": list(s.average_px),
            "maximum_px": list(s.maximum_px),
        }
        for s in run.series
    ]
    try:
        (folder / "tables").mkdir(exist_ok=True)
        for table in run.tables:
            to_csv(table, folder / "tables" / f"{table.number}.csv")
        (folder / "tables.txt").write_text("\n".join(map(to_text, run.tables)), encoding="utf-8")
        (folder / "tables.md").write_text("\n".join(map(to_markdown, run.tables)), encoding="utf-8")
        tables = [to_json(table) for table in run.tables]
        told = {**head, "machine": describe_machine(), "command": command, "tables": tables, "series": series}
        write_json(folder / "evaluation.json", told)
    except OSError as error:
        raise InputError(f'"{folder}" cannot be written: {error.strerror or error}', path=str(folder)) from error
    software = ", ".join(f"{name} {made[name]}" for name in ("grasptrack", "python", "numpy", "opencv"))
    facts = [
        ("Machine", describe_machine()),
        ("Software", software),
        ("Kernels", kernels.BACKEND),
        ("Again", f"`{command}`"),
    ]
    return paper_report(folder, run.tables, run.series, run.pictures, lead=LEAD, facts=facts)
