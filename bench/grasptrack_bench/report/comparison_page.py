# SPDX-License-Identifier: Apache-2.0
"""What a comparison says: lines for a terminal, and a page after `templates/comparison.html`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from grasptrack_bench.charts import DASH, format_number, series_palette
from grasptrack_bench.metrics.integrity import frame_ranges
from grasptrack_bench.metrics.paired import BLOCK, FEW_CASES
from grasptrack_bench.metrics.summary import ALL
from grasptrack_bench.report.comparison import FELL, MATTERS, UNLIKELY, Change, Comparison, SequenceToInspect
from grasptrack_bench.report.glossary import COMPARED, Term
from grasptrack_bench.report.pages import (
    TEMPLATES,
    Cell,
    CellLike,
    Column,
    Line,
    PageTable,
    Tone,
    count_phrase,
    write_page,
)
from grasptrack_bench.report.run import headline_method
from grasptrack_bench.report.tables import format_measure

_TONE: dict[str, Tone] = {"worse": "bad", "better": "good", "same": "", "untold": "muted"}
MOST = 40
"""Lines of one list."""
MOST_SHOWN = 200
"""Sequences in a page."""
COLUMNS = ("located_whole", "tracked_visible", "false_accepts", "rms_px", "median_px", "p95_px", "median_ms")


def write_comparison(c: Comparison, path: Path) -> Path:
    """Write the page of a comparison as one HTML file that needs nothing else."""
    return write_page(
        path,
        TEMPLATES / "comparison.html",
        "Two runs side by side",
        "grasptrack compare",
        series_palette(c.methods),
        headline_method(c.methods),
        c=c,
        verdict=comparison_verdict(c),
        terms=list(COMPARED.values()),
        changes_table=_change_table,
        looks_table=_looks_table,
        overall_table=_overall_figures,
        levels_table=_figures_by_level,
        fell=FELL,
        few_cases=FEW_CASES,
        block=BLOCK,
        matters=MATTERS,
        unlikely=UNLIKELY,
    )


def comparison_lines(c: Comparison) -> list[str]:
    """All that is worth telling, the worst first."""
    out = [
        f"A, before: {c.a.path}",
        f"B, now:    {c.b.path}",
        f"{len(c.cases)} sequences in both, {len(c.methods)} methods",
    ]
    for only, which in ((c.only_a, "A"), (c.only_b, "B")):
        if only:
            out.append(f"{len(only)} only in {which}: {', '.join(only[:6])}{', ...' if len(only) > 6 else ''}")
    out += [f"Note: {text}" for text in c.differs]
    out += ["", *_overall_lines(c)]
    for title, found in (("Worse beyond its noise", c.worse), ("Better beyond its noise", c.better)):
        if found:
            out += ["", f"{title}, {len(found)}:", *_limit_lines(f"  {format_change(change)}" for change in found)]
    if c.looks:
        out += ["", "Sequences to look at:", *_limit_lines(f"  {look_told(look)}" for look in c.looks)]
    return [*out, "", comparison_verdict(c)]


def comparison_verdict(c: Comparison) -> str:
    """One sentence."""
    worse, better = len(c.worse), len(c.better)
    new = sum(len(look.new_wrong) for look in c.looks)
    also = "" if not new else " One answer is wrong that was not before." if new == 1 else ""
    also = also or (f" {format_number(new)} answers are wrong that were not before." if new else "")
    if not worse:
        mended = f" {count_phrase(better, 'figure')} got better." if better else ""
        return f"Nothing got worse beyond its noise.{mended}{also}"
    return f"{count_phrase(worse, 'figure')} got worse beyond {'its' if worse == 1 else 'their'} noise, {better} better.{also}"


def format_change(change: Change) -> str:
    """One change in a line."""
    term = COMPARED[change.measure]
    where = "" if change.level == ALL else f", {change.level}"
    noise = f"noise {format_plain_measure(term, change.noise)}"
    if change.measure == "false_accepts":
        noise = "" if change.noise > 0.5 else f"by chance {format_odds(change.noise)}"
    beside = f" ({noise})" if noise else ""
    before, after = (format_plain_measure(term, value) for value in (change.a, change.b))
    return f"{change.method}{where}: {term.label} {before} -> {after} {term.unit}{beside}"


def format_odds(probability: float) -> str:
    """How seldom something is."""
    return "less than once in a million" if probability < 1e-6 else f"once in {format_number(round(1.0 / probability))}"


def look_told(look: SequenceToInspect) -> str:
    """One sequence in a line."""
    parts = []
    if look.new_wrong:
        parts.append(f"wrong now, not before: frames {format_frame_ranges(look.new_wrong)}")
    if look.mended:
        parts.append(f"wrong before, not now: frames {format_frame_ranges(look.mended)}")
    before, now = (100.0 * share for share in look.located)
    parts.append(f"located {before:.0f} % -> {now:.0f} %")
    return f"{look.method}, {look.case}: {'; '.join(parts)}"


def format_frame_ranges(frames: Sequence[int]) -> str:
    """Frame numbers in words: 3, 5-9."""
    said = [str(a) if a == b else f"{a}-{b}" for a, b in frame_ranges(frames)]
    return ", ".join(said[:8]) + (", ..." if len(said) > 8 else "")


def format_plain_measure(term: Term, what: float) -> str:
    """A value of a measure as it stands in a line."""
    return format_measure(term, what).replace("\u2212", "-").replace("\u202f", "").replace("\u2013", "-")


def _overall_lines(c: Comparison) -> list[str]:
    rows = [["over all sequences", *(f"{COMPARED[k].label}, {COMPARED[k].unit}" for k in COLUMNS)]]
    for method in c.methods:
        cells = [method]
        for key in COLUMNS:
            change = c.change(method, ALL, key)
            term = COMPARED[key]
            mark = {"worse": " !", "better": " +"}.get(change.verdict, "") if change is not None else ""
            cells.append(
                "-"
                if change is None
                else f"{format_plain_measure(term, change.a)} -> {format_plain_measure(term, change.b)}{mark}"
            )
        rows.append(cells)
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return [
        "  ".join([row[0].ljust(widths[0]), *(x.rjust(w) for x, w in zip(row[1:], widths[1:], strict=True))]).rstrip()
        for row in rows
    ]


def _limit_lines(found: Iterable[str]) -> list[str]:
    listed = list(found)
    return listed if len(listed) <= MOST else [*listed[:MOST], f"  and {len(listed) - MOST} more"]


def _change_table(changes: Sequence[Change], factor: str) -> PageTable:
    columns = [
        Column("method", words=True),
        Column(factor, words=True),
        Column("measure", words=True),
        Column("before"),
        Column("now"),
        Column("change"),
        Column("noise", tip="How far it may change by chance, with 95 % confidence for all changes together"),
    ]
    lines = []
    for change in changes:
        term = COMPARED[change.measure]
        ratio = change.b / change.a - 1.0 if change.a else math.nan
        by = change.b - change.a
        moved = f"{100 * ratio:+.0f} %" if term.kind in ("px", "ms", "percent") and not math.isnan(ratio) else ""
        moved = moved or ("+" if by > 0 else "−") + format_measure(term, abs(by))
        wrong = change.measure == "false_accepts"
        noise = format_odds(change.noise) if wrong else format_measure(term, change.noise)
        lines.append(
            Line(
                [
                    change.method,
                    change.level,
                    f"{term.label}, {term.unit}",
                    Cell(format_measure(term, change.a), change.a),
                    Cell(format_measure(term, change.b), change.b),
                    Cell(moved, by, tone=_TONE[change.verdict]),
                    Cell(noise, math.nan if wrong else change.noise, tone="muted"),
                ],
                series=change.method,
            )
        )
    return PageTable(columns, lines)


def _looks_table(looks: Sequence[SequenceToInspect]) -> PageTable:
    columns = [
        Column("method", words=True),
        Column("sequence", words=True),
        Column("wrong now, not before", "frames", words=True),
        Column("wrong before, not now", "frames", words=True),
        Column("located", "% of the frames"),
    ]
    lines = []
    for look in looks[:MOST_SHOWN]:
        before, now = look.located
        cells: list[CellLike] = [
            look.method,
            look.case,
            Cell(format_frame_ranges(look.new_wrong) or DASH, len(look.new_wrong)),
            Cell(format_frame_ranges(look.mended) or DASH, len(look.mended)),
            Cell(f"{100 * before:.0f} → {100 * now:.0f}", now - before),
        ]
        lines.append(Line(cells, series=look.method))
    return PageTable(columns, lines)


def _overall_figures(c: Comparison) -> PageTable:
    columns = [Column(t.label, t.unit, t.meaning) for t in COMPARED.values()]
    lines = [Line([m, *(_change_cell(c.change(m, ALL, key)) for key in COMPARED)], series=m) for m in c.methods]
    return PageTable([Column("method", words=True), *columns], lines)


def _figures_by_level(c: Comparison, key: str) -> PageTable:
    found = {(x.method, x.level): x for x in c.changes if x.measure == key}
    columns = [Column(c.a.factor, words=True), *(Column(m, series=m) for m in c.methods)]
    return PageTable(
        columns, [Line([level, *(_change_cell(found.get((m, level))) for m in c.methods)]) for level in c.levels]
    )


def _change_cell(change: Change | None) -> Cell:
    if change is None or (math.isnan(change.a) and math.isnan(change.b)):
        return Cell(DASH)
    term = COMPARED[change.measure]
    before, now = format_measure(term, change.a), format_measure(term, change.b)
    if change.a == change.b:
        return Cell(now, change.b, tone="muted")
    return Cell(
        f"{before} → {now}", change.b - change.a, tone=_TONE[change.verdict] if change.verdict != "untold" else "muted"
    )
