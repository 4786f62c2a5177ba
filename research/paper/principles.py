# SPDX-License-Identifier: Apache-2.0
"""Figures 5, 6 and 10 of the paper: what a grasp line is described by, the three strategies, the search of a correspondence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import Grasp
from grasptrack.transfer import STRATEGIES, grasp_line, homography, rrp, transfer
from grasptrack.transfer.rrp import INTERPOLATED
from grasptrack.typing import Floats
from grasptrack.view.style import DARK, INK, MUTED, create_figure
from research.paper.correspondences import Correspondences
from research.paper.descriptions import relative_text
from research.paper.drawing import (
    AXIS,
    GRASP,
    HALO,
    PEAK,
    REFERENCE,
    TRUTH,
    WIDE,
    Picture,
    draw_contact,
    draw_label,
    draw_line,
    draw_outline,
    draw_truth,
    frame_axes,
    shown_view,
    to_picture,
    worst_px,
)
from research.paper.footage import Footage
from research.paper.transfers import Refused


def draw_grasp_line(axes: Any, view: View, grasp: Grasp) -> grasp_line.GraspLineDescription:
    """A grasp's line beside the inertia axes, and the distances that describe it."""
    described = grasp_line.describe(grasp, view)
    centre, root, (a, b) = np.array(described.centroid), math.sqrt(described.area), grasp.contacts
    draw_outline(axes, view)
    for angle, name in ((described.theta, r"$I_{\min}$"), (described.theta + 0.5 * math.pi, r"$I_{\max}$")):
        along = root * np.array([math.cos(angle), math.sin(angle)])
        axes.plot(*np.array([centre - along, centre + along]).T, color=AXIS, lw=1.3)
        axes.annotate(name, centre + 0.92 * along, fontsize=9, color=DARK, bbox=HALO, ha="center", va="center")
    axes.plot(*np.array([a - 0.5 * (b - a), b + 0.5 * (b - a)]).T, color=GRASP, lw=1.8)
    foot = a + (b - a) * float((centre - a) @ (b - a) / ((b - a) @ (b - a)))
    axes.plot(*np.array([centre, foot]).T, ":", color=DARK, lw=1.5)
    axes.annotate(r"$d_c$", 0.5 * (centre + foot), fontsize=9, bbox=HALO, xytext=(-12, 8), textcoords="offset points")
    axes.plot(*centre, "o", color=AXIS, mec=DARK, ms=6)
    meets = _meeting(a, b, centre, described.theta)
    axes.plot(*meets, "s", color=DARK, ms=4)
    for at, name in ((a, "$d_1$"), (b, "$d_2$")):
        draw_label(axes, 0.5 * (meets + at), name, centre, size=9, gap=11)
    for at, label in zip(grasp.contacts, ("$p_{g_1}$", "$p_{g_2}$"), strict=True):
        draw_contact(axes, at, label, centre)
    return described


def figure_five(examples: Sequence[Footage]) -> Picture:
    """The four grasp-line coordinates of the grasps on the first two objects given, in the first view."""
    figure = create_figure(WIDE, 4.2, layout="constrained")
    for axes, footage in zip(figure.subplots(1, 2), examples, strict=False):
        view, grasp = shown_view(footage.silhouettes[0]), Grasp(footage.on_silhouette)
        described = draw_grasp_line(axes, view, grasp)
        centre = np.array(described.centroid)
        a, b = grasp.contacts
        meets = _meeting(a, b, centre, described.theta)
        turn = described.theta + np.linspace(0.0, described.alpha_m, 41)
        arc = meets + 0.25 * math.sqrt(described.area) * np.column_stack([np.cos(turn), np.sin(turn)])
        axes.plot(*arc.T, color=TRUTH, lw=1.4)
        draw_label(axes, arc[20], r"$\alpha_m$", meets, size=11)
        draw_label(axes, centre, "$p_c$", meets, size=10, gap=16)
        told = f"{relative_text(described.paper())}\n" + r"$(d_c, \alpha_m, d_1, d_2)$, over the area as printed"
        axes.set_xlabel(told, fontsize=8.5, color=INK)
        frame_axes(axes, view.points, footage.part.name, 0.34)
    return "Fig. 5: grasp description by grasp-line coordinates", to_picture(figure)


def figure_six(footage: Footage, frame: int) -> Picture:
    """The three options of the grasp-transfer block: what each describes in the first view, and where it puts the grasp."""
    figure = create_figure(WIDE, 5.2, layout="constrained")
    titles = {"rrp": "RRP coordinates", "grasp-line": "grasp-line coordinates", "homography": "homography"}
    for (above, below), name in zip(figure.subplots(2, 3).T, STRATEGIES, strict=True):
        first, second = (shown_view(footage.outlines(name)[k]) for k in (0, frame))
        grasp = Grasp(footage.contacts(name))
        draw_outline(above, first)
        draw_line(above, grasp.contacts)
        frame_axes(above, first.points, titles[name], 0.2)
        above.set_xlabel(_describe(above, name, grasp, first), fontsize=7.5, color=INK)
        above.plot(*grasp.contacts.T, "o", color=GRASP, mec=DARK, ms=7)
        draw_outline(below, second)
        try:
            found = transfer(grasp, first, second, name).grasp.contacts
        except Refused as error:
            frame_axes(below, second.points, f"refused: {error}", 0.2)
            continue
        truth = footage.truth(name, frame)
        draw_truth(below, truth)
        draw_line(below, found)
        below.plot(*found.T, "o", color=GRASP, mec=DARK, ms=7)
        frame_axes(below, second.points, f"frame {frame}, off by {worst_px(found, truth):.3f} px", 0.2)
    return f"Fig. 6, {footage.part.name}: the three strategies on one pair of views, true places crossed", to_picture(
        figure
    )


def _describe(axes: Any, name: str, grasp: Grasp, view: View) -> str:
    """What a strategy keeps of the first view, drawn and in words."""
    if name == "rrp":
        axes.plot(*view.outer.points[::INTERPOLATED].T, "o", color=REFERENCE, mec=DARK, mew=0.6, ms=4)
        return "(c, ref, interp): " + " ".join(map(str, rrp.describe(grasp, view).paper()))
    if name == "grasp-line":
        described = grasp_line.describe(grasp, view)
        along = math.sqrt(described.area) * np.array([math.cos(described.theta), math.sin(described.theta)])
        for axis in (along, along[::-1] * (-1.0, 1.0)):
            axes.plot(*(described.centroid + np.array([-axis, axis])).T, color=AXIS, lw=1.3)
        return r"$(d_c, \alpha_m, d_1, d_2)$: " + relative_text(described.paper())
    points = view.outer.points[homography.describe(grasp, view).peaks[:4]]
    for k, at in enumerate(points, start=1):
        axes.plot(*at, "o", color=PEAK, mec="white", ms=7)
        draw_label(axes, at, str(k), view.points.mean(axis=0), size=8)
    return "four peaks of curvature"


def figure_ten(c: Correspondences) -> Picture:
    """The search of one point's correspondence to the letter: both curvature vectors, and eq. (3) over the window.

    It is the selected point whose neighbourhoods differ most.
    """
    v, w = (k / view.outer.length for k, view in zip(c.curvature, (c.first, c.second), strict=True))
    i = c.samples[0]
    k = int(np.argmax(c.errors))
    n, kappa = len(v), len(w) / len(v)
    reach, radius = round(homography.SEARCH * n), round(homography.NEIGHBOURHOOD * n)
    window = np.arange(math.ceil(kappa * (i[k] - reach)), math.floor(kappa * (i[k] + reach)) + 1)
    beside = np.arange(-radius, radius + 1)
    errors = errors_along(v, i[k], w, window.astype(np.float64), radius)
    figure = create_figure(WIDE, 4.6, layout="constrained")
    one, two, three = figure.subplots(3, 1)
    around = i[k] + np.arange(-2 * reach, 2 * reach + 1)
    one.plot(around, v[around % n], color=DARK, lw=1.2)
    one.plot(
        i[k] + beside, v[(i[k] + beside) % n], color=PEAK, lw=3.0, alpha=0.6, label="neighbourhood, n samples to a side"
    )
    one.plot(i[k], v[i[k]], "*", color=PEAK, mec=DARK, ms=11)
    best = int(window[int(np.argmin(errors))])
    across = np.arange(window[0] - reach, window[-1] + reach + 1)
    two.plot(across, w[across % len(w)], color=DARK, lw=1.2)
    two.axvspan(window[0], window[-1], color=MUTED, alpha=0.15, label=r"$[i_c - \kappa\xi, i_c + \kappa\xi]$")
    there = np.arange(best - round(kappa * radius), best + round(kappa * radius) + 1)
    two.plot(there, w[there % len(w)], color=PEAK, lw=3.0, alpha=0.6, label="neighbourhood of the least error")
    two.plot(best, w[best % len(w)], "o", color=PEAK, mec=DARK, ms=7)
    three.axvspan(window[0], window[-1], color=MUTED, alpha=0.15)
    three.plot(window, errors, color=TRUTH, lw=1.4, label=r"$d(p_i, p'_j)$, eq. (3)")
    three.plot(best, errors.min(), "o", color=PEAK, mec=DARK, ms=7)
    three.set_xlim(two.get_xlim())
    for axes in (one, two):
        axes.margins(y=0.15)
    texts = (
        f"frame 0: v about $p_{{{k + 1}}}$, i = {i[k]}",
        f"frame {c.frame}: v', j = {best % len(w)}",
        "eq. (3) over j",
    )
    for axes, told in zip((one, two, three), texts, strict=True):
        axes.set_title(told, fontsize=9.5, color=INK)
        axes.legend(fontsize=8, frameon=False, loc="upper right")
        axes.tick_params(labelsize=8, colors=MUTED)
        axes.spines[["top", "right"]].set_visible(False)
    three.set_xlabel("sample of the contour; curvature in 1/px", fontsize=8.5, color=INK)
    return f"Fig. 10, {c.footage.part.name}: search of the correspondence of a point, to the letter", to_picture(figure)


def errors_along(v: Floats, i: int, w: Floats, places: Floats, radius: int) -> Floats:
    """(M,) eq. (3) between sample i of a contour and places j (M,) of another, which may go round, lengths in samples.

    v and w are (N,) and (N',) the curvature of both in the same unit; the radius is n.
    """
    k = np.arange(-radius, radius + 1)
    there = np.interp(places[:, None] + len(w) / len(v) * k, np.arange(len(w)), w, period=len(w))
    return np.asarray(np.abs(v[(i + k) % len(v)] - there).sum(axis=1))


def _meeting(a: Floats, b: Floats, centre: Floats, angle: float) -> Floats:
    """(2,) where the line through a and b meets the axis."""
    across = np.array([-math.sin(angle), math.cos(angle)])
    return np.asarray(a + (b - a) * float(across @ (centre - a)) / float(across @ (b - a)))
