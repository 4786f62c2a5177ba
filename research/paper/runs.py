# SPDX-License-Identifier: Apache-2.0
"""Many runs of the same experiment, one row each: shapes by seeds; their medians with intervals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from grasptrack.typing import Floats
from grasptrack_bench.metrics.errors import ErrorMeasure
from grasptrack_bench.metrics.statistics import bootstrap_counts
from grasptrack_bench.report.table import Cell
from research.paper.transfers import count_reasons

OFF_PX = 3.0
"""An answer whose worst contact is farther from its place than this is counted as off."""


@dataclass(frozen=True, slots=True)
class StrategyRun:
    """What one strategy made of one sequence, or of the part of it at one value of what was varied.

    Attributes:
        experiment: "paths", "rule", "starts", "tilt", "clipped", "ablation", "refinement" or "sensitivity".
        shape, seed: of the sequence.
        motion, contours: see `footage`.
        strategy: or the variant of one.
        way: see `transfers.WAYS`.
        varied: what was varied, "" for nothing.
        value: of it: degrees, per cent, or a factor.
        asked, answered: frames.
        off: answered frames off by more than `OFF_PX`.
        mean_px, worst_px: SE over the answered frames (e_av and e_max times the area); None where all were refused.
        mean_percent: e_av in per cent of the opening.
        reason: that was given most often, "" for none.
    """

    experiment: str
    shape: str
    seed: int
    motion: str
    contours: str
    strategy: str
    way: str
    varied: str
    value: float
    asked: int
    answered: int
    off: int
    mean_px: float | None
    worst_px: float | None
    mean_percent: float | None
    reason: str


def run_of(errors: Sequence[ErrorMeasure | str], *setting: str | int | float) -> StrategyRun:
    """Run of a setting, the fields of `StrategyRun` up to `value`, whose frames had these errors, or reasons of refusals."""
    answered = [e for e in errors if isinstance(e, ErrorMeasure)]
    reasons = count_reasons(e for e in errors if isinstance(e, str))
    common: dict[str, Any] = dict(zip([f.name for f in fields(StrategyRun)], setting, strict=False))
    return StrategyRun(
        **{"varied": "", "value": 0.0, **common},
        asked=len(errors),
        answered=len(answered),
        off=sum(e.maximum_px > OFF_PX for e in answered),
        mean_px=float(np.mean([e.average_px for e in answered])) if answered else None,
        worst_px=max((e.maximum_px for e in answered), default=None),
        mean_percent=float(np.mean([e.average_percent for e in answered])) if answered else None,
        reason=next(iter(reasons), ""),
    )


SUMMARY = ("median px", "95 % from", "95 % to", "worst px", "median % of opening", "answered %", "off %")
"""Heads of what `summarize` gives."""
SUMMARY_NOTES = (
    "Median over the runs of their mean error (SE, e_av), with its 95 % interval: shapes drawn anew with replacement, since "
    "runs of one shape are not independent. Worst: of all contacts in all frames that were answered.",
    f"Answered: of all frames. Off: of the frames answered, those with a contact more than {OFF_PX:g} px from its place. "
    "Refused, -: nothing was answered.",
)


def summarize(runs: Iterable[StrategyRun]) -> list[Cell]:
    """Cells under `SUMMARY` for runs of several shapes and seeds."""
    listed = list(runs)
    asked, answered = sum(r.asked for r in listed), sum(r.answered for r in listed)
    known = [r for r in listed if r.mean_px is not None]
    share = 100.0 * answered / asked if asked else None
    if not known:
        return [*["refused"] * 5, share, None]
    values = np.array([r.mean_px for r in known], dtype=np.float64)
    middle, low, high = median_interval(values, [r.shape for r in known])
    return [
        middle,
        low,
        high,
        max(r.worst_px for r in known if r.worst_px is not None),
        float(np.median([r.mean_percent for r in known if r.mean_percent is not None])),
        share,
        100.0 * sum(r.off for r in listed) / answered,
    ]


def median_interval(values: Floats, units: Sequence[object], draws: int = 1000) -> tuple[float, float, float]:
    """Median of values (n,), n > 0, and its 95 % interval, by drawing whole units anew (bootstrap of clusters).

    `units` (n,) tells which each value belongs to: values of one unit are not independent of each other.
    """
    names = list(dict.fromkeys(units))
    unit = np.array([names.index(u) for u in units])
    order = np.argsort(values, kind="stable")
    weights = bootstrap_counts(len(names), draws, seed=0)[:, unit[order]]
    below = np.cumsum(weights, axis=1)
    drawn = values[order][(below >= 0.5 * below[:, -1:]).argmax(axis=1)]
    low, high = np.percentile(drawn, [2.5, 97.5], method="nearest").tolist()
    return float(np.median(values)), low, high
