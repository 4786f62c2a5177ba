# SPDX-License-Identifier: Apache-2.0
"""One approach to look at: a video of both views, plots, and the verdict."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.evaluation.approach.case import Case, Row
from grasptrack.evaluation.approach.pictures import side_by_side
from grasptrack.evaluation.approach.trial import Step, run_trial
from grasptrack.io.results import versions, write_json
from grasptrack.io.run import prepare_folder
from grasptrack.io.video import VideoWriter
from grasptrack.simulation.physical import World
from grasptrack.simulation.physical.world import PERIOD_S

Floats = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

VIDEO, PLOTS, VERDICT = "approach.mp4", "approach.png", "approach.json"
_EXPECTED = 250


class Record:
    """Keeps what the plots show, and writes the video as it goes.

    Args:
        video: file; None writes none.
        progress: called with stage, images so far, and how many are to be expected.
    """

    def __init__(self, video: Path | None, progress: Progress | None) -> None:
        self._writer = None if video is None else VideoWriter(video, 1.0 / PERIOD_S)
        self._progress = progress
        self.time: list[float] = []
        self.errors: list[Floats] = []
        self.error_px: list[float] = []
        self.twists: list[Floats] = []
        self.states: list[str] = []
        self.count = 0

    def __call__(self, world: World, step: Step) -> None:
        """Take in one step."""
        if self._writer is not None:
            self._writer.write(side_by_side(world, step))
        self.count += 1
        if self._progress is not None:
            self._progress(step.stage, self.count, max(_EXPECTED, self.count))
        if step.stage == "approach" and step.command is not None:
            self.time.append(step.time)
            self.errors.append(np.asarray(step.command.error, dtype=np.float64))
            self.error_px.append(step.command.error_px)
            self.twists.append(step.command.twist)
            self.states.append(step.command.state)

    def close(self) -> None:
        """Finish the video."""
        if self._writer is not None:
            self._writer.close()


def run_and_film(case: Case, output: Path, *, video: bool, options: dict[str, Any], progress: Progress | None) -> Row:
    """Run one approach; write approach.mp4, approach.png and approach.json.

    Args:
        case: what to try.
        output: folder, made when missing.
        video: write the video.
        options: what was asked for, for the verdict's file.
        progress: see `Record`.

    Raises:
        InputError: the folder cannot be written, MuJoCo is missing, or the part cannot be shown.
    """
    prepare_folder(output)
    record = Record(output / VIDEO if video else None, progress)
    try:
        row, _ = run_trial(case, record)
    finally:
        record.close()
    plot(record, row, output / PLOTS)
    told = {name: _plain(value) for name, value in row.values().items()}
    write_json(output / VERDICT, {"options": options, "versions": versions(), "verdict": told})
    return row


def plot(record: Record, row: Row, path: Path) -> None:
    """Features' errors, distance from the goal in px, and twist over time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(4, 1, sharex=True)
    t = np.array(record.time)
    if len(t):
        errors = np.array([np.pad(e, (0, 6 - len(e)), constant_values=np.nan) for e in record.errors])
        for i, name in enumerate(("x/l", "y/l", "1/l", "angle, rad", "tilt x", "tilt y")):
            if np.isfinite(errors[:, i]).any():
                axes[0].plot(t, errors[:, i], label=name)
        axes[1].semilogy(t, np.maximum(record.error_px, 1e-2), color="k")
        axes[1].axhline(1.0, color="0.6", linewidth=0.8)
        twists = np.array(record.twists)
        for i, name in enumerate(("x", "y", "z")):
            axes[2].plot(t, twists[:, i], label=f"v {name}")
            axes[3].plot(t, twists[:, 3 + i], label=f"w {name}")
        _shade(axes, t, record.states)
    for axis, name in zip(axes, ("features' error", "px from the goal", "m/s", "rad/s"), strict=True):
        axis.set_ylabel(name)
        axis.grid(True, alpha=0.3)
        if axis.get_legend_handles_labels()[0]:
            axis.legend(loc="upper right", fontsize=8, ncols=3)
    axes[-1].set_xlabel("s   (shaded: the grasp is not seen)")
    figure.suptitle(f"{row.shape}, {row.scenario}, {row.law}: {row.outcome}. {row.reason}"[:110], fontsize=11)
    figure.savefig(path, dpi=110)


def _shade(axes: Any, t: Floats, states: list[str]) -> None:
    blind = np.array([state in ("holding", "searching") for state in states])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], blind, [False]]).astype(int)))
    for begin, end in edges.reshape(-1, 2):
        for axis in axes:
            axis.axvspan(t[begin], t[min(end, len(t) - 1)], color="orange", alpha=0.18, linewidth=0)


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not np.isfinite(value) else value
