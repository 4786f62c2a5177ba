# SPDX-License-Identifier: Apache-2.0
"""Tables T and S as small curves: the error over the tilt, and over each constant of the homography."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from grasptrack.view.style import INK, MUTED, RULE, STRATEGY_RGB, create_figure, hex_colour
from research.paper.drawing import WIDE, Picture, to_picture
from research.paper.evidence import Evidence, number_of
from research.paper.printed import STRATEGIES

LEAST_PX = 0.01
"""The lower end of the scale."""
NAMES = {"rrp": "RRP", "grasp-line": "grasp line", "homography": "homography"}


def table_curves(evidence: Evidence) -> list[tuple[str, Picture]]:
    """Names and pictures, each with its caption."""
    return [("paper-tilt", _tilt(evidence)), ("paper-sensitivity", _sensitivity(evidence))]


def _tilt(e: Evidence) -> Picture:
    """Median error and its interval over the tilt, ours beside the paper's to the letter."""
    figure = create_figure(WIDE, 3.2, layout="constrained")
    for axes, prefix, title in zip(
        figure.subplots(1, 2, sharey=True), ("", "paper-"), ("ours", "the paper's to the letter"), strict=True
    ):
        for name in STRATEGIES:
            rows = e.rows("T", {"strategy": prefix + name, "way": "first view"})
            tilt, middle, low, high = (
                np.array([number_of(r[head]) for r in rows])
                for head in ("tilt, degrees", "median px", "95 % from", "95 % to")
            )
            colour = hex_colour(STRATEGY_RGB[name])
            axes.fill_between(tilt, *(_drawn(v) for v in (low, high)), color=colour, alpha=0.18, lw=0)
            axes.plot(tilt, _drawn(middle), "o-", color=colour, ms=4, label=NAMES[name])
        axes.set(yscale="log", xlabel="tilt, degrees")
        axes.set_title(title, fontsize=9.5, color=INK)
        _plain_axes(axes)
        axes.legend(fontsize=8, frameon=False, loc="lower right")
        if not prefix:
            axes.set_ylabel("error, px, median and 95 % interval", fontsize=8.5)
    return "Error over tilt, all shapes and seeds, contours sampled anew, from the first view (Table T)", to_picture(
        figure
    )


def _sensitivity(e: Evidence) -> Picture:
    """Median error and answers over each constant of the homography."""
    constants = list(dict.fromkeys(r["constant"] for r in e.rows("S", {})))
    columns = 4
    figure = create_figure(WIDE, 1.6 * math.ceil(len(constants) / columns), layout="constrained")
    panels = figure.subplots(
        math.ceil(len(constants) / columns), columns, sharex=True, sharey=True, squeeze=False
    ).ravel()
    for axes, constant in zip(panels, constants, strict=False):
        rows = e.rows("S", {"constant": constant})
        factor, middle, low, high, answered = (
            np.array([number_of(r[head]) for r in rows])
            for head in ("times the usual", "median px", "95 % from", "95 % to", "answered %")
        )
        colour = hex_colour(STRATEGY_RGB["homography"])
        axes.fill_between(factor, *(_drawn(v) for v in (low, high)), color=colour, alpha=0.18, lw=0)
        axes.plot(factor, _drawn(middle), "o-", color=colour, ms=3)
        axes.set(xscale="log", yscale="log", xticks=factor)
        axes.set_xticks([], minor=True)
        axes.set_xticklabels([f"{f:g}" for f in factor], fontsize=7)
        axes.set_title(f"{constant}\n{answered.min():.0f} to {answered.max():.0f} % answered", fontsize=7, color=INK)
        _plain_axes(axes)
    for axes in panels[len(constants) :]:
        axes.set_visible(False)
    figure.supylabel("median error, px", fontsize=8.5)
    figure.supxlabel("the constant over its usual value", fontsize=8.5)
    return "The homography's error over each of its constants, 6 DoF, contours sampled anew (Table S)", to_picture(
        figure
    )


def _drawn(values: Any) -> Any:
    """Values on the scale; what was refused leaves a gap."""
    return np.where(np.isfinite(values), np.maximum(values, LEAST_PX), np.nan)


def _plain_axes(axes: Any) -> None:
    axes.grid(True, color=RULE, lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8, colors=MUTED)
