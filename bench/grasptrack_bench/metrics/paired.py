# SPDX-License-Identifier: Apache-2.0
"""Two runs of one method on the same sequences: each measure of both, and by how much their difference is noise."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grasptrack.typing import Floats
from grasptrack_bench.metrics.integrity import PARTLY, WHOLE, recovery_delays
from grasptrack_bench.metrics.score import FrameScore

Pair = tuple[FrameScore, FrameScore]

FEW_CASES, BLOCK = 8, 25
"""With fewer sequences than these each is cut into blocks of so many frames: neighbours in time resemble each other."""
FEW_UNITS = 5
"""With fewer sequences or blocks than these the noise cannot be told."""
AROUND, STEPS = 20.0, 161
"""Quantiles are drawn again among so many values that lie within so many per cent of the values round the quantile."""


@dataclass(frozen=True)
class Unit:
    """The frames of one sequence, or of a block of one, in both runs; and the waits after the object's returns."""

    pairs: tuple[Pair, ...]
    waits: tuple[tuple[int | None, ...], tuple[int | None, ...]]

    @classmethod
    def of(cls, one: Sequence[FrameScore], other: Sequence[FrameScore]) -> Unit:
        """A whole sequence: the frames that both runs have, without those that define a truth."""
        second = {f.frame: f for f in other if not f.defining}
        pairs = tuple((f, second[f.frame]) for f in one if not f.defining and f.frame in second)
        return cls(pairs, (tuple(recovery_delays(one)), tuple(recovery_delays(other))))

    @cached_property
    def sides(self) -> tuple[_Side, _Side]:
        """Sums of the first run and of the second."""
        return _Side.of(self, 0), _Side.of(self, 1)


@dataclass(frozen=True, slots=True)
class PairedMeasure:
    """A measure in two runs.

    Attributes:
        a, b: its values; NaN where there is nothing to measure.
        error: standard error of b - a as sequences are drawn again; NaN where there are too few.
        units: sequences or blocks that it is made from.
    """

    a: float
    b: float
    error: float
    units: int


def units_of(sequences: Iterable[Unit]) -> list[Unit]:
    """Whole sequences; blocks of them where there are few."""
    listed = [u for u in sequences if u.pairs]
    if len(listed) >= FEW_CASES:
        return listed
    return [
        Unit(u.pairs[i : i + BLOCK], u.waits if i == 0 else ((), ()))
        for u in listed
        for i in range(0, len(u.pairs), BLOCK)
    ]


def measures_of(units: Sequence[Unit], taken: Floats) -> dict[str, PairedMeasure]:
    """Each measure in both runs, with the standard error of its difference.

    Errors are those of the frames that both runs answered with the object there, so that to answer more, and harder,
    frames is no loss.

    Args:
        units: as from `units_of`.
        taken: (draws, n) as from `bootstrap_counts`, for n units or more; the rest is left out.
    """
    if not units:
        return {}
    if taken.shape[1] != len(units):
        raise ValueError(f"draws of {taken.shape[1]} units cannot serve {len(units)}")
    sides = [[u.sides[k] for u in units] for k in (0, 1)]
    found: dict[str, PairedMeasure] = {}
    for key in ("located_whole", "located_partly", "tracked_visible", "recovered", "recovery_frames", "rms_px"):
        parts = [np.array([getattr(s, key) for s in side], dtype=np.float64) for side in sides]
        found[key] = _of_ratio(parts, taken, root=key == "rms_px")
    for key, values, percent in (
        ("median_px", "errors", 50.0),
        ("p95_px", "errors", 95.0),
        ("median_ms", "times", 50.0),
    ):
        found[key] = _of_quantile([[getattr(s, values) for s in side] for side in sides], percent, taken)
    return found


def wrong_in_one(units: Sequence[Unit]) -> tuple[int, int, int, int]:
    """False accepts of the first run and of the second, and those that only the first has, and only the second."""
    flags = np.array([(a.is_false_accept, b.is_false_accept) for u in units for a, b in u.pairs]).reshape(-1, 2)
    a, b = flags[:, 0], flags[:, 1]
    return int(a.sum()), int(b.sum()), int((a & ~b).sum()), int((b & ~a).sum())


@dataclass(frozen=True)
class _Side:
    """Sums of one unit in one run: pairs are a sum and how many it is of."""

    located_whole: tuple[float, float]
    located_partly: tuple[float, float]
    tracked_visible: tuple[float, float]
    recovered: tuple[float, float]
    recovery_frames: tuple[float, float]
    rms_px: tuple[float, float]
    errors: Floats
    times: Floats

    @classmethod
    def of(cls, unit: Unit, side: int) -> _Side:
        frames = [pair[side] for pair in unit.pairs]
        whole = [f for f in frames if f.present and f.visible >= WHOLE]
        partly = [f for f in frames if f.present and PARTLY <= f.visible < WHOLE]
        answered = [(a.distances, b.distances) for a, b in unit.pairs if not a.gone and not b.gone]
        both = [pair[side] for pair in answered if pair[0] is not None and pair[1] is not None]
        errors = np.concatenate([d for d in both if d is not None]) if both else np.empty(0)
        errors = errors[np.isfinite(errors)]  # where the truth is behind the camera, for both runs alike
        times = np.array([f.latency_ms for f in frames])
        waits = [w for w in unit.waits[side] if w is not None]
        shown = [*whole, *partly]
        return cls(
            (sum(f.answered for f in whole), len(whole)),
            (sum(f.answered for f in partly), len(partly)),
            (sum(f.status == "tracked" for f in shown), len(shown)),
            (len(waits), len(unit.waits[side])),
            (sum(waits), len(waits)),
            (float((errors**2).sum()), len(errors)),
            errors,
            times[np.isfinite(times)],
        )


def _of_ratio(parts: Sequence[Floats], taken: Floats, root: bool) -> PairedMeasure:
    def evaluate_ratio(sums: Floats) -> Floats:
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = sums[..., 0] / sums[..., 1]
        return np.asarray(np.sqrt(ratio) if root else ratio, dtype=np.float64)

    a, b = (float(evaluate_ratio(p.sum(axis=0))) for p in parts)
    return PairedMeasure(
        a,
        b,
        _standard_error(evaluate_ratio(taken @ parts[1]) - evaluate_ratio(taken @ parts[0]), taken.shape[1]),
        taken.shape[1],
    )


def _of_quantile(sides: Sequence[Sequence[Floats]], percent: float, taken: Floats) -> PairedMeasure:
    pooled = [np.concatenate(side) for side in sides]
    if not len(pooled[0]) or not len(pooled[1]):
        return PairedMeasure(math.nan, math.nan, math.nan, taken.shape[1])
    a, b = (float(np.percentile(p, percent)) for p in pooled)
    near = np.linspace(max(0.0, percent - AROUND), min(100.0, percent + AROUND), STEPS)
    edges = np.unique(np.percentile(np.concatenate(pooled), near))
    edges = np.unique(np.append(edges, [a, b]))
    spread = []
    for side in sides:
        below = np.array([np.searchsorted(np.sort(values), edges, side="right") for values in side], dtype=np.float64)
        total = taken @ np.array([len(values) for values in side], dtype=np.float64)
        first = ((taken @ below) < 0.01 * percent * total[:, None]).sum(axis=1)
        spread.append(edges[first.clip(max=len(edges) - 1)])
    return PairedMeasure(a, b, _standard_error(spread[1] - spread[0], taken.shape[1]), taken.shape[1])


def _standard_error(differences: Floats, units: int) -> float:
    known = differences[np.isfinite(differences)]
    return float(known.std()) if units >= FEW_UNITS and len(known) >= len(differences) / 2 else math.nan
