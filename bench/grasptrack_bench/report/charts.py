# SPDX-License-Identifier: Apache-2.0
"""The charts of a run's report."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from grasptrack_bench.charts import Axis, Chart, Series, format_number
from grasptrack_bench.charts.chart import log_range
from grasptrack_bench.metrics.integrity import (
    Runs,
    out_of_view,
    over_time,
    precision_curve,
    recovery_curve,
    risk_coverage,
    spread_of,
)
from grasptrack_bench.run_folder import EvaluationRun

Methods = Mapping[str, Series]

_UPPER, _LOWER = (40, 26, 10, 6), (40, 7, 10, 36)
CAMERA_MS = 1000.0 / 30.0
WAIT = 30
"""Frames after a return that are shown."""


def time_charts(run: EvaluationRun, level: str, series: Methods, ends: tuple[float, float]) -> tuple[Chart, Chart]:
    """Error over the frames of one level, a disturbance or a video, and below it the share located.

    `ends` are those of the axis of errors, px.
    """
    cases = [c for c in run.scored if c.disturbance == level]
    lines = {name: over_time(run.runs(name, cases)) for name in series if run.runs(name, cases)}
    last = max((t.frames[-1] for t in lines.values() if len(t.frames)), default=1.0)
    x = Axis("frame", 0.0, max(1.0, last))
    upper = Chart(
        f"Error over time, {level}",
        Axis("frame", x.low, x.high, ticks=()),
        Axis("error, px", *ends, "log"),
        340,
        184,
        _UPPER,
    )
    shares = Axis("", 0.0, 1.0, ticks=(0.0, 1.0), unit="%")
    lower = Chart(f"Share located over time, {level}", x, shares, 340, 70, _LOWER)
    some = next((run.runs(name, cases) for name in lines), [])
    for chart in (upper, lower):
        for kind, stretches in zip(("gone", "partly"), out_of_view(some), strict=True):
            tip = "most of it out of view" if kind == "gone" else "partly out of view"
            for first, final in stretches:
                chart.shade_span(max(x.low, first - 0.5), min(x.high, final + 0.5), kind, tip)
    for name in reversed(list(lines)):
        t = lines[name]
        if len(cases) > 2:
            upper.draw_band(t.frames, t.low, t.high, series[name])
        upper.draw_line(t.frames, t.median, series[name])
        lower.draw_line(t.frames, t.located, series[name])
    return upper, lower


def error_ends(run: EvaluationRun, methods: Sequence[str]) -> tuple[float, float]:
    """Ends of the axis of errors that all charts over time share, px."""
    errors = np.array([e for m in methods for e in _finite_errors(run.runs(m, run.scored))])
    known = errors[errors > 0.0]
    return log_range(np.percentile(known, (1.0, 99.9)) if len(known) else known, 1e-3, 300.0, floor=10.0)


def precision_chart(run: EvaluationRun, series: Methods, of_opening: bool) -> Chart:
    """Cumulative error over all frames in which an answer can be asked for."""
    unit = "%" if of_opening else "px"
    at = np.geomspace(0.01, 30.0, 141)
    what = "of the opening" if of_opening else ""
    x = Axis(f"error at most, {unit} {what}".strip(), 0.01, 30.0, "log", (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0))
    chart = Chart(f"Precision at a distance in {unit} {what}".strip(), x, Axis("share of frames", 0.0, 1.0, unit="%"))
    for name in reversed(list(series)):
        chart.draw_line(at, precision_curve(run.runs(name, run.scored), at, of_opening), series[name])
    return chart


def risk_chart(run: EvaluationRun, series: Methods) -> Chart:
    """Share of wrong answers as they are taken by falling confidence; a ring for a method without a confidence."""
    curves = {m: risk_coverage(f for r in run.runs(m, run.scored) for f in r) for m in series}
    ends: dict[str, tuple[float, float]] = {}
    for name in series:
        frames = [f for r in run.runs(name, run.scored) for f in r if f.measured]
        given = sum(f.answered for f in frames)
        if given:
            ends[name] = given / len(frames), sum(f.is_false_accept for f in frames) / given
    top = max([0.01, *(r for _, r in ends.values()), *(float(c[:, 2].max()) for c in curves.values() if len(c))])
    high = next(v for v in (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.75, 1.0) if v >= min(1.0, top))
    x = Axis("coverage: share of frames answered", 0.0, 1.0, unit="%")
    y = Axis("risk: share of wrong answers", 0.0, high, "root", unit="%")
    chart = Chart("Risk over coverage", x, y, grid="both")
    for name in reversed(list(ends)):
        curve = curves[name]
        if len(curve):
            chart.draw_line(np.append(0.0, curve[:, 1]), np.append(curve[0, 2], curve[:, 2]), series[name])
        at = (float(curve[-1, 1]), float(curve[-1, 2])) if len(curve) else ends[name]
        tip = f"{name}: {format_number(100 * at[1], 2)} % wrong of the {format_number(100 * at[0], 3)} % answered"
        chart.draw_dot(*at, series[name], tip, hollow=not len(curve))
    return chart


def recovery_chart(run: EvaluationRun, series: Methods) -> Chart | None:
    """Share of the object's returns after which it was located within so many frames; None where it never left."""
    x = Axis("frames after its return to whole view", 0.0, float(WAIT))
    chart = Chart("Frames until recovery", x, Axis("share of returns", 0.0, 1.0, unit="%"))
    returned = False
    for name in reversed(list(series)):
        shares, returns = recovery_curve(run.runs(name, run.scored), WAIT)
        if returns:
            chart.draw_stairs(np.arange(WAIT + 1), shares, series[name])
            returned = True
    return chart if returned else None


def spread_chart(run: EvaluationRun, series: Methods, levels: Sequence[str]) -> Chart:
    """Median error and the range of 90 % of the frames, a line for each method, level by level."""
    step, head, top = 9.0, 24.0, 4
    block = step * len(series) + head + 6.0
    rows: list[tuple[float, str, Sequence[float], str]] = []
    for i, level in enumerate(levels):
        cases = [c for c in run.scored if c.disturbance == level]
        for k, method in enumerate(series):
            values = spread_of(_finite_errors(run.runs(method, cases)), (5.0, 50.0, 95.0)).tolist()
            middle, low, high = (format_number(values[j]) for j in (1, 0, 2))
            tip = f"{method}, {level}: median {middle} px, 5 to 95 %: {low} to {high} px"
            rows.append((top + i * block + head + (k + 0.5) * step, method, values, tip))
    ends = log_range([v for _, _, values, _ in rows for v in values], 1e-3, 1e3, floor=10.0)
    x, y = Axis("error, px", *ends, "log"), Axis("", 0.0, 1.0, ticks=())
    height = round(top + block * len(levels) + 46)
    chart = Chart(f"Errors by {run.factor}", x, y, 640, height, (8, top, 22, 42), "both")
    for i, level in enumerate(levels):
        if i:
            chart.draw_separator(top + i * block)
        chart.draw_text(chart.left, top + i * block + 17, level, "strong")
    for at, method, values, tip in rows:
        chart.draw_spread(values, at, series[method], tip)
    return chart


def latency_chart(run: EvaluationRun, series: Methods) -> Chart:
    """Time of an update: median, and the range from the 5th percentile to the 99th."""
    spreads = {
        m: spread_of((f.latency_ms for r in run.runs(m, run.scored) for f in r if not f.defining), (5.0, 50.0, 99.0))
        for m in series
    }
    known = {m: v.tolist() for m, v in spreads.items() if np.isfinite(v).all()}
    low, high = log_range([v for values in known.values() for v in values] + [CAMERA_MS], 1e-3, 1e5, floor=10.0)
    step, top = 24.0, 18
    wide = 20 + 8 * max(map(len, series), default=0)
    chart = Chart(
        "Latency by method",
        Axis("ms for an update", low, high, "log"),
        Axis("", 0.0, 1.0, ticks=()),
        460,
        round(top + step * len(known) + 44),
        (wide, top, 22, 40),
        "both",
    )
    chart.draw_rule(CAMERA_MS, "30 frames/s")
    for k, (method, values) in enumerate(known.items()):
        y = top + (k + 0.5) * step + 2
        chart.draw_text(chart.left - 8, y + 4, method, "end", series[method])
        chart.draw_spread(
            values,
            y,
            series[method],
            f"{method}: median {format_number(values[1])} ms, 99 %: {format_number(values[2])} ms",
        )
    return chart


def _finite_errors(runs: Runs) -> list[float]:
    return [f.error for run in runs for f in run if not f.defining and not f.gone and math.isfinite(f.error)]
