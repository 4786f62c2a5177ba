# SPDX-License-Identifier: Apache-2.0
"""Axes of charts: values to places, and the values that are worth a mark."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from grasptrack.typing import Floats
from grasptrack.view.report.markup import format_number


@dataclass(frozen=True)
class Axis:
    """One axis.

    Attributes:
        label: below or above it, with the unit.
        low, high: values at its ends.
        kind: "log" for what spans decades, "root" for shares that are mostly near 0.
        ticks: values to mark; None chooses them.
        unit: behind values shown on hovering; "%" shows a share in per cent.
    """

    label: str
    low: float
    high: float
    kind: Literal["linear", "log", "root"] = "linear"
    ticks: Sequence[float] | None = None
    unit: str = ""

    def place(self, values: ArrayLike) -> Floats:
        """0 to 1 along the axis, held at its ends; NaN stays."""
        ends = self._to_scale(np.array([self.low, self.high]))
        clipped = np.clip(np.asarray(values, dtype=np.float64), self.low, self.high)
        return np.asarray((self._to_scale(clipped) - ends[0]) / (ends[1] - ends[0]), dtype=np.float64)

    def _to_scale(self, values: Floats) -> Floats:
        if self.kind == "log":
            return np.asarray(np.log10(values), dtype=np.float64)
        return np.sqrt(np.maximum(values, 0.0)) if self.kind == "root" else values

    @property
    def marks(self) -> list[float]:
        """Values with a mark."""
        if self.ticks is not None:
            return [t for t in self.ticks if self.low <= t <= self.high]
        if self.kind == "log":
            return log_ticks(self.low, self.high)
        if self.kind == "root":
            chosen = [self.high]
            for share in (0.5, 0.25, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 0.0):
                if self.low <= share < self.high and np.ptp(self.place([share, chosen[0]])) >= 0.12:
                    chosen.insert(0, share)
            return chosen
        return linear_ticks(self.low, self.high)

    def written(self, value: float) -> str:
        """A mark's text."""
        if self.unit == "%":
            return f"{100.0 * value:g} %"
        return f"{value:g}" if abs(value) >= 1e-4 or value == 0.0 else format_number(value, 1)


def log_ticks(low: float, high: float) -> list[float]:
    """Powers of ten in a range; 2 and 5 times these too where the powers alone would be few."""
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    chosen = [10.0**p for p in powers if low * 0.999 <= 10.0**p <= high * 1.001]
    if len(chosen) >= 3:
        return chosen[:: 2 if len(chosen) > 6 else 1]
    return [m * 10.0**p for p in powers for m in (1, 2, 5) if low * 0.999 <= m * 10.0**p <= high * 1.001]


def linear_ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Round values in a range, at most so many."""
    raw = (high - low) / most
    size = 10.0 ** math.floor(math.log10(raw))
    step = next(size * m for m in (1, 2, 2.5, 5, 10) if size * m >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    return [round(i * step, 12) for i in range(first, math.floor(high / step + 1e-9) + 1)]


def log_range(values: ArrayLike, least: float, most: float, floor: float = 2.0) -> tuple[float, float]:
    """Ends of a logarithmic axis that holds the positive finite values, within limits and at 1, 2 or 5 of a decade.

    Args:
        values: any; others are left out.
        least, most: the ends never go beyond these.
        floor: the least ratio of the ends.
    """
    array = np.asarray(values, dtype=np.float64)
    array = array[np.isfinite(array) & (array > 0.0)]
    low = max(least, min(most, float(array.min()))) if len(array) else least
    high = min(most, max(least, float(array.max()))) if len(array) else most
    high = max(high, low * floor)
    return _round_limit(low, math.floor), _round_limit(high, math.ceil)


def _round_limit(value: float, toward: Callable[[float], int]) -> float:
    power = math.floor(math.log10(value) + 1e-12)
    lead = value / 10.0**power
    below = max(m for m in (1, 2, 5) if m <= lead + 1e-9)
    if toward is math.floor or abs(lead - below) < 1e-9:
        return float(below * 10.0**power)
    return float({1: 2, 2: 5, 5: 10}[below] * 10.0**power)
