# SPDX-License-Identifier: Apache-2.0
"""What scored frames become in charts: errors over time, precision at a distance, frames until recovery."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from grasptrack.bench.metrics.integrity import PARTLY, WHOLE, cumulative_share, recovery_delays
from grasptrack.bench.metrics.score import FrameScore
from grasptrack.typing import Floats

Runs = Sequence[Sequence[FrameScore]]


@dataclass(frozen=True)
class OverTime:
    """One method at each frame number, over its runs.

    Attributes:
        frames: (n,) frame numbers.
        median, low, high: (n,) px, of the worst contact over the runs that answered with the object there: the middle
            one, and those that 95 % lie between; NaN where fewer than a quarter of the runs answered.
        located: (n,) share of the runs with contacts, 0 to 1.
    """

    frames: Floats
    median: Floats
    low: Floats
    high: Floats
    located: Floats


def over_time(runs: Runs) -> OverTime:
    """Error and share located by frame number; the frames that define a grasp's truth are left out."""
    count = max((f.frame for run in runs for f in run), default=-1) + 1
    errors, answered = np.full((len(runs), count), np.nan), np.full((len(runs), count), np.nan)
    for i, run in enumerate(runs):
        for f in run:
            if not f.defining:
                answered[i, f.frame] = f.answered
                errors[i, f.frame] = np.nan if f.gone else f.error
    shown = np.isfinite(answered).sum(axis=0)
    kept = (~np.isnan(errors)).sum(axis=0) >= np.maximum(1, shown / 4)
    parts = np.full((3, count), np.nan)
    if kept.any():
        parts[:, kept] = _column_percentiles(errors[:, kept], np.array([2.5, 50.0, 97.5]))
    located = np.full(count, np.nan)
    located[shown > 0] = np.nanmean(answered[:, shown > 0], axis=0)
    return OverTime(np.arange(count, dtype=np.float64), parts[1], parts[0], parts[2], located)


def _column_percentiles(values: Floats, percents: Floats) -> Floats:
    """(p, n) percentiles of the known values in each column of (m, n), at least one in each; as NumPy's, but at once."""
    ordered = np.sort(values, axis=0)  # NaN last
    at = 0.01 * percents[:, None] * ((~np.isnan(values)).sum(axis=0) - 1)
    low, high = (np.take_along_axis(ordered, f(at).astype(np.intp), axis=0) for f in (np.floor, np.ceil))
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(low == high, low, low + (at - np.floor(at)) * (high - low)), dtype=np.float64)


def out_of_view(runs: Runs) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Stretches of frames, first and last, in which most runs have the object gone or hardly in view; or partly hidden."""
    seen: dict[int, list[float]] = {}
    for run in runs:
        for f in run:
            seen.setdefault(f.frame, []).append(f.visible if f.present else 0.0)
    frames = sorted(seen)
    away = [sum(v < PARTLY for v in seen[i]) * 2 > len(seen[i]) for i in frames]
    partly = [sum(v < WHOLE for v in seen[i]) * 2 > len(seen[i]) and not a for i, a in zip(frames, away, strict=True)]
    return _frame_ranges(frames, away), _frame_ranges(frames, partly)


def _frame_ranges(frames: Sequence[int], flags: Sequence[bool]) -> list[tuple[int, int]]:
    found: list[tuple[int, int]] = []
    for frame, flag in zip(frames, flags, strict=True):
        if flag and found and found[-1][1] == frame - 1:
            found[-1] = (found[-1][0], frame)
        elif flag:
            found.append((frame, frame))
    return found


def precision_curve(runs: Runs, at: Floats, of_opening: bool = False) -> Floats:
    """Share of the frames with 70 % of the outline in view or more whose contacts were all within `at` (m,).

    Frames without contacts count as missed, so that a method that answers seldom gains nothing.

    Args:
        runs: frames of one method.
        at: distances, px; per cent of the true opening with `of_opening`.
        of_opening: see `at`.
    """
    asked = [f for run in runs for f in run if not f.defining and f.present and f.visible >= PARTLY]
    size = [(100.0 * f.error / f.opening if of_opening else f.error) if f.answered else np.inf for f in asked]
    errors = np.array(size, dtype=np.float64)
    known = errors[~np.isnan(errors)]
    return cumulative_share(known, at) if len(known) else np.full(len(at), np.nan)


def recovery_curve(runs: Runs, most: int) -> tuple[Floats, int]:
    """(most + 1,) share of the object's returns after which it was rightly located within 0, 1, ... frames, and returns."""
    waits = [wait for run in runs for wait in recovery_delays(run)]
    counts = np.zeros(most + 1)
    for wait in waits:
        if wait is not None and wait <= most:
            counts[wait:] += 1
    return counts / max(1, len(waits)), len(waits)


def spread_of(values: Iterable[float], percents: Sequence[float]) -> Floats:
    """Percentiles of the values that are known; NaN without any."""
    array = np.array([v for v in values if not np.isnan(v)])
    return np.asarray(np.percentile(array, percents) if len(array) else np.full(len(percents), np.nan))
