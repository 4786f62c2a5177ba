# SPDX-License-Identifier: Apache-2.0
"""Tables VI and VII: reversibility, reference and sequence errors; and what each strategy needs, by experiment."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from grasptrack.bench.metrics.errors import ErrorMeasure
from grasptrack.bench.paper import printed
from grasptrack.bench.paper.footage import (
    KINDS,
    MOTIONS,
    TILT,
    Footage,
    Kind,
    Motion,
    Part,
    camera_trajectory,
    in_four_dof,
    observe_scene,
    resample_view,
    sample_view,
)
from grasptrack.bench.paper.transfers import Course, Refused, measure_reversibility, transfer_and_measure
from grasptrack.bench.report.table import Cell, Table
from grasptrack.bench.simulation import SHAPES, Bar, Scene, Shape
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography, similarity_transform
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.synthesis import synthesize
from grasptrack.transfer import transfer
from grasptrack.typing import Floats

Row = tuple[Cell, ...]
Measures = Sequence[ErrorMeasure | str | None]

_STRATEGIES = [printed.HEADS[s] for s in printed.STRATEGIES]
_HEAD = (
    "contours",
    "grasp",
    "error",
    *(f"{s}, {unit}" for unit in ("1/px", "px", "% of opening") for s in _STRATEGIES),
)
_UNIT = (
    "1/px is the paper's unit, a distance over the object's area; it falls as the object is seen larger. Per cent of the "
    "opening do not. -: the paper prints none. 1e-13 px is the rounding of the arithmetic."
)
_OPENING = (
    "Printed rows in per cent: over d_2 - d_1 of Tables III and IV, about 0.0020 and 0.0076, if the rows follow Table VI; "
    "Table V is missing."
)


def table_six(footage: Sequence[Footage], frame: int, motion: Motion) -> Table:
    """Table VI: R_v E of the pairs of the first frame and another, of the footage with one motion."""
    rows: list[Row] = []
    for (name, columns), opening in zip(printed.TABLE_VI, printed.OPENINGS, strict=True):
        for k, error in enumerate(("e_av", "e_max")):
            rows.append(_printed_row(name, f"R_v E ({error})", [c[k] for c in columns], opening))
    refused = []
    for f in [f for f in footage if f.motion == motion]:
        measures = [measure_reversibility(f, s, frame) for s in printed.STRATEGIES]
        rows += _measure_rows(f, "R_v E", measures)
        refused += [
            f"{f.kind}, {f.part.name}, {printed.HEADS[s]} refused: {m}."
            for s, m in zip(printed.STRATEGIES, measures, strict=True)
            if isinstance(m, str)
        ]
    kinds = dict.fromkeys(f.kind for f in footage)
    return Table(
        f"VI-{1 if motion == '4 DoF' else 2}",
        f"Reversibility error (R_v E), frame 0 to frame {frame} and back, {motion}",
        _HEAD,
        tuple(rows),
        (
            printed.SIZES_COMPARE,
            _UNIT,
            _OPENING,
            "A transfer that comes back to where it began need not have been right: Table VII says how far it was off.",
            *(f"{kind}: {KINDS[kind]}." for kind in kinds),
            *refused,
        ),
    )


def table_seven(number: int, courses: Sequence[Course], frame: int) -> Table:
    """Table VII of one kind of contours and one motion.

    Args:
        number: of the table among the tables VII.
        courses: of all objects and strategies, from the first view and carried on.
        frame: of the reference error.
    """
    rows: list[Row] = []
    for k, (lines, opening) in enumerate(zip(printed.TABLE_VII, printed.OPENINGS, strict=True), start=1):
        names = ("R_f E (e_av)", "R_f E (e_max)", "SE (e_av)", "SE (e_max)")
        rows += [_printed_row(f"grasp {k}", n, line, opening) for n, line in zip(names, lines, strict=True)]
    one = courses[0].footage
    for name in dict.fromkeys(c.footage.part.name for c in courses):
        first, on = (_object_courses(courses, name, carried) for carried in (False, True))
        rows += _measure_rows(first[0].footage, "R_f E", [c.errors[frame - 1] for c in first])
        rows += _measure_rows(first[0].footage, "SE", [c.sequence for c in first])
        rows += _measure_rows(first[0].footage, "SE carried on", [c.sequence for c in on])
    total = len(courses[0].errors)
    tilt = f", tilt to {round(TILT * 57.2958)}°" if one.motion == "6 DoF" else ""
    return Table(
        f"VII-{number}",
        f"Reference (R_f E) and sequence errors (SE): {one.kind} contours, {one.motion}{tilt}",
        _HEAD,
        tuple(rows),
        (
            printed.SIZES_COMPARE,
            _UNIT,
            _OPENING,
            f"{one.kind}: {KINDS[one.kind]}.",
            f"R_f E at frame {frame}; SE over frames 1 to {total}, the first view being frame 0. SE transfers from the "
            "first view to each frame, SE carried on from each frame to the next, after a refusal from the last one "
            "answered; the text does not say which it is.",
            "The printed R_f E of grasp 3 by grasp line is larger than its printed SE (e_max), which cannot be: frame "
            "50 is one of the sequence.",
            "Opening of the grasps in the first view: "
            + ", ".join(f"{c.footage.part.name} {c.footage.part.opening:.0f} px" for c in _of_strategy(courses))
            + ".",
            *_refusal_notes(courses, total),
        ),
    )


def at_a_glance(courses: Sequence[Course]) -> Table:
    """Sequence errors of all objects together, by contours and motion, in px."""
    rows: list[Row] = []
    for motion, kind in dict.fromkeys((c.footage.motion, c.footage.kind) for c in courses):
        row: list[Cell] = [motion, kind]
        for strategy in printed.STRATEGIES:
            here = [c for c in courses if (c.footage.motion, c.footage.kind, c.strategy) == (motion, kind, strategy)]
            first = [e for c in here if not c.carried_on for e in c.answered]
            on = [e for c in here if c.carried_on for e in c.answered]
            asked = sum(len(c.errors) for c in here if not c.carried_on)
            row += [
                sum(e.average_px for e in first) / len(first) if first else "refused",
                max((e.maximum_px for e in first), default="refused"),
                max((e.maximum_px for e in on), default="refused"),
                f"{len(first)} of {asked}",
            ]
        rows.append(tuple(row))
    what = ("mean px", "worst px", "worst px carried on", "answered")
    return Table(
        "VII",
        "Sequence errors at a glance, all objects together",
        ("motion", "contours", *(f"{s} {w}" for s in _STRATEGIES for w in what)),
        tuple(rows),
        (
            "Mean and worst over the frames answered, transferred from the first view; answered: of all frames.",
            *(f"{kind}: {KINDS[kind]}." for kind in dict.fromkeys(c.footage.kind for c in courses)),
            "Strategies that answered other frames do not compare: who refuses the frames that are tilted most has the "
            "smaller errors left.",
            "Nothing but the strategies' own refusals judges these answers; the tracker asks the image as well.",
        ),
    )


def _measure_rows(footage: Footage, name: str, measures: Measures) -> list[Row]:
    """e_av and e_max of one measure by all strategies, in all units."""

    def list_cells(fields: tuple[str, ...]) -> list[Cell]:
        listed: list[Cell] = []
        for field in fields:
            listed += [float(getattr(m, field)) if isinstance(m, ErrorMeasure) else "refused" for m in measures]
        return listed

    return [
        (footage.kind, footage.part.name, f"{name} (e_av)", *list_cells(("e_av", "average_px", "average_percent"))),
        (footage.kind, footage.part.name, f"{name} (e_max)", *list_cells(("e_max", "maximum_px", "maximum_percent"))),
    ]


def _printed_row(grasp: str, error: str, values: Sequence[float], opening: float | None) -> Row:
    """A row as the paper prints it, and in per cent where the opening is known."""
    percent = [None if opening is None else 100.0 * v / opening for v in values]
    return "paper", grasp, error, *values, *[None] * 3, *percent


def _object_courses(courses: Sequence[Course], name: str, carried_on: bool) -> list[Course]:
    """One object's courses in the paper's order of the strategies."""
    here = [c for c in courses if c.footage.part.name == name and c.carried_on == carried_on]
    return sorted(here, key=lambda c: printed.STRATEGIES.index(c.strategy))


def _of_strategy(courses: Sequence[Course]) -> list[Course]:
    """One course for each object."""
    return list({c.footage.part.name: c for c in courses}.values())


def _refusal_notes(courses: Sequence[Course], total: int) -> list[str]:
    """What was refused, and why."""
    notes = []
    for c in courses:
        if c.reasons:
            how = "carried on" if c.carried_on else "from the first view"
            why = "; ".join(f"{count} times: {reason}" for reason, count in list(c.reasons.items())[:3])
            least = f"{c.footage.part.name}, {printed.HEADS[c.strategy]} {how}: {len(c.answered)} of {total} answered"
            notes.append(f"{least}, and the errors are of those. Refused {why}.")
    return notes or ["Every frame was answered by every strategy."]


CONTEXT_FRAMES = 40
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
    cover = Scene(
        part.shape,
        camera_trajectory("4 DoF", CONTEXT_FRAMES, seed),
        covers=(Bar(1, CONTEXT_FRAMES, width=0.05),),
        seed=seed,
    )
    path = camera_trajectory("4 DoF", CONTEXT_FRAMES, seed)
    still = {name: np.repeat(getattr(path, name)[:1], CONTEXT_FRAMES, axis=0) for name in ("distance", "roll", "tilt")}
    leaving = np.column_stack([np.linspace(0.0, 2.4, CONTEXT_FRAMES), np.zeros(CONTEXT_FRAMES)])
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
        ("asked for", "section", "experiment", *(printed.HEADS[s] for s in printed.STRATEGIES)),
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
    return [_course_cell([c for c in here if c.strategy == strategy]) for strategy in printed.STRATEGIES]


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
    return [_course_cell([transfer_and_measure(footage, strategy, False)]) for strategy in printed.STRATEGIES]


def _another_start(part: Part) -> list[str]:
    """Every strategy, RRP too, given the same outline from another first point."""
    points = [np.roll(c.points, -len(c) // 10, axis=0) for c in part.reference.contours]
    shifted = sample_view(tuple(points)).transformed(MOVED)
    return [
        _transfer_cell(strategy, part.contacts, part.reference, shifted, apply_homography(MOVED, part.contacts))
        for strategy in printed.STRATEGIES
    ]


def _pair_cells(polygons: tuple[Floats, ...], seed: int, fingers: int = 2) -> list[str]:
    """Every strategy on one pair of contours of a shape, with the grasp farthest from the centroid of the ten best."""
    centre = np.array([320.0, 240.0])
    reference = sample_view(tuple(np.ascontiguousarray(SIDE * p + centre) for p in polygons))
    ranked = synthesize(reference, fingers=fingers, top=10)
    grasp = max(ranked, key=lambda g: math.dist(g.contacts.mean(axis=0), centre))
    truth = apply_homography(MOVED, grasp.contacts)
    anew = resample_view(reference.transformed(MOVED), np.random.default_rng((seed, 37)))
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
