# SPDX-License-Identifier: Apache-2.0
"""Two runs side by side: what got worse and what got better, beyond its noise, on the sequences that both have."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from grasptrack.errors import InputError
from grasptrack_bench.metrics.paired import FEW_CASES, PairedMeasure, Unit, measures_of, units_of, wrong_in_one
from grasptrack_bench.metrics.statistics import bootstrap_counts, critical_value, mcnemar_probability
from grasptrack_bench.metrics.summary import ALL
from grasptrack_bench.report.glossary import COMPARED
from grasptrack_bench.run_folder import EvaluationRun, read_run

Verdict = Literal["worse", "better", "same", "untold"]

MATTERS: dict[str, tuple[float, float]] = {
    "located_whole": (0.005, 0.0),
    "located_partly": (0.005, 0.0),
    "tracked_visible": (0.005, 0.0),
    "recovered": (0.01, 0.0),
    "recovery_frames": (0.5, 0.0),
    "rms_px": (0.005, 0.03),
    "median_px": (0.005, 0.03),
    "p95_px": (0.005, 0.03),
    "median_ms": (0.0, 0.1),
}
"""A difference that is smaller is of no use to anybody, noise or not: absolute, and as a share of the first value."""
UNLIKELY = 0.01
"""A number of new wrong answers that chance would give no more often is no chance."""
DRAWS = 500
"""How often sequences are drawn again."""
FELL = 0.1
"""Share of a sequence's frames, located before and not now, that make it worth a look."""


@dataclass(frozen=True, slots=True)
class SequenceToInspect:
    """A sequence worth a look: frames with contacts that are wrong only now, and the share located before and now."""

    method: str
    case: str
    new_wrong: tuple[int, ...]
    mended: tuple[int, ...]
    located: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Change:
    """One measure of one method, over all sequences ("all") or at one level, in two runs.

    Attributes:
        method, level, measure: what it is of; `measure` is a key of `grasptrack_bench.report.glossary:COMPARED`.
        a, b: its values.
        noise: by how much b - a may differ from 0 by chance, in the measure's unit; NaN where that cannot be told. Of
            false accepts: the probability of as many that are new, if new and mended ones were equally likely.
        verdict: "untold" where the noise is not known.
    """

    method: str
    level: str
    measure: str
    a: float
    b: float
    noise: float
    verdict: Verdict


@dataclass(frozen=True)
class Comparison:
    """Two runs side by side.

    Attributes:
        a, b: the runs.
        methods: that both have.
        levels: disturbances or videos that both have.
        cases: names of the sequences that both have.
        only_a, only_b: those that one has.
        differs: sentences on what makes the runs differ: options, versions, machines, frames.
        changes: every measure of every method, over all and by level.
        looks: sequences worth a look.
    """

    a: EvaluationRun = field(repr=False)
    b: EvaluationRun = field(repr=False)
    methods: tuple[str, ...]
    levels: tuple[str, ...]
    cases: tuple[str, ...]
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]
    differs: tuple[str, ...]
    changes: tuple[Change, ...] = field(repr=False)
    looks: tuple[SequenceToInspect, ...] = field(repr=False)

    @property
    def worse(self) -> list[Change]:
        """What got worse beyond its noise; wrong answers first."""
        return self._with_verdict("worse")

    @property
    def better(self) -> list[Change]:
        """What got better beyond its noise."""
        return self._with_verdict("better")

    def change(self, method: str, level: str, measure: str) -> Change | None:
        """One of the changes; None where there is nothing to compare."""
        return next((c for c in self.changes if (c.method, c.level, c.measure) == (method, level, measure)), None)

    def _with_verdict(self, verdict: Verdict) -> list[Change]:
        found = [c for c in self.changes if c.verdict == verdict]
        return sorted(found, key=lambda c: (c.measure != "false_accepts", c.level != ALL))


def compare_runs(a: Path, b: Path) -> Comparison:
    """Put two runs side by side.

    A difference counts when it is larger than what matters to anybody, and than the noise with which it would differ on
    other sequences: sequences are drawn again with replacement, both runs together, and the level of 5 % holds for all
    differences together. Wrong answers are compared frame by frame by an exact test. Latencies of different machines are
    not judged.

    Args:
        a, b: folders of runs; a is the one before.
    """
    one, other = read_run(a), read_run(b)
    if one.kind != other.kind:
        raise InputError(f'"{a}" is a run of kind {one.kind}, "{b}" of kind {other.kind}: they cannot be compared')
    level_of = {c.name: c.disturbance for c in one.scored}
    there = {c.name for c in other.scored}
    cases = tuple(name for name in level_of if name in there)
    methods = tuple(m for m in one.methods if m in other.methods)
    if not cases or not methods:
        raise InputError(f'"{a}" and "{b}" have no {"sequence" if not cases else "method"} in common')
    levels = tuple(dict.fromkeys(level_of[name] for name in cases))
    groups = [(ALL, cases), *((level, tuple(n for n in cases if level_of[n] == level)) for level in levels)]
    if len(levels) < 2:
        groups = groups[:1]
    found: list[tuple[str, str, list[Unit], dict[str, PairedMeasure]]] = []
    taken = {}
    sequences = {method: _paired_units(one, other, method, cases) for method in methods}
    for method in methods:
        for level, names in groups:
            units = units_of(sequences[method][name] for name in names if name in sequences[method])
            if len(units) not in taken:
                taken[len(units)] = bootstrap_counts(len(units), DRAWS, 0) if units else np.empty((DRAWS, 0))
            found.append((method, level, units, measures_of(units, taken[len(units)])))
    count = sum(not math.isnan(m.error) for *_, measures in found for m in measures.values())
    same_machine = one.index.get("machine") == other.index.get("machine")
    changes = [
        change
        for method, level, units, measures in found
        for change in _level_changes(method, level, units, measures, count, same_machine)
    ]
    return Comparison(
        one,
        other,
        methods,
        levels,
        cases,
        tuple(n for n in level_of if n not in there),
        tuple(c.name for c in other.scored if c.name not in level_of),
        tuple(_list_differences(one, other, methods, cases)),
        tuple(changes),
        tuple(_sequences_to_look_at(sequences)),
    )


def _paired_units(one: EvaluationRun, other: EvaluationRun, method: str, names: Sequence[str]) -> dict[str, Unit]:
    runs = ((name, one.scores[name].get(method), other.scores[name].get(method)) for name in names)
    return {name: Unit.of(a, b) for name, a, b in runs if a is not None and b is not None}


def _level_changes(
    method: str, level: str, units: Sequence[Unit], measures: dict[str, PairedMeasure], count: int, same_machine: bool
) -> list[Change]:
    if not units:
        return []
    first, second, mended, new = wrong_in_one(units)
    likely = mcnemar_probability(max(new, mended), min(new, mended))
    verdict: Verdict = "same" if likely > UNLIKELY else "worse" if new > mended else "better"
    changes = [Change(method, level, "false_accepts", float(first), float(second), likely, verdict)]
    for key, m in measures.items():
        noise = critical_value(count, m.units) * m.error
        judged = key != "median_ms" or same_machine
        changes.append(
            Change(method, level, key, m.a, m.b, noise, _change_verdict(key, m, noise) if judged else "untold")
        )
    return changes


def _change_verdict(key: str, m: PairedMeasure, noise: float) -> Verdict:
    if not all(map(math.isfinite, (noise, m.a, m.b))):
        return "untold"
    change = m.b - m.a
    absolute, relative = MATTERS[key]
    if abs(change) <= max(noise, absolute, relative * abs(m.a)):
        return "same"
    return "better" if (change > 0.0) == (COMPARED[key].better == "more") else "worse"


def _sequences_to_look_at(sequences: Mapping[str, Mapping[str, Unit]]) -> list[SequenceToInspect]:
    """Sequences worth a look, by method and name; most new wrong answers first, then those that lost most."""
    found = []
    for method, of_method in sequences.items():
        for name, unit in of_method.items():
            pairs = unit.pairs
            new = tuple(b.frame for a, b in pairs if b.is_false_accept and not a.is_false_accept)
            mended = tuple(a.frame for a, b in pairs if a.is_false_accept and not b.is_false_accept)
            before, now = (sum(p[k].answered for p in pairs) / max(1, len(pairs)) for k in (0, 1))
            if new or mended or before - now > FELL:
                found.append(SequenceToInspect(method, name, new, mended, (before, now)))
    return sorted(found, key=lambda w: (-len(w.new_wrong), w.located[1] - w.located[0]))


def _list_differences(
    one: EvaluationRun, other: EvaluationRun, methods: Sequence[str], cases: Sequence[str]
) -> list[str]:
    """Sentences on options, versions, machines, methods, failures and frames that the runs do not share."""
    said = []
    for what in ("options", "versions"):
        before, now = dict(one.index.get(what) or {}), dict(other.index.get(what) or {})
        said += [
            f"{what[:-1]} {key}: {before.get(key, 'none')} before, {now.get(key, 'none')} now"
            for key in dict.fromkeys((*before, *now))
            if before.get(key) != now.get(key)
        ]
    for what in ("machine", "backend"):
        if one.index.get(what) != other.index.get(what):
            said.append(f"{what}: {one.index.get(what)} before, {other.index.get(what)} now")
    if one.index.get("machine") != other.index.get("machine"):
        said.append("the machines differ, so that latency is not judged")
    for run, rest, which in ((one, other, "before"), (other, one, "now")):
        alone = [m for m in run.methods if m not in rest.methods]
        said += [f"methods only {which}: {', '.join(alone)}"] if alone else []
        said += [f"{len(run.failed)} sequences without results {which}"] if run.failed else []
    changed = [name for name in cases if not _same_frames(one, other, methods, name)]
    if changed:
        shown = ", ".join(changed[:5]) + (", ..." if len(changed) > 5 else "")
        said.append(
            f"frames differ in {len(changed)} of {len(cases)} sequences ({shown}): these are not the same images"
        )
    if len(cases) < FEW_CASES:
        said.append(f"only {len(cases)} sequences in both: noise is told from blocks of frames, which says less")
    return said


def _same_frames(one: EvaluationRun, other: EvaluationRun, methods: Sequence[str], name: str) -> bool:
    """Whether a sequence has the same frames with the same truth in both runs."""
    for method in methods:
        first, second = one.scores[name].get(method), other.scores[name].get(method)
        if first is not None and second is not None:
            told = [[(f.frame, f.present) for f in run] for run in (first, second)]
            seen, visible = (np.array([f.visible for f in run]) for run in (first, second))
            before, now = (np.array([f.area for f in run]) for run in (first, second))
            if told[0] != told[1] or not np.array_equal(seen, visible, equal_nan=True):
                return False
            if not np.allclose(before, now, rtol=1e-6, equal_nan=True):
                return False
    return True
