# SPDX-License-Identifier: Apache-2.0
"""What the grasps' picture says in words and bars: headings, the best grasp's terms, captions and the legend."""

from __future__ import annotations

import math
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from grasptrack.view.fingers import grasp_opening
from grasptrack.view.grasp_panel import CONE, FINGER, LINE, NEIGHBOUR, REGION
from grasptrack.view.style import text_width

if TYPE_CHECKING:
    from grasptrack.grasp.contacts import GraspList, RankedGrasp
    from grasptrack.grasp.hand import HandPx

INK, MUTED, RULE = "#1d232b", "#5a6472", "#d5dae1"
_ROW = 0.29
_CHARACTERS = 64
"""That a line of 11 points in the column holds."""


def format_quality(quality: float) -> str:
    """A quality with two decimals, or so many more that something of a small one is seen."""
    return f"{quality:.2f}" if quality >= 0.01 else f"{quality:.1g}" if quality >= 0.001 else "<0.001"


def describe_hand(hand: HandPx, px_per_mm: float | None) -> str:
    """The hand on an object in a few words."""
    scale, unit = (1.0, "px") if px_per_mm is None else (px_per_mm, "mm")
    size = f"{hand.finger_width / scale:.3g} x {hand.finger_thickness / scale:.3g} {unit}"
    low, high = hand.min_opening / scale, hand.max_opening / scale
    if math.isfinite(high):
        return f"of {size}, opening {f'{low:.4g} to' if low else 'up to'} {high:.4g} {unit}"
    return f"of {size}" + (f", opening from {low:.4g} {unit}" if low else "")


def describe_grasp(grasp: RankedGrasp, px_per_mm: float | None) -> str:
    """Quality, opening and kind in a few words."""
    wide = f"{grasp_opening(grasp):.0f} px" if px_per_mm is None else f"{grasp_opening(grasp) / px_per_mm:.1f} mm"
    return f"{format_quality(grasp.quality)}  {wide}{'  spread' if grasp.spread else ''}"


class Column:
    """The column beside the large panel, filled from the top.

    Args:
        figure: matplotlib's.
        size: of the figure in inches.
        box: left, bottom, width and height of the column in inches.
    """

    def __init__(self, figure: Any, size: tuple[float, float], box: tuple[float, float, float, float]) -> None:
        self._figure, self._size = figure, size
        self._left, self._bottom, self._width, height = box
        self._y = self._bottom + height

    def free(self) -> tuple[float, float, float, float]:
        """left, bottom, width and height in inches of what is left of the column."""
        return self._left, self._bottom, self._width, self._y - self._bottom

    def title(self, name: str, more: str, left: float) -> None:
        """What the picture is of, above everything."""
        y = self._size[1] - 0.42
        short = name if len(name) <= 60 else name[:28] + "…" + name[-28:]
        self._write_text(left, y, short, 17.0, weight="bold")
        self._write_text(self._left + self._width, y, more, 12.0, color=MUTED, ha="right")

    def heading(self, text: str) -> None:
        """A line in bold."""
        self._y -= 0.3
        self._write_text(self._left, self._y, text, 13.0, weight="bold")
        self._y -= 0.1

    def best(self, grasp: RankedGrasp, px_per_mm: float | None, cut: bool) -> None:
        """The best grasp: what it is, and its quality with the terms that it is the product of."""
        kind = "spread: pushed outward" if grasp.spread else "squeezed"
        self.heading(f"Grasp 1, {kind}")
        mm = "" if px_per_mm is None else f" ({grasp_opening(grasp) / px_per_mm:.1f} mm)"
        slip = "/".join(f"{r:.0f}" if r >= 9.5 else f"{r:.1f}" for r in grasp.regions.tolist())
        facts = (
            f"opening {grasp_opening(grasp):.0f} px{mm}    margin {math.degrees(grasp.margin):.1f}°    slip ± {slip} px"
        )
        self._write_lines(facts)
        if cut:
            self._write_lines("Cut by the border: the centre is that of the part in view.")
        self._y -= 0.06
        self._draw_bar("quality", grasp.quality, INK)
        for name, value in grasp.terms._asdict().items():
            self._draw_bar(name, value, FINGER)
        self._y -= 0.14

    def nothing(self, grasps: GraspList) -> None:
        """Why there is no grasp, and how many candidates fell to what."""
        self.heading("No grasp")
        self._write_lines(grasps.reason)
        if grasps.refused:
            self._y -= 0.1
            self.heading("Candidates refused")
            for reason, count in list(grasps.refused.items())[:12]:
                self._write_lines(f"{count} ×  {reason}")

    def caption(self, box: tuple[float, float, float, float], rank: str, text: str) -> None:
        """Rank and a few words above a small panel."""
        left, y = box[0], box[1] + box[3] + 0.07
        start = 0.13 + 0.09 * len(rank)
        wide = text_width(text, 100) / 7200.0  # inches at one point
        self._write_text(left, y, rank, 11.0, weight="bold")
        self._write_text(left + start, y, text, min(10.0, 0.92 * (box[2] - start) / wide), color=MUTED)

    def _write_lines(self, text: str) -> None:
        for line in wrap(text, _CHARACTERS):
            self._y -= 0.21
            self._write_text(self._left, self._y, line, 11.0)

    def _draw_bar(self, name: str, value: float, colour: str) -> None:
        from matplotlib.patches import Rectangle

        self._y -= _ROW
        start, room = self._left + 0.85, self._width - 1.45
        weight = "bold" if name == "quality" else "normal"
        self._write_text(self._left, self._y, name, 11.0, weight=weight)
        for share, shade in ((1.0, RULE), (min(max(value, 0.0), 1.0), colour)):
            low, size = (start / self._size[0], (self._y - 0.02) / self._size[1]), share * room / self._size[0]
            bar = Rectangle(low, size, 0.17 / self._size[1], facecolor=shade, transform=self._figure.transFigure)
            self._figure.add_artist(bar)
        self._write_text(self._left + self._width, self._y, format_quality(value), 11.0, weight=weight, ha="right")

    def _write_text(self, x: float, y: float, text: str, size: float, **more: Any) -> None:
        style = {"color": INK, "va": "baseline", "parse_math": False, **more}
        self._figure.text(x / self._size[0], y / self._size[1], text, fontsize=size, **style)


def draw_legend(axes: Any, grasp: bool, several: bool, neighbours: bool) -> None:
    """What is what, below the large panel."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = []
    if grasp:
        handles.append(Patch(facecolor=FINGER, edgecolor=FINGER, alpha=0.7, label="finger"))
    if grasp and not several:
        handles.append(Line2D([], [], color=FINGER, lw=1.8, ls=(0, (3, 2)), label="its way in"))
        handles.append(Patch(facecolor=CONE, label="friction cone"))
        handles.append(Line2D([], [], color=REGION, lw=5, label="where it may slip to"))
    if grasp:
        handles.append(Line2D([], [], color=LINE, lw=2, marker="o", mec="white", label="contacts"))
    if neighbours and not several:
        handles.append(Line2D([], [], color=NEIGHBOUR, lw=1.6, ls=(0, (4, 3)), label="neighbours"))
    if handles:
        place = {"loc": "upper left", "bbox_to_anchor": (0.0, -0.005), "borderaxespad": 0.3, "borderpad": 0.0}
        style = {"frameon": False, "fontsize": 11, "labelcolor": INK, "handlelength": 1.8, "columnspacing": 1.5}
        axes.legend(handles=handles, ncols=len(handles), **place, **style)
