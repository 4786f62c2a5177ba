# SPDX-License-Identifier: Apache-2.0
"""Tables VI and VII: reversibility, reference and sequence errors, of our transfers and of the paper's to the letter."""

from __future__ import annotations

from collections.abc import Sequence

from grasptrack_bench.metrics.errors import ErrorMeasure
from grasptrack_bench.report.table import Cell, Table
from research.paper import printed
from research.paper.footage import KINDS, TILT, Footage
from research.paper.transfers import WAYS, Course, Return, Way

Row = tuple[Cell, ...]
Measures = Sequence[ErrorMeasure | str | None]

_STRATEGIES = [printed.HEADS[s] for s in printed.STRATEGIES]
_HEAD = (
    "contours",
    "grasp",
    "error",
    "transfer",
    *(f"{s}, {unit}" for unit in ("1/px", "px", "% of opening") for s in _STRATEGIES),
)
_UNIT = (
    "1/px is the paper's unit, a distance over the object's area; it falls as the object is seen larger. Per cent of the "
    "opening do not. -: the paper prints none. 1e-13 px is the rounding of the arithmetic."
)
_LITERAL = (
    "ours: as in this library; to the letter: as the text has them, with distances over the area, the four highest peaks, "
    "a window about an index, whole samples, whole interp."
)
_OPENING = (
    "Printed rows in per cent: over d_2 - d_1 of Tables III and IV, about 0.0020 and 0.0076, if the rows follow Table VI; "
    "Table V is missing."
)
_READ_WITH = (printed.SIZES_COMPARE, _UNIT, _OPENING, _LITERAL)


def table_six(number: int, returns: Sequence[Return]) -> Table:
    """Table VI: R_v E of the pairs of the first frame and another, of one motion."""
    rows: list[Row] = []
    for (name, columns), opening in zip(printed.TABLE_VI, printed.OPENINGS, strict=True):
        for k, error in enumerate(("e_av", "e_max")):
            rows.append(_printed_row(name, f"R_v E ({error})", [c[k] for c in columns], opening))
    found = {(r.footage.kind, r.footage.part.name, r.strategy): r for r in returns}
    for kind, name in dict.fromkeys((r.footage.kind, r.footage.part.name) for r in returns):
        for transfer, strategies in printed.TRANSFERS.items():
            mine = [found[kind, name, s] for s in strategies]
            rows += _measure_rows(mine[0].footage, "R_v E", transfer, [r.error for r in mine])
    refused = [
        f"{r.footage.kind}, {r.footage.part.name}, {r.strategy} refused: {r.error}."
        for r in returns
        if isinstance(r.error, str)
    ]
    kinds = dict.fromkeys(r.footage.kind for r in returns)
    return Table(
        f"VI-{number}",
        f"Reversibility error (R_v E), frame 0 to frame {returns[0].frame} and back, {returns[0].footage.motion}",
        _HEAD,
        tuple(rows),
        (
            *_READ_WITH,
            "A transfer that comes back to where it began need not have been right: Table VII says how far it was off.",
            "A contact that can only be a point of the contours comes back to where it began if it comes within half a "
            "step of it: such zeros are bought by the quantisation, on pixel chains by that of the contours and to the "
            "letter by a whole interp. Our RRP keeps places on a grid of 2^-32 of a side; what that leaves stands here.",
            *(f"{kind}: {KINDS[kind]}." for kind in kinds),
            *refused,
        ),
    )


_ROWS: dict[Way, str] = {"first view": "SE", "last frame as prior": "SE prior", "carried on": "SE carried on"}


def table_seven(number: int, courses: Sequence[Course], frame: int) -> Table:
    """Table VII of one kind of contours and one motion."""
    rows: list[Row] = []
    for k, (lines, opening) in enumerate(zip(printed.TABLE_VII, printed.OPENINGS, strict=True), start=1):
        names = ("R_f E (e_av)", "R_f E (e_max)", "SE (e_av)", "SE (e_max)")
        rows += [_printed_row(f"grasp {k}", n, line, opening) for n, line in zip(names, lines, strict=True)]
    one = courses[0].footage
    found = {(c.footage.part.name, c.strategy, c.way): c for c in courses}
    for name in dict.fromkeys(c.footage.part.name for c in courses):
        for transfer, strategies in printed.TRANSFERS.items():
            for way, error in _ROWS.items():
                mine = [found[name, s, way] for s in strategies if (name, s, way) in found]
                if not mine:
                    continue
                if way == "first view":
                    rows += _measure_rows(mine[0].footage, "R_f E", transfer, [c.errors[frame - 1] for c in mine])
                rows += _measure_rows(mine[0].footage, error, transfer, [c.sequence for c in mine])
    total, parts = len(courses[0].errors), {c.footage.part.name: c.footage.part for c in courses}
    tilt = f", tilt to {round(TILT * 57.2958)}°" if one.motion == "6 DoF" else ""
    return Table(
        f"VII-{number}",
        f"Reference (R_f E) and sequence errors (SE): {one.kind} contours, {one.motion}{tilt}",
        _HEAD,
        tuple(rows),
        (
            *_READ_WITH,
            f"{one.kind}: {KINDS[one.kind]}.",
            f"R_f E at frame {frame}, from the first view; SE over frames 1 to {total}, the first view being frame 0.",
            *(f"{_ROWS[way]}: {meaning}." for way, meaning in WAYS.items()),
            "The text does not say which it is. To the letter there is no prediction, and so no SE prior.",
            "The printed R_f E of grasp 3 by grasp line is larger than its printed SE (e_max), which cannot be if both are "
            "of the same pairs of frames: frame 50 is one of the sequence. The text does not say that they are.",
            "Opening of the grasps in the first view: "
            + ", ".join(f"{name} {part.opening:.0f} px" for name, part in parts.items())
            + ".",
            *_refusal_notes(courses, total),
        ),
    )


def at_a_glance(courses: Sequence[Course]) -> Table:
    """Sequence errors of all objects together, by contours, motion and way, in px."""
    rows: list[Row] = []
    for motion, kind in dict.fromkeys((c.footage.motion, c.footage.kind) for c in courses):
        for transfer, strategies in printed.TRANSFERS.items():
            for way in WAYS:
                row: list[Cell] = [motion, kind, transfer, way]
                for strategy in strategies:
                    here = [c for c in courses if (c.footage.motion, c.footage.kind) == (motion, kind)]
                    row += _glance_cells([c for c in here if (c.strategy, c.way) == (strategy, way)])
                if any(cell is not None for cell in row[4:]):
                    rows.append(tuple(row))
    what = ("mean px", "worst px", "answered")
    return Table(
        "VII",
        "Sequence errors at a glance, all objects together",
        ("motion", "contours", "transfer", "way", *(f"{s} {w}" for s in _STRATEGIES for w in what)),
        tuple(rows),
        (
            "Mean and worst over the frames answered; answered: of all frames.",
            _LITERAL,
            *(f"{way}: {meaning}." for way, meaning in WAYS.items()),
            *(f"{kind}: {KINDS[kind]}." for kind in dict.fromkeys(c.footage.kind for c in courses)),
            "Strategies that answered other frames do not compare: who refuses the frames that are tilted most has the "
            "smaller errors left.",
            "Nothing but the strategies' own refusals judges these answers; the tracker asks the image as well.",
        ),
    )


def _glance_cells(courses: Sequence[Course]) -> list[Cell]:
    """Mean px, worst px and how many were answered, of one strategy on all objects."""
    if not courses:
        return [None] * 3
    errors = [e for c in courses for e in c.answered]
    asked = sum(len(c.errors) for c in courses)
    if not errors:
        return ["refused", "refused", f"0 of {asked}"]
    mean = sum(e.average_px for e in errors) / len(errors)
    return [mean, max(e.maximum_px for e in errors), f"{len(errors)} of {asked}"]


def _measure_rows(footage: Footage, name: str, transfer: str, measures: Measures) -> list[Row]:
    """e_av and e_max of one measure by all strategies, in all units."""

    def list_cells(fields: tuple[str, ...]) -> list[Cell]:
        listed: list[Cell] = []
        for field in fields:
            listed += [float(getattr(m, field)) if isinstance(m, ErrorMeasure) else "refused" for m in measures]
        return listed

    return [
        (
            footage.kind,
            footage.part.name,
            f"{name} ({error})",
            transfer,
            *list_cells((error, f"{px}_px", f"{px}_percent")),
        )
        for error, px in (("e_av", "average"), ("e_max", "maximum"))
    ]


def _printed_row(grasp: str, error: str, values: Sequence[float], opening: float | None) -> Row:
    """A row as the paper prints it, and in per cent where the opening is known."""
    percent = [None if opening is None else 100.0 * v / opening for v in values]
    return "paper", grasp, error, "printed", *values, *[None] * 3, *percent


def _refusal_notes(courses: Sequence[Course], total: int) -> list[str]:
    notes = []
    for c in courses:
        if c.reasons:
            why = "; ".join(f"{count} times: {reason}" for reason, count in list(c.reasons.items())[:3])
            least = f"{c.footage.part.name}, {c.strategy}, {c.way}: {len(c.answered)} of {total} answered"
            notes.append(f"{least}, and the errors are of those. Refused {why}.")
    return notes or ["Every frame was answered by every strategy."]
