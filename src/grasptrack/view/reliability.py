# SPDX-License-Identifier: Apache-2.0
"""The reliability diagram: how often answers are wrong over how often they said that they would be."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from grasptrack.typing import Floats

WIDE = 6.4
"""Inches."""
FLOOR = 1e-5
"""Least share that is shown."""


def plot_reliability(path: Path, shares: Floats, labels: Sequence[str], title: str) -> None:
    """Draw the share of wrong answers as counted over that told, both logarithmic.

    Args:
        path: of the PNG.
        shares: (n, 4) of each bin: as told, as counted, least and most of the 95 % interval.
        labels: of each bin.
        title: above.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDE, 0.62 * WIDE), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    told, low = np.maximum(shares[:, 0], FLOOR), np.maximum(shares[:, 1], FLOOR)
    least, most = np.clip(shares[:, 2], FLOOR, low), np.maximum(shares[:, 3], low)
    axes.plot([FLOOR, 1.0], [FLOOR, 1.0], color="0.7", lw=1.0, label="as told")
    bars = [low - least, most - low]
    axes.errorbar(told, low, bars, fmt="o", color="#1f5fa8", capsize=3, lw=1.2, label="counted, 95 % interval")
    for label, x, y in zip(labels, told, most, strict=True):
        axes.annotate(label, (x, y), xytext=(0, 5), textcoords="offset points", fontsize=8, ha="center")
    axes.set(xscale="log", yscale="log", xlim=(FLOOR / 1.5, 1.2), ylim=(FLOOR / 1.5, 2.5), title=title)
    axes.set(xlabel="wrong answers as told: 1 - confidence", ylabel="wrong answers as counted")
    axes.legend(loc="lower right", frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=150)
