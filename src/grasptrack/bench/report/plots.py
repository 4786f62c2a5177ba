# SPDX-License-Identifier: Apache-2.0
"""The sections of a run's page that show charts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grasptrack.bench.metrics.curves import precision_curve
from grasptrack.bench.metrics.summary import Summary
from grasptrack.bench.report import charts as charts
from grasptrack.bench.report.worst_frames import Progress, report_progress
from grasptrack.bench.run_folder import EvaluationRun
from grasptrack.view.report import Cell, Chart, Column, Line, Page, format_percent
from grasptrack.view.report.palette import standalone_svg
from grasptrack.view.report.parts import make_slug

AT_PX = (0.1, 0.25, 0.5, 1.0, 2.0, 3.0, 5.0)


class Plots:
    """Adds the charts of a run to its page, and writes each as a file of its own.

    Args:
        page: to add to.
        run: that is told of.
        summary: its figures.
        first: the method whose bands are shown.
        figures: folder of the files.
    """

    def __init__(self, page: Page, run: EvaluationRun, summary: Summary, first: str, figures: Path) -> None:
        self.page, self.run, self.summary, self.first, self.figures = page, run, summary, first, figures
        self.series = page.series

    def over_time(self, progress: Progress | None) -> None:
        """Small charts of error and share located over the frames."""
        several = len(self.run.scored) > len(self.summary.levels)
        band = (
            "Median over the parts, and for one method the band that holds 95 % of them: it is that of "
            f"{self.first}, or of the key under the pointer. Below each chart: the share located. "
        )
        self.page.section(
            "Error over time",
            (band if several else "Below each chart: whether it was located. ")
            + "Shaded: the object is partly out of view; darker: gone or hardly in view.",
        )
        ends, parts = charts.error_ends(self.run, self.summary.methods), []
        for i, level in enumerate(self.summary.levels):
            upper, lower = charts.time_charts(self.run, level, self.series, ends)
            drawn = self.keep(f"error-over-time-{level}", upper) + self.keep(f"located-over-time-{level}", lower)
            parts.append((level, self.summary.group_of.get(level, ""), drawn))
            report_progress(progress, "charts", i + 1, len(self.summary.levels))
        self.page.figures(parts, "Errors are those of the worst contact, in px, on one logarithmic scale throughout.")

    def precision(self) -> None:
        """Cumulative error curves and the values at a few distances."""
        self.page.section(
            "Precision",
            "How many of all frames are answered that well. A frame without an answer counts as missed, so accuracy and "
            "availability are in one figure: at the right end of a curve stands the share that was answered at all.",
        )
        drawn = [
            (title, "", self.keep(name, charts.precision_chart(self.run, self.series, of_opening)))
            for title, name, of_opening in (
                ("In px", "precision-px", False),
                ("In per cent of the grasp's opening", "precision-opening", True),
            )
        ]
        self.page.figures(drawn, "Share of the frames with 70 % of the outline in view or more.", large=True)
        at = np.array(AT_PX)
        rows = []
        for method in self.summary.methods:
            shares = precision_curve(self.run.runs(method, self.run.scored), at).tolist()
            rows.append(Line([method, *(Cell(format_percent(v), v, v) for v in shares)], series=method))
        columns = [Column("method", words=True), *(Column(f"{t:g} px") for t in AT_PX)]
        self.page.table(columns, rows, caption="Precision at t px, per cent of the frames.")

    def spread(self) -> None:
        """Errors of each method at each level."""
        factor = self.summary.factor
        self.page.section(
            f"Errors by {factor}", "Of the frames that were answered with the object there.", f"Errors by {factor}"
        )
        chart = charts.spread_chart(self.run, self.series, self.summary.levels)
        said = "Dot: median of the worst contact's error. Line: from the 5th percentile to the 95th."
        self.page.figure(self.keep("errors", chart), said)

    def confidence(self) -> None:
        """What the confidence is worth, and how soon the object is found again."""
        self.page.section(
            "Trust and recovery",
            "Left: take the most confident answers first, and see how many of those taken are wrong. A curve on the floor "
            "is never wrong; one that rises only at its end knows its bad answers. Right: how soon the object is found "
            "again after it was out of view.",
        )
        risk = self.keep("risk-coverage", charts.risk_chart(self.run, self.series))
        drawn = [("Risk over coverage", "", risk)]
        again = charts.recovery_chart(self.run, self.series)
        if again is not None:
            drawn.append(("Frames until recovery", "", self.keep("recovery", again)))
        self.page.figures(
            drawn,
            "A ring: the method gives no confidence, so that its answers cannot be ordered. The scale of risks is that of "
            "their square roots.",
            large=True,
        )

    def latency(self) -> None:
        """Times."""
        self.page.section("Latency", "Time of one update, one thread, without reading, rendering and drawing.")
        chart = self.keep("latency", charts.latency_chart(self.run, self.series))
        self.page.figures([("", "", chart)], "Dot: median. Line: from the 5th percentile to the 99th.", large=True)

    def keep(self, name: str, chart: Chart) -> str:
        """The chart for the page; it is written to a file by its name too."""
        svg = chart.svg()
        path = self.figures / f"{make_slug(name)}.svg"
        path.write_text(standalone_svg(svg, self.series.values(), self.first) + "\n", encoding="utf-8")
        return svg
