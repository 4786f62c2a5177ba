# SPDX-License-Identifier: Apache-2.0
"""The page of a comparison: what got worse, what got better, and every figure before and now."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from grasptrack.bench.metrics.paired import BLOCK, FEW_CASES
from grasptrack.bench.metrics.summary import ALL
from grasptrack.bench.report import comparison_sentences as words
from grasptrack.bench.report.comparison import MATTERS, UNLIKELY, Change, Comparison
from grasptrack.bench.report.comparison_notes import FELL
from grasptrack.bench.report.glossary import COMPARED
from grasptrack.bench.report.sentences import headline_method
from grasptrack.bench.report.tables import format_measure
from grasptrack.view.report import DASH, Cell, Column, Line, Page
from grasptrack.view.report.parts import Tone

_TONE: dict[str, Tone] = {"worse": "bad", "better": "good", "same": "", "untold": "muted"}


def write_comparison(c: Comparison, path: Path) -> Path:
    """Write the page of a comparison as one HTML file that needs nothing else."""
    return comparison_page(c).write(path)


def comparison_page(c: Comparison) -> Page:
    """The page of a comparison."""
    page = Page("Two runs side by side", "grasptrack compare", c.methods, headline_method(c.methods))
    page.lead(f"**{words.comparison_verdict(c)}**" if c.worse else words.comparison_verdict(c))
    page.facts(_comparison_facts(c))
    if c.differs:
        page.section("What makes them differ")
        page.points(c.differs)
    for title, found, said in (
        ("Worse", c.worse, "Beyond what other sequences would have made of it."),
        ("Better", c.better, "Beyond what other sequences would have made of it."),
    ):
        if found:
            page.section(title, said)
            page.table(*_change_table(found, c.a.factor))
    if c.looks:
        page.section(
            "Sequences to look at",
            f"Answers that are wrong in one run alone, and sequences in which {100 * FELL:.0f} % of the frames and more are "
            "located no longer. One sequence proves little: that is why they need not be among what is worse.",
        )
        columns = [
            Column("method", words=True),
            Column("sequence", words=True),
            Column("wrong now, not before", "frames", words=True),
            Column("wrong before, not now", "frames", words=True),
            Column("located", "% of the frames"),
        ]
        page.table(
            columns,
            [
                Line(
                    [
                        look.method,
                        look.case,
                        Cell(words.format_frame_ranges(look.new_wrong) or DASH, len(look.new_wrong)),
                        Cell(words.format_frame_ranges(look.mended) or DASH, len(look.mended)),
                        Cell(
                            "{:.0f} → {:.0f}".format(*(100 * s for s in look.located)),
                            look.located[1] - look.located[0],
                        ),
                    ],
                    series=look.method,
                )
                for look in c.looks[:200]
            ],
        )
    _add_all_figures(page, c)
    _add_explanation(page, c)
    return page


def _comparison_facts(c: Comparison) -> list[tuple[str, str]]:
    facts = [
        (f"{name}", f"`{run.path}`, {run.index.get('started') or 'of an unknown time'}")
        for name, run in (("A, before", c.a), ("B, now", c.b))
    ]
    facts.append(("Sequences", f"{len(c.cases)} in both, {len(c.only_a)} only in A, {len(c.only_b)} only in B"))
    for only, name in ((c.only_a, "Only in A"), (c.only_b, "Only in B")):
        if only:
            facts.append((name, ", ".join(only[:12]) + (", …" if len(only) > 12 else "")))
    return facts


def _change_table(changes: Sequence[Change], factor: str) -> tuple[list[Column], list[Line]]:
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
        noise = words.format_odds(change.noise) if wrong else format_measure(term, change.noise)
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
                rule=False,
            )
        )
    return columns, lines


def _add_all_figures(page: Page, c: Comparison) -> None:
    """Every figure of both runs, measure by measure."""
    page.section(
        "Every figure",
        "Before → now. Red: worse beyond its noise; green: better; grey: the noise cannot be told. "
        "Errors are over the frames that both runs answered.",
    )
    keys = list(COMPARED)
    columns = [
        Column("method", words=True),
        *(Column(COMPARED[k].label, COMPARED[k].unit, COMPARED[k].meaning) for k in keys),
    ]
    rows = [Line([m, *(_change_cell(c.change(m, ALL, k)) for k in keys)], series=m) for m in c.methods]
    page.table(columns, rows, caption="Over all sequences.")
    if len(c.levels) < 2:
        return
    table = {(x.method, x.level, x.measure): x for x in c.changes}
    for key in keys:
        term = COMPARED[key]
        with page.folded(f"{term.label}, {term.unit}", f"by {c.a.factor}", shown=key == "false_accepts"):
            heads = [Column(c.a.factor, words=True), *(Column(m, series=m) for m in c.methods)]
            page.table(
                heads,
                [Line([level, *(_change_cell(table.get((m, level, key))) for m in c.methods)]) for level in c.levels],
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


def _add_explanation(page: Page, c: Comparison) -> None:
    page.section("How it is judged")
    absolute, relative = MATTERS["rms_px"]
    page.points(
        (
            "Only sequences and frames that both runs have are compared, each with itself.",
            "Noise: sequences are drawn again with replacement, both runs together. A change is told when it is larger than "
            "chance would make it in any of all the comparisons with 95 % confidence (Bonferroni, Student's quantile).",
            f"With fewer than {FEW_CASES} sequences these are cut into blocks of {BLOCK} frames.",
            f"Smaller changes are not told even if they are certain: of errors {absolute:g} px and {100 * relative:g} %, of "
            f"shares half a percentage point, of latency {100 * MATTERS['median_ms'][1]:g} %.",
            f"Wrong answers are compared frame by frame by McNemar's exact test, and told when chance would bring as many new "
            f"ones less often than once in {1 / UNLIKELY:.0f}. Frames of one sequence resemble each other, so that this is "
            "strict: it rather warns once too often.",
            "Errors are over the frames that both runs answered, so that to answer more, and harder, frames is no loss.",
            "Latency says something only on one machine with nothing else to do.",
        )
    )
    page.terms((f"{t.label}, {t.unit}", t.meaning, t.source) for t in COMPARED.values())
