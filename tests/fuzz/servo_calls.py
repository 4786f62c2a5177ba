# SPDX-License-Identifier: Apache-2.0
"""Random call sequences of the servo, and approaches with the tracker on rendered images in which something fails.

    python tests/fuzz/servo_calls.py --count 20000 --real 500 --seed 1

Judged is by where the simulated hand is, what its camera sees and what time it is in truth (`servo_judge.Judge`). A finding
says what makes it again.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices of 4 x 4: threads only wait for each other

import pickle
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

if __name__ == "__main__":
    import sys

    sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

import grasptrack as gt
import servo_images
from grasptrack.servo.camera import pose_of, rotation_matrix
from harness import options
from servo_bench import Bench
from servo_judge import KINDS, OVER, Judge
from servo_trial import ARM, CALLS, FALSE, POSES, TIMES, Answers, Trial

CASES = 25
"""Sequences that branch off one approach."""
EVERY = 3
"""Calls after which an approach is kept, to branch off there."""
LONGEST = 700
"""Calls of an approach at most."""
AFTER = 14
"""Calls after the end."""
LEAST = 0.04
"""m of the lowest fingertip above the table at the start: a hand that is tilted may begin below it."""
SLOW = gt.Limits(0.3, 0.8, 1.0, 4.0)


class Finding(NamedTuple):
    """What was found wrong."""

    kind: str  # of `servo_judge.KINDS`
    case: str  # options that make it again
    said: str  # details


class Ran(NamedTuple):
    """What came of some sequences."""

    counts: Counter[str]  # sequences, calls, approaches without a fault, and how all ended
    findings: list[Finding]  # what was wrong


def draw_approach(rng: np.random.Generator) -> Trial:
    """An arm, a camera and an object at random, and a servo that knows nothing of them."""
    while (trial := _draw_trial(rng)).bench.clearance() < LEAST:
        pass
    return trial


def _draw_trial(rng: np.random.Generator) -> Trial:
    every, period = [(1, 0.04), (1, 0.04), (1, 0.033), (2, 0.02), (3, 0.02), (4, 0.04)][int(rng.integers(6))]
    bench = Bench(
        seed=int(rng.integers(1 << 30)),
        dof=int(rng.choice([4, 4, 6])),
        fingers=int(rng.choice([2, 2, 2, 3])),
        belt=float(rng.choice([0.0, 0.0, 80.0, 200.0])),
        noise=float(rng.choice([0.02, 0.05, 0.2])),
        latency=float(rng.choice([0.0, 0.03, 0.08])),
        every=every,
        period=period,
        lag=float(rng.choice([0.02, 0.05, 0.08])),
        stamped=bool(rng.random() < 0.4),
    )
    options: dict[str, Any] = {"retries": int(rng.choice([0, 0, 1, 2]))}
    if rng.random() < 0.3:
        options["limits"] = SLOW
    if rng.random() < 0.2:
        mounting = pose_of(
            bench.camera.turn @ rotation_matrix(rng.normal(0.0, 0.06, 3)),
            bench.camera.offset + rng.normal(0.0, 0.01, 3),
        )
        away = float(bench.camera.from_hand((bench.contacts() - bench.hand[:3, 3]) @ bench.hand[:3, :3])[0, 2])
        guess = gt.NominalCamera(bench.camera.focal * 1.05, mounting, away * rng.uniform(0.65, 1.5))
        options |= {"law": "nominal", "camera": guess}
    servo = gt.GraspServo(bench.goal(), bench.dof, latency=0.0 if bench.stamped else bench.latency, **options)
    judge = Judge(servo.limits, every * period, period, options["retries"])
    return Trial(bench, servo, Answers(), judge)


def draw_faults(rng: np.random.Generator) -> list[set[str]]:
    """What fails at each call of a sequence."""
    groups = [tuple(FALSE), tuple(FALSE), POSES, TIMES, ARM, CALLS]
    if rng.random() < 0.1:  # whatever there is, at every call anew
        names = [n for group in groups for n in group if n not in ("stopped", "touched", "hurry")]
        share = rng.uniform(0.05, 0.9)
        return [{str(rng.choice(names))} if rng.random() < share else set() for _ in range(int(rng.integers(20, 80)))]
    plan: list[set[str]] = [set() for _ in range(160)]
    last = 0
    if rng.random() < 0.5:
        groups.remove(TIMES)
    else:
        groups[-1] = tuple(name for name in CALLS if name != "hurry")  # how much time passes, only the clock tells then
    for _ in range(int(rng.choice([1, 1, 2, 3]))):
        kind = str(rng.choice(groups[int(rng.integers(len(groups)))]))
        begin, length = int(rng.integers(0, 30)), int(rng.choice([1, 1, 2, 3, 5, 8, 13, 30, 80]))
        length = 1 if kind in ("pause", "touched", "stopped", "closed early", "copied") else length
        length = min(length, 4) if kind in ("pose nan", "pose no rotation", "time nan") else length
        last = max(last, begin + length)
        for faults in plan[begin : begin + length]:
            faults.add(kind)
    return plan[: last + int(rng.integers(10, 40))]


def run_approach(seed: int, number: int, only: int | None = None) -> Ran:
    """An approach without a fault, and the sequences that branch off it.

    Args:
        seed: of everything.
        number: of the approach.
        only: the one sequence to play; default all.
    """
    rng = np.random.default_rng((seed, number))
    trial, kept, counts = draw_approach(rng), [], Counter({"approaches": 1})
    after = 0
    for k in range(LONGEST):
        if k % EVERY == 0 and after < 2:
            kept.append(pickle.dumps(trial))
        trial.call((), rng)
        after += trial.servo.over
        if after > AFTER:
            break
    if trial.servo.state != "done":
        trial.judge.find("nothing failed, and yet not done", f"{trial.servo.state}: {trial.servo.reason}")
    found = [Finding(f.kind, f"--approach {number}", f"call {f.call}: {f.said}") for f in trial.judge.findings]
    already = {f.kind for f in found}
    counts["calls"] += trial.judge.calls
    for case in range(number * CASES, (number + 1) * CASES) if only is None else [only]:
        branch, began, faults = run_case(seed, case, kept)
        counts["sequences"] += 1
        counts["calls"] += branch.judge.calls - began
        counts[branch.servo.state] += 1
        found += [
            Finding(f.kind, f"--only {case}", f"call {f.call}: {f.said} [{faults}]")
            for f in branch.judge.findings
            if f.kind not in already
        ]
    return Ran(counts, found)


def run_case(seed: int, case: int, kept: list[bytes]) -> tuple[Trial, int, str]:
    """A sequence with faults, from somewhere on the way, after which call it began, and which they were."""
    rng = np.random.default_rng((seed, case, 1))
    where = rng.random()
    at = int(rng.integers(len(kept)))
    if where < 0.15:
        at = 0
    elif where < 0.45:  # about to close, and closing
        at = len(kept) - 1 - int(rng.integers(min(10, len(kept))))
    trial: Trial = pickle.loads(kept[at])
    after, began = 0, trial.judge.calls
    plan = draw_faults(rng)
    for faults in plan:
        trial.call(sorted(faults), rng)
        after += trial.servo.over
        if after > AFTER:
            break
    spans: dict[str, list[int]] = {}
    for k, faults in enumerate(plan):
        for name in faults:
            spans.setdefault(name, []).append(began + 1 + k)
    return trial, began, ", ".join(f"{name} from call {ks[0]} to {ks[-1]}" for name, ks in spans.items())


def run_real(seed: int, number: int) -> Ran:
    """An approach with the tracker on rendered images, in which something fails."""
    trial, fault, rng = servo_images.draw_trial(seed, number)
    begin, length = int(rng.integers(0, 75)), int(rng.choice([3, 10, 25, 200]))
    counts: Counter[str] = Counter({"real": 1})
    after = 0
    for k in range(260):
        broken = fault != "nothing" and begin <= k < begin + length
        trial.call((fault,) if broken else (), rng)
        after += trial.servo.over
        if after > AFTER or (k > begin + min(length, 110) + 70 and fault != "nothing"):
            break
    counts["calls"] += trial.judge.calls
    counts[f"real {trial.servo.state}"] += 1
    counts[f"real {fault}"] += 1
    if fault == "nothing" and trial.servo.state != "done":
        trial.judge.find("nothing failed, and yet not done", f"{trial.servo.state}: {trial.servo.reason}")
    said = f"[{fault} from call {begin + 1}, {length} calls]"
    return Ran(
        counts,
        [Finding(f.kind, f"--only-real {number}", f"call {f.call}: {f.said} {said}") for f in trial.judge.findings],
    )


def every(seed: int, count: int, real: int, workers: int, seconds: float) -> Iterator[Ran]:
    """Everything that is asked for, as it is done."""
    until = time.monotonic() + seconds
    with ProcessPoolExecutor(workers) as pool:
        asked = [pool.submit(run_real, seed, k) for k in range(real)]
        asked += [pool.submit(run_approach, seed, k) for k in range(-(-count // CASES))]
        for each in asked:
            if time.monotonic() > until:
                each.cancel()
            if not each.cancelled():
                yield each.result()


def show(ran: Ran) -> str:
    """A table of what was found."""
    counts, lines = ran.counts, []
    for kind in KINDS:
        found = [f for f in ran.findings if f.kind == kind]
        real = sum("real" in f.case for f in found)
        lines.append(f"{kind:44s} {len(found) - real:9d} {real:9d}   {', '.join(f.case for f in found[:3])}")
    head = f"{'':44s} {'sequences':>9s} {'images':>9s}"
    done = ", ".join(f"{counts[s]} {s}" for s in OVER)
    told = (
        f"{counts['sequences']} sequences of {counts['approaches']} approaches ({done}), {counts['real']} with images, "
    )
    return "\n".join([head, *lines, f"{told}{counts['calls']} calls: {len(ran.findings)} findings"])


def main() -> int:
    """Run, print what was found; status 1 where there is anything."""
    asked = options(
        __doc__,
        1e9,
        count=(20000, "call sequences"),
        real=(500, "approaches with rendered images"),
        workers=(os.cpu_count() or 1, "processes"),
        only=(None, "one call sequence"),
        only_real=(None, "one approach with rendered images"),
        approach=(None, "one approach, and the sequences that branch off it"),
    )
    if asked.only is not None:
        rans = iter([run_approach(asked.seed, asked.only // CASES, asked.only)])
    elif asked.only_real is not None:
        rans = iter([run_real(asked.seed, asked.only_real)])
    elif asked.approach is not None:
        rans = iter([run_approach(asked.seed, asked.approach)])
    else:
        rans = every(asked.seed, asked.count, asked.real, asked.workers, asked.seconds)
    counts: Counter[str] = Counter()
    findings: list[Finding] = []
    for ran in rans:
        counts += ran.counts
        findings += ran.findings
        for found in ran.findings:
            print(f"--seed {asked.seed} {found.case}: {found.kind}: {found.said}", flush=True)
    print(show(Ran(counts, findings)))
    return 1 if findings else 0


if __name__ == "__main__":
    raise SystemExit(main())
