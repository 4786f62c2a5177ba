# SPDX-License-Identifier: Apache-2.0
"""Two views of an object side by side, as the paper's tables show them: outlines, grasps, axes, correspondences."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats
from grasptrack.view.draw import as_bgr, draw_disc, draw_polyline
from grasptrack.view.style import (
    CONE_RGB,
    DARK_RGB,
    INK_RGB,
    MUTED_RGB,
    PANEL_RGB,
    REGION_RGB,
    RULE_RGB,
    STATUS_RGB,
    STRATEGY_RGB,
    WHITE_RGB,
    Picture,
    put_text,
    rgb_to_bgr,
    text_width,
)

_GAP, _TITLE, _PLOT = 8, 34, 150
_GRASP = STATUS_RGB["tracked"]


@dataclass(frozen=True)
class Panel:
    """One view.

    Attributes:
        image: (H, W) or (H, W, 3), 8 bit.
        title: above it.
        outlines: curves (N, 2) px, drawn in white.
        points: (m, 2) px, numbered: selected points or correspondences.
        before: (k, 2) px, contacts before the refinement, drawn as rings.
        contacts: (k, 2) px, the grasp.
        truth: (k, 2) px, where its contacts truly are, drawn as small crosses.
        dots: (n, 2) px, drawn small: a tracked outline's reference points.
        axis: (x, y, rad, half-length in px) of an inertia axis through the centroid.
        curve: (n,) a curve to plot below the image, over the outline's samples; `marks` of its samples are numbered.
    """

    image: NDArray[Any]
    title: str
    outlines: list[Floats] = field(default_factory=list)
    points: Floats | None = None
    before: Floats | None = None
    contacts: Floats | None = None
    truth: Floats | None = None
    dots: Floats | None = None
    axis: tuple[float, float, float, float] | None = None
    curve: Floats | None = None
    marks: list[int] = field(default_factory=list)


def draw_panels(panels: list[Panel], curve_title: str = "") -> Picture:
    """(H', W', 3) uint8 BGR: the panels side by side, their curves below on one scale.

    Args:
        panels: views of one size.
        curve_title: above the curves, where there are any.
    """
    curves = [p.curve for p in panels if p.curve is not None]
    top = max((float(np.nanmax(np.abs(c))) for c in curves), default=1.0)
    columns = []
    for panel in panels:
        picture = as_bgr(panel.image)
        _draw_panel(picture, panel)
        parts = [_blank_strip(picture.shape[1], _TITLE), picture]
        put_text(parts[0], panel.title, 10, 23, 16, INK_RGB)
        if panel.curve is not None:
            parts.append(_plot_curve(panel, picture.shape[1], top, curve_title))
        columns.append(np.concatenate(parts))
    height = max(c.shape[0] for c in columns)
    filled = [np.concatenate([c, _blank_strip(c.shape[1], height - c.shape[0])]) for c in columns]
    gap = _blank_strip(_GAP, height)
    spaced = [filled[0], *(part for c in filled[1:] for part in (gap, c))]
    return np.ascontiguousarray(np.concatenate(spaced, axis=1))


def _draw_panel(picture: Picture, panel: Panel) -> None:
    for width, colour in ((3.2, DARK_RGB), (1.2, WHITE_RGB)):
        for outline in panel.outlines:
            draw_polyline(picture, outline, colour, width, closed=True)
    if panel.dots is not None:
        for at in panel.dots:
            draw_disc(picture, at, 2.6, DARK_RGB)
            draw_disc(picture, at, 1.8, STRATEGY_RGB["rrp"])
    if panel.axis is not None:
        x, y, angle, half = panel.axis
        along = half * np.array([np.cos(angle), np.sin(angle)])
        centre = np.array([x, y])
        ends = np.array([centre - along, centre + along])
        draw_polyline(picture, ends, DARK_RGB, 3.2)
        draw_polyline(picture, ends, CONE_RGB, 1.6)
        draw_disc(picture, centre, 5.0, DARK_RGB)
        draw_disc(picture, centre, 3.6, CONE_RGB)
    if panel.contacts is not None:
        _draw_grasp(picture, panel.contacts)
    if panel.before is not None:
        for at in panel.before:
            draw_disc(picture, at, 10.5, DARK_RGB, 4.0)
            draw_disc(picture, at, 10.5, REGION_RGB, 2.0)
    if panel.truth is not None:
        for at in panel.truth:
            for way in ((5.0, 5.0), (5.0, -5.0)):
                draw_polyline(picture, np.array([at - way, at + way]), DARK_RGB, 1.4)
    if panel.points is not None:
        centre = panel.points.mean(axis=0)
        for k, at in enumerate(panel.points):
            away = (at - centre) / max(float(np.linalg.norm(at - centre)), 1e-9)
            draw_disc(picture, at, 6.4, DARK_RGB)
            draw_disc(picture, at, 4.6, STRATEGY_RGB["homography"])
            _draw_number(picture, k + 1, at + 19.0 * away)


def _draw_grasp(picture: Picture, contacts: Floats) -> None:
    if len(contacts) == 2:
        along = contacts[1] - contacts[0]
        line = np.array([contacts[0] - 0.35 * along, contacts[1] + 0.35 * along])
        draw_polyline(picture, line, DARK_RGB, 3.6)
        draw_polyline(picture, line, _GRASP, 1.8)
    for at in contacts:
        draw_disc(picture, at, 7.4, DARK_RGB)
        draw_disc(picture, at, 6.2, WHITE_RGB)
        draw_disc(picture, at, 4.6, _GRASP)


def _plot_curve(panel: Panel, width: int, top: float, title: str) -> Picture:
    """A panel's curve, its marked samples numbered."""
    assert panel.curve is not None
    plot = _blank_strip(width, _PLOT)
    left, right, up, down = 12.0, width - 12.0, 34.0, _PLOT - 12.0
    values = np.nan_to_num(np.append(panel.curve, panel.curve[0]))
    x = left + (right - left) * np.arange(len(values)) / (len(values) - 1)
    y = 0.5 * (up + down) - values / top * 0.5 * (down - up)
    draw_polyline(plot, np.array([[left, 0.5 * (up + down)], [right, 0.5 * (up + down)]]), RULE_RGB, 1.0)
    draw_polyline(plot, np.column_stack([x, y]), INK_RGB, 1.2)
    for k, i in enumerate(panel.marks):
        at = np.array([x[i], y[i]])
        draw_disc(plot, at, 5.0, STRATEGY_RGB["homography"])
        _draw_number(plot, k + 1, at + np.array([14.0 if at[0] < right - 24.0 else -14.0, 4.0]))
    put_text(plot, title, 10, 22, 13, MUTED_RGB)
    return plot


def _draw_number(picture: Picture, number: int, at: Floats) -> None:
    room = np.array([picture.shape[1] - 10.0, picture.shape[0] - 10.0])
    at = np.minimum(np.maximum(at, 9.0), room)
    draw_disc(picture, at, 8.5, DARK_RGB)
    text = str(number)
    put_text(
        picture, text, round(at[0] - text_width(text, 12, bold=True) / 2), round(at[1] + 4.5), 12, WHITE_RGB, bold=True
    )


def _blank_strip(width: int, height: int) -> Picture:
    return np.full((height, width, 3), rgb_to_bgr(PANEL_RGB), np.uint8)
