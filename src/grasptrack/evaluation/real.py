# SPDX-License-Identifier: Apache-2.0
"""Real videos with reference homographies: every strategy on the same frames, no parameter touched."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.evaluation.homographies import read_homographies
from grasptrack.evaluation.score import Score
from grasptrack.evaluation.truth import Truth
from grasptrack.io.sources import Frame, open_source
from grasptrack.tracker import GraspTracker

Floats = NDArray[np.float64]

STRATEGIES = ("auto", "rrp", "grasp-line", "homography")


def score_frames(
    frames: Iterable[Frame],
    homographies: Mapping[int, Floats],
    strategy: str = "auto",
    *,
    on_frame: Callable[[Frame, Any], None] | None = None,
    **options: Any,
) -> Score:
    """Track a grasp synthesised in the first frame and compare it with the reference homographies.

    Args:
        frames: of the video, in order.
        homographies: H_current_reference (3, 3) by frame index; frames without one are not measured.
        strategy: of the tracker.
        on_frame: called with each frame and its TrackResult.
        **options: further ones of `GraspTracker`.
    """
    tracker, score = GraspTracker(strategy=strategy, **options), Score(strategy)
    truths = {index: Truth.of_homography(H) for index, H in homographies.items()}
    for frame in frames:
        result = tracker.update(frame.image, time=frame.time)
        score.add(result, truths.get(frame.index))
        if on_frame is not None:
            on_frame(frame, result)
    return score


def score_video(video: Path, table: Path, strategies: Sequence[str] = STRATEGIES) -> list[Score]:
    """Score strategies on a video and its table of reference homographies.

    Raises:
        InputError: the video or the table cannot be read.
    """
    homographies = read_homographies(table)
    frames = list(open_source(video))
    return [score_frames(frames, homographies, strategy) for strategy in strategies]
