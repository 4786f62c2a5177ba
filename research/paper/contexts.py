# SPDX-License-Identifier: Apache-2.0
"""What each strategy needs, by experiment (Sections III, IV and VI): Table C."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography, similarity_transform
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.synthesis import synthesize
from grasptrack.typing import Floats
from grasptrack_bench.report.table import Cell, Table
from grasptrack_bench.simulation import SHAPES, Bar, Scene, Shape
from grasptrack_bench.simulation.paths import at_rest
from research.paper.footage import (
    MOTIONS,
    TRACKED,
    FilmedPart,
    camera_trajectory,
    in_four_dof,
    moved_curves,
    observe_scene,
    resample_view,
    sample_view,
)
from research.paper.transfers import (
    COMPARED,
    Course,
    Refused,
    Way,
    count_reasons,
    strategy_called,
    transfer_and_measure,
    ways_of,
)

Row = tuple[Cell, ...]

FRAMES_ON_IMAGES = 40
"""Of the experiments on images."""
MOVED = similarity_transform(1.1, 0.5, (320.0, 240.0), (340.0, 250.0))
"""The motion of the experiments on one pair of contours."""
SIDE = 130.0
"""px, root of the area of the objects in them."""


def table_of_contexts(courses: Sequence[Course], part: FilmedPart, seed: int, after: Callable[[], None]) -> Table:
    """Requirements of the strategies and what happens without them."""
    rows: list[Row] = []
    for motion, section, what in (
        (MOTIONS[0], "III", "resampled contours, all objects"),
        (MOTIONS[1], "III-C, V", "the same, the camera tilts"),
        (MOTIONS[2], "III", "the same, the camera comes nearer by a factor of 2.5"),
    ):
        here = [c for c in courses if (c.footage.motion, c.footage.kind) == (motion, "resampled")]
        rows += _rows_of_courses(f"motion: {motion}", section, what, here)
    rows.append(("points that correspond", "III-A, IV-C.1, VI", "a contour with another start", *_another_start(part)))
    for what, scene in (
        ("a bar crosses the object", crossed_scene(part, seed)),
        ("the border cuts", cut_scene(part, seed)),
    ):
        footage, _ = observe_scene(part, "4 DoF", scene, after)
        here = [transfer_and_measure(footage, strategy, way) for strategy in COMPARED for way in ways_of(strategy)]
        rows += _rows_of_courses("the whole outline", "III-B, VI", f"images: {what}", here)
    for asked, section, what, shape, fingers in (
        ("two fingers", "III-B, V", "a grasp of three contacts", part.shape, 3),
        ("distinct inertia axes", "III-B", "a disc", SHAPES["disc"](), 2),
        ("no half-turn symmetry", "III-B", "a rectangle", SHAPES["rectangle"](), 2),
        ("four peaks of curvature", "IV-C.1", "an egg", SHAPES["egg"](), 2),
    ):
        rows.append((asked, section, what, *_pair_cells(shape, seed, fingers)))
    return Table(
        "C",
        "What each strategy needs, by experiment (Sections III, IV and VI; not a table of the paper)",
        ("asked for", "section", "experiment", *COMPARED),
        tuple(rows),
        (
            "px are the largest error of a contact over the answered frames; a refusal is the strategy's own reason.",
            "An error of px without a refusal is a wrong answer that the strategy cannot tell from a right one.",
            "paper-*: the paper's transfers to the letter. They know no prediction: where frames are consecutive they go "
            "from each frame to the next.",
            "On contours RRP works on a contour that a perfect tracker of 4 DoF moved, except where it says otherwise; "
            "on images on a snake of 4 DoF.",
        ),
    )


def crossed_scene(part: FilmedPart, seed: int) -> Scene:
    """A bar crosses the object."""
    path = camera_trajectory("4 DoF", FRAMES_ON_IMAGES, seed)
    return Scene(part.shape, path, covers=(Bar(1, FRAMES_ON_IMAGES, width=0.05),), seed=seed)


def cut_scene(part: FilmedPart, seed: int) -> Scene:
    """The object leaves the image sideways."""
    path = camera_trajectory("4 DoF", FRAMES_ON_IMAGES, seed)
    leaving = np.column_stack([np.linspace(0.0, 2.4, FRAMES_ON_IMAGES), np.zeros(FRAMES_ON_IMAGES)])
    return Scene(part.shape, replace(at_rest(path), target=path.target[0] + leaving), seed=seed)


def _rows_of_courses(asked: str, section: str, what: str, courses: Sequence[Course]) -> list[Row]:
    """One row for pairs of views, and one for consecutive frames."""
    rows: list[Row] = []
    ways: tuple[tuple[str, Way], ...] = (("", "first view"), (", consecutive frames", "last frame as prior"))
    for told, way in ways:
        cells = []
        for strategy in COMPARED:
            taken = way if way in ways_of(strategy) else "carried on"
            cells.append(_course_cell([c for c in courses if (c.strategy, c.way) == (strategy, taken)]))
        rows.append((asked, section, f"{what}{told}", *cells))
    return rows


def _course_cell(courses: Sequence[Course]) -> str:
    errors = [e.maximum_px for c in courses for e in c.answered]
    asked = sum(len(c.errors) for c in courses)
    reasons = count_reasons(e for c in courses for e in c.errors if isinstance(e, str))
    said = _format_px(max(errors)) if errors else ""
    if reasons:
        refused = f"refused in {asked - len(errors)} of {asked} frames, mostly: {next(iter(reasons))}"
        said = f"{said}; {refused}" if said else refused
    return said


def _another_start(part: FilmedPart) -> list[str]:
    """Every strategy, RRP too, given the same outline from another first point."""
    starts = np.array([len(c) / 10.0 + 0.25 for c in part.reference.contours])
    shifted = sample_view(moved_curves(part, MOVED), starts)
    truth = apply_homography(MOVED, part.contacts)
    return [_transfer_cell(strategy, part.contacts, part.reference, shifted, truth) for strategy in COMPARED]


def _pair_cells(shape: Shape, seed: int, fingers: int) -> list[str]:
    """Every strategy on one pair of contours of a shape, with the grasp farthest from the centroid of the ten best."""
    centre = np.array([320.0, 240.0])
    curves = tuple(np.ascontiguousarray(SIDE * p + centre) for p in shape.polygons)
    reference = sample_view(curves)
    ranked = synthesize(reference, fingers=fingers, top=10)
    grasp = max(ranked, key=lambda g: math.dist(g.contacts.mean(axis=0), centre))
    truth = apply_homography(MOVED, grasp.contacts)
    rng = np.random.default_rng((seed, 37))
    anew = resample_view(tuple(apply_homography(MOVED, c) for c in curves), rng)
    tracked = in_four_dof(reference, MOVED[None])[0]
    return [
        _transfer_cell(strategy, grasp.contacts, reference, tracked if strategy in TRACKED else anew, truth)
        for strategy in COMPARED
    ]


def _transfer_cell(strategy: str, contacts: Floats, first: View, second: View, truth: Floats) -> str:
    chosen = strategy_called(strategy)
    try:
        found = chosen.apply(chosen.describe(Grasp(contacts), first), second).grasp.contacts
    except Refused as error:
        return f"refused: {error}"
    return _format_px(float(np.hypot(*(found - truth).T).max()))


def _format_px(value: float) -> str:
    return "0.00 px" if value < 0.005 else f"{value:.2f} px"
