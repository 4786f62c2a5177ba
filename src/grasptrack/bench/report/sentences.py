# SPDX-License-Identifier: Apache-2.0
"""What a run's figures say in sentences, each made from the figures, and what they do not say."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from grasptrack.bench.metrics.summary import Row, Summary
from grasptrack.bench.run_folder import EvaluationRun
from grasptrack.statistics import upper_bound
from grasptrack.view.report import Card, format_number, format_percent

ENOUGH = 0.5
"""Share of the frames that a method must locate to be named as the most accurate."""

LIMITS: dict[str, tuple[str, ...]] = {
    "scenes": (
        "The scenes are rendered. Their light, lenses and textures are simpler than a factory's; figures of real videos "
        "stand in the report of `grasptrack evaluate real`.",
        "All methods are told the same contacts in the first frame. Choosing the object and the grasp is not measured here.",
        "Frames of one sequence resemble each other. The bound on the rate of wrong answers treats them as independent, "
        "so it is the least that can be said, not the most.",
        "A contact is wrong beyond max(3 px, 4 % of the root of the object's area). A hand that needs more will "
        "find more answers wrong: see precision at t px.",
        "Errors are over the frames that a method answered. One that answers seldom may look accurate: read them with the "
        "share located, or read precision at t px, where every frame counts.",
        "Latency was measured while other sequences ran on the other cores; it orders methods, and is no promise.",
    ),
    "real": (
        "The truth is a table of homographies that were measured in the same videos. It has errors of its own, of "
        "tenths of a px; errors below them mean nothing.",
        "A homography says where a flat object is, not whether it is covered: frames count as whole in view unless the "
        "object's quadrilateral is known and reaches out of the image, and answers that are missing in a covered frame "
        "count as missing.",
        "Frames without a reference homography are looked at, but not measured.",
        "A few videos are a few lights, cameras and objects. They show that it works there, not how often it works.",
        "The bound on the rate of wrong answers treats the frames of a video as independent, which they are not.",
        "Latency was measured while other sequences ran on the other cores; it orders methods, and is no promise.",
    ),
}
"""What is not measured, by kind of run."""


def headline_method(methods: Sequence[str]) -> str:
    """The method that a report speaks of first."""
    return "auto" if "auto" in methods else methods[0]


def verdict_paragraphs(run: EvaluationRun, summary: Summary) -> list[str]:
    """Paragraphs: what was run, how the first method did and how often it was wrong; what was best, and what hard."""
    name = headline_method(summary.methods)
    row = summary.row(name)
    assert row is not None
    m = row.measures
    words = [_run_description(run, summary, row)]
    hidden = (
        ""
        if math.isnan(m.located_partly)
        else f", and in {format_percent(m.located_partly)} % of those with up to 30 % of its outline hidden"
    )
    words.append(
        f"**{name}** gave contacts in **{format_percent(m.located_whole)} %** of the frames with the whole object in view"
        f"{hidden}."
    )
    words.append(
        f"Half of its contacts lie within **{format_number(m.median_px, 2)} px** of the truth, "
        f"95 % within {format_number(m.p95_px, 2)} px."
        if math.isfinite(m.median_px)
        else "No contact of it could be held against a truth."
    )
    others = [*_best_methods(summary), *_hardest_level(summary, name)]
    return [" ".join([*words, wrong_answers_sentence(row)]), *([" ".join(others)] if others else [])]


def wrong_answers_sentence(row: Row) -> str:
    """How often one method was wrong, with the bound that this puts on its rate."""
    m = row.measures
    bound = format_percent(upper_bound(m.false_accepts, m.frames), 2)
    if m.false_accepts == 0:
        return (
            f"It was **never wrong** in {format_number(m.frames)} frames, which puts the rate of wrong answers below {bound} % "
            "with 95 % confidence (rule of three)."
        )
    gone = f", {format_number(m.false_given_gone)} of them with the object gone" if m.false_given_gone else ""
    times = "once" if m.false_accepts == 1 else f"in {format_number(m.false_accepts)} frames"
    return (
        f"It was **wrong without saying so {times}** of {format_number(m.frames)}{gone}: "
        f"{format_percent(m.false_accepts / m.frames, 2)} %, and with 95 % confidence not more than {bound} %."
    )


def summary_cards(summary: Summary) -> list[Card]:
    """Key figures of the first method."""
    row = summary.row(headline_method(summary.methods))
    assert row is not None
    m = row.measures
    never = m.false_accepts == 0
    found = [
        Card("Located, whole object in view", format_percent(m.located_whole), "of the frames", unit="%"),
        Card(
            "Wrong answers",
            format_number(m.false_accepts),
            f"of {format_number(m.frames)} frames; rate below {format_percent(m.false_bound, 2)} %",
            "good" if never else "bad",
        ),
        Card("Median error", format_number(m.median_px, 2), f"95 % within {format_number(m.p95_px, 2)} px", unit="px"),
        Card("RMS error", format_number(m.rms_px, 2), f"largest {format_number(m.max_px, 2)} px", unit="px"),
        Card(
            "Latency, median", format_number(m.median_ms, 2), f"99 % within {format_number(m.p99_ms, 2)} ms", unit="ms"
        ),
    ]
    if m.returns:
        wait = f"after {format_number(m.recovery_frames, 2)} frames on average" if m.recoveries else "it never was"
        found.insert(4, Card("Found again", f"{m.recoveries} of {m.returns}", f"returns to whole view; {wait}"))
    return found


def _run_description(run: EvaluationRun, summary: Summary, row: Row) -> str:
    who = f"{len(summary.methods)} methods were shown the same" if len(summary.methods) > 1 else "One method was shown"
    frames = f"{format_number(row.measures.frames)} images"
    if run.kind == "real":
        return f"{who} {frames} of {_count_phrase(row.cases, 'real video')}."
    parts, levels = _count_phrase(len(summary.shapes), "part"), _count_phrase(len(summary.levels), "disturbance")
    return f"{who} {frames}: {parts} under {levels}, {_count_phrase(row.cases, 'sequence')} in all."


def _count_phrase(n: int, what: str) -> str:
    return f"{format_number(n)} {what}" if n == 1 else f"{format_number(n)} {what}s"


def _best_methods(summary: Summary) -> list[str]:
    """The best of all methods in three respects, where there are several."""
    rows = [r for r in summary.overall if r.measures.frames]
    if len(rows) < 2:
        return []

    def top(of: Callable[[Row], float], among: Sequence[Row]) -> list[Row]:
        known = [r for r in among if not math.isnan(of(r))]
        return [r for r in known if of(r) == min(map(of, known))]

    fewest = top(lambda r: float(r.measures.false_accepts), rows)
    most = top(lambda r: -r.measures.located_whole, rows)
    exact = top(lambda r: r.measures.median_px, [r for r in rows if r.measures.located_whole >= ENOUGH])
    said = [
        f"Over all methods, {_join_methods(fewest)} had the fewest wrong answers "
        f"({format_number(fewest[0].measures.false_accepts)})"
    ]
    if most:
        wrongs = [format_number(r.measures.false_accepts) for r in most]
        told = " and ".join([", ".join(wrongs[:-1]), wrongs[-1]]) if len(wrongs) > 1 else wrongs[0]
        share = format_percent(most[0].measures.located_whole)
        said.append(f"{_join_methods(most)} gave contacts most often ({share} %; wrong in {told} frames)")
    if exact:
        error = format_number(exact[0].measures.median_px, 2)
        said.append(
            f"{_join_methods(exact)} had the smallest median error ({error} px) of those that locate half or more"
        )
    return ["; ".join(said) + "."]


def _join_methods(rows: Sequence[Row]) -> str:
    names = [r.method for r in rows]
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]


def _hardest_level(summary: Summary, name: str) -> list[str]:
    rows = [r for r in summary.by_level if r.method == name and not math.isnan(r.located)]
    if len(rows) < 2:
        return []
    worst = min(rows, key=lambda r: r.located)
    said = f"Hardest for {name} was {worst.level}: located in {format_percent(worst.located)} % of the frames"
    where = [r.level for r in rows if r.measures.false_accepts]
    told = f"; its wrong answers lie in {', '.join(where)}" if where else ""
    return [f"{said}{told}."]
