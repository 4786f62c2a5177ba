# SPDX-License-Identifier: Apache-2.0
"""What is to be known of two runs beside their figures: what makes them differ, and which sequences are worth a look."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from grasptrack.bench.metrics.paired import FEW_CASES, Unit
from grasptrack.bench.run_folder import EvaluationRun

FELL = 0.1
"""Share of a sequence's frames, located before and not now, that make it worth a look."""


@dataclass(frozen=True, slots=True)
class Look:
    """A sequence worth a look: frames with contacts that are wrong only now, and the share located before and now."""

    method: str
    case: str
    new_wrong: tuple[int, ...]
    mended: tuple[int, ...]
    located: tuple[float, float]


def looks_of(sequences: Mapping[str, Mapping[str, Unit]]) -> list[Look]:
    """Sequences worth a look, by method and name; most new wrong answers first, then those that lost most."""
    found = []
    for method, of_method in sequences.items():
        for name, unit in of_method.items():
            pairs = unit.pairs
            new = tuple(b.frame for a, b in pairs if b.is_false_accept and not a.is_false_accept)
            mended = tuple(a.frame for a, b in pairs if a.is_false_accept and not b.is_false_accept)
            before, now = (sum(p[k].answered for p in pairs) / max(1, len(pairs)) for k in (0, 1))
            if new or mended or before - now > FELL:
                found.append(Look(method, name, new, mended, (before, now)))
    return sorted(found, key=lambda w: (-len(w.new_wrong), w.located[1] - w.located[0]))


def differs_of(one: EvaluationRun, other: EvaluationRun, methods: Sequence[str], cases: Sequence[str]) -> list[str]:
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
