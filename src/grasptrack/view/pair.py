# SPDX-License-Identifier: Apache-2.0
"""The same grasp in two views: the reference on the left, each strategy's answer on the right."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from textwrap import wrap
from typing import Any

from numpy.typing import NDArray

from grasptrack.errors import one_line
from grasptrack.geometry.contours import View
from grasptrack.typing import Floats
from grasptrack.view.draw import as_bgr, grasp_spokes, outward_directions
from grasptrack.view.panel import Panel
from grasptrack.view.style import INK, STATUS_RGB, STRATEGY_RGB, add_legend, create_figure, hex_colour, save_whole

# Open marks of nested sizes: where strategies agree none hides another, and the outline is seen within the smallest.
_MARKS = {"registration": ("h", 24), "rrp": ("s", 18), "grasp-line": ("D", 12), "homography": ("o", 9)}
_RGB = {"registration": (0, 158, 115), **STRATEGY_RGB}
_OTHER = ("^", 15), (120, 100, 80)  # of a strategy that another package registered
_GRASP_RGB = STATUS_RGB["tracked"]
_REFERENCE = 11.0
"""Points, size of a mark in the reference view."""
_GAP = 0.2
"""Inches between the views."""


def write_pair(
    path: Path,
    reference: tuple[NDArray[Any], View, Floats],
    current: tuple[NDArray[Any], View],
    transferred: Mapping[str, Floats],
    refused: Mapping[str, str],
    titles: tuple[str, str] = ("reference", "current"),
) -> None:
    """Write a picture of both views.

    Args:
        path: the picture.
        reference: image, outline and contacts (k, 2) px of the reference view.
        current: image and outline of the current view.
        transferred: contacts (k, 2) px in the current view for each strategy that carried the grasp.
        refused: the reason for each strategy that did not.
        titles: what the views are called.
    """
    from matplotlib.lines import Line2D

    image, view, contacts = reference
    ratios = [i.shape[1] / i.shape[0] for i in (image, current[0])]
    tall = min((13.4 - _GAP) / sum(ratios), 9.0)
    figure = create_figure(13.4, tall, facecolor="white")
    left = _add_view(figure, image, view, (0.0, tall * ratios[0], tall), titles[0])
    right = _add_view(figure, *current, (tall * ratios[0] + _GAP, tall * ratios[1], tall), titles[1])
    _draw_open_marks(left.axes, contacts, hex_colour(_GRASP_RGB), "o", _REFERENCE)
    _draw_numbers(left, contacts)
    handles = []
    for name, found in transferred.items():
        colour, (mark, size) = hex_colour(_RGB.get(name, _OTHER[1])), _MARKS.get(name, _OTHER[0])
        _draw_open_marks(right.axes, found, colour, mark, size)
        handles.append(_legend_handle(colour, mark, size, name))
    if transferred:
        _draw_numbers(right, next(iter(transferred.values())))
    for name, reason in refused.items():
        handles.append(Line2D([], [], lw=0, label="\n".join(wrap(f"{name} refused: {reason}", 80))))
    add_legend(left.axes, [_legend_handle(hex_colour(_GRASP_RGB), "o", _REFERENCE, "the grasp")])
    add_legend(right.axes, handles, most=1)
    save_whole(figure, path, 110, bbox_inches="tight", pad_inches=0.2)


def _add_view(figure: Any, image: NDArray[Any], view: View, place: tuple[float, float, float], title: str) -> Panel:
    """A whole image with its outline, `place` being left, width and height in inches."""
    (left, width, height), whole = place, figure.get_figwidth()
    axes = figure.add_axes((left / whole, 0.0, width / whole, 1.0))
    shown = -0.5, -0.5, image.shape[1] - 0.5, image.shape[0] - 0.5
    panel = Panel(axes, as_bgr(image)[:, :, ::-1], shown, (72.0 * width, 72.0 * height))
    panel.draw_outline(view, 1.0)
    axes.set_title(one_line(title), fontsize=12, color=INK, loc="left", parse_math=False)
    return panel


def _draw_numbers(panel: Panel, contacts: Floats) -> None:
    places = contacts + 28.0 * panel.px_per_point * outward_directions(contacts)
    for i, place in enumerate(places):
        panel.draw_label(str(i + 1), place, 9.0)


def _draw_open_marks(axes: Any, contacts: Floats, colour: str, mark: str, size: float) -> None:
    """Lines end at the marks, and marks are open: what lies below a contact stays visible."""
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.patheffects import withStroke

    both = len(contacts) == 2  # else a spoke begins in the middle
    for start, end in grasp_spokes(contacts):
        inner = 0.5 * size if both else 0.0
        axes.add_patch(
            FancyArrowPatch(start, end, arrowstyle="-", color=colour, lw=1.8, shrinkA=inner, shrinkB=0.5 * size)
        )
    casing = [withStroke(linewidth=4.2, foreground="white")]
    style: dict[str, Any] = {"mfc": "none", "mec": colour, "ms": size, "mew": 2.0, "zorder": 3}
    axes.plot(contacts[:, 0], contacts[:, 1], mark, path_effects=casing, **style)


def _legend_handle(colour: str, mark: str, size: float, label: str) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], color=colour, marker=mark, ms=min(size, 11.0), mfc="none", mew=2.0, lw=0, label=label)
