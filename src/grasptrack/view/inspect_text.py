# SPDX-License-Identifier: Apache-2.0
"""What the picture of an inspection says: the verdict, bars of the motions, a table, and the legend."""

from __future__ import annotations

from textwrap import wrap
from typing import TYPE_CHECKING, Any

from grasptrack.trackability.motions import SLIDING
from grasptrack.trackability.report import Row, expected, report_rows
from grasptrack.view.grasp_panel import LINE, NEIGHBOUR
from grasptrack.view.grasp_text import INK, MUTED, RULE
from grasptrack.view.style import STATUS_RGB, STRATEGY_RGB, hex_colour, text_width

if TYPE_CHECKING:
    from grasptrack.trackability import Suitability
    from grasptrack.trackability.motions import Motions

CLEAR, WEAK, BAD = (hex_colour(STATUS_RGB[s]) for s in ("tracked", "unstable", "lost"))
LEVEL = {"good": CLEAR, "fair": WEAK, "poor": BAD}
PEAK = hex_colour(STRATEGY_RGB["grasp-line"])
_REASONS = 3
"""Reasons that are written out."""


class Sheet:
    """The column beside the picture, filled from the top.

    Args:
        figure: matplotlib's.
        size: of the figure in inches.
        box: left, bottom, width and height of the column in inches.
    """

    def __init__(self, figure: Any, size: tuple[float, float], box: tuple[float, float, float, float]) -> None:
        self._figure, self._size = figure, size
        self._left, self._bottom, self._width, height = box
        self._y = self._bottom + height

    def title(self, name: str, left: float) -> None:
        """What the picture is of, above everything."""
        short = name if len(name) <= 60 else name[:28] + "…" + name[-28:]
        self._write_text(left, self._size[1] - 0.42, short, 17.0, weight="bold")

    def verdict(self, found: Suitability) -> None:
        """The level on a coloured field, what a run will give, and what speaks against it with what would help."""
        self._draw_box(self._left, self._size[1] - 0.62, 1.2, 0.46, LEVEL[found.level])
        self._write_text(
            self._left + 0.6, self._size[1] - 0.46, found.level.upper(), 17.0, weight="bold", color="white", ha="center"
        )
        taken = f"--strategy {found.strategy}" if found.strategy else "no strategy will do"
        self._write_text(self._left + 1.35, self._size[1] - 0.44, taken, 13.0, weight="bold")
        if told := expected(found):
            self._write_lines(_as_sentence(f"expected: {told}"), 10.5)
        if not found.reasons:
            self._write_lines("Nothing speaks against it.", 11.0)
        for reason in found.reasons[:_REASONS]:
            self._y -= 0.02
            self._draw_box(self._left, self._y - 0.21, 0.09, 0.15, WEAK)
            self._write_lines(_as_sentence(reason.text), 11.0, indent=0.2)
            if reason.advice:
                self._write_lines(f"Would help: {reason.advice}.", 10.5, indent=0.2, color=MUTED)
        if len(found.reasons) > _REASONS:
            self._write_lines(
                f"and {len(found.reasons) - _REASONS} more in inspect.json", 10.5, indent=0.2, color=MUTED
            )

    def motions(self, motions: Motions) -> None:
        """A bar for each motion, as much of it as moves the edges, and whether it is told from the others."""
        self._y -= 0.36
        self._write_text(self._left, self._y, "What moves the edges", 12.5, weight="bold")
        self._write_text(self._left + self._width, self._y, "told from all others", 10.5, color=MUTED, ha="right")
        start, room = self._left + 1.15, self._width - 3.25
        top = self._y
        for motion in motions.motions:
            self._y -= 0.235
            seen = "homography" in motion.observed
            self._write_text(self._left, self._y, motion.name, 10.5)
            self._draw_box(start, self._y - 0.02, room, 0.14, RULE)
            self._draw_box(start, self._y - 0.02, room * min(motion.shown, 1.0), 0.14, CLEAR if seen else BAD)
            self._write_text(start + room + 0.12, self._y, f"{100.0 * motion.shown:.0f} %", 10.5)
            flat = "also under tilt" if seen else "only while flat" if "similarity" in motion.observed else "no"
            self._write_text(self._left + self._width, self._y, flat, 10.5, color=INK if seen else BAD, ha="right")
        mark = start + room * SLIDING
        self._draw_box(mark, self._y - 0.05, 0.015, top - self._y - 0.05, INK)
        self._y -= 0.03

    def table(self, found: Suitability) -> None:
        """The rows of the terminal's table, as far as they fit."""
        self._y -= 0.14
        for row in report_rows(found):
            if row.name == "motions":
                continue
            self._write_row(row)

    def _write_row(self, row: Row) -> None:
        start = self._left + 2.35
        lines = _wrap_to_width(row.note, self._width - 2.35, 10.0) or [""]
        if self._y - 0.2 * len(lines) < 0.1:
            return
        self._y -= 0.215
        self._write_text(self._left, self._y, row.name, 10.5, color=MUTED)
        colour = BAD if row.value in ("no", "none", "not fixed") and row.name not in ("symmetry",) else INK
        self._write_text(self._left + 1.05, self._y, row.value, 10.5, weight="bold", color=colour)
        for i, line in enumerate(lines):
            self._y -= 0.17 * (i > 0)
            self._write_text(start, self._y, line, 10.0)

    def _write_lines(self, text: str, size: float, indent: float = 0.0, **more: Any) -> None:
        for line in _wrap_to_width(text, self._width - indent, size):
            self._y -= 0.21
            self._write_text(self._left + indent, self._y, line, size, **more)

    def _draw_box(self, left: float, bottom: float, width: float, height: float, colour: str) -> None:
        from matplotlib.patches import Rectangle

        wide, high = self._size
        place = (left / wide, bottom / high), width / wide, height / high
        self._figure.add_artist(Rectangle(*place, facecolor=colour, transform=self._figure.transFigure))

    def _write_text(self, x: float, y: float, text: str, size: float, **more: Any) -> None:
        style = {"color": INK, "va": "baseline", "parse_math": False, **more}
        self._figure.text(x / self._size[0], y / self._size[1], text, fontsize=size, **style)


def _as_sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


def _wrap_to_width(text: str, room: float, size: float) -> list[str]:
    """Lines of a text that are at most so many inches wide at a size in points."""
    whole = max(text_width(text, 100) / 7200.0 * size, 1e-6)
    return wrap(text, max(12, int(0.97 * len(text) * room / whole))) if text else []


def draw_legend(axes: Any, found: Suitability, times: float) -> None:
    """What is what, below the large panel."""
    from matplotlib.lines import Line2D

    from grasptrack.trackability.report import FAINT

    edges = found.edges
    weak = edges.clear & (edges.strength < FAINT)
    handles: list[Any] = [Line2D([], [], color=CLEAR, lw=4, label="clear edge")]
    if weak.any():
        handles.append(Line2D([], [], color=WEAK, lw=4, label="faint edge"))
    if not edges.clear.all():
        handles.append(Line2D([], [], color=BAD, lw=5, label="no edge"))
    if len(found.peaks):
        handles.append(Line2D([], [], color=PEAK, marker="D", ms=7, lw=0, label="peaks"))
    if found.motions.slide is not None:
        handles.append(Line2D([], [], color=BAD, marker=r"$\rightarrow$", ms=14, lw=0, label="outline slides"))
    if found.symmetry.every or found.symmetry.turns:
        ring: dict[str, Any] = {"marker": "o", "ms": 9, "mfc": "none", "mew": 2.0}
        handles.append(Line2D([], [], color=MUTED, lw=0, label="ways it fits itself", **ring))
    if found.equals:
        handles.append(Line2D([], [], color=NEIGHBOUR, lw=1.6, ls=(0, (4, 3)), label="its equals"))
    if found.grasp is not None:
        large = ", not fixed" if found.by == "nothing" else "" if times == 1.0 else f", drawn {times:g} ×"
        label = f"95 % of the errors{large}"
        handles.append(Line2D([], [], color=LINE, lw=2, marker="o", mec="white", label="grasp"))
        handles.append(Line2D([], [], color=INK, marker="o", ms=12, mfc="none", lw=0, label=label))
    place = {"loc": "upper left", "bbox_to_anchor": (0.0, -0.005), "borderaxespad": 0.3, "borderpad": 0.0}
    style = {
        "frameon": False,
        "fontsize": 11 if len(handles) < 7 else 10,
        "labelcolor": INK,
        "handlelength": 1.6,
        "columnspacing": 1.2,
    }
    axes.legend(handles=handles, ncols=len(handles), **place, **style)
