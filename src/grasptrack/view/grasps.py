# SPDX-License-Identifier: Apache-2.0
"""Synthesised grasps on one page: the best one large, the next ones small, and what the best one's rank rests on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats
from grasptrack.view.grasp_panel import Panel, mute_image
from grasptrack.view.grasp_text import Column, describe_grasp, describe_hand, draw_legend
from grasptrack.view.layout import Box, Window, aspect_of, image_window, panel_grid, quiet_corner

if TYPE_CHECKING:
    from grasptrack.geometry.contours import View
    from grasptrack.grasp.contacts import GraspList
    from grasptrack.grasp.hand import HandPx

WIDTH, HEIGHT = 16.0, 9.0
"""inches; at 100 px each, a slide of 1600 by 900 px."""
SHOWN = 9
"""Grasps, or objects, that get a small panel."""
_DPI = 100
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

    Args:
        path: the picture.
        image: (H, W), BGR (H, W, 3) or BGRA (H, W, 4), 8 or 16 bits.
        objects: at least one; grasps may be missing.
        fingers: of the hand.
        friction: coefficient, which gives the cones their angle.
        title: what the image is called.
        px_per_mm: scale; openings are given in mm too.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, HEIGHT), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    picture = mute_image(image)
    column = Column(figure, (WIDTH, HEIGHT), _RIGHT)
    _draw_main_panel(figure, picture, objects, friction)
    hands = {describe_hand(o.hand, px_per_mm) for o in objects}
    size = f" {hands.pop()}" if len(hands) == 1 else ""
    column.title(title, f"{fingers} fingers{size}, friction {friction:g}", _MAIN[0])
    if len(objects) > 1:
        _draw_each_object(figure, picture, objects, column, px_per_mm)
    elif objects[0].grasps:
        column.best(objects[0].grasps[0], px_per_mm, objects[0].outline.is_clipped)
        _draw_next_best(figure, picture, objects[0], column, px_per_mm)
    else:
        column.nothing(objects[0].grasps)
    partial = path.with_name(path.name + ".part")
    figure.savefig(partial, dpi=_DPI, format="png")
    partial.replace(path)


def _draw_main_panel(figure: Any, picture: NDArray[np.uint8], objects: Sequence[Planned], friction: float) -> None:
    several = len(objects) > 1
    best = [o.grasps[0] for o in objects if o.grasps]
    outlines, fingers = [o.outline.points for o in objects], [g.swept for g in best]
    shown = image_window(outlines, fingers, _image_size(picture), _MAIN[2] / _MAIN[3], 0.1, 1.7)
    panel = _add_panel(figure, picture, shown, _MAIN)
    if not several:
        panel.neighbours(objects[0].neighbours)
    for o in objects:
        panel.outline(o.outline, 1.8)
    for i, o in enumerate(objects):
        if o.grasps and several:
            panel.small_grasp(o.grasps[0])
        elif o.grasps and not _close_up(figure, picture, panel, o, friction):
            panel.grasp(o.grasps[0], o.outline, friction)
        if several:
            panel.label(str(i + 1), _number_position(o), 9.0)
    draw_legend(panel.axes, bool(best), several, any(o.neighbours for o in objects))


def _close_up(figure: Any, picture: NDArray[np.uint8], panel: Panel, found: Planned, friction: float) -> bool:
    """Where the grasp is small on the object: draw it large in a corner that hides neither, if there is one."""
    grasp, outline = found.grasps[0], found.outline.points
    left, bottom, width, height = _MAIN
    size = width * _INSET, height * _INSET
    near = image_window([grasp.swept.reshape(-1, 2)], [], _image_size(picture), size[0] / size[1], 0.25)
    if _LARGER * (near[2] - near[0]) > _INSET * (panel.window[2] - panel.window[0]):
        return False
    seen = np.vstack([outline, [near[:2], near[2:], (near[0], near[3]), (near[2], near[1])]])
    corner = quiet_corner(panel.window, _INSET, seen, [o.outer.points for o in found.neighbours])
    if corner is None:
        return False
    place = left + (width - size[0]) * (corner % 2), bottom + (height - size[1]) * (corner < 2), *size
    inset = _add_panel(figure, picture, near, place)
    inset.frame()
    inset.neighbours(found.neighbours)
    inset.outline(found.outline, 1.6)
    inset.grasp(grasp, found.outline, friction)
    panel.small_grasp(grasp)
    panel.mark(inset.window)
    return True


def _draw_next_best(
    figure: Any, picture: NDArray[np.uint8], found: Planned, column: Column, px_per_mm: float | None
) -> None:
    """The grasps after the best one, all in the same window."""
    rest = found.grasps[1 : 1 + SHOWN]
    if not rest:
        return
    left = len(found.grasps) - 1 - len(rest)
    column.heading("The next best" + (f", and {left} more in grasps.json" if left else ""))
    outline, fingers = found.outline.points, [g.fingers for g in rest]
    boxes = panel_grid(column.free(), len(rest), aspect_of(outline))
    for i, (box, grasp) in enumerate(zip(boxes, rest, strict=True)):
        shown = image_window([outline], fingers, _image_size(picture), box[2] / box[3], 0.05)
        panel = _add_panel(figure, picture, shown, box)
        panel.outline(found.outline, 1.0)
        panel.small_grasp(grasp)
        column.caption(box, str(i + 2), describe_grasp(grasp, px_per_mm))


def _draw_each_object(
    figure: Any, picture: NDArray[np.uint8], objects: Sequence[Planned], column: Column, px_per_mm: float | None
) -> None:
    """Every object with its best grasp, or the word that there is none."""
    left = len(objects) - SHOWN
    column.heading("The best on each object" + (f", and {left} more in grasps.json" if left > 0 else ""))
    boxes = panel_grid(column.free(), min(len(objects), SHOWN), 1.0)
    for i, (box, found) in enumerate(zip(boxes, objects, strict=False)):
        best = found.grasps[:1]
        fingers = [g.fingers for g in best]
        shown = image_window([found.outline.points], fingers, _image_size(picture), box[2] / box[3], 0.05)
        panel = _add_panel(figure, picture, shown, box)
        panel.outline(found.outline, 1.0)
        for grasp in best:
            panel.small_grasp(grasp)
        column.caption(box, str(i + 1), describe_grasp(best[0], px_per_mm) if best else "no grasp")


def _add_panel(figure: Any, picture: NDArray[np.uint8], shown: Window, box: Box) -> Panel:
    left, bottom, width, height = box
    axes = figure.add_axes((left / WIDTH, bottom / HEIGHT, width / WIDTH, height / HEIGHT))
    return Panel(axes, picture, shown, (72.0 * width, 72.0 * height))


def _number_position(found: Planned) -> Floats:
    """Where an object's number hides nothing of its grasp: of its four outermost points the one farthest from it."""
    points = found.outline.outer.points
    ends = points[[points[:, 1].argmin(), points[:, 0].argmax(), points[:, 0].argmin(), points[:, 1].argmax()]]
    if not found.grasps:
        return np.asarray(ends[0])
    away = np.linalg.norm(ends[:, None] - found.grasps[0].contacts, axis=2).min(axis=1)
    return np.asarray(ends[int(away.argmax())])


def _image_size(picture: NDArray[np.uint8]) -> tuple[int, int]:
    return picture.shape[0], picture.shape[1]
