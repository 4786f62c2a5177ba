# SPDX-License-Identifier: Apache-2.0
"""What each strategy needs (Sections III and VI), each claim by an experiment."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from grasptrack.bench.paper.contours import Kind, in_four_dof, resample_view, transform_view
from grasptrack.bench.paper.images import observe_scene
from grasptrack.bench.paper.objects import MOTIONS, Part, camera_trajectory, sample_view
from grasptrack.bench.paper.printed import HEADS, STRATEGIES
from grasptrack.bench.paper.transfers import Course, Refused, transfer_and_measure
from grasptrack.bench.report.table import Cell, Table
from grasptrack.bench.simulation import SHAPES, Bar, Scene, Shape
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography, similarity_transform
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.synthesis import synthesize
from grasptrack.transfer import transfer
from grasptrack.typing import Floats

Row = tuple[Cell, ...]

FRAMES = 40
"""Of the experiments on images."""
MOVED = similarity_transform(1.1, 0.5, (320.0, 240.0), (340.0, 250.0))
"""The motion of the experiments on one pair of contours."""
SIDE = 130.0
"""px, root of the area of the objects in them."""


def table_of_contexts(courses: Sequence[Course], part: Part, seed: int, after: Callable[[], None]) -> Table:
    """Requirements of the strategies and what happens without them.

    Args:
        courses: of all objects, strategies and contours.
        part: the object of the experiments that need only one.
        seed: of the scenes.
        after: called after each frame of the two scenes.
    """
    cover = Scene(part.shape, camera_trajectory("4 DoF", FRAMES, seed), covers=(Bar(1, FRAMES, width=0.05),), seed=seed)
    path = camera_trajectory("4 DoF", FRAMES, seed)
    still = {name: np.repeat(getattr(path, name)[:1], FRAMES, axis=0) for name in ("distance", "roll", "tilt")}
    leaving = np.column_stack([np.linspace(0.0, 2.4, FRAMES), np.zeros(FRAMES)])
    border = Scene(part.shape, replace(path, target=path.target[0] + leaving, **still), seed=seed)
    rows: list[Row] = [
        ("motion of 4 DoF", "III", "resampled contours, all objects", *_worst_cells(courses, MOTIONS[0], "resampled")),
        ("motion of 6 DoF", "III-C, V", "the same, the camera tilts", *_worst_cells(courses, MOTIONS[1], "resampled")),
        ("points that correspond", "III-A, VI", "RRP given a contour with another start", *_another_start(part)),
        ("the whole outline", "III-B, VI", "images: a bar crosses the object", *_on_images(part, cover, after)),
        ("the whole outline", "III-B, VI", "images: the border cuts the object", *_on_images(part, border, after)),
        ("two fingers", "III-B, V", "a grasp of three contacts", *_pair_cells(part.shape.polygons, seed, fingers=3)),
        ("distinct inertia axes", "III-B", "a disc", *_pair_cells(SHAPES["disc"]().polygons, seed)),
        ("no half-turn symmetry", "III-B", "a rectangle", *_pair_cells(SHAPES["rectangle"]().polygons, seed)),
        ("four peaks of curvature", "IV-C.1", "an egg", *_pair_cells(egg_shape().polygons, seed)),
    ]
    return Table(
        "C",
        "What each strategy needs, by experiment (Sections III, IV and VI; not a table of the paper)",
        ("asked for", "section", "experiment", *(HEADS[s] for s in STRATEGIES)),
        tuple(rows),
        (
            "px are the largest error of a contact over the answered frames; a refusal is the strategy's own reason.",
            "An error of px without a refusal is a wrong answer that the strategy cannot tell from a right one.",
            "On contours RRP works on a contour that a perfect tracker of 4 DoF moved, except where it says otherwise; "
            "on images on a snake of 4 DoF.",
        ),
    )


def egg_shape() -> Shape:
    """A smooth outline with distinct axes, a blunt end and a pointed one."""
    angles = np.linspace(0.0, 2.0 * np.pi, 240, endpoint=False)
    return Shape.of("egg", np.column_stack([1.4 * np.cos(angles), (1.0 - 0.2 * np.cos(angles)) * np.sin(angles)]))


def _worst_cells(courses: Sequence[Course], motion: str, kind: Kind) -> list[str]:
    """A cell for each strategy, over all objects, from the first view."""
    here = [c for c in courses if (c.footage.motion, c.footage.kind, c.carried_on) == (motion, kind, False)]
    return [_course_cell([c for c in here if c.strategy == strategy]) for strategy in STRATEGIES]


def _course_cell(courses: Sequence[Course]) -> str:
    errors = [e.maximum_px for c in courses for e in c.answered]
    asked = sum(len(c.errors) for c in courses)
    reasons: dict[str, int] = {}
    for c in courses:
        for reason, count in c.reasons.items():
            reasons[reason] = reasons.get(reason, 0) + count
    said = f"{_format_px(max(errors))}" if errors else ""
    if reasons:
        most = max(reasons, key=lambda r: reasons[r])
        refused = f"refused in {asked - len(errors)} of {asked} frames, mostly: {most}"
        said = f"{said}; {refused}" if said else refused
    return said


def _on_images(part: Part, scene: Scene, after: Callable[[], None]) -> list[str]:
    footage, _ = observe_scene(part, "4 DoF", scene, after)
    return [_course_cell([transfer_and_measure(footage, strategy, False)]) for strategy in STRATEGIES]


def _another_start(part: Part) -> list[str]:
    """Every strategy, RRP too, given the same outline from another first point."""
    points = [np.roll(c.points, -len(c) // 10, axis=0) for c in part.reference.contours]
    shifted = transform_view(sample_view(tuple(points)), MOVED)
    return [
        _transfer_cell(strategy, part.contacts, part.reference, shifted, apply_homography(MOVED, part.contacts))
        for strategy in STRATEGIES
    ]


def _pair_cells(polygons: tuple[Floats, ...], seed: int, fingers: int = 2) -> list[str]:
    """Every strategy on one pair of contours of a shape, with the grasp farthest from the centroid of the ten best."""
    centre = np.array([320.0, 240.0])
    reference = sample_view(tuple(np.ascontiguousarray(SIDE * p + centre) for p in polygons))
    ranked = synthesize(reference, fingers=fingers, top=10)
    grasp = max(ranked, key=lambda g: math.dist(g.contacts.mean(axis=0), centre))
    truth = apply_homography(MOVED, grasp.contacts)
    anew = resample_view(transform_view(reference, MOVED), np.random.default_rng((seed, 37)))
    tracked = in_four_dof(reference, MOVED[None])[0]
    seen = {"rrp": tracked, "grasp-line": anew, "homography": anew}
    return [_transfer_cell(strategy, grasp.contacts, reference, view, truth) for strategy, view in seen.items()]


def _transfer_cell(strategy: str, contacts: Floats, first: View, second: View, truth: Floats) -> str:
    try:
        found = transfer(Grasp(contacts), first, second, strategy).grasp.contacts
    except Refused as error:
        return f"refused: {error}"
    return _format_px(float(np.hypot(*(found - truth).T).max()))


def _format_px(value: float) -> str:
    return "0.00 px" if value < 0.005 else f"{value:.2f} px"
