# SPDX-License-Identifier: Apache-2.0
"""The rule of Sections III and V along the paths: the strategy chosen anew in each frame, beside each alone. Table W."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.errors import StrategyError
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.transfer import STRATEGIES, strategy_named
from grasptrack.transfer.choice import COST_US, TransferContext, choose_strategy
from grasptrack.typing import Floats
from grasptrack_bench.metrics.errors import error_measure
from grasptrack_bench.report.table import Cell, Table
from research.paper.footage import Footage, nearest_points
from research.paper.runs import SUMMARY, SUMMARY_NOTES, StrategyRun, run_of, summarize
from research.paper.transfers import Answer, Refused, Way

RULES = {"chosen": True, "chosen, no tracker": False}
"""The rule by what it is called, and whether it has a tracked outline."""
PRIOR: Way = "last frame as prior"
PROBES = 60
"""Points of the outline that tell whether it lies on the extracted one."""
NEARER = 2.0
"""An outline of 4 DoF has to lie so many times nearer to be kept once 4 DoF are doubted: its errors hide along the outline."""
COST, SWITCHES = "us per frame", "switches of strategy per path"
EXACT_PX = {"pixel chain": math.hypot(math.sqrt(0.5), math.sqrt(0.5))}
"""px, what whole pixels leave open: half a pixel's diagonal of each of two contours."""
SUBPIXEL_PX = 0.05
"""px, the same of contours that lie between pixels: what localisation leaves of an edge."""


class Chosen(NamedTuple):
    """What the rule made of one frame.

    Attributes:
        answer: (2, 2) px, or why there is none.
        tried: strategies in their order.
        strategy: whose answer it is, "" for none.
        reason: of the switch from the first one, "" for none.
    """

    answer: Answer
    tried: tuple[str, ...]
    strategy: str
    reason: str


def choose_along(footage: Footage, tracked: bool) -> list[Chosen]:
    """The grasp in each frame after the first, by the cheapest strategy that suffices there.

    The motion counts as one of 4 DoF until the outline that a strategy predicts lies beside the extracted one by more than
    contours of this kind leave open. Then the rule is asked again with 6 DoF, and the outlines tell which answer is kept. All
    strategies carry the grasp of the first frame, each by its own description, with the last homography as prediction.
    """
    known, prior = footage.silhouettes[0], np.eye(3)
    if not isinstance(known, View):
        return [Chosen(known, (), "", "")] * (len(footage.H) - 1)
    context = TransferContext.of(Grasp(footage.on_silhouette), known, predicted=True)
    found: list[Chosen] = []
    for k in range(1, len(footage.H)):
        here = replace(context, tracked=tracked and isinstance(footage.tracked[k], View))
        tried: dict[str, _Tried | str] = {}
        reason = ""
        for dof in (4, 6):
            try:
                name = choose_strategy(replace(here, dof=dof)).strategy
            except StrategyError as error:
                reason = str(error)
                continue
            if name not in tried:
                tried[name] = _try_strategy(name, footage, k, prior)
            told = tried[name]
            if isinstance(told, _Tried) and told.gap <= EXACT_PX.get(footage.kind, SUBPIXEL_PX):
                break
            reason = told if isinstance(told, str) else "the predicted outline lies beside the extracted one"
        answers = {name: told for name, told in tried.items() if isinstance(told, _Tried)}
        if not answers:
            found.append(Chosen(reason, tuple(tried), "", ""))
            continue
        best = min(answers, key=lambda name: answers[name].gap / (NEARER if name == "homography" else 1.0))
        prior = answers[best].homography
        found.append(Chosen(answers[best].contacts, tuple(tried), best, reason if len(tried) > 1 else ""))
    return found


class _Tried(NamedTuple):
    """A transfer: contacts (2, 2) px; (3, 3) the motion that it tells; px, mean by which its outline lies off."""

    contacts: Floats
    homography: Floats
    gap: float


def _try_strategy(name: str, footage: Footage, frame: int, prior: Floats) -> _Tried | str:
    """What a strategy makes of a frame, or why it refuses it."""
    first, outline, extracted = (*(footage.outlines(name)[k] for k in (0, frame)), footage.silhouettes[frame])
    for view in (first, outline, extracted):
        if isinstance(view, str):
            return view
    assert isinstance(first, View) and isinstance(outline, View) and isinstance(extracted, View)
    strategy = strategy_named(name)
    try:
        moved = strategy.apply(strategy.describe(Grasp(footage.contacts(name)), first), outline, prior)
    except Refused as error:
        return str(error)
    H = similarity_between(first.outer.points, outline.outer.points) if moved.homography is None else moved.homography
    some = apply_homography(H, first.outer.points[:: max(1, len(first.outer) // PROBES)])
    gaps = kernels.project_to_contour(extracted.outer.points, extracted.outer.offsets, some)[:, 2]
    contacts = nearest_points(moved.grasp.contacts, outline) if footage.quantised else moved.grasp.contacts
    return _Tried(contacts, H, float(gaps.mean()))


def similarity_between(one: Floats, other: Floats) -> Floats:
    """(3, 3) the similarity that brings points (N, 2) nearest to others (N, 2), in the sense of least squares."""
    z, w = (p @ (1.0, 1.0j) for p in (one, other))
    turn = np.vdot(z - z.mean(), w - w.mean()) / np.vdot(z - z.mean(), z - z.mean())
    shift = w.mean() - turn * z.mean()
    a, b = turn.real, turn.imag
    return np.array([[a, -b, shift.real], [b, a, shift.imag], [0.0, 0.0, 1.0]])


def rule_runs(footage: Footage, seed: int) -> Iterator[StrategyRun]:
    """The rule along a path, with a tracker and without; what is varied is the time per frame by the paper's times."""
    for name, tracked in RULES.items():
        chosen = choose_along(footage, tracked)
        errors = tuple(
            c.answer
            if isinstance(c.answer, str)
            else error_measure(c.answer, footage.truth(c.strategy, k), float(footage.areas[k]))
            for k, c in enumerate(chosen, start=1)
        )
        cost = float(np.mean([sum(COST_US[s] for s in c.tried) for c in chosen]))
        setting = footage.part.name, seed, footage.motion, footage.kind, name, PRIOR
        yield run_of(errors, "rule", *setting, COST, cost)
        for strategy in STRATEGIES:
            share = float(np.mean([c.strategy == strategy for c in chosen]))
            yield run_of((), "rule", *setting, f"by {strategy}, %", 100.0 * share)
        yield run_of(
            (), "rule", *setting, SWITCHES, float(sum(bool(a.strategy != b.strategy) for a, b in pairwise(chosen)))
        )


def table_of_rule(runs: Sequence[StrategyRun]) -> Table:
    """Table W: the rule beside each strategy alone."""
    alone = [r for r in runs if r.experiment == "paths" and r.way == PRIOR and r.strategy in STRATEGIES]
    rule = [r for r in runs if r.experiment == "rule"]
    shares = tuple(f"by {name}, %" for name in STRATEGIES)
    rows: list[tuple[Cell, ...]] = []
    for motion, contours in dict.fromkeys((r.motion, r.contours) for r in rule):
        for name in (*STRATEGIES, *RULES):
            here = [r for r in (*alone, *rule) if (r.motion, r.contours, r.strategy) == (motion, contours, name)]
            told = [_mean(r.value for r in here if r.varied == what) for what in (COST, *shares, SWITCHES)]
            if name in COST_US:
                told = [COST_US[name], *(100.0 * (name == other) for other in STRATEGIES), 0.0]
            rows.append((motion, contours, name, *summarize(r for r in here if r.varied in ("", COST)), *told))
    return Table(
        "W",
        "The strategy chosen anew in each frame, beside each alone, last frame as prior (Sections III and V)",
        ("motion", "contours", "strategy", *SUMMARY, COST, *shares, SWITCHES),
        tuple(rows),
        (
            *SUMMARY_NOTES,
            f"{COST}: mean over the frames of the paper's times of all strategies that were tried there. What looks whether "
            "the predicted outline lies on the extracted one is not in it.",
            f"4 DoF hold while it lies within {SUBPIXEL_PX:g} px, on whole pixels within 1 px, on average; "
            f"beyond that the homography is tried, and kept unless the other outline lies {NEARER:g} times nearer. The "
            "numbers were chosen on four seeds of some of these shapes, that of whole pixels after a first run of this table.",
            "by ...: of all frames; the rest were refused. A carried grasp stays that of the first frame whichever "
            "strategy carries it.",
        ),
    )


def _mean(values: Iterable[float]) -> float | None:
    listed = list(values)
    return float(np.mean(listed)) if listed else None
