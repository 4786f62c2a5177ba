# SPDX-License-Identifier: Apache-2.0
"""The page of a run, section by section."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.evaluation import report_charts as charts
from grasptrack.evaluation import report_words as words
from grasptrack.evaluation.curves import precision
from grasptrack.evaluation.glossary import CURVES, TERMS
from grasptrack.evaluation.report_tables import ANSWERS, ERRORS, heat_table, measures_table
from grasptrack.evaluation.run_folder import EvaluationRun
from grasptrack.evaluation.summary import Row, Summary, Worst
from grasptrack.view.report import Cell, Chart, Column, Line, Page, number, percent
from grasptrack.view.report.answer import draw_answer
from grasptrack.view.report.markup import slug
from grasptrack.view.report.theme import standalone

Floats = NDArray[np.float64]
Shown = tuple[NDArray[Any], Floats | None, Sequence[Floats]]
"""An image, the true contacts (k, 2) px or None where the object is gone, the true outline's polygons in px."""
Picture = Callable[[str, str, int], Shown | None]
"""Called with a case, a method and a frame; gives what is to be shown of it, or None where it cannot be had."""
Progress = Callable[[str, int, int], None]
"""Called with the name of the step, what is done of it, and all of it."""

OF_FIRST, OF_OTHERS = 8, 3
"""Worst frames that are shown of the first method, and of each other one."""
AT_PX = (0.1, 0.25, 0.5, 1.0, 2.0, 3.0, 5.0)
REASONS = 10


class RunPage:
    """Builds the page of a run.

    Args:
        run: that is told of.
        summary: its figures.
        figures: folder into which each chart is written as a file of its own too.
    """

    def __init__(self, run: EvaluationRun, summary: Summary, figures: Path) -> None:
        self.run, self.summary, self.figures = run, summary, figures
        self.first = words.headline(summary.methods)
        what = "rendered scenes" if run.kind == "scenes" else "real videos"
        self.page = Page(f"Grasp tracking on {what}", "grasptrack evaluation", summary.methods, self.first)
        self.series = self.page.series

    def build(self, picture: Picture | None, progress: Progress | None) -> Page:
        """The whole page."""
        self.opening()
        self.methods()
        self.levels()
        self.over_time(progress)
        self.precision()
        self.spread()
        self.confidence()
        self.latency()
        if picture is not None:
            self.worst(picture, progress)
        self.shapes()
        self.reasons()
        self.definitions()
        return self.page

    def keep(self, name: str, chart: Chart) -> str:
        """The chart for the page; it is written to a file by its name too."""
        svg = chart.svg()
        path = self.figures / f"{slug(name)}.svg"
        path.write_text(standalone(svg, self.series.values(), self.first) + "\n", encoding="utf-8")
        return svg

    def opening(self) -> None:
        """What a hurried reader takes away, and how to do it again."""
        index = self.run.index
        first, *others = words.verdict(self.run, self.summary)
        self.page.lead(first)
        self.page.text(*others)
        self.page.cards(words.cards(self.summary))
        versions = index.get("versions") or {}
        names = ("grasptrack", "python", "numpy", "opencv")
        facts = [
            ("Machine", str(index.get("machine") or "")),
            ("Software", ", ".join(f"{n} {versions[n]}" for n in names if versions.get(n))),
            ("Kernels", str(index.get("backend") or "")),
            ("Run", _when(index)),
            ("Again", f"`{index['command']}`" if index.get("command") else ""),
        ]
        self.page.facts((a, b) for a, b in facts if b)
        if self.run.failed:
            self.page.text(f"**{len(self.run.failed)} of {len(self.run.cases)} sequences have no results:**")
            shown = [f"`{c.name}`: {c.error}" for c in self.run.failed[:12]]
            more = len(self.run.failed) - len(shown)
            self.page.points([*shown, f"and {more} more"] if more else shown)

    def methods(self) -> None:
        """All measures by method."""
        self.page.section(
            "Methods",
            "Every measure over all sequences. A head sorts the table and, under the pointer, says what it means; all "
            "are defined at the end. The keys above hide methods everywhere.",
        )
        self.tables(self.summary.overall, "method")

    def tables(self, rows: Sequence[Row], first: str) -> None:
        """All measures, in two tables."""
        by_method = first == "method"
        exact = "**How exactly** they were given, over the frames that were answered, and how long an update took."
        exact += " In weight: the best of a column." if by_method and len(rows) > 1 else ""
        for keys, said in (
            (
                ANSWERS,
                "**How often** contacts were given, how often wrongly, and what became of an object that was away.",
            ),
            (
                ERRORS,
                "**How exactly** they were given, over the frames that were answered, and how long an update took.",
            ),
        ):
            self.page.table(*measures_table(rows, keys, first, by_method), caption=said)

    def levels(self) -> None:
        """Heat maps of methods over disturbances."""
        factor, s = self.summary.factor, self.summary
        if len(s.levels) < 2:
            return
        self.page.section(
            f"By {factor}",
            f"One line for each {factor}, one column for each method."
            + (" A line sets groups apart." if s.groups else ""),
        )
        for key, said in (
            ("located", "**Located, %** of the frames with 70 % of the outline in view or more. More is better."),
            ("false_accepts", "**Wrong answers**, frames: each one is an answer that a hand would have followed."),
            (
                "rms_px",
                "**RMS error, px**, of the contacts that were given while the object was there. Less is better.",
            ),
        ):
            self.page.table(*heat_table(s.by_level, key, s.methods, s.levels, factor, s.group_of), caption=said)
        if s.groups:
            with self.page.folded("The same by group of disturbances"):
                for key, said in (
                    ("located", "Located, %"),
                    ("false_accepts", "Wrong answers, frames"),
                    ("rms_px", "RMS, px"),
                ):
                    self.page.table(*heat_table(s.by_group, key, s.methods, s.groups, "group", {}), caption=said)
        with self.page.folded(f"All measures of {self.first} by {factor}", series=self.first):
            rows = [r for r in s.by_level if r.method == self.first]
            self.tables(rows, factor)

    def over_time(self, progress: Progress | None) -> None:
        """Small charts of error and share located over the frames."""
        several = len(self.run.scored) > len(self.summary.levels)
        self.page.section(
            "Error over time",
            ("Median over the parts, and for one method the band that holds 95 % of them: it is that of "
            f"{self.first}, or of the key under the pointer. " if several else "")
            + "Below each, the share located. Shaded: the object is partly out of view; darker: gone or hardly in view.",
        )  # fmt: skip
        ends, parts = charts.error_ends(self.run, self.summary.methods), []
        for i, level in enumerate(self.summary.levels):
            upper, lower = charts.time_charts(self.run, level, self.series, ends)
            drawn = self.keep(f"error-over-time-{level}", upper) + self.keep(f"located-over-time-{level}", lower)
            parts.append((level, self.summary.group_of.get(level, ""), drawn))
            _tell(progress, "charts", i + 1, len(self.summary.levels))
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
            shares = precision(self.run.runs(method, self.run.scored), at).tolist()
            rows.append(Line([method, *(Cell(percent(v), v, v) for v in shares)], series=method))
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

    def worst(self, picture: Picture, progress: Progress | None) -> None:
        """Pictures of the worst frames."""
        wanted = [
            w
            for m in self.summary.methods
            for w in self.summary.worst[m][: OF_FIRST if m == self.first else OF_OTHERS]
            if w.false_accept or m == self.first or w.error > 0.5 * w.limit
        ]
        found = []
        for i, w in enumerate(wanted):
            shown = picture(w.case, w.method, w.frame)
            if shown is not None:
                image, truth, outline = shown
                drawn = draw_answer(image, None if w.gone else truth, outline, np.array(w.contacts))
                found.append((_caption(w), drawn, w.method))
            _tell(progress, "worst frames", i + 1, len(wanted))
        if found:
            self.page.section(
                "Worst frames",
                "The worst answers of each method, wrong ones first, at most two of a sequence. White: the true outline. "
                "Green rings: where the contacts truly are. Orange: where they were said to be.",
            )
            self.page.pictures(found)

    def shapes(self) -> None:
        """The measures part by part."""
        s = self.summary
        if len(s.shapes) < 2:
            return
        self.page.section("By part", f"What {self.first} makes of each part, over all disturbances.")
        rows = [r for r in s.by_shape if r.method == self.first]
        self.tables(rows, "part")
        with self.page.folded("All methods by part"):
            for key, said in (
                ("located", "Located, %"),
                ("false_accepts", "Wrong answers, frames"),
                ("rms_px", "RMS, px"),
            ):
                self.page.table(*heat_table(s.by_shape, key, s.methods, s.shapes, "part", {}), caption=said)

    def reasons(self) -> None:
        """Why there were no contacts."""
        self.page.section(
            "Reasons of loss",
            "A frame without contacts says why. Reasons that differ in their numbers alone are counted as one.",
        )
        never = [m for m in self.summary.methods if not self.summary.reasons[m]]
        for method in (m for m in self.summary.methods if m not in never):
            found, row = self.summary.reasons[method], self.summary.row(method)
            total, frames = sum(n for _, n in found), row.measures.frames if row is not None else 0
            note = f"{number(total)} of {number(frames)} frames without contacts"
            with self.page.folded(method, note, method, shown=method == self.first):
                shown = [(n, reason or "no reason given") for reason, n in found[:REASONS]]
                rest = sum(n for _, n in found[REASONS:])
                rows = [*shown, (rest, "other reasons")] if rest else shown
                self.page.bars(rows, max((n for n, _ in rows), default=1))
        if never:
            self.page.text(f"Without a frame that they did not answer: {', '.join(never)}.")

    def definitions(self) -> None:
        """What each measure means, and what none of them says."""
        self.page.section("What is measured", "Every figure of this page.")
        listed = [(f"{t.label}, {t.unit}" if t.unit else t.label, t.meaning, t.source) for t in TERMS.values()]
        self.page.terms([*listed, *CURVES])
        self.page.section("What is not measured")
        self.page.points(words.LIMITS[self.run.kind])


def _caption(w: Worst) -> str:
    if w.gone:
        told = "the object is gone"
    else:
        told = f"{number(w.error, 3)} px off" + (f", limit {number(w.limit, 2)} px" if w.false_accept else "")
    sure = "" if np.isnan(w.confidence) else f", confidence {number(w.confidence, 2)}"
    return f"**{w.method}**, {told}\n{w.case}, frame {w.frame}{sure}"


def _when(index: Any) -> str:
    started, seconds = str(index.get("started") or ""), index.get("seconds")
    with contextlib.suppress(ValueError):
        started = datetime.fromisoformat(started).strftime("%d %B %Y, %H:%M").lstrip("0")
    took = ""
    if isinstance(seconds, int | float):
        took = f"{seconds / 60.0:.1f} minutes" if seconds >= 90.0 else f"{number(float(seconds), 2)} s"
    return ", ".join(part for part in (started, took) if part)


def _tell(progress: Progress | None, step: str, done: int, total: int) -> None:
    if progress is not None:
        progress(step, done, total)
