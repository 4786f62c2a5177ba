# SPDX-License-Identifier: Apache-2.0
"""Synthesised grasps on one page: the best one large, the next ones small, and what the best one's rank rests on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import GraspList, RankedGrasp
from grasptrack.grasp.hand import HandPx
from grasptrack.typing import Floats
from grasptrack.view.panel import (
    FINGER,
    PAGE,
    PAGE_DPI,
    Panel,
    TextColumn,
    add_panel,
    aspect_of,
    draw_legend,
    grasp_opening,
    image_window,
    mute_image,
    panel_grid,
    quiet_corner,
)
from grasptrack.view.style import INK, MUTED, create_figure, save_whole, text_width

_ROW = 0.29


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


class GraspColumn(TextColumn):
    """What the picture says beside its panels: the best grasp, or why there is none, and captions."""

    def free_box(self) -> tuple[float, float, float, float]:
        """left, bottom, width and height in inches of what is left of the column."""
        return self._left, self._bottom, self._width, self._y - self._bottom

    def write_best(self, grasp: RankedGrasp, px_per_mm: float | None, cut: bool) -> None:
        """The best grasp: what it is, and its quality with the terms that it is the product of."""
        kind = "spread: pushed outward" if grasp.spread else "squeezed"
        self.write_heading(f"Grasp 1, {kind}")
        mm = "" if px_per_mm is None else f" ({grasp_opening(grasp) / px_per_mm:.1f} mm)"
        slip = "/".join(f"{r:.0f}" if r >= 9.5 else f"{r:.1f}" for r in grasp.regions.tolist())
        facts = (
            f"opening {grasp_opening(grasp):.0f} px{mm}    margin {math.degrees(grasp.margin):.1f}°    slip ± {slip} px"
        )
        self.write_lines(facts)
        if cut:
            self.write_lines("Cut by the border: the centre is that of the part in view.")
        self._y -= 0.06
        self._write_bar("quality", grasp.quality, INK)
        for name, value in grasp.terms._asdict().items():
            self._write_bar(name, value, FINGER)
        self._y -= 0.14

    def write_no_grasp(self, grasps: GraspList) -> None:
        """Why there is no grasp, and how many candidates fell to what."""
        self.write_heading("No grasp")
        self.write_lines(grasps.reason)
        if grasps.refused:
            self._y -= 0.1
            self.write_heading("Candidates refused")
            for reason, count in list(grasps.refused.items())[:12]:
                self.write_lines(f"{count} ×  {reason}")

    def write_caption(self, box: tuple[float, float, float, float], rank: str, text: str) -> None:
        """Rank and a few words above a small panel."""
        left, y = box[0], box[1] + box[3] + 0.07
        start = 0.13 + 0.09 * len(rank)
        wide = text_width(text, 100) / 7200.0  # inches at one point
        self._write_text(left, y, rank, 11.0, weight="bold")
        self._write_text(left + start, y, text, min(10.0, 0.92 * (box[2] - start) / wide), color=MUTED)

    def _write_bar(self, name: str, value: float, colour: str) -> None:
        self._y -= _ROW
        weight = "bold" if name == "quality" else "normal"
        self._write_text(self._left, self._y, name, 11.0, weight=weight)
        self._draw_bar(self._left + 0.85, self._width - 1.45, 0.17, value, colour)
        self._write_text(self._left + self._width, self._y, format_quality(value), 11.0, weight=weight, ha="right")


SHOWN = 9
"""Grasps, or objects, that get a small panel."""
_MAIN = (0.2, 0.62, 9.7, 7.7)
_RIGHT = (10.2, 0.25, 5.6, 8.07)
_INSET, _LARGER = 0.4, 1.8
"""Share of the large panel that an inset takes, and by how much it must enlarge to be worth that."""


class Planned(NamedTuple):
    """What was found for one object.

    Attributes:
        outline: the object.
        neighbours: outlines of what else lies there.
        hand: on this object, px.
        grasps: best first, and why others were refused.
    """

    outline: View
    neighbours: Sequence[View]
    hand: HandPx
    grasps: GraspList


def write_grasps(
    path: Path,
    image: NDArray[Any],
    objects: Sequence[Planned],
    *,
    fingers: int,
    friction: float,
    title: str,
    px_per_mm: float | None = None,
) -> None:
    """Write the page, 1600 by 900 px, as PNG. The file is complete at any moment or absent.

    One object gets its best grasp large and the next ones small. Several get their best grasps in one large panel, and
    a small panel each.
    """
    figure = create_figure(*PAGE, dpi=PAGE_DPI, facecolor="white")
    picture = mute_image(image)
    column = GraspColumn(figure, _RIGHT)
    _draw_main_panel(figure, picture, objects, friction)
    hands = {describe_hand(o.hand, px_per_mm) for o in objects}
    size = f" {hands.pop()}" if len(hands) == 1 else ""
    column.write_title(title, _MAIN[0], f"{fingers} fingers{size}, friction {friction:g}")
    if len(objects) > 1:
        _draw_each_object(figure, picture, objects, column, px_per_mm)
    elif objects[0].grasps:
        column.write_best(objects[0].grasps[0], px_per_mm, objects[0].outline.is_clipped)
        _draw_next_best(figure, picture, objects[0], column, px_per_mm)
    else:
        column.write_no_grasp(objects[0].grasps)
    save_whole(figure, path, PAGE_DPI)


def _draw_main_panel(figure: Any, picture: NDArray[np.uint8], objects: Sequence[Planned], friction: float) -> None:
    several = len(objects) > 1
    best = [o.grasps[0] for o in objects if o.grasps]
    outlines, fingers = [o.outline.points for o in objects], [g.swept for g in best]
    shown = image_window(outlines, fingers, picture.shape, _MAIN[2] / _MAIN[3], 0.1, 1.7)
    panel = add_panel(figure, picture, shown, _MAIN)
    if not several:
        panel.draw_neighbours(objects[0].neighbours)
    for o in objects:
        panel.draw_outline(o.outline, 1.8)
    for i, o in enumerate(objects):
        if o.grasps and several:
            panel.draw_small_grasp(o.grasps[0])
        elif o.grasps and not _close_up(figure, picture, panel, o, friction):
            panel.draw_grasp(o.grasps[0], o.outline, friction)
        if several:
            panel.draw_label(str(i + 1), _number_position(o), 9.0)
    alone = bool(best) and not several
    marks: dict[str, str | bool] = {"finger": bool(best), "its way in": alone, "friction cone": alone}
    marks |= {"where it may slip to": alone, "grasp": "contacts" if best else False}
    draw_legend(panel.axes, {**marks, "neighbours": not several and bool(objects[0].neighbours)})


def _close_up(figure: Any, picture: NDArray[np.uint8], panel: Panel, found: Planned, friction: float) -> bool:
    """Where the grasp is small on the object: draw it large in a corner that hides neither, if there is one."""
    grasp, outline = found.grasps[0], found.outline.points
    left, bottom, width, height = _MAIN
    size = width * _INSET, height * _INSET
    near = image_window([grasp.swept.reshape(-1, 2)], [], picture.shape, size[0] / size[1], 0.25)
    if _LARGER * (near[2] - near[0]) > _INSET * (panel.window[2] - panel.window[0]):
        return False
    seen = np.vstack([outline, [near[:2], near[2:], (near[0], near[3]), (near[2], near[1])]])
    corner = quiet_corner(panel.window, _INSET, seen, [o.outer.points for o in found.neighbours])
    if corner is None:
        return False
    place = left + (width - size[0]) * (corner % 2), bottom + (height - size[1]) * (corner < 2), *size
    inset = add_panel(figure, picture, near, place)
    for side in inset.axes.spines.values():
        side.set(visible=True, color="white", linewidth=2.0)
    inset.draw_neighbours(found.neighbours)
    inset.draw_outline(found.outline, 1.6)
    inset.draw_grasp(grasp, found.outline, friction)
    panel.draw_small_grasp(grasp)
    panel.draw_rectangle(inset.window)
    return True


def _draw_next_best(
    figure: Any, picture: NDArray[np.uint8], found: Planned, column: GraspColumn, px_per_mm: float | None
) -> None:
    """The grasps after the best one, all in the same window."""
    rest = found.grasps[1 : 1 + SHOWN]
    if not rest:
        return
    left = len(found.grasps) - 1 - len(rest)
    column.write_heading("The next best" + (f", and {left} more in grasps.json" if left else ""))
    outline, fingers = found.outline.points, [g.fingers for g in rest]
    boxes = panel_grid(column.free_box(), len(rest), aspect_of(outline))
    for i, (box, grasp) in enumerate(zip(boxes, rest, strict=True)):
        shown = image_window([outline], fingers, picture.shape, box[2] / box[3], 0.05)
        panel = add_panel(figure, picture, shown, box)
        panel.draw_outline(found.outline, 1.0)
        panel.draw_small_grasp(grasp)
        column.write_caption(box, str(i + 2), describe_grasp(grasp, px_per_mm))


def _draw_each_object(
    figure: Any, picture: NDArray[np.uint8], objects: Sequence[Planned], column: GraspColumn, px_per_mm: float | None
) -> None:
    """Every object with its best grasp, or the word that there is none."""
    left = len(objects) - SHOWN
    column.write_heading("The best on each object" + (f", and {left} more in grasps.json" if left > 0 else ""))
    boxes = panel_grid(column.free_box(), min(len(objects), SHOWN), 1.0)
    for i, (box, found) in enumerate(zip(boxes, objects, strict=False)):
        best = found.grasps[:1]
        fingers = [g.fingers for g in best]
        shown = image_window([found.outline.points], fingers, picture.shape, box[2] / box[3], 0.05)
        panel = add_panel(figure, picture, shown, box)
        panel.draw_outline(found.outline, 1.0)
        for grasp in best:
            panel.draw_small_grasp(grasp)
        column.write_caption(box, str(i + 1), describe_grasp(best[0], px_per_mm) if best else "no grasp")


def _number_position(found: Planned) -> Floats:
    """Where an object's number hides nothing of its grasp: of its four outermost points the one farthest from it."""
    points = found.outline.outer.points
    ends = points[[points[:, 1].argmin(), points[:, 0].argmax(), points[:, 0].argmin(), points[:, 1].argmax()]]
    if not found.grasps:
        return np.asarray(ends[0])
    away = np.linalg.norm(ends[:, None] - found.grasps[0].contacts, axis=2).min(axis=1)
    return np.asarray(ends[int(away.argmax())])
