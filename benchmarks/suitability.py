# SPDX-License-Identifier: Apache-2.0
"""Does `inspect` foretell what the tracker then does: expected error against measured, verdict against frames located."""

from __future__ import annotations

import common

# isort: split
import math
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

import numpy as np

from grasptrack import GraspTracker, inspect
from grasptrack.errors import ObservationError
from grasptrack.evaluation.score import accept_limit
from grasptrack.projective import apply_homography
from grasptrack.simulation import DISTURBANCES, SHAPES

LEVELS = ("good", "fair", "poor")
LOST, TRACKED = 0.5, 0.95
"""A scene is lost when less of its frames after the first is located than the one, tracked when at least the other."""


class Outcome(NamedTuple):
    """What was foretold of a scene, and what came of it: px, shares of the frames after the first, frames."""

    disturbance: str
    shape: str
    level: str
    why: str
    expected: float
    fixed: bool
    located: float
    error: float
    wrong: int
    answered: int


def run(task: tuple[str, str, int, int]) -> Outcome | None:
    """One scene: inspect its first frame, track the rest; None where there is nothing to choose."""
    disturbance, shape, seed, frames = task
    scene = DISTURBANCES[disturbance].scene(SHAPES[shape](), frames, seed)
    try:
        found = inspect(scene[0].image)
    except ObservationError:
        return None
    if found.grasp is None:
        return None
    tracker, chosen, off, wrong = GraspTracker(), found.grasp.contacts, [], 0
    for k in range(frames):
        frame = scene[k]
        result = tracker.update(frame.image, time=frame.time)
        if k == 0:
            assert result.contacts is not None and np.array_equal(result.contacts, chosen)
        elif result.contacts is not None:
            away = np.hypot(*(result.contacts - apply_homography(frame.H_current_reference, chosen)).T)
            off.append(float(away.max()))
            wrong += off[-1] > accept_limit(found.looks.size**2)
    return Outcome(
        disturbance,
        shape,
        found.level,
        found.verdict,
        found.expected,
        found.by != "nothing",
        len(off) / (frames - 1),
        math.sqrt(float(np.mean(np.square(off)))) if off else math.nan,
        wrong,
        len(off),
    )


def ranked(values: list[float]) -> np.ndarray:
    """Ranks, those of equal values shared."""
    listed = np.array(values)
    return np.array([(listed < v).sum() + 0.5 * ((listed == v).sum() - 1) for v in listed])


def correlation(some: list[Outcome]) -> float:
    """Spearman's, of expected and measured errors."""
    if len(some) < 3:
        return math.nan
    return float(np.corrcoef(ranked([o.expected for o in some]), ranked([o.error for o in some]))[0, 1])


def main() -> None:
    parser = common.parser(__doc__)
    parser.add_argument("--disturbances", default="clean-6dof,noise,blur")
    parser.add_argument("--shapes", default=",".join(SHAPES))
    parser.add_argument("--seeds", default="7,8", help="of the scenes, one each")
    parser.add_argument("--frames", type=int, default=25)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--list", action="store_true", help="print the scenes of which the verdict was not borne out")
    args = parser.parse_args()
    names = args.disturbances.split(",")
    tasks = [
        (name, shape, int(seed), args.frames)
        for name in names
        for shape in args.shapes.split(",")
        for seed in args.seeds.split(",")
    ]
    with ProcessPoolExecutor(args.jobs) as workers:
        outcomes = [o for o in workers.map(run, tasks) if o is not None]
    common.heading("Suitability")
    common.say(
        f"{len(outcomes)} of {len(tasks)} scenes, {args.frames} frames each; inspected in the first frame, tracked by auto "
        f"in the others. A scene is tracked when at least {100 * TRACKED:.0f} % of these frames are located, lost when less "
        f"than {100 * LOST:.0f} %."
    )
    rows = []
    for level in LEVELS:
        some = [o for o in outcomes if o.level == level]
        if some:
            answered = [o for o in some if o.answered]
            rows.append(
                [
                    level,
                    len(some),
                    f"{100 * np.mean([o.located >= TRACKED for o in some]):.0f} %",
                    f"{100 * np.mean([o.located < LOST for o in some]):.0f} %",
                    f"{100 * np.mean([o.located for o in some]):.1f} %",
                    float(np.median([o.error for o in answered])) if answered else math.nan,
                    f"{sum(o.wrong for o in some)} of {sum(o.answered for o in some)}",
                ]
            )
    common.table(
        ["verdict", "scenes", "tracked", "lost", "frames located", "median px", "wrong of answered"],
        rows,
    )
    common.say("Errors of the worst contact, rms over a scene, where it is fixed and answered, over the one expected.")
    rows = []
    for name in (*names, "all"):
        some = [o for o in outcomes if o.answered and o.fixed and name in (o.disturbance, "all")]
        ratio = [o.error / o.expected for o in some]
        if some:
            low, middle, high = np.quantile(ratio, [0.05, 0.5, 0.95]).tolist()
            within = f"{100 * np.mean([0.5 <= r <= 2.0 for r in ratio]):.0f} %"
            rows.append([name, len(some), correlation(some), low, middle, high, within])
    common.table(["scenes of", "scenes", "rank correlation", "5 %", "median", "95 %", "within twice"], rows)
    if args.list:
        for o in outcomes:
            amiss = (o.level != "poor" and o.located < TRACKED) or (o.level == "poor" and o.located >= LOST) or o.wrong
            if amiss:
                print(
                    f"{o.disturbance} {o.shape}: located {100 * o.located:.0f} %, expected {o.expected:.2f}, measured "
                    f"{o.error:.2f} px, {o.wrong} wrong; {o.why}"
                )
    common.finish(args.output)


if __name__ == "__main__":
    main()
