# SPDX-License-Identifier: Apache-2.0
"""How an approach went: errors of the features, distance from the goal, twist."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from grasptrack.typing import Floats
from grasptrack.view.style import create_figure, save_whole

_FEATURES = ("x/l", "y/l", "1/l", "angle, rad", "tilt x", "tilt y")


def plot_approach(
    times: Sequence[float],
    errors: Sequence[Floats],
    error_px: Sequence[float],
    twists: Sequence[Floats],
    blind: Sequence[bool],
    title: str,
    path: Path,
) -> None:
    """Write a picture of four charts over time.

    Args:
        times: (n,) s.
        errors: (4,) or (6,) of the features at each time.
        error_px: of the farthest contact from its goal.
        twists: (6,) m/s and rad/s.
        blind: where the grasp was not seen; shaded.
        title: above it.
        path: of the PNG.
    """
    figure = create_figure(9.0, 8.0, layout="constrained")
    axes = figure.subplots(4, 1, sharex=True)
    t = np.asarray(times, dtype=np.float64)
    if len(t):
        rows = np.array([np.pad(e, (0, 6 - len(e)), constant_values=np.nan) for e in errors])
        for i, name in enumerate(_FEATURES):
            if np.isfinite(rows[:, i]).any():
                axes[0].plot(t, rows[:, i], label=name)
        axes[1].semilogy(t, np.maximum(np.asarray(error_px), 1e-2), color="k")
        axes[1].axhline(1.0, color="0.6", linewidth=0.8)
        rates = np.array(twists)
        for i, name in enumerate("xyz"):
            axes[2].plot(t, rates[:, i], label=f"v {name}")
            axes[3].plot(t, rates[:, 3 + i], label=f"w {name}")
        ends = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(blind, dtype=int), [0]])))
        for begin, end in ends.reshape(-1, 2):
            for axis in axes:
                axis.axvspan(t[begin], t[min(end, len(t) - 1)], color="orange", alpha=0.18, linewidth=0)
    for axis, name in zip(axes, ("features' error", "px from the goal", "m/s", "rad/s"), strict=True):
        axis.set_ylabel(name)
        axis.grid(True, alpha=0.3)
        if axis.get_legend_handles_labels()[0]:
            axis.legend(loc="upper right", fontsize=8, ncols=3)
    axes[-1].set_xlabel("s   (shaded: the grasp is not seen)")
    figure.suptitle(title, fontsize=11)
    save_whole(figure, path, 110)
