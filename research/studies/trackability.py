# SPDX-License-Identifier: Apache-2.0
"""Does `inspect` foretell the run: share of located frames and error against their intervals, on rendered scenes and videos."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from grasptrack.errors import GraspTrackError
from grasptrack.trackability import inspect
from grasptrack.trackability.prediction import (
    FILE,
    FRAMES,
    QUANTILES,
    UNFORESEEN,
    Drawn,
    Unforeseen,
    beta_of,
    errors_of,
    log_chance,
    predict_run,
)
from grasptrack.typing import Floats
from grasptrack_bench.method import MethodFrame, MethodStart, score_sequence
from grasptrack_bench.methods import method_makers
from grasptrack_bench.metrics.score import FrameScore
from grasptrack_bench.real import RealCase, sequence_of, videos_of
from grasptrack_bench.scenes import SceneCase, built_in, make_scene_cases, show_scene
from research.studies import common

LEVELS = ("good", "fair", "poor")
PARTS = "bracket,spanner,gasket,notched-plate,disc,square,gear,hinge,strip,key,hammer-head,ellipse,egg,half-disc,pencil,guitar"
"""Of the scenes that a fit uses."""
OTHERS = "bracket,t-plate,cross,star,arrow,hex-nut,u-clip,hook,fork,spoon,disc,egg,bean,crescent,slotted-disc,bottle"
DISTURBANCES = "clean-4dof,clean-6dof,noise,blur,light,motion-blur,lens,thick,rolling-shutter,jpeg,print,mixed"
WHOLE = 0.999
"""Of the outline, so much is seen in a frame that counts: what covers the object cannot be foretold from one image."""
LEAST = 10
"""Frames that count; of fewer no share is taken."""
LOGS = (math.log(1e-5), math.log(100.0))
"""Between which the logs of what is fitted are looked for."""
DRAWS = 40
"""Resamplings of the runs, for the intervals of what is fitted."""


class RunOutcome(NamedTuple):
    """What was foretold of a run, and what came of it.

    Attributes:
        kind: the disturbance, or "video".
        name: of the scene or video.
        level, verdict: of the inspection.
        drawn: what its prediction rests on; None where the grasp cannot be carried.
        seconds: that it took.
        frames, located: that count, and how many of them were located.
        error: px of the worst contact, rms over these; NaN where none was.
        wrong: frames among them whose contacts were wrong.
    """

    kind: str
    name: str
    level: str
    verdict: str
    drawn: Drawn | None
    seconds: float
    frames: int
    located: int
    error: float
    wrong: int

    @property
    def share(self) -> float:
        """Of the frames, 0 to 1."""
        return self.located / self.frames


def inspect_and_track(kind: str, name: str, start: MethodStart, shown: Iterable[MethodFrame]) -> RunOutcome | None:
    """Inspect the first frame and track the rest, both told of the same contacts; None where too few frames count."""
    frames = iter(shown)
    first = next(frames)
    began = time.process_time()
    found = inspect(first.image, grasp=start.contacts, object_at=start.object_at)
    seconds = time.process_time() - began
    scored: list[FrameScore] = score_sequence(chain([first], frames), method_makers(["auto"]), start)["auto"][1:]
    counted = [f for f in scored if f.present and f.visible >= WHOLE]
    if len(counted) < LEAST:
        return None
    errors = np.array([f.error for f in counted if f.answered])
    return RunOutcome(
        kind,
        name,
        found.level,
        found.verdict,
        None if found.prediction is None else found.prediction.drawn,
        seconds,
        len(counted),
        len(errors),
        float(np.sqrt(np.mean(np.square(errors)))) if len(errors) else math.nan,
        sum(f.is_false_accept for f in counted),
    )


def of_scene(case: SceneCase) -> RunOutcome | None:
    """A rendered scene; None where there is nothing to choose."""
    try:
        return inspect_and_track(case.disturbance, case.name, *show_scene(case.scene(), case.fingers, case.friction))
    except GraspTrackError:
        return None


def of_video(case: RealCase) -> RunOutcome | None:
    """A real video; None where its object is not found."""
    try:
        with sequence_of(case) as (start, shown, _):
            return inspect_and_track("video", case.name, start, shown)
    except GraspTrackError as error:
        print(f"{case.name}: {error}")
        return None


def run_cases(function: Callable[[Any], RunOutcome | None], cases: Sequence[Any], jobs: int) -> list[RunOutcome]:
    """All that came of some cases."""
    return [o for o in common.run_all(function, cases, jobs) if o is not None]


# --- the fit -------------------------------------------------------------------------------------


def fit_unforeseen(
    outcomes: Sequence[RunOutcome], weights: Floats, start: Unforeseen = UNFORESEEN, near: float = 0.02
) -> Unforeseen:
    """The numbers that make what came of runs most probable, and their errors' quantiles best (pinball loss of the log).

    Each run has its weight (n,); numbers are looked for from `start`, to within a share `near` of each.
    """
    from scipy.optimize import minimize  # of the development extras

    known = [
        (o, o.drawn, w) for o, w in zip(outcomes, weights.tolist(), strict=True) if o.drawn is not None and w > 0.0
    ]

    def share_loss(logs: Floats) -> float:
        u = UNFORESEEN._replace(**dict(zip(("located", "lost", "weight"), np.exp(logs).tolist(), strict=True)))
        return -float(sum(w * log_chance(*beta_of(d, u), o.frames, o.located) for o, d, w in known))

    def error_loss(logs: Floats) -> float:
        names = ("factor", "factor_spread", "beyond", "beyond_spread")
        u = UNFORESEEN._replace(**dict(zip(names, np.exp(logs).tolist(), strict=True)))
        loss = 0.0
        for o, d, w in known:
            if o.located and d.located:
                for q, value in zip(QUANTILES, errors_of(d, u), strict=True):
                    off = math.log(o.error / value)
                    loss += w * max(q * off, (q - 1.0) * off) / math.sqrt(q * (1.0 - q))
        return loss

    def minimize_loss(loss: Callable[[Floats], float], numbers: Sequence[float]) -> Floats:
        logs = np.log(numbers)
        simplex = np.vstack([logs, logs + 0.4 * np.eye(len(logs))])
        options = {"xatol": near, "fatol": 0.05 * near, "maxiter": 400, "initial_simplex": simplex}
        return np.asarray(minimize(loss, logs, method="Nelder-Mead", bounds=[LOGS] * len(logs), options=options).x)

    first, second = minimize_loss(share_loss, start[:3]), minimize_loss(error_loss, start[3:])
    return Unforeseen(*np.exp([*first, *second]).tolist())


def balance_weights(outcomes: Sequence[RunOutcome]) -> Floats:
    """(n,) so that videos count as much as scenes."""
    videos = np.array([o.kind == "video" for o in outcomes])
    share = np.where(videos, 0.5 / max(int(videos.sum()), 1), 0.5 / max(int((~videos).sum()), 1))
    return np.asarray(share * len(outcomes), dtype=np.float64)


def write_numbers(path: Path, outcomes: Sequence[RunOutcome], by: str) -> Unforeseen:
    """Fit, and write the numbers with their intervals."""
    weights = balance_weights(outcomes)
    best, rng = fit_unforeseen(outcomes, weights), np.random.default_rng(0)
    count = len(outcomes)
    drawn = [
        fit_unforeseen(outcomes, weights * np.bincount(rng.integers(0, count, count), minlength=count), best, 0.2)
        for _ in range(DRAWS)
    ]
    low, high = np.quantile(np.array(drawn), [0.025, 0.975], axis=0)
    told = {
        name: {"value": float(f"{v:.3g}"), "from": float(f"{a:.2g}"), "to": float(f"{b:.2g}"), "by": by}
        for name, v, a, b in zip(Unforeseen._fields, best, low.tolist(), high.tolist(), strict=True)
    }
    common.write_numbers(path, told)
    return Unforeseen(*(float(str(entry["value"])) for entry in told.values()))


# --- tables --------------------------------------------------------------------------------------


def is_within(o: RunOutcome, unforeseen: Unforeseen) -> tuple[bool, bool]:
    """Whether the share of located frames and the error of a run lie within their intervals."""
    assert o.drawn is not None
    run = predict_run(o.drawn, o.frames, unforeseen)
    (a, b), (c, d) = run.located_interval, run.error_interval
    return a <= o.share <= b, not o.located or not o.drawn.located or c <= o.error <= d


def by_kind(outcomes: Sequence[RunOutcome], unforeseen: Unforeseen) -> list[list[object]]:
    """Rows of how often runs of each kind lie within."""
    rows: list[list[object]] = []
    kinds = list(dict.fromkeys(o.kind for o in outcomes))
    for kind in (*kinds, "all"):
        some = [o for o in outcomes if kind in (o.kind, "all") and o.drawn is not None]
        shares, errors = zip(*(is_within(o, unforeseen) for o in some), strict=True)
        ratio = [o.error / predict_run(o.drawn, FRAMES, unforeseen).error_px for o in some if o.drawn and o.located]
        middle = float(np.nanmedian(ratio)) if ratio else math.nan
        rows.append([kind, len(some), f"{100 * np.mean(shares):.0f} %", f"{100 * np.mean(errors):.0f} %", middle])
    return rows


def by_level(outcomes: Sequence[RunOutcome]) -> list[list[object]]:
    """Rows of what came of runs that were called good, fair and poor."""
    rows: list[list[object]] = []
    for level in LEVELS:
        some = [o for o in outcomes if o.level == level]
        if some:
            frames, located = sum(o.frames for o in some), sum(o.located for o in some)
            least = min(o.share for o in some)
            error = float(np.nanmedian([o.error for o in some])) if located else math.nan
            wrong = f"{sum(o.wrong for o in some)} of {located}"
            rows.append([level, len(some), f"{100 * located / frames:.1f} %", f"{100 * least:.0f} %", error, wrong])
    return rows


def outcome_row(o: RunOutcome, unforeseen: Unforeseen) -> list[object]:
    """A run beside what was foretold of it."""
    if o.drawn is None:
        return [o.name, o.level, "", f"{100 * o.share:.0f} %", "", o.error, ""]
    run = predict_run(o.drawn, o.frames, unforeseen)
    (a, b), (c, d) = run.located_interval, run.error_interval
    within = is_within(o, unforeseen)
    px = "" if math.isnan(c) else f"{c:.2g} to {d:.2g}"
    outside = ", ".join(what for what, inside in zip(("located", "px"), within, strict=True) if not inside)
    return [o.name, o.level, f"{100 * a:.0f} to {100 * b:.0f} %", f"{100 * o.share:.1f} %", px, o.error, outside]


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__, disturbances=DISTURBANCES, jobs=1)
    parser.add_argument("--parts", default=OTHERS, help=f"of the scenes; with --fit {PARTS}")
    parser.add_argument("--frames", type=int, default=31, help="of a scene")
    parser.add_argument("--seed", type=int, default=0, help="of the scenes")
    parser.add_argument(
        "--real", type=Path, action="append", help="folder of videos, as for `evaluate real`; several may be"
    )
    parser.add_argument("--fit", action="store_true", help="fit what is not foreseen to these runs")
    parser.add_argument("--write", type=Path, default=FILE, help="file for what is fitted")
    args = parser.parse_args()
    parts = PARTS if args.fit and args.parts == OTHERS else args.parts
    names = args.disturbances.split(",")
    scenes = make_scene_cases(built_in(parts.split(",")), names, frames=args.frames, seed=args.seed)
    videos = [
        case
        for folder in args.real or filter(Path.is_dir, [common.data_folder() / "videos"])
        for case in videos_of(folder)
    ]
    outcomes = [*run_cases(of_scene, scenes, args.jobs), *run_cases(of_video, videos, args.jobs)]
    common.begin_section("Suitability")
    common.add_paragraph(
        f"{len(outcomes)} of {len(scenes)} scenes and {len(videos)} videos; inspected in the first frame, tracked by auto in "
        "the others that show the object as a whole. Time of an inspection: median "
        f"{np.median([o.seconds for o in outcomes]):.2f} s, at most {max(o.seconds for o in outcomes):.2f} s of one core."
    )
    unforeseen = UNFORESEEN
    if args.fit:
        unforeseen = write_numbers(args.write, outcomes, f"research.studies.trackability --fit --seed {args.seed}")
        common.add_paragraph(f"Fitted: {', '.join(f'{n} {v:.3g}' for n, v in unforeseen._asdict().items())}.")
    common.add_table(
        ["runs of", "runs", "located within", "px within", "px of the median told"], by_kind(outcomes, unforeseen)
    )
    common.add_table(["verdict", "runs", "located", "least of a run", "median px", "wrong"], by_level(outcomes))
    listed = [o for o in outcomes if o.kind == "video"]
    listed += [o for o in outcomes if o.kind != "video" and (o.drawn is None or not all(is_within(o, unforeseen)))]
    common.add_paragraph("Each video, and the scenes that lie outside an interval.")
    head = ["run", "verdict", "located, 95 %", "located", "px, 95 %", "px", "outside"]
    common.add_table(head, [outcome_row(o, unforeseen) for o in listed])
    common.write_sections(args.output)


if __name__ == "__main__":
    main()
