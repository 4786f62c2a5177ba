# SPDX-License-Identifier: Apache-2.0
"""The same grasp in two views: the reference on the left, each strategy's answer on the right."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats
from grasptrack.view.draw import grasp_spokes
from grasptrack.view.style import DARK, INK, STATUS_RGB, STRATEGY_RGB, create_figure, hex_colour, save_whole

if TYPE_CHECKING:
    from grasptrack.geometry.contours import View


# Open marks of nested sizes: where strategies agree none hides another, and the outline is seen within the smallest.
_MARKS = {"registration": ("h", 24), "rrp": ("s", 18), "grasp-line": ("D", 12), "homography": ("o", 9)}
_RGB = {"registration": (0, 158, 115), **STRATEGY_RGB}
_OTHER = ("^", 15), (120, 100, 80)  # of a strategy that another package registered
_GRASP_RGB = STATUS_RGB["tracked"]
_REFERENCE = 11.0
"""Points, size of a mark in the reference view."""
_LEGEND: dict[str, Any] = {
    "loc": "upper left",
    "bbox_to_anchor": (0.0, -0.01),
    "borderaxespad": 0.2,
    "frameon": False,
    "labelcolor": INK,
}


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
    wide = sum(i.shape[1] / i.shape[0] for i in (image, current[0]))
    tall = min(max(13.0 / wide, 3.0), 9.0)
    figure = create_figure(13.4, tall, facecolor="white")
    widths = [i.shape[1] / i.shape[0] for i in (image, current[0])]
    edges = {"left": 0.0, "right": 1.0, "bottom": 0.0, "top": 1.0, "wspace": 0.03}
    left, right = figure.subplots(1, 2, width_ratios=widths, gridspec_kw=edges)
    _show_view(left, image, view, titles[0])
    _show_view(right, *current, titles[1])
    _draw_grasp(left, contacts, hex_colour(_GRASP_RGB), "o", _REFERENCE)
    for i, at in enumerate(contacts):
        _draw_number(left, i + 1, at, contacts.mean(axis=0))
    handles = []
    for name, found in transferred.items():
        colour, (mark, size) = hex_colour(_RGB.get(name, _OTHER[1])), _MARKS.get(name, _OTHER[0])
        _draw_grasp(right, found, colour, mark, size)
        handles.append(_legend_handle(colour, mark, size, name))
    if transferred:
        best = next(iter(transferred.values()))
        for i, at in enumerate(best):
            _draw_number(right, i + 1, at, best.mean(axis=0))
    left.legend(handles=[_legend_handle(hex_colour(_GRASP_RGB), "o", _REFERENCE, "the grasp")], **_LEGEND)
    for name, reason in refused.items():
        handles.append(Line2D([], [], lw=0, label="\n".join(wrap(f"{name} refused: {reason}", 88))))
    right.legend(handles=handles, **_LEGEND)
    save_whole(figure, path, 110, bbox_inches="tight", pad_inches=0.2)


def _show_view(axes: Any, image: NDArray[Any], view: View, title: str) -> None:
    if image.ndim == 2:
        axes.imshow(image, cmap="gray", vmin=0, vmax=255)
    else:
        axes.imshow(image[:, :, ::-1])
    for contour in view.contours:
        closed = np.vstack([contour.points, contour.points[:1]])
        axes.plot(closed[:, 0], closed[:, 1], color=DARK, lw=2.6)
        axes.plot(closed[:, 0], closed[:, 1], color="white", lw=1.0)
    # Fixed here, so that a contact beyond the border does not shrink the image.
    axes.set_xlim(-0.5, image.shape[1] - 0.5)
    axes.set_ylim(image.shape[0] - 0.5, -0.5)
    axes.set_title(title, fontsize=12, color=INK, loc="left")
    axes.set_axis_off()


def _draw_grasp(axes: Any, contacts: Floats, colour: str, mark: str, size: float) -> None:
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


def _draw_number(axes: Any, number: int, at: Floats, middle: Floats) -> None:
    away = (at - middle) / max(float(np.linalg.norm(at - middle)), 1e-9)
    axes.annotate(
        str(number),
        at,
        xytext=(28 * away[0], -28 * away[1]),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=9,
        fontweight="bold",
        color="white",
        bbox={"boxstyle": "circle,pad=0.25", "fc": DARK, "ec": "none"},
        annotation_clip=True,
        zorder=2.5,
    )
