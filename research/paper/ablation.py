# SPDX-License-Identifier: Apache-2.0
"""What each improvement over the paper's text is worth: added to the paper's transfer alone, and taken from all of them;
and how much hangs on each constant of the homography transfer, one at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import Grasp
from grasptrack.transfer import TransferStrategy, homography, strategy_named
from grasptrack_bench.baselines.literal import LiteralGraspLine, LiteralHomography, LiteralRRP
from grasptrack_bench.report.table import Table
from research.paper.footage import MOTIONS, FilmedPart, Footage, Kind, Motion, ideal_footage
from research.paper.runs import SUMMARY, SUMMARY_NOTES, StrategyRun, run_of, summarize
from research.paper.transfers import Refused, Way, measure_answers, transfer_and_measure, transferred_contacts

SWITCHES = {
    "curvature times length": "scale_free",
    "choice of peaks": "chosen",
    "window at the alignment or prediction": "aligned",
    "between samples": "between",
}
"""The homography's improvements, by what they are called."""

VARIANTS: dict[str, tuple[str, TransferStrategy]] = {
    "RRP, whole interp (the paper's)": ("paper-rrp", LiteralRRP()),
    "RRP, real interp (ours)": ("rrp", strategy_named("rrp")),
    "grasp line, over the area (the paper's)": ("grasp-line", LiteralGraspLine()),
    "grasp line, over its root": ("grasp-line", LiteralGraspLine(invariant=True)),
    "grasp line, ours": ("grasp-line", strategy_named("grasp-line")),
    "homography, the paper's": ("homography", LiteralHomography()),
    "the paper's without the refinement": ("homography", LiteralHomography(refined=False)),
    **{
        f"the paper's and {name}": ("homography", LiteralHomography(**{switch: True}))
        for name, switch in SWITCHES.items()
    },
    "all of these": ("homography", LiteralHomography(**dict.fromkeys(SWITCHES.values(), True))),
    "all without the refinement": (
        "homography",
        LiteralHomography(**dict.fromkeys(SWITCHES.values(), True), refined=False),
    ),
    **{
        f"all without {name}": (
            "homography",
            LiteralHomography(**{other: other != switch for other in SWITCHES.values()}),
        )
        for name, switch in SWITCHES.items()
    },
    "homography, ours": ("homography", strategy_named("homography")),
}
"""Transfers by what they are called, each with the strategy whose contours it works on."""
ON: tuple[tuple[Kind, Motion], ...] = (*(("resampled", motion) for motion in MOTIONS), ("pixel chain", "4 DoF"))
"""Contours and paths on which they are tried."""
REFINEMENT = "refinement of Fig. 11"
"""What is varied in the runs that say how often it brings a contact nearer."""


def ablation_runs(part: FilmedPart, seed: int, frames: int) -> Iterator[StrategyRun]:
    """Every variant along the paths of `ON`, as pairs of views and with the last frame as prior."""
    for kind, motion in ON:
        footage = ideal_footage(part, kind, motion, frames, seed)
        for name, (strategy, variant) in VARIANTS.items():
            for way in variant_ways(variant):
                outlines, contacts = footage.outlines(strategy), footage.contacts(strategy)
                answers = transferred_contacts(variant, outlines, contacts, way, footage.quantised)
                errors = measure_answers(footage, strategy, answers)
                yield run_of(errors, "ablation", part.name, seed, motion, kind, name, way)
        for name in ("homography, the paper's", "all of these"):
            yield refinement_run(footage, name, seed)


def variant_ways(variant: TransferStrategy) -> tuple[Way, ...]:
    """A prediction is tried where the variant looks at one."""
    literal = isinstance(variant, LiteralRRP | LiteralGraspLine | LiteralHomography)
    takes_prior = (isinstance(variant, LiteralHomography) and variant.aligned) or not literal
    return ("first view", "last frame as prior") if takes_prior else ("first view",)


def refinement_run(footage: Footage, name: str, seed: int) -> StrategyRun:
    """How often the refinement brings a contact nearer to its true place.

    Returns:
        Of all contacts of all frames that were answered: `asked`, and `answered` those that it brought nearer; `mean_px` and
        `worst_px` are by how much the refinement lowers the distance, on average and at most.
    """
    variant = VARIANTS[name][1]
    assert isinstance(variant, LiteralHomography)
    first, *rest = (view for view in footage.silhouettes if isinstance(view, View))
    description = variant.describe(Grasp(footage.on_silhouette), first)
    plain = LiteralHomography(variant.scale_free, variant.chosen, variant.aligned, variant.between, refined=False)
    gains: list[float] = []
    for k, view in enumerate(rest, start=1):
        try:
            moved = [s.apply(description, view).grasp.contacts for s in (plain, variant)]
        except Refused:
            continue
        before, after = (np.hypot(*(m - footage.truth("homography", k)).T) for m in moved)
        gains += (before - after).tolist()
    setting = "refinement", footage.part.name, seed, footage.motion, footage.kind, name, "first view", REFINEMENT
    mean, most = (float(np.mean(gains)), max(gains)) if gains else (None, None)
    better = sum(g > 0.0 for g in gains)
    return replace(run_of((), *setting), asked=len(gains), answered=better, mean_px=mean, worst_px=most)


def ablation_tables(runs: Sequence[StrategyRun]) -> list[Table]:
    """Table A: every variant by path and way; Table R: how often the refinement helps."""
    rows = []
    mine = [r for r in runs if r.experiment == "ablation"]
    for key in dict.fromkeys((r.motion, r.contours, r.way, r.strategy) for r in mine):
        here = [r for r in mine if (r.motion, r.contours, r.way, r.strategy) == key]
        rows.append((*key, *summarize(here)))
    refined = []
    fig11 = [r for r in runs if r.experiment == "refinement"]
    for pair in dict.fromkeys((r.motion, r.contours, r.strategy) for r in fig11):
        here = [r for r in fig11 if (r.motion, r.contours, r.strategy) == pair]
        asked = sum(r.asked for r in here)
        gain = [r.mean_px for r in here if r.mean_px is not None]
        share = 100.0 * sum(r.answered for r in here) / asked if asked else None
        refined.append((*pair, asked, share, float(np.median(gain)) if gain else None))
    counts = f"{len({r.shape for r in mine})} shapes, {len({r.seed for r in mine})} seeds."
    return [
        Table(
            "A",
            "What each improvement is worth: added to the paper's transfer alone, and taken from all",
            ("motion", "contours", "way", "transfer", *SUMMARY),
            tuple(rows),
            (
                counts,
                *SUMMARY_NOTES,
                "curvature times length: instead of curvature per px, which changes with scale. choice of peaks: well "
                "apart, with a quadrilateral that fixes a homography well, instead of the four highest. window: where the "
                "outlines' alignment puts the point, or with the last frame as prior where that does (a gate at the "
                "prediction), instead of the same index. between samples: the least error of eq. (3) to a sixteenth of "
                "a sample.",
                "all of these: by the code of this comparison, which works sample by sample; ours: the library's.",
            ),
        ),
        Table(
            "R",
            "How often the refinement of Fig. 11 brings a contact nearer to its true place",
            ("motion", "contours", "transfer", "contacts", "nearer %", "lowers the distance by, median px"),
            tuple(refined),
            (
                counts,
                "Median over the runs of what it lowers on average; below 0 it does harm. -: nothing was answered.",
            ),
        ),
    ]


CONSTANTS = tuple(name for name, value in vars(homography).items() if name.isupper() and isinstance(value, int | float))
"""All numbers of `transfer.homography`, in the order of the file."""
PRIOR: Way = "last frame as prior"
FACTORS = (0.5, 0.71, 1.0, 1.41, 2.0)
"""By which each is multiplied."""


@contextmanager
def changed(constant: str, factor: float) -> Iterator[None]:
    """`transfer.homography` with one of its constants multiplied, within this process; whole numbers stay whole."""
    usual = getattr(homography, constant)
    setattr(homography, constant, type(usual)(round(usual * factor) if isinstance(usual, int) else usual * factor))
    try:
        yield
    finally:
        setattr(homography, constant, usual)


def sensitivity_runs(part: FilmedPart, seed: int, frames: int) -> Iterator[StrategyRun]:
    """The homography with each constant changed, 6 DoF, contours sampled anew, with the last frame as prior."""
    footage = ideal_footage(part, "resampled", "6 DoF", frames, seed)
    usual = transfer_and_measure(footage, "homography", PRIOR).errors
    for constant in CONSTANTS:
        for factor in FACTORS:
            errors = usual
            if factor != 1.0:
                with changed(constant, factor):
                    errors = transfer_and_measure(footage, "homography", PRIOR).errors
            setting = "sensitivity", part.name, seed, "6 DoF", "resampled", "homography", PRIOR
            yield run_of(errors, *setting, constant, factor)


def sensitivity_table(runs: Sequence[StrategyRun]) -> Table:
    """Table S: errors and shares answered by constant and factor."""
    mine = [r for r in runs if r.experiment == "sensitivity"]
    rows = []
    for constant, factor in dict.fromkeys((r.varied, r.value) for r in mine):
        here = [r for r in mine if (r.varied, r.value) == (constant, factor)]
        rows.append((constant, getattr(homography, constant) * factor, factor, *summarize(here)))
    return Table(
        "S",
        "Sensitivity of the homography to each of its constants, 6 DoF, contours sampled anew, last frame as prior",
        ("constant", "value", "times the usual", *SUMMARY),
        tuple(rows),
        (
            f"{len({r.shape for r in mine})} shapes, {len({r.seed for r in mine})} seeds; the constants are those of "
            "`transfer.homography`.",
            *SUMMARY_NOTES,
        ),
    )
