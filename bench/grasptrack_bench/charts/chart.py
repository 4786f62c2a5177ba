# SPDX-License-Identifier: Apache-2.0
"""Charts as SVG whose colours are CSS variables, so that one drawing serves light pages, dark ones and paper; their axes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.typing import Floats
from grasptrack_bench.charts.palette import Series, escape_html, format_number


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

    def to_fraction(self, values: ArrayLike) -> Floats:
        """0 to 1 along the axis, held at its ends; NaN stays."""
        ends = self._to_scale(np.array([self.low, self.high]))
        clipped = np.clip(np.asarray(values, dtype=np.float64), self.low, self.high)
        return np.asarray((self._to_scale(clipped) - ends[0]) / (ends[1] - ends[0]), dtype=np.float64)

    def _to_scale(self, values: Floats) -> Floats:
        if self.kind == "log":
            return np.asarray(np.log10(values), dtype=np.float64)
        return np.sqrt(np.maximum(values, 0.0)) if self.kind == "root" else values

    @property
    def tick_values(self) -> list[float]:
        """Values with a mark."""
        if self.ticks is not None:
            return [t for t in self.ticks if self.low <= t <= self.high]
        if self.kind == "log":
            return log_ticks(self.low, self.high)
        if self.kind == "root":
            chosen = [self.high]
            for share in (0.5, 0.25, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 0.0):
                if self.low <= share < self.high and np.ptp(self.to_fraction([share, chosen[0]])) >= 0.12:
                    chosen.insert(0, share)
            return chosen
        return linear_ticks(self.low, self.high)

    def format_tick(self, value: float) -> str:
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


def linear_ticks(low: float, high: float) -> list[float]:
    """Round values in a range, some six."""
    raw = (high - low) / 6
    size = 10.0 ** math.floor(math.log10(raw))
    step = next(size * m for m in (1, 2, 2.5, 5, 10) if size * m >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    return [round(i * step, 12) for i in range(first, math.floor(high / step + 1e-9) + 1)]


def log_range(values: ArrayLike, least: float, most: float, floor: float = 2.0) -> tuple[float, float]:
    """Ends of a logarithmic axis that holds the positive finite values, within limits and at 1, 2 or 5 of a decade.

    `floor` is the least ratio of the ends.
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


class Chart:
    """One panel with two axes.

    Args:
        title: what it shows, for those who do not see it.
        x, y: axes.
        width, height: px of its coordinates.
        margins: px on the left, on top, on the right and below for what stands beside the panel.
        grid: lines at the marks of the y axis; of x too with "both".
    """

    def __init__(
        self,
        title: str,
        x: Axis,
        y: Axis,
        width: int = 460,
        height: int = 310,
        margins: tuple[int, int, int, int] = (46, 30, 22, 40),
        grid: str = "y",
    ) -> None:
        self.title, self.x, self.y, self.grid = title, x, y, grid
        self.width, self.height = width, height
        self.left, self.top = margins[0], margins[1]
        self.right, self.bottom = width - margins[2], height - margins[3]
        self._below: list[str] = []
        self._parts: list[str] = []
        self._texts: list[str] = []

    def to_x(self, values: ArrayLike) -> Floats:
        """Places along x."""
        return self.left + self.x.to_fraction(values) * (self.right - self.left)

    def to_y(self, values: ArrayLike) -> Floats:
        """Places along y, counted from the top."""
        return self.bottom - self.y.to_fraction(values) * (self.bottom - self.top)

    def draw_line(self, xs: ArrayLike, ys: ArrayLike, series: Series) -> None:
        """A line; it breaks where a value is none."""
        path = _svg_path(self.to_x(xs), self.to_y(ys))
        if path:
            dash = f' stroke-dasharray="{series.dash}"' if series.dash else ""
            self._parts.append(
                f'<path class="ln" data-m="{escape_html(series.name)}" d="{path}" '
                f'style="stroke:var({series.variable})" stroke-width="{series.width:g}"{dash}/>'
            )

    def draw_stairs(self, xs: ArrayLike, ys: ArrayLike, series: Series) -> None:
        """A line of steps: each value holds until the next."""
        x, y = np.asarray(xs, dtype=np.float64), np.asarray(ys, dtype=np.float64)
        self.draw_line(np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1], series)

    def draw_band(self, xs: ArrayLike, low: ArrayLike, high: ArrayLike, series: Series) -> None:
        """The area between two lines, where both have values; shown for the method that is looked at."""
        x, a, b = self.to_x(xs), self.to_y(low), self.to_y(high)
        known = np.isfinite(x) & np.isfinite(a) & np.isfinite(b)
        pieces = []
        for run in _true_runs(known):
            there = [f"{px:.1f},{py:.1f}" for px, py in zip(x[run], b[run], strict=True)]
            back = [f"{px:.1f},{py:.1f}" for px, py in zip(x[run][::-1], a[run][::-1], strict=True)]
            pieces.append("M" + "L".join([*there, *back]) + "Z")
        if pieces:
            self._below.append(
                f'<path class="band" data-m="{escape_html(series.name)}" d="{"".join(pieces)}" '
                f'style="fill:var({series.variable})"/>'
            )

    def draw_dot(self, x: float, y: float, series: Series, tip: str = "", *, hollow: bool = False) -> None:
        """One value."""
        px, py = float(self.to_x(x)), float(self.to_y(y))
        if np.isfinite([px, py]).all():
            self._add_dot(px, py, series, tip, 3.6, hollow)

    def _add_dot(self, px: float, py: float, series: Series, tip: str, radius: float, hollow: bool) -> None:
        paint = f"fill:{'var(--surface)' if hollow else f'var({series.variable})'};stroke:var({series.variable})"
        said = f"<title>{escape_html(tip)}</title>" if tip else ""
        self._parts.append(
            f'<circle class="dot" data-m="{escape_html(series.name)}" cx="{px:.1f}" cy="{py:.1f}" r="{radius:g}" '
            f'style="{paint}">{said}</circle>'
        )

    def draw_spread(self, values: Sequence[float], y: float, series: Series, tip: str = "") -> None:
        """Low, middle and high along x at a place y px: a line with a dot."""
        low, middle, high = (float(self.to_x(v)) for v in values)
        if not np.isfinite([low, middle, high]).all():
            return
        self._parts.append(
            f'<path class="reach" data-m="{escape_html(series.name)}" d="M{low:.1f},{y:.1f}H{high:.1f}" '
            f'style="stroke:var({series.variable})"/>'
        )
        self._add_dot(middle, y, series, tip, 3.4, hollow=False)

    def shade_span(self, low: float, high: float, kind: str, tip: str = "") -> None:
        """Shades the values of x between two; `kind` is the class: "gone" or "partly"."""
        a, b = (float(v) for v in self.to_x([low, high]))
        said = f"<title>{escape_html(tip)}</title>" if tip else ""
        self._below.append(
            f'<rect class="span {kind}" x="{a:.1f}" y="{self.top}" width="{max(1.0, b - a):.1f}" '
            f'height="{self.bottom - self.top}">{said}</rect>'
        )

    def draw_rule(self, value: float, label: str) -> None:
        """A marked value of x with a line across the panel."""
        at = float(self.to_x(value))
        self._below.append(f'<path class="rule" d="M{at:.1f},{self.top}V{self.bottom}"/>')
        late = at > 0.5 * (self.left + self.right)
        self.draw_text(at + (4 if late else -4), self.top - 5, label, "end" if late else "")

    def draw_separator(self, y: float) -> None:
        """A thin line across the whole width at a place y px."""
        self._below.append(f'<path class="grid" d="M4,{y:.1f}H{self.right}"/>')

    def draw_text(self, x: float, y: float, text: str, kind: str = "", series: Series | None = None) -> None:
        """A line of text at a place in px; `kind`: classes, "end" and "mid" say where it is held."""
        marks = f' data-m="{escape_html(series.name)}"' if series is not None else ""
        self._texts.append(f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}"{marks}>{escape_html(text)}</text>')

    def svg(self) -> str:
        """The whole drawing."""
        hover = (
            f'data-x="{_axis_attribute(self.x, self.left, self.right)}" '
            f'data-y="{_axis_attribute(self.y, self.bottom, self.top)}" '
            f'data-xl="{escape_html(self.x.label)}"'
        )
        return (
            f'<svg class="chart" viewBox="0 0 {self.width} {self.height}" role="img" '
            f'aria-label="{escape_html(self.title)}" {hover}>'
            f"{''.join(self._below)}{self._axes_svg()}{''.join(self._parts)}{''.join(self._texts)}</svg>"
        )

    def _axes_svg(self) -> str:
        out = []
        last = -1e9
        for value in self.x.tick_values:
            at = float(self.to_x(value))
            if self.grid == "both":
                out.append(f'<path class="grid" d="M{at:.1f},{self.top}V{self.bottom}"/>')
            out.append(f'<path class="tick" d="M{at:.1f},{self.bottom}v4"/>')
            text = self.x.format_tick(value)
            if at - last > 7.0 * len(text) + 4.0:
                out.append(f'<text class="mid" x="{at:.1f}" y="{self.bottom + 16}">{escape_html(text)}</text>')
                last = at
        for value in self.y.tick_values:
            at = float(self.to_y(value))
            out.append(f'<path class="grid" d="M{self.left},{at:.1f}H{self.right}"/>')
            out.append(
                f'<text class="end" x="{self.left - 6}" y="{at + 4:.1f}">{escape_html(self.y.format_tick(value))}</text>'
            )
        out.append(f'<path class="axis" d="M{self.left},{self.bottom}H{self.right}"/>')
        if self.x.label and self.x.tick_values:
            middle = (self.left + self.right) / 2
            out.append(
                f'<text class="label mid" x="{middle:.1f}" y="{self.bottom + 32}">{escape_html(self.x.label)}</text>'
            )
        if self.y.label:
            out.append(f'<text class="label" x="2" y="{max(9, self.top - 14)}">{escape_html(self.y.label)}</text>')
        return "".join(out)


def _axis_attribute(axis: Axis, start: float, end: float) -> str:
    return f"{axis.kind},{axis.low:g},{axis.high:g},{start},{end},{axis.unit}"


def _true_runs(known: NDArray[np.bool_]) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(np.int8)))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _svg_path(x: Floats, y: Floats) -> str:
    pieces = []
    for run in _true_runs(np.isfinite(x) & np.isfinite(y)):
        points = [f"{px:.1f},{py:.1f}" for px, py in zip(x[run], y[run], strict=True)]
        if len(points) == 1:
            points.append(f"{x[run][0] + 0.6:.1f},{y[run][0]:.1f}")
        pieces.append("M" + "L".join(points))
    return "".join(pieces)
