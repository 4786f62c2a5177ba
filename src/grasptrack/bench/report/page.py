# SPDX-License-Identifier: Apache-2.0
"""The page of a run, section by section."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from grasptrack.bench.metrics.summary import Row, Summary
from grasptrack.bench.report import sentences as words
from grasptrack.bench.report.glossary import CURVES, TERMS
from grasptrack.bench.report.plots import Plots
from grasptrack.bench.report.tables import ANSWERS, ERRORS, heat_table, measures_table
from grasptrack.bench.report.worst_frames import Picture, Progress, show_worst
from grasptrack.bench.run_folder import EvaluationRun
from grasptrack.view.report import Page, format_number

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
        self.first = words.headline_method(summary.methods)
        what = "rendered scenes" if run.kind == "scenes" else "real videos"
        self.page = Page(f"Grasp tracking on {what}", "grasptrack evaluation", summary.methods, self.first)

    def build(self, picture: Picture | None, progress: Progress | None) -> Page:
        """The whole page."""
        self.opening()
        self.methods()
        self.levels()
        plots = Plots(self.page, self.run, self.summary, self.first, self.figures)
        plots.over_time(progress)
        plots.precision()
        plots.spread()
        plots.confidence()
        plots.latency()
        if picture is not None:
            show_worst(self.page, self.summary, self.first, picture, progress)
        self.shapes()
        self.reasons()
        self.definitions()
        return self.page

    def opening(self) -> None:
        """What a hurried reader takes away, and how to do it again."""
        index = self.run.index
        first, *others = words.verdict_paragraphs(self.run, self.summary)
        self.page.lead(first)
        self.page.text(*others)
        self.page.cards(words.summary_cards(self.summary))
        versions = index.get("versions") or {}
        names = ("grasptrack", "python", "numpy", "opencv")
        facts = [
            ("Machine", str(index.get("machine") or "")),
            ("Software", ", ".join(f"{n} {versions[n]}" for n in names if versions.get(n))),
            ("Kernels", str(index.get("backend") or "")),
            ("Run", _format_run_time(index)),
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
        often = "**How often** contacts were given, how often wrongly, and what became of an object that was away."
        exact = "**How exactly** they were given, over the frames that were answered, and how long an update took."
        exact += " In weight: the best of a column." if by_method and len(rows) > 1 else ""
        for keys, said in ((ANSWERS, often), (ERRORS, exact)):
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
            note = f"{format_number(total)} of {format_number(frames)} frames without contacts"
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


def _format_run_time(index: Any) -> str:
    started, seconds = str(index.get("started") or ""), index.get("seconds")
    with contextlib.suppress(ValueError):
        started = datetime.fromisoformat(started).strftime("%d %B %Y, %H:%M").lstrip("0")
    took = ""
    if isinstance(seconds, int | float):
        took = f"{seconds / 60.0:.1f} minutes" if seconds >= 90.0 else f"{format_number(float(seconds), 2)} s"
    return ", ".join(part for part in (started, took) if part)
