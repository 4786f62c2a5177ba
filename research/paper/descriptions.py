# SPDX-License-Identifier: Apache-2.0
"""Tables I, III and IV: grasps in RRP and grasp-line coordinates, before and after a transfer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import Grasp
from grasptrack.transfer import grasp_line, rrp
from grasptrack.typing import Floats
from grasptrack_bench.report.table import Cell, Table
from research.paper import printed
from research.paper.footage import FilmedPart, Footage
from research.paper.transfers import Refused, strategy_called

Row = tuple[Cell, ...]
Line = tuple[float, float, float, float]

_NAMES = (("p_g1", "p_g2"), ("p'_g1", "p'_g2"))
_HEAD = (
    "contours", "object", "transfer", "contact", "Location (c, p)", "RRP (c, r, t)",
    "Relative (d_c, alpha_m, d_1, d_2), 1/px and degrees", "off by, px",
)  # fmt: skip
_UNIT = "Distances over the area, in 1/px as the paper prints them; they change with the object's scale in the image."
_BOTH = "Relative holds for both contacts and stands in the first one's row."
_PAIR = f"{_BOTH} Off by: from the true place."


def table_one(parts: Sequence[FilmedPart]) -> Table:
    """Table I: the same grasps in both descriptions, on contours of 300 points."""
    rows: list[Row] = []
    for name, both, values in printed.TABLE_I:
        texts = relative_text(values), ""
        rows += [("paper", name, _NAMES[0][i], str(both[i]), texts[i]) for i in range(2)]
    for part in parts:
        view, grasp = part.reference, Grasp(part.contacts)
        relative = (line_of(grasp, view), "")
        coordinates = rrp_of(grasp, view)
        for i in range(2):
            rows.append((part.name, "g1", _NAMES[0][i], coordinates[i], relative[i]))
    return Table(
        "I",
        "Grasp descriptions in RRP and grasp-line coordinates",
        ("object", "grasp", "contact", "RRP (c, r, t)", "Relative (d_c, alpha_m, d_1, d_2), 1/px and degrees"),
        tuple(rows),
        (
            printed.SIZES_COMPARE,
            _UNIT,
            _BOTH,
            "RRP with six points to a span, as Table IV counts them: p = 6 r + t, t printed as the nearest whole number.",
            "The signs of d_c and alpha_m follow our conventions; printed values of alpha_m go beyond a half turn.",
        ),
    )


def table_three(footage: Sequence[Footage], frame: int) -> Table:
    """Table III: the grasp transferred by RRP from the first frame to another."""
    rows = _printed_rows(printed.TABLE_III)
    kept: list[bool] = []
    for f in footage:
        first, other = f.tracked[0], f.tracked[frame]
        sides = f.silhouettes[0], f.silhouettes[frame]
        if not isinstance(first, View) or not isinstance(other, View):
            rows.append(_refusal_row(f, next(o for o in (first, other) if isinstance(o, str))))
            continue
        grasp = Grasp(f.on_tracked)
        for how, name in (("ours", "rrp"), ("to the letter", "paper-rrp")):
            chosen = strategy_called(name)
            moved = chosen.apply(chosen.describe(grasp, first), other).grasp
            before, after = rrp_of(grasp, first), rrp_of(moved, other)
            kept.append(before == after)
            rows += _description_rows(f, how, 0, grasp, sides[0], before)
            rows += _description_rows(f, how, frame, moved, sides[1], after, f.truth("rrp", frame))
    same = f"stayed the same in {sum(kept)} of {len(kept)} transfers"
    return Table(
        "III",
        f"Grasp transfer based on RRP coordinates, frame 0 to frame {frame}, 4 DoF",
        _HEAD,
        tuple(rows),
        (
            printed.SIZES_COMPARE,
            _UNIT,
            _PAIR,
            f"What the table shows: the RRP coordinates {same}; Location and Relative are read off another contour, "
            "which is extracted anew, and change a little.",
            "RRP on the outline that is tracked, Location and Relative on the silhouette. The printed rows do not obey "
            "p = 6 r + t: the B-spline there has other spans.",
            _kinds_note(footage),
        ),
    )


def table_four(footage: Sequence[Footage], frame: int) -> Table:
    """Table IV: the grasp transferred by grasp-line coordinates from the first frame to another."""
    rows = _printed_rows(printed.TABLE_IV)
    change = 0.0
    for f in footage:
        first, other = f.silhouettes[0], f.silhouettes[frame]
        if not isinstance(first, View) or not isinstance(other, View):
            rows.append(_refusal_row(f, next(o for o in (first, other) if isinstance(o, str))))
            continue
        grasp = Grasp(f.on_silhouette)
        for how, name in (("ours", "grasp-line"), ("to the letter", "paper-grasp-line")):
            chosen = strategy_called(name)
            try:
                moved = chosen.apply(chosen.describe(grasp, first), other).grasp
                before, after = grasp_line.describe(grasp, first), grasp_line.describe(moved, other)
            except Refused as error:
                rows.append(_refusal_row(f, str(error), how))
                continue
            if how == "ours":
                pairs = ((before.d_c, after.d_c), (before.d_1, after.d_1), (before.d_2, after.d_2))
                change = max(change, *(abs(a - b) for a, b in pairs))
            rows += _description_rows(f, how, 0, grasp, first, rrp_of(grasp, first))
            rows += _description_rows(f, how, frame, moved, other, rrp_of(moved, other), f.truth("grasp-line", frame))
    return Table(
        "IV",
        f"Grasp transfer using grasp-line coordinates, frame 0 to frame {frame}, 4 DoF",
        _HEAD,
        tuple(rows),
        (
            printed.SIZES_COMPARE,
            _UNIT,
            _PAIR,
            "What the table shows: over the root of the area the coordinates stay the same (largest change in our transfers "
            f"{change:.1g}), over the area they change with scale; Location and RRP change with the contour's start. To the "
            "letter the line is laid by distances over the area, and contacts end where it meets the outline.",
            "RRP counts the points of the silhouette by six, p = 6 r + t, as the printed rows do.",
            _kinds_note(footage),
        ),
    )


def rrp_of(grasp: Grasp, view: View) -> list[str]:
    """RRP coordinates of each contact as the paper prints them."""
    return [str(row) for row in rrp.describe(grasp, view).paper()]


def line_of(grasp: Grasp, view: View) -> str:
    """Grasp-line coordinates as the paper prints them, or why there are none."""
    try:
        return relative_text(grasp_line.describe(grasp, view).paper())
    except Refused as error:
        return f"refused: {error}"


def relative_text(values: Line) -> str:
    """(d_c, alpha_m in degrees, d_1, d_2) with the paper's four digits."""
    d_c, alpha, d_1, d_2 = (f"{v:z.4f}" for v in values)
    return f"({d_c}, {alpha}°, {d_1}, {d_2})"


def location_of(grasp: Grasp, view: View) -> list[str]:
    """(c, p) of each contact: the contour and its nearest point."""
    counts = [len(c) for c in view.contours]
    return [f"({int(c)}, {round(p) % counts[int(c)]})" for c, p, _ in grasp.on(view).tolist()]


def _description_rows(
    f: Footage,
    how: str,
    frame: int,
    grasp: Grasp,
    silhouette: View | str,
    coordinates: list[str],
    truth: Floats | None = None,
) -> list[Row]:
    names = _NAMES[min(frame, 1)]
    off = [None, None] if truth is None else np.hypot(*(grasp.contacts - truth).T).tolist()
    if isinstance(silhouette, str):
        location, relative = [f"no silhouette: {silhouette}"] * 2, ""
    else:
        location, relative = location_of(grasp, silhouette), line_of(grasp, silhouette)
    return [
        (f.kind, f.part.name, how, names[i], location[i], coordinates[i], (relative, "")[i], off[i]) for i in range(2)
    ]


def _refusal_row(f: Footage, reason: str, how: str = "ours") -> Row:
    return f.kind, f.part.name, how, "both", f"refused: {reason}", "", "", None


def _kinds_note(footage: Sequence[Footage]) -> str:
    kinds = dict.fromkeys(f.kind for f in footage)
    return f"Contours: {', '.join(kinds)}, see Table VI. -: the paper prints none, or nothing was transferred."


def _printed_rows(
    table: Sequence[tuple[tuple[tuple[int, int], ...], tuple[tuple[int, int, int], ...], Line]],
) -> list[Row]:
    """The rows of Table III or IV as the paper prints them."""
    rows: list[Row] = []
    for names, (places, coordinates, values) in zip(_NAMES, table, strict=True):
        texts = relative_text(values), ""
        rows += [
            ("paper", "its own", "printed", names[i], str(places[i]), str(coordinates[i]), texts[i], None)
            for i in range(2)
        ]
    return rows
