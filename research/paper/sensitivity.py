# SPDX-License-Identifier: Apache-2.0
"""How much hangs on each constant of the homography transfer: small curves, one constant at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from grasptrack.transfer import homography
from grasptrack_bench.report.table import Table
from research.paper.footage import FilmedPart, ideal_footage
from research.paper.runs import SUMMARY, SUMMARY_NOTES, StrategyRun, run_of, summarize
from research.paper.transfers import Way, transfer_and_measure

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
