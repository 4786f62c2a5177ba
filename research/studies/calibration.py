# SPDX-License-Identifier: Apache-2.0
"""Fits the numbers that scale covariances and the most that confidence may say, writes the file of numbers, and shows on other
sequences how reliable they are: how many contacts of each kind of scene the ellipses hold that were fitted without that kind,
and how often an answer is wrong that is told with so much confidence."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import grasptrack as gt
from grasptrack.errors import GraspTrackError
from grasptrack.tracking.numbers import NUMBERS, OWN, read_numbers
from grasptrack.typing import Floats
from grasptrack_bench.method import MethodFrame, MethodStart
from grasptrack_bench.metrics.score import Score
from grasptrack_bench.metrics.statistics import upper_bound
from grasptrack_bench.real import RealCase, sequence_of, videos_of
from grasptrack_bench.scenes import SceneCase, built_in, make_scene_cases, show_scene
from grasptrack_bench.simulation.disturbances import DISTURBANCES
from research.studies import common
from research.studies.confidence import HEAD, Answers, bins_of, plot_bins, rows_of

PARTS = "bracket,key,spanner,s-blob,gear,bean,half-disc,leaf"
OTHERS = "hook,notched-plate,guitar,t-plate,fork,ring-wrench,bottle,u-clip"
"""Parts of the sequences that the fit does not use."""
WITHIN = 5.991
"""95 % of chi-squared with two degrees of freedom."""
LEAST = 0.01**2
"""px^2: contacts are told with two decimals."""
HELD, KINDS = 0.93, 0.9
"""Of the contacts of a kind of scene that its ellipses of 95 % are to hold: as many as chance may leave; and of the kinds, for
which they are to: what two numbers cannot hold is an error of the model, and no reason to tell less of all the others."""
GRID = [(float(a), float(b)) for a in np.geomspace(0.7, 3.0, 22) for b in np.geomspace(0.01, 0.2, 22)]
"""Pairs of inflate and exposed that are tried."""
DRAWS = 200
"""Resamplings of the sequences, for the intervals."""


RISK = 0.5
"""At which reliability is looked at: answers of every confidence from one half on are given."""


class Followed(NamedTuple):
    """Contacts of a sequence, (n, ...) each, that were located at the usual risk; and all answers.

    Attributes:
        disturbance: or "real".
        off: (n, 2) px.
        covariance: (n, 2, 2) px^2, as estimated.
        moved: (n,) px since the image before, or in that if it was less.
        answers: at `RISK`.
    """

    disturbance: str
    off: Floats
    covariance: Floats
    moved: Floats
    answers: Answers


def followed_frames(name: str, start: MethodStart, frames: Iterable[MethodFrame]) -> Followed:
    """What the tracker says of each frame, and what is true of it."""
    off, covariance, moved, confidence, wrong = [], [], [], [], []
    tracker = gt.GraspTracker(grasp=start.contacts, object_at=start.object_at, risk=RISK)
    score, before, last = Score(name, given=start.contacts), None, 0.0
    first: Floats | None = None
    for shown in frames:
        result, truth = tracker.update(shown.image, time=shown.time), shown.truth
        scored = score.add(result, truth)
        if first is None:
            first = result.contacts
        elif result.contacts is not None and truth is not None:
            confidence.append(result.confidence)
            wrong.append(scored.is_false_accept)
            way = 0.0 if before is None else float(np.sqrt(((result.contacts - before) ** 2).mean() * 2.0))
            known = result.confidence >= 1.0 - NUMBERS.risk and before is not None and not scored.gone
            if known and result.covariance is not None:
                least = min(way, last)
                own = result.covariance - (NUMBERS.exposed * least) ** 2 * np.eye(2)
                off += list(result.contacts - truth.carry_points(first))
                covariance += list(own / NUMBERS.inflate**2)
                moved += [least] * len(result.contacts)
            last = way
        before = result.contacts
    return Followed(
        name,
        np.reshape(off, (-1, 2)),
        np.reshape(covariance, (-1, 2, 2)),
        np.array(moved),
        Answers(name, np.array(confidence), np.array(wrong, np.float64), np.ones(len(wrong)), len(wrong)),
    )


def inflate_covariances(sequence: Followed, inflate: float, exposed: float) -> Floats:
    """(n, 2, 2) px^2 as they would be told."""
    more = (exposed * sequence.moved) ** 2 + LEAST
    return np.asarray(inflate**2 * sequence.covariance + more[:, None, None] * np.eye(2))


def mahalanobis_distances(sequence: Followed, inflate: float, exposed: float) -> Floats:
    """(n,) squared, of the contacts from where they are, in their covariance."""
    C = inflate_covariances(sequence, inflate, exposed)
    return np.asarray(np.einsum("ni,ni->n", sequence.off, np.linalg.solve(C, sequence.off[:, :, None])[:, :, 0]))


class SequenceCoverage(NamedTuple):
    """What a sequence makes of all GRID: how many contacts are held, of how many, and the mean log of their ellipses' size."""

    disturbance: str
    contacts: int
    held: Floats
    size: Floats


def evaluate_grid(sequence: Followed) -> SequenceCoverage:
    """See there."""
    held = [float(np.sum(mahalanobis_distances(sequence, *numbers) < WITHIN)) for numbers in GRID]
    size = [float(np.mean(np.linalg.slogdet(inflate_covariances(sequence, *numbers))[1])) for numbers in GRID]
    return SequenceCoverage(sequence.disturbance, len(sequence.off), np.array(held), np.array(size))


def coverage_shares(sequences: Sequence[Followed], inflate: float, exposed: float) -> dict[str, float]:
    """Share of the contacts in their 95 % ellipses, by disturbance."""
    found: dict[str, list[Floats]] = {}
    for sequence in sequences:
        found.setdefault(sequence.disturbance, []).append(mahalanobis_distances(sequence, inflate, exposed))
    return {name: float(np.mean(np.concatenate(parts) < WITHIN)) for name, parts in found.items()}


def fit_inflation(tried: list[SequenceCoverage], chosen: NDArray[np.int64]) -> Floats:
    """(2,) inflate and exposed: the sharpest with which the contacts of `KINDS` of the kinds of scenes are held.

    Sharpness subject to calibration (Gneiting, Balabdaoui and Raftery 2007). Where none holds so many, the sharpest of those
    that hold most kinds.
    """
    held: dict[str, list[Floats]] = {}
    for i in chosen.tolist():
        held.setdefault(tried[i].disturbance, []).append(
            np.column_stack([tried[i].contacts * np.ones(len(GRID)), tried[i].held])
        )
    totals = [np.sum(parts, axis=0) for parts in held.values()]
    kinds = np.mean([total[:, 1] >= HELD * total[:, 0] for total in totals], axis=0)
    size = np.mean([tried[i].size for i in chosen.tolist()], axis=0)
    best = int(np.argmin(np.where(kinds >= min(KINDS, kinds.max()), size, np.inf)))
    return np.array(GRID[best])


def leave_each_out(tried: list[SequenceCoverage]) -> dict[str, Floats]:
    """(2,) inflate and exposed of each kind of scene, fitted without the sequences of that kind."""
    kinds = {coverage.disturbance for coverage in tried}
    return {
        kind: fit_inflation(tried, np.array([k for k, c in enumerate(tried) if c.disturbance != kind]))
        for kind in kinds
        if len(kinds) > 1
    }


def least_told(sequences: Sequence[Followed]) -> tuple[int, float]:
    """How many answers the default risk gives, and the upper bound of the share of them that is wrong: no less is told."""
    told, wrong = (np.concatenate([getattr(s.answers, name) for s in sequences]) for name in ("told", "wrong"))
    surest = told >= 1.0 - NUMBERS.risk
    return int(surest.sum()), upper_bound(int(wrong[surest].sum()), int(surest.sum()))


def followed_or_none(case: SceneCase | RealCase) -> Followed | None:
    """A rendered sequence or a real video; None where it holds no grasp, or nothing was located."""
    try:
        if isinstance(case, SceneCase):
            found = followed_frames(case.disturbance, *show_scene(case.scene()))
        else:
            with sequence_of(case) as (start, shown, _):
                found = followed_frames("real", start, shown)
    except GraspTrackError:
        return None
    return found if len(found.off) else None


def main() -> None:
    """Fit, write, show."""
    parser = common.create_parser(__doc__, frames=30, disturbances=",".join(DISTURBANCES), workers=2, parts=PARTS)
    parser.add_argument(
        "--seed", type=int, default=91, help="of the sequences that are fitted to; those of the next show it"
    )
    parser.add_argument("--others", default=OTHERS, help="parts that show it")
    parser.add_argument("--real", type=Path, help="folder of videos as for `grasptrack evaluate real`, to show it on")
    parser.add_argument(
        "--fit-real",
        action="store_true",
        help="fit to every other of them too: what their references err counts as ours",
    )
    parser.add_argument("--picture", type=Path, metavar="FILE", help="PNG of the reliability diagram")
    parser.add_argument(
        "--write", type=Path, metavar="FILE", help="the numbers, for GRASPTRACK_NUMBERS=FILE or for the package"
    )
    asked = parser.parse_args()
    videos = videos_of(asked.real) if asked.real else []
    fitted_to, shown_on = (videos[::2], videos[1::2]) if asked.fit_real else ([], videos)

    def choose_sequences(parts: str, seed: int, real: Sequence[RealCase]) -> list[Followed]:
        scenes = make_scene_cases(
            built_in(parts.split(",")), asked.disturbances.split(","), frames=asked.frames, seed=seed
        )
        every: list[SceneCase | RealCase] = [*scenes, *real]
        return [f for f in common.run_all(followed_or_none, every, asked.workers) if f is not None]

    fit = choose_sequences(asked.parts, asked.seed, fitted_to)
    table = [evaluate_grid(sequence) for sequence in fit]
    best = fit_inflation(table, np.arange(len(fit)))
    rng = np.random.default_rng(asked.seed)
    drawn = np.array([fit_inflation(table, rng.integers(len(fit), size=len(fit))) for _ in range(DRAWS)])
    low, high = np.percentile(drawn, [2.5, 97.5], axis=0)
    common.begin_section("Calibration")
    count = sum(len(s.off) for s in fit)
    common.add_paragraph(
        f"{count} contacts of {len(fit)} sequences, seed {asked.seed}; intervals of 95 % by resampling them."
    )
    names = "inflate", "exposed"
    common.add_table(("number", "now", "fitted", "from", "to"), [
        (name, getattr(NUMBERS, name), *(float(v[k]) for v in (best, low, high))) for k, name in enumerate(names)
    ])  # fmt: skip
    show = choose_sequences(asked.others, asked.seed + 1, shown_on)
    given, most_wrong = least_told([*fit, *show])
    if asked.write:
        told = json.loads(OWN.read_text(encoding="utf-8"))
        by = f"research.studies.calibration --seed {asked.seed}"
        for k, name in enumerate(names):
            value, lower, upper = (round(float(v[k]), 4) for v in (best, low, high))
            told[name] |= {"value": value, "from": lower, "to": upper, "by": by}
        told["untested"] |= {"value": min(NUMBERS.risk, math.ceil(1e5 * most_wrong) / 1e5), "by": by}
        common.write_numbers(asked.write, told)
        read_numbers(asked.write)
        common.add_paragraph(f"Written: `{asked.write.name}`.")
    common.add_paragraph(
        f"In the 95 % ellipses, of {sum(len(s.off) for s in show)} contacts of other parts and videos, seed "
        f"{asked.seed + 1}; in the last column as fitted without any scene of that kind:"
    )
    now, then = coverage_shares(show, NUMBERS.inflate, NUMBERS.exposed), coverage_shares(show, *best)
    without = leave_each_out(table)
    apart = {
        kind: coverage_shares([s for s in show if s.disturbance == kind], *without.get(kind, best))[kind]
        for kind in now
    }
    counts = Counter(s.disturbance for s in show for _ in s.answers.told)
    rows = [(kind, counts[kind], *(f"{100 * shares[kind]:.0f} %" for shares in (now, then, apart))) for kind in now]
    common.add_table(("kind", "answers", "now", "fitted", "left out"), rows)
    common.add_paragraph(
        f"Answers at --risk {RISK:g} in both, with the numbers as they are now; of the {given} that the default risk gives at "
        f"most {1e3 * most_wrong:.2f} in a thousand are wrong, with 95 % confidence:"
    )
    answers = [sequence.answers for sequence in (*fit, *show)]
    bins = bins_of(answers)
    common.add_table(HEAD, rows_of(bins))
    wrong = Counter[str]()
    for a in answers:
        wrong[a.name] += int(a.wrong[a.told >= 1.0 - NUMBERS.risk].sum())
    common.add_paragraph(
        "Wrong at the default risk: "
        + (", ".join(f"{name} {n}" for name, n in wrong.most_common() if n) or "none")
        + "."
    )
    if asked.picture:
        plot_bins(asked.picture, bins, len(answers))
        common.add_paragraph(f"Picture: {asked.picture.name}")
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()
