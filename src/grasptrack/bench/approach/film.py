# SPDX-License-Identifier: Apache-2.0
"""One approach to look at: a video of both views, plots, and the verdict."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from grasptrack.bench.approach.case import Case, Row
from grasptrack.bench.approach.pictures import side_by_side
from grasptrack.bench.approach.trial import Step, run_trial
from grasptrack.bench.physics import World
from grasptrack.bench.physics.world import PERIOD_S
from grasptrack.io.results import software_versions, write_json
from grasptrack.io.run import prepare_folder
from grasptrack.io.video import VideoWriter
from grasptrack.typing import Floats
from grasptrack.view.approach import plot_approach

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
    blind = [state in ("holding", "searching") for state in record.states]
    title = f"{row.shape}, {row.scenario}, {row.law}: {row.outcome}. {row.reason}"[:110]
    plot_approach(record.time, record.errors, record.error_px, record.twists, blind, title, output / PLOTS)
    write_json(output / VERDICT, {"options": options, "versions": software_versions(), "verdict": row.values()})
    return row
