# SPDX-License-Identifier: Apache-2.0
"""What the paper's figures have in common: colours, outlines, contacts, reference points, labels."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.geometry.contours import View
from grasptrack.images import Grey
from grasptrack.typing import Floats
from grasptrack.view.style import DARK, INK, MUTED, STATUS_RGB, STRATEGY_RGB, hex_colour

Picture = tuple[str, NDArray[np.uint8]]
"""A caption and a BGR image."""
WIDE = 8.2
"""Inches."""
DPI = 100
GRASP = hex_colour(STATUS_RGB["tracked"])
TRUTH = "#d1361b"
REFERENCE = hex_colour(STRATEGY_RGB["rrp"])
AXIS = hex_colour(STRATEGY_RGB["grasp-line"])
PEAK = hex_colour(STRATEGY_RGB["homography"])
HALO: dict[str, Any] = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8}


def shown_view(seen: View | str) -> View:
    """The view of a frame in which an outline was seen."""
    if isinstance(seen, str):
        raise ValueError(seen)
    return seen


def worst_px(found: Floats, truth: Floats) -> float:
    """px, the farthest contact (k, 2) from its true place."""
    return float(np.hypot(*(found - truth).T).max())


def closed(points: Floats) -> Floats:
    """(N + 1, 2) with the first point again at the end."""
    return np.concatenate([points, points[:1]])


def draw_image(axes: Any, image: Grey) -> None:
    """The image as a pale backdrop: smooth and of few greys, so that the file stays small."""
    smooth = cv2.medianBlur(image, 7).astype(np.int64) // 24 * 24
    axes.imshow(
        smooth,
        cmap="gray",
        vmin=-500,
        vmax=290,
        interpolation="nearest",
        extent=(-0.5, image.shape[1] - 0.5, image.shape[0] - 0.5, -0.5),
    )


def draw_outline(axes: Any, view: View) -> None:
    """All contours of a view."""
    for contour in view.contours:
        axes.plot(*closed(contour.points).T, color=DARK, lw=1.2)


def draw_matches(axes: Any, image: Grey, view: View, points: Floats, title: str) -> None:
    """A view with numbered points of its outline."""
    draw_image(axes, image)
    draw_outline(axes, view)
    for k, at in enumerate(points, start=1):
        axes.plot(*at, "o", color=PEAK, mec="white", ms=8)
        draw_label(axes, at, str(k), view.points.mean(axis=0))
    frame_axes(axes, view.points, title)


def draw_references(axes: Any, references: Floats, contacts: Floats) -> None:
    """Every fifth is numbered, where no contact needs the place."""
    axes.plot(*references.T, "o", color=REFERENCE, mec=DARK, mew=0.6, ms=5)
    room = 0.06 * float(np.ptp(references, axis=0).max())
    for i in range(0, len(references), 5):
        if np.hypot(*(contacts - references[i]).T).min() > room:
            draw_label(axes, references[i], str(i), references.mean(axis=0), size=7.5, gap=9)


def draw_contact(axes: Any, at: Floats, label: str, centre: Floats) -> None:
    """A contact with its label beside it."""
    axes.plot(*at, "o", color=GRASP, mec=DARK, ms=8, zorder=4)
    draw_label(axes, at, label, centre, size=10, gap=32)


def draw_line(axes: Any, contacts: Floats) -> None:
    """The line through two contacts (2, 2), and a little beyond."""
    a, b = contacts
    axes.plot(*np.array([a - 0.4 * (b - a), b + 0.4 * (b - a)]).T, color=GRASP, lw=1.6)


def draw_truth(axes: Any, truth: Floats | None) -> None:
    """A cross at every true place (k, 2), if they are known."""
    if truth is not None:
        axes.plot(*truth.T, "x", color=TRUTH, mew=2.0, ms=12)


def draw_label(axes: Any, at: Floats, text: str, centre: Floats, size: float = 10, gap: float = 13) -> None:
    """Beside a point, away from the centre."""
    away = (at - centre) / max(float(np.hypot(*(at - centre))), 1e-9)
    axes.annotate(
        text,
        at,
        xytext=(gap * away[0], -gap * away[1]),
        textcoords="offset points",
        fontsize=size,
        ha="center",
        va="center",
        color=DARK,
        bbox=HALO,
        zorder=9,
    )


def frame_axes(axes: Any, points: Floats, title: str, margin: float = 0.14) -> None:
    """The part of the plane that holds these points, y downward as in images."""
    low, high = points.min(axis=0), points.max(axis=0)
    room = margin * float((high - low).max())
    axes.set(
        xlim=(low[0] - room, high[0] + room), ylim=(high[1] + room, low[1] - room), aspect="equal", xticks=[], yticks=[]
    )
    axes.set_title(title, fontsize=9.5, color=INK)
    for spine in axes.spines.values():
        spine.set_color(MUTED)


def to_picture(figure: Any) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 BGR."""
    figure.set_dpi(DPI)
    figure.canvas.draw()
    return np.ascontiguousarray(np.asarray(figure.canvas.buffer_rgba())[:, :, 2::-1])
