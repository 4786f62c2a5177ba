# SPDX-License-Identifier: Apache-2.0
"""An inspection on one page: the object with what its outline shows and does not, and beside it why."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.trackability import Suitability
from grasptrack.trackability.motions import SLIDING, Motions, sliding_displacement
from grasptrack.trackability.report import FAINT, Entry, describe_expectation, report_rows
from grasptrack.trackability.result import Held
from grasptrack.view import style
from grasptrack.view.draw import outward_directions
from grasptrack.view.panel import (
    BAD,
    CLEAR,
    PAGE,
    PAGE_DPI,
    PEAK,
    WEAK,
    Panel,
    TextColumn,
    add_panel,
    draw_legend,
    image_window,
    mute_image,
    wrap_to_width,
)
from grasptrack.view.style import create_figure, save_whole

LEVEL = {"good": CLEAR, "fair": WEAK, "poor": BAD}
_REASONS = 3
"""Reasons that are written out."""


class Sheet(TextColumn):
    """The verdict with its reasons, bars of the motions, and the table of the terminal."""

    def write_verdict(self, found: Suitability) -> None:
        """The level on a coloured field, what a run will give, and what speaks against it with what would help."""
        self._draw_box(self._left, PAGE[1] - 0.62, 1.2, 0.46, LEVEL[found.level])
        self._write_text(
            self._left + 0.6, PAGE[1] - 0.46, found.level.upper(), 17.0, weight="bold", color="white", ha="center"
        )
        taken = f"--strategy {found.strategy}" if found.strategy else "no strategy will do"
        self._write_text(self._left + 1.35, PAGE[1] - 0.44, taken, 13.0, weight="bold")
        if told := describe_expectation(found):
            self.write_lines(_as_sentence(f"expected: {told}"), 10.5)
        if not found.reasons:
            self.write_lines("Nothing speaks against it.", 11.0)
        for reason in found.reasons[:_REASONS]:
            self._y -= 0.02
            self._draw_box(self._left, self._y - 0.21, 0.09, 0.15, WEAK)
            self.write_lines(_as_sentence(reason.text), 11.0, indent=0.2)
            if reason.advice:
                self.write_lines(f"Would help: {reason.advice}.", 10.5, indent=0.2, color=style.MUTED)
        if len(found.reasons) > _REASONS:
            self.write_lines(
                f"and {len(found.reasons) - _REASONS} more in inspect.json", 10.5, indent=0.2, color=style.MUTED
            )

    def draw_motions(self, motions: Motions) -> None:
        """A bar for each motion, as much of it as moves the edges, and whether it is told from the others."""
        self._y -= 0.36
        self._write_text(self._left, self._y, "What moves the edges", 12.5, weight="bold")
        self._write_text(self._left + self._width, self._y, "told from all others", 10.5, color=style.MUTED, ha="right")
        start, room = self._left + 1.15, self._width - 3.25
        top = self._y
        for motion in motions.motions:
            self._y -= 0.235
            seen = "homography" in motion.observed
            self._write_text(self._left, self._y, motion.name, 10.5)
            self._draw_bar(start, room, 0.14, motion.shown, CLEAR if seen else BAD)
            self._write_text(start + room + 0.12, self._y, f"{100.0 * motion.shown:.0f} %", 10.5)
            flat = "also under tilt" if seen else "only while flat" if "similarity" in motion.observed else "no"
            self._write_text(
                self._left + self._width, self._y, flat, 10.5, color=style.INK if seen else BAD, ha="right"
            )
        mark = start + room * SLIDING
        self._draw_box(mark, self._y - 0.05, 0.015, top - self._y - 0.05, style.INK)
        self._y -= 0.03

    def write_table(self, found: Suitability) -> None:
        """The rows of the terminal's table, as far as they fit."""
        self._y -= 0.14
        for row in report_rows(found):
            if row.name == "motions":
                continue
            self._write_row(row)

    def _write_row(self, row: Entry) -> None:
        start = self._left + 2.35
        lines = wrap_to_width(row.note, self._width - 2.35, 10.0) or [""]
        if self._y - 0.2 * len(lines) < 0.1:
            return
        self._y -= 0.215
        self._write_text(self._left, self._y, row.name, 10.5, color=style.MUTED)
        colour = BAD if row.value in ("no", "none", "not fixed") and row.name not in ("symmetry",) else style.INK
        self._write_text(self._left + 1.05, self._y, row.value, 10.5, weight="bold", color=colour)
        for i, line in enumerate(lines):
            self._y -= 0.17 * (i > 0)
            self._write_text(start, self._y, line, 10.0)


def _as_sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


_MAIN = (0.2, 0.62, 9.2, 7.7)
_RIGHT = (9.7, 0.25, 6.1, 8.07)
_ELLIPSE = 26.0
"""Points that the longer half-axis of the largest ellipse of error is drawn long, about."""
_INSIDE_95 = math.sqrt(5.991)
"""Standard deviations that hold 95 % in two dimensions."""
_FARTHEST = 80.0
"""Points; a longer half-axis is cut there, and the ellipse dashed."""
_ARROWS = 14
"""Arrows along the outline for a motion that it does not show."""


def write_inspection(path: Path, image: NDArray[Any], found: Suitability, *, title: str) -> None:
    """Write the page, 1600 by 900 px, as PNG. The file is complete at any moment or absent."""
    figure = create_figure(*PAGE, dpi=PAGE_DPI, facecolor="white")
    picture = mute_image(image)
    seen = [found.view.points, *(v.outer.points for v in found.equals[:1])]
    shown = image_window(seen, [], picture.shape, _MAIN[2] / _MAIN[3], 0.16, 1.3)
    panel = add_panel(figure, picture, shown, _MAIN)
    times = ellipse_magnification(found, panel.px_per_point)
    panel.draw_neighbours(found.equals, 1.6)
    _draw_edges(panel, found)
    _draw_slides(panel, found)
    if len(found.peaks):
        panel.axes.plot(*found.peaks.T, "D", color=PEAK, ms=8.0, mec=style.DARK, mew=1.2, zorder=4)
    if found.grasp is not None:
        _draw_errors(panel, found.grasp, times)
    draw_legend(panel.axes, _marks_shown(found, times))
    sheet = Sheet(figure, _RIGHT)
    sheet.write_title(title, _MAIN[0])
    sheet.write_verdict(found)
    sheet.draw_motions(found.motions)
    sheet.write_table(found)
    save_whole(figure, path, PAGE_DPI)


def _marks_shown(found: Suitability, times: float) -> dict[str, str | bool]:
    edges, large = found.edges, "" if times == 1.0 else f", drawn {times:g} ×"
    errors = f"95 % of the errors{', not fixed' if found.by == 'nothing' else large}"
    return {
        "clear edge": True,
        "faint edge": bool((edges.clear & (edges.strength < FAINT)).any()),
        "no edge": not edges.clear.all(),
        "peaks": len(found.peaks) > 0,
        "outline slides": found.motions.slide is not None,
        "neighbours": "its equals" if found.equals else False,
        "grasp": found.grasp is not None,
        "errors": errors if found.grasp is not None else False,
    }


def ellipse_magnification(found: Suitability, px_per_point: float) -> float:
    """How many times larger than they are ellipses of error are drawn: 1, 2 or 5 with as many zeros as make them seen."""
    if found.grasp is None:
        return 1.0
    largest = _INSIDE_95 * math.sqrt(float(np.linalg.eigvalsh(found.grasp.covariance).max()))
    wanted = max(_ELLIPSE * px_per_point / max(largest, 1e-9), 1.0)
    power = 10.0 ** math.floor(math.log10(wanted))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted)


def _draw_edges(panel: Panel, found: Suitability) -> None:
    """The outline, each part in the colour of its edge, on one dark casing."""
    edges = found.edges
    for i, contour in enumerate(found.view.contours):
        own = edges.contour == i
        points = np.vstack([contour.points, contour.points[:1]])
        panel.axes.plot(points[:, 0], points[:, 1], color=style.DARK, lw=5.6, alpha=0.75, solid_capstyle="butt")
        cut = np.zeros(len(contour), np.bool_) if contour.clipped is None else contour.clipped
        kind = np.where(cut, 3, np.where(~edges.clear[own], 2, np.where(edges.strength[own] < FAINT, 1, 0)))
        ends = [0, *(np.flatnonzero(np.diff(kind)) + 1).tolist(), len(kind)]
        for start, end in pairwise(ends):
            colour, wide = ((CLEAR, 3.0), (WEAK, 3.0), (BAD, 4.4), ("white", 1.2))[int(kind[start])]
            panel.axes.plot(*points[start : end + 1].T, color=colour, lw=wide, solid_capstyle="butt", zorder=3)


def _draw_slides(panel: Panel, found: Suitability) -> None:
    """Arrows along the outline: the motion that its edges show least, where the tracker takes it as not seen."""
    if found.motions.slide is None:
        return
    outer = found.view.outer
    at = np.linspace(0.0, outer.length, _ARROWS, endpoint=False)
    chosen = np.searchsorted(outer.arc_length[:-1], at).clip(0, len(outer) - 1)
    points = outer.points[chosen if outer.clipped is None else chosen[~outer.clipped[chosen]]]
    moved = sliding_displacement(found.motions, points)
    longest = float(np.hypot(*moved.T).max())
    reach = min(max(0.16 * found.looks.size, 24.0 * panel.px_per_point), 60.0 * panel.px_per_point)
    inward = found.motions.frame.centre - points
    inward = 13.0 * panel.px_per_point * inward / np.maximum(np.hypot(*inward.T), 1e-9)[:, None]
    for point, way in zip(points - inward, moved * reach / longest, strict=True):
        if float(np.hypot(*way)) < 0.25 * reach:
            continue
        panel.draw_arrow(point - 0.5 * way, point + 0.5 * way, BAD, 0.3)


def _draw_errors(panel: Panel, grasp: Held, times: float) -> None:
    """The line between the contacts, and round each the ellipse that holds it with 95 %, enlarged."""
    from matplotlib.patches import Ellipse

    panel.draw_grasp_line(grasp.contacts, 2.0, 7.0)
    ways = outward_directions(grasp.contacts)
    for i, (contact, covariance, away) in enumerate(zip(grasp.contacts, grasp.covariance, ways, strict=True)):
        size, V = np.linalg.eigh(covariance)
        half = times * _INSIDE_95 * np.sqrt(np.maximum(size, 0.0))
        open_ended = half.max() > _FARTHEST * panel.px_per_point
        half = np.clip(half, 2.0 * panel.px_per_point, _FARTHEST * panel.px_per_point)
        turn = math.degrees(math.atan2(V[1, 1], V[0, 1]))
        line_style = (0, (2, 1.5)) if open_ended else "-"
        for colour, wide in ((style.DARK, 4.0), ("white", 2.0)):
            look = {"fill": False, "ec": colour, "lw": wide, "ls": line_style, "zorder": 3.5}  # below the contact's dot
            panel.axes.add_patch(Ellipse(tuple(contact), 2.0 * half[1], 2.0 * half[0], angle=turn, **look))
        reach = min(math.sqrt(float(away @ V @ np.diag(half**2) @ V.T @ away)), 60.0 * panel.px_per_point)
        panel.draw_label(str(i + 1), contact + (reach + 15.0 * panel.px_per_point) * away)
