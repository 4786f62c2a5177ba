# SPDX-License-Identifier: Apache-2.0
"""Whether confidence is the probability that it says, and what each risk costs: wrong answers of evaluations that ran,
counted and expected, and the share of frames that is answered at each risk, beside other methods where a run has them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from grasptrack.typing import Floats
from grasptrack.view.style import create_figure
from grasptrack_bench.metrics.integrity import WHOLE
from grasptrack_bench.metrics.score import FrameScore
from grasptrack_bench.run_folder import read_run
from research.studies import common

BINS = (0.0, 0.5, 0.8, 0.9, 0.99, 0.999, 1.0)
"""Confidences between which answers are counted."""
RISKS = (1e-1, 1e-2, 1e-3)
"""No answer is told to be surer than `Numbers.untested`."""
DRAWS = 500
"""Resamplings of the sequences, for the intervals: frames of one sequence are wrong together."""

WIDE = 6.4
"""Inches."""
FLOOR = 1e-5
"""Least share that is shown."""


class Answers(NamedTuple):
    """Answers of one method to one sequence, (n,) each, by no order; and frames that show the object whole.

    Attributes:
        name: of the sequence.
        told, wrong, whole: of each answer: confidence, whether it is a false accept, whether all of the object can be seen.
        frames: that show the object whole.
    """

    name: str
    told: Floats
    wrong: Floats
    whole: Floats
    frames: int


def cases_of(folders: Sequence[Path]) -> Iterator[tuple[str, Answers]]:
    """Each method's answers to each sequence; the frames that define the truth are left out."""
    for folder in folders:
        for name, scores in read_run(folder).scores.items():
            for method, frames in scores.items():
                yield method, _collect_answers(name, [f for f in frames if not f.defining])


def _collect_answers(name: str, frames: list[FrameScore]) -> Answers:
    given = [f for f in frames if f.answered]
    confidence = [f.confidence if math.isfinite(f.confidence) else 1.0 for f in given]
    wrong, whole = ([float(x) for x in v] for v in zip(*((f.is_false_accept, _is_whole(f)) for f in given), strict=True)
                    ) if given else ([], [])  # fmt: skip
    return Answers(name, np.array(confidence), np.array(wrong), np.array(whole), sum(map(_is_whole, frames)))


def _is_whole(f: FrameScore) -> bool:
    return f.present and f.visible >= WHOLE


class Bin(NamedTuple):
    """Answers of about one confidence: their number, how many are wrong as told and as counted, with the 95 % interval."""

    low: float
    high: float
    answers: int
    told: float
    wrong: int
    least: float
    most: float


def bins_of(cases: Sequence[Answers]) -> list[Bin]:
    """Those of BINS that hold answers.

    The interval is that of the count, were the run repeated: of sequences drawn anew, and never narrower than what a Poisson
    count leaves.
    """
    rng, found = np.random.default_rng(0), []
    for low, high in pairwise(BINS):
        inside = [(c.told >= low) & ((c.told < high) | (high == 1.0)) for c in cases]
        wrong = np.array([c.wrong[k].sum() for c, k in zip(cases, inside, strict=True)])
        count = int(sum(k.sum() for k in inside))
        if not count:
            continue
        told = float(sum((1.0 - c.told[k]).sum() for c, k in zip(cases, inside, strict=True)))
        drawn = [wrong[rng.integers(len(wrong), size=len(wrong))].sum() for _ in range(DRAWS)]
        n = float(wrong.sum())
        least = min(float(np.percentile(drawn, 2.5)), max(0.0, (math.sqrt(n) - 0.98) ** 2))
        most = max(float(np.percentile(drawn, 97.5)), (math.sqrt(n + 1.0) + 0.98) ** 2)
        found.append(Bin(low, high, count, told, int(n), least, most))
    return found


def at_risk(cases: Sequence[Answers], risk: float) -> tuple[float, int, float]:
    """Share of the whole frames that is located, answers wrong of all, and as told, with `--risk` so."""
    taken = [c.told >= 1.0 - risk for c in cases]
    frames = sum(c.frames for c in cases)
    located = sum(float((c.whole * (1.0 - c.wrong))[k].sum()) for c, k in zip(cases, taken, strict=True))
    wrong = sum(float(c.wrong[k].sum()) for c, k in zip(cases, taken, strict=True))
    told = sum(float((1.0 - c.told)[k].sum()) for c, k in zip(cases, taken, strict=True))
    return located / max(1, frames), round(wrong), told


def best_at(cases: Sequence[Answers], risk: float) -> float | None:
    """The largest share of whole frames that a method locates if its confidence is cut where so many answers are wrong.

    The best cut is known from the truth alone: it flatters a method that cannot tell its risk. None where no cut does.
    """
    told, wrong, whole = (np.concatenate([getattr(c, name) for c in cases]) for name in ("told", "wrong", "whole"))
    order = np.argsort(-told, kind="stable")
    told, wrong, whole = told[order], wrong[order], whole[order]
    last = np.append(np.diff(told) != 0.0, True)  # answers of one confidence are taken together
    share = np.cumsum(wrong) / np.arange(1, len(wrong) + 1)
    fits = last & (share <= risk)
    return float(np.cumsum(whole * (1.0 - wrong))[fits].max() / sum(c.frames for c in cases)) if fits.any() else None


def rows_of(bins: Sequence[Bin]) -> list[tuple[object, ...]]:
    """Rows: confidence, answers, wrong as told, wrong as counted, and its 95 % interval."""
    return [
        (f"{b.low:g} to {b.high:g}", b.answers, f"{b.told:.1f}", b.wrong, f"{b.least:.0f} to {b.most:.0f}")
        for b in bins
    ]


HEAD = ("confidence", "answers", "wrong as told", "wrong", "95 %")
"""Of the table of `rows_of`."""


def plot_reliability(path: Path, shares: Floats, labels: Sequence[str], title: str) -> None:
    """Draw the share of wrong answers as counted over that told, both logarithmic."""
    figure = create_figure(WIDE, 0.62 * WIDE, layout="constrained")
    axes = figure.add_subplot()
    told, low = np.maximum(shares[:, 0], FLOOR), np.maximum(shares[:, 1], FLOOR)
    least, most = np.clip(shares[:, 2], FLOOR, low), np.maximum(shares[:, 3], low)
    axes.plot([FLOOR, 1.0], [FLOOR, 1.0], color="0.7", lw=1.0, label="as told")
    bars = [low - least, most - low]
    axes.errorbar(told, low, bars, fmt="o", color="#1f5fa8", capsize=3, lw=1.2, label="counted, 95 % interval")
    for label, x, y in zip(labels, told, most, strict=True):
        axes.annotate(label, (x, y), xytext=(0, 5), textcoords="offset points", fontsize=8, ha="center")
    axes.set(xscale="log", yscale="log", xlim=(FLOOR / 1.5, 1.2), ylim=(FLOOR / 1.5, 2.5), title=title)
    axes.set(xlabel="wrong answers as told: 1 - confidence", ylabel="wrong answers as counted")
    axes.legend(loc="lower right", frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=150)


def plot_bins(path: Path, bins: Sequence[Bin], sequences: int) -> None:
    """The reliability diagram (PNG) of the answers to so many sequences."""
    shares = np.array([(b.told, b.wrong, b.least, b.most) for b in bins]) / np.array([[b.answers] for b in bins])
    labels = [f"{b.wrong} of {b.answers}" for b in bins]
    plot_reliability(path, shares, labels, f"{sum(b.answers for b in bins)} answers in {sequences} sequences")


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__)
    parser.add_argument(
        "runs", type=Path, nargs="+", help="folders of runs of `grasptrack evaluate`, best made with --risk 0.5"
    )
    parser.add_argument("--method", default="auto", help="whose confidence is a probability")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="PNG of the reliability diagram")
    asked = parser.parse_args()
    methods: dict[str, list[Answers]] = {}
    for method, case in cases_of(asked.runs):
        methods.setdefault(method, []).append(case)
    if asked.method not in methods:
        parser.error(f'no answers of "{asked.method}" there; there are those of {", ".join(methods) or "no method"}')
    cases = methods.pop(asked.method)
    common.begin_section("Confidence")
    count = sum(len(c.told) for c in cases)
    common.add_paragraph(f"{count} answers of {asked.method} in {len(cases)} sequences.")
    bins = bins_of(cases)
    common.add_table(HEAD, rows_of(bins))
    common.add_paragraph("At each risk: located of the frames that show the part whole, and wrong answers of all.")
    told = []
    for risk in RISKS:
        located, wrong, expected = at_risk(cases, risk)
        told.append((f"{risk:g}", f"{100 * located:.1f} %", wrong, f"{expected:.2f}"))
    common.add_table(("risk", "located", "wrong", "wrong as told"), told)
    if methods:
        common.add_paragraph(
            "The others tell no risk. Located if each is cut where, by the truth, as many of its answers are wrong:"
        )
        found = {
            name: [best_at(theirs, risk) for risk in RISKS] for name, theirs in {asked.method: cases, **methods}.items()
        }
        common.add_table(
            ("method", *(f"{risk:g}" for risk in RISKS)),
            [(n, *("-" if v is None else f"{100 * v:.1f} %" for v in shares)) for n, shares in found.items()],
        )
    if asked.picture:
        plot_bins(asked.picture, bins, len(cases))
        common.add_paragraph(f"Picture: {asked.picture.name}")
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()
