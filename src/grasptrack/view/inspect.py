# SPDX-License-Identifier: Apache-2.0
"""An inspection on one page: the object with what its outline shows and does not, and beside it why."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.trackability.motions import sliding_displacement
from grasptrack.typing import Floats
from grasptrack.view.grasp_panel import DARK, LINE, Panel, mute_image
from grasptrack.view.inspect_text import BAD, CLEAR, PEAK, WEAK, Sheet, draw_legend
from grasptrack.view.layout import image_window, quiet_corner

if TYPE_CHECKING:
    from grasptrack.trackability import Suitability
    from grasptrack.trackability.result import Held


WIDTH, HEIGHT = 16.0, 9.0
"""inches; at 100 px each, a slide of 1600 by 900 px."""
_DPI = 100
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
_MANY = 24
"""Turns of a symmetry that are drawn one by one."""


def write_inspection(path: Path, image: NDArray[Any], found: Suitability, *, title: str) -> None:
    """Write the page, 1600 by 900 px, as PNG. The file is complete at any moment or absent.

    Args:
        path: the picture.
        image: (H, W), BGR (H, W, 3) or BGRA (H, W, 4), 8 or 16 bits.
        found: what was found in it.
        title: what the image is called.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, HEIGHT), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    picture = mute_image(image)
    left, bottom, width, height = _MAIN
    seen = [found.view.points, *(v.outer.points for v in found.equals[:1])]
    shown = image_window(seen, [], (picture.shape[0], picture.shape[1]), width / height, 0.16, 1.3)
    axes = figure.add_axes((left / WIDTH, bottom / HEIGHT, width / WIDTH, height / HEIGHT))
    panel = Panel(axes, picture, shown, (72.0 * width, 72.0 * height))
    times = ellipse_magnification(found, panel.px_per_point)
    panel.neighbours(found.equals, 1.6)
    _draw_outline(panel, found)
    _draw_symmetry(panel, found)
    _draw_slides(panel, found)
    if len(found.peaks):
        panel.axes.plot(*found.peaks.T, "D", color=PEAK, ms=8.0, mec=DARK, mew=1.2, zorder=4)
    if found.grasp is not None:
        _draw_grasp(panel, found.grasp, times)
    draw_legend(axes, found, times)
    sheet = Sheet(figure, (WIDTH, HEIGHT), _RIGHT)
    sheet.title(title, left)
    sheet.verdict(found)
    sheet.motions(found.motions)
    sheet.table(found)
    partial = path.with_name(path.name + ".part")
    figure.savefig(partial, dpi=_DPI, format="png")
    partial.replace(path)


def ellipse_magnification(found: Suitability, px_per_point: float) -> float:
    """How many times larger than they are ellipses of error are drawn: 1, 2 or 5 with as many zeros as make them seen."""
    if found.grasp is None:
        return 1.0
    largest = _INSIDE_95 * math.sqrt(float(np.linalg.eigvalsh(found.grasp.covariance).max()))
    wanted = max(_ELLIPSE * px_per_point / max(largest, 1e-9), 1.0)
    power = 10.0 ** math.floor(math.log10(wanted))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted)


def _draw_outline(panel: Panel, found: Suitability) -> None:
    """The outline, each part in the colour of its edge, on one dark casing."""
    from grasptrack.trackability.report import FAINT

    edges = found.edges
    for i, contour in enumerate(found.view.contours):
        own = edges.contour == i
        points = np.vstack([contour.points, contour.points[:1]])
        panel.axes.plot(points[:, 0], points[:, 1], color=DARK, lw=5.6, alpha=0.75, solid_capstyle="butt")
        cut = np.zeros(len(contour), np.bool_) if contour.clipped is None else contour.clipped
        kind = np.where(cut, 3, np.where(~edges.clear[own], 2, np.where(edges.strength[own] < FAINT, 1, 0)))
        ends = [0, *(np.flatnonzero(np.diff(kind)) + 1).tolist(), len(kind)]
        for start, end in pairwise(ends):
            colour, wide = ((CLEAR, 3.0), (WEAK, 3.0), (BAD, 4.4), ("white", 1.2))[int(kind[start])]
            panel.axes.plot(*points[start : end + 1].T, color=colour, lw=wide, solid_capstyle="butt", zorder=3)


def _draw_slides(panel: Panel, found: Suitability) -> None:
    """Arrows along the outline: the motion that its edges show least, where the tracker takes it as not seen."""
    from matplotlib.patheffects import withStroke

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
        arrow = {"arrowstyle": "-|>,head_width=0.3,head_length=0.5", "color": BAD, "lw": 2.0, "mutation_scale": 12.0}
        arrow.update(shrinkA=0.0, shrinkB=0.0, path_effects=[withStroke(linewidth=4.0, foreground=DARK)])
        panel.axes.annotate("", point + 0.5 * way, xytext=point - 0.5 * way, arrowprops=arrow, zorder=5)


def _draw_symmetry(panel: Panel, found: Suitability) -> None:
    """A ring about the centre with a tick for each way in which the outline fits itself."""
    symmetry, frame = found.symmetry, found.motions.frame
    if not symmetry.every and not symmetry.turns:
        return
    radius = min(max(0.13 * found.looks.size, 26.0 * panel.px_per_point), 60.0 * panel.px_per_point)
    centre = _free_place(panel, found, radius)
    around = np.linspace(0.0, 2.0 * math.pi, 121)
    panel.line(centre + radius * np.column_stack([np.cos(around), np.sin(around)]), "white", 1.6)
    start = math.degrees(math.atan2(frame.axes[0, 1], frame.axes[0, 0]))
    if not symmetry.every and len(symmetry.turns) < _MANY:
        for turn in (0.0, *symmetry.turns):
            way = np.array([math.cos(math.radians(start + turn)), math.sin(math.radians(start + turn))])
            panel.line(centre + radius * np.outer([0.72, 1.28], way), "white", 2.4)
    text = "every turn" if symmetry.every else f"alike {symmetry.order} ×"
    style = {"ha": "center", "va": "center", "fontsize": 11.0, "fontweight": "bold", "color": "white", "zorder": 6}
    box = {"boxstyle": "round,pad=0.25", "fc": DARK, "ec": "none", "alpha": 0.75}
    panel.axes.text(*centre, text, bbox=box, **style)


def _free_place(panel: Panel, found: Suitability, radius: float) -> Floats:
    """The object's centre, or where the grasp is there a corner of the picture."""
    centre = found.motions.frame.centre
    if found.grasp is None or np.hypot(*(found.grasp.contacts - centre).T).min() > 2.0 * radius:
        return centre
    left, top, right, bottom = panel.window
    share = 3.0 * radius / min(right - left, bottom - top)
    corner = quiet_corner(panel.window, share, found.view.points, [v.outer.points for v in found.equals])
    if corner is None:
        return centre
    x = right - 1.6 * radius if corner % 2 else left + 1.6 * radius
    return np.array([x, bottom - 1.6 * radius if corner // 2 else top + 1.6 * radius])


def _draw_grasp(panel: Panel, grasp: Held, times: float) -> None:
    """The line between the contacts, and round each the ellipse that holds it with 95 %, enlarged."""
    from matplotlib.patches import Ellipse

    contacts = grasp.contacts
    middle = contacts.mean(axis=0)
    for spoke in [contacts] if len(contacts) == 2 else [np.vstack([middle, c]) for c in contacts]:
        panel.line(spoke, LINE, 2.0)
    for i, (contact, covariance) in enumerate(zip(contacts, grasp.covariance, strict=True)):
        size, V = np.linalg.eigh(covariance)
        half = times * _INSIDE_95 * np.sqrt(np.maximum(size, 0.0))
        open_ended = half.max() > _FARTHEST * panel.px_per_point
        half = np.clip(half, 2.0 * panel.px_per_point, _FARTHEST * panel.px_per_point)
        turn = math.degrees(math.atan2(V[1, 1], V[0, 1]))
        style = (0, (2, 1.5)) if open_ended else "-"
        for colour, wide in ((DARK, 4.0), ("white", 2.0)):
            ring = Ellipse(
                tuple(contact),
                2.0 * half[1],
                2.0 * half[0],
                angle=turn,
                fill=False,
                ec=colour,
                lw=wide,
                ls=style,
                zorder=5,
            )
            panel.axes.add_patch(ring)
        panel.axes.plot(*contact, "o", color=LINE, ms=7.0, mec="white", mew=1.4, zorder=6)
        away = contact - middle
        away /= max(float(np.hypot(*away)), 1e-9)
        reach = math.sqrt(float(away @ V @ np.diag(half**2) @ V.T @ away))
        panel.label(str(i + 1), contact + (min(reach, 60.0 * panel.px_per_point) + 15.0 * panel.px_per_point) * away)
