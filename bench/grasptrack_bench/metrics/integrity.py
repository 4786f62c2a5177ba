# SPDX-License-Identifier: Apache-2.0
"""What scored frames add up to: how often contacts are given, how often wrongly, how exactly; as numbers and as curves."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import compress
from typing import Literal

import numpy as np

from grasptrack.typing import Floats
from grasptrack_bench.metrics.score import FrameScore, errors_of
from grasptrack_bench.metrics.statistics import upper_bound

WHOLE = 0.995
"""Share of the outline that must be in view for the object to count as whole in view; less is the renderer's rounding."""
PARTLY = 0.7
"""Share of the outline in view down to which an answer can be asked for: up to 30 % covered or cut."""
ELLIPSE_95 = 5.991
"""Squared Mahalanobis distance within which 95 % of the errors of a true covariance lie (chi square, two degrees)."""

ALIGNED_PX = 5.0, 15.0
"""px of the alignment error up to which the benchmark POT, and those who report on it, count a frame as tracked."""


@dataclass(frozen=True, slots=True)
class Measures:
    """One method over any number of frames; shares are 0 to 1, NaN where there is nothing to count.

    Attributes:
        frames: that were looked at; those that define a grasp's truth are left out of all that follows.
        located_whole: contacts given, of the frames with the whole object in view.
        located_partly: the same of the frames with 70 % of the outline in view or more, but not all.
        tracked_visible: status tracked, of the frames with 70 % of the outline in view or more.
        false_accepts: frames with contacts given and wrong, or with the object gone.
        false_given_gone: those of them in which the object was gone.
        false_bound: upper 95 % bound of the rate of false accepts among all frames.
        rms_px, median_px, p95_px, max_px: of the contacts' distances from the truth, each contact for itself, over all
            frames that were answered with the object there, wrong ones included.
        median_percent: median distance in per cent of the grasp's true opening.
        in_ellipse: share of these contacts within their 95 % ellipse.
        recovery_frames: mean number of frames from the object's return to whole view until contacts are given rightly.
        recoveries, returns: how often they were given before it was hidden again, and how often it returned.
        median_ms, p99_ms: latency.
        frames_whole: frames with the whole object in view.
        aligned_5, aligned_15: frames with an alignment error up to 5 and 15 px, of those whose corners are known.
        losses: how often contacts were missing after there had been some, with 70 % of the outline in view all the while.
        lost_median, lost_p95: frames from a loss until contacts are given rightly; infinite where they were not any more.
    """

    frames: int
    located_whole: float
    located_partly: float
    tracked_visible: float
    false_accepts: int
    false_given_gone: int
    false_bound: float
    rms_px: float
    median_px: float
    p95_px: float
    max_px: float
    median_percent: float
    in_ellipse: float
    recovery_frames: float
    recoveries: int
    returns: int
    median_ms: float
    p99_ms: float
    frames_whole: int
    aligned_5: float
    aligned_15: float
    losses: int
    lost_median: float
    lost_p95: float


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


def compute_measures(runs: Iterable[Sequence[FrameScore]]) -> Measures:
    """All measures of one method over its runs, each a sequence of frames in order."""
    listed = [list(run) for run in runs]
    frames = [f for run in listed for f in run if f.measured]
    whole = [f for f in frames if f.present and f.visible >= WHOLE]
    partly = [f for f in frames if f.present and PARTLY <= f.visible < WHOLE]
    wrong = [f for f in frames if f.is_false_accept]
    errors = errors_of(frames)
    finite = errors[np.isfinite(errors)]
    shares = [100.0 * f.distances / f.opening for f in frames if f.distances is not None and not f.gone]
    spread = [f.spread for f in frames if f.spread is not None and not f.gone]
    waits = [wait for run in listed for wait in recovery_delays(run)]
    aligned = np.array([f.alignment for f in frames if not math.isnan(f.alignment)])
    within = [_share_true(aligned <= most) for most in ALIGNED_PX]
    lost = np.array([length for run in listed for length in loss_lengths(run)])
    times = np.array([f.latency_ms for run in listed for f in run if not f.defining and math.isfinite(f.latency_ms)])
    return Measures(
        frames=len(frames),
        located_whole=_share_true(f.answered for f in whole),
        located_partly=_share_true(f.answered for f in partly),
        tracked_visible=_share_true(f.status == "tracked" for f in (*whole, *partly)),
        false_accepts=len(wrong),
        false_given_gone=sum(f.gone for f in wrong),
        false_bound=upper_bound(len(wrong), len(frames)),
        rms_px=float(np.sqrt(np.mean(errors**2))) if len(errors) else math.nan,
        median_px=_percentile_or_nan(errors, 50),
        p95_px=_percentile_or_nan(errors, 95),
        max_px=float(errors.max()) if len(finite) else math.nan,
        median_percent=_percentile_or_nan(np.concatenate(shares), 50) if shares else math.nan,
        in_ellipse=_share_true(np.concatenate(spread) <= ELLIPSE_95) if spread else math.nan,
        recovery_frames=float(np.mean([w for w in waits if w is not None]))
        if any(w is not None for w in waits)
        else math.nan,
        recoveries=sum(w is not None for w in waits),
        returns=len(waits),
        median_ms=_percentile_or_nan(times, 50),
        p99_ms=_percentile_or_nan(times, 99),
        frames_whole=len(whole),
        aligned_5=within[0],
        aligned_15=within[1],
        losses=len(lost),
        lost_median=_percentile_or_nan(lost, 50, "higher"),
        lost_p95=_percentile_or_nan(lost, 95, "higher"),
    )


def loss_lengths(run: Sequence[FrameScore]) -> list[float]:
    """For each loss of the object, in view all the time: frames until it was located again; infinite where it never was."""
    lengths: list[float] = []
    held, since = False, None
    for i, f in enumerate(run):
        if not f.present or f.visible < PARTLY:  # away: what follows is a return
            held, since = False, None
        elif f.answered and not f.is_false_accept:
            if since is not None:
                lengths.append(i - since)
            held, since = True, None
        elif held and since is None and not f.answered:
            since = i
    return lengths if since is None else [*lengths, math.inf]


def recovery_delays(run: Sequence[FrameScore]) -> list[int | None]:
    """For each return of the object to whole view after it was gone or hardly in view: frames until it was located.

    0 is the very frame of its return; None: not before it was hidden again, or the run ended.
    """
    waits: list[int | None] = []
    away, since = False, None
    for f in run:
        here = f.present and f.visible >= WHOLE
        if not f.present or f.visible < PARTLY:
            away = True
            if since is not None:
                waits.append(None)
                since = None
        elif here and away:
            away, since = False, f.frame
        if since is not None and f.answered and not f.is_false_accept:
            waits.append(f.frame - since)
            since = None
    return waits if since is None else [*waits, None]


def risk_coverage(frames: Iterable[FrameScore]) -> Floats:
    """(n, 3) confidence, coverage and risk as answers are taken in the order of falling confidence.

    Coverage is the share of all frames, risk the share of false accepts among those taken; frames of one confidence are
    taken together. Empty where a method gives no confidence.
    """
    listed = [f for f in frames if f.measured]
    given = [(f.confidence, f.is_false_accept) for f in listed if f.answered and math.isfinite(f.confidence)]
    if not given:
        return np.empty((0, 3))
    confidence, wrong = np.array(given, dtype=np.float64).T
    order = np.argsort(-confidence, kind="stable")
    confidence, wrong = confidence[order], np.cumsum(wrong[order])
    last = np.append(np.diff(confidence) != 0.0, True)
    taken = np.arange(1, len(wrong) + 1)
    table = np.column_stack([confidence, taken / len(listed), wrong / taken])
    return np.asarray(table[last], dtype=np.float64)


def cumulative_share(errors: Floats, at: Floats) -> Floats:
    """Share of errors (n,) px at most as large as each of `at` (m,) px: a precision at t px where all frames count."""
    return np.asarray(np.searchsorted(np.sort(errors), at, side="right") / max(1, len(errors)), dtype=np.float64)


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
    return frame_ranges(compress(frames, away)), frame_ranges(compress(frames, partly))


def frame_ranges(frames: Iterable[int]) -> list[tuple[int, int]]:
    """First and last of each stretch of frame numbers without a gap."""
    found: list[tuple[int, int]] = []
    for frame in frames:
        if found and found[-1][1] == frame - 1:
            found[-1] = (found[-1][0], frame)
        else:
            found.append((frame, frame))
    return found


def precision_curve(runs: Runs, at: Floats, of_opening: bool = False) -> Floats:
    """Share of the frames with 70 % of the outline in view or more whose contacts were all within `at` (m,).

    px, or per cent of the true opening. Frames without contacts count as missed, so that a method that answers seldom gains
    nothing.
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


def _share_true(of: Iterable[object]) -> float:
    flags = [bool(x) for x in of]
    return sum(flags) / len(flags) if flags else math.nan


def _percentile_or_nan(values: Floats, percent: float, method: Literal["linear", "higher"] = "linear") -> float:
    return float(np.percentile(values, percent, method=method)) if len(values) else math.nan
