# SPDX-License-Identifier: Apache-2.0
"""What a step of the servo costs, and how often each law arrives, on the kinematic bench of the tests."""

from __future__ import annotations

import common

# isort: split
import sys
import time
from pathlib import Path

import numpy as np

import grasptrack as gt
from grasptrack.servo.camera import pose_of, rotation_matrix

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from servo_bench import Bench

CASES: dict[str, dict[str, object]] = {
    "static": {},
    "belt, half the view a second": {"belt": 320.0},
    "blackout of 0.5 s": {"blackout": (1.9, 2.4)},
    "pushed by 30 mm": {"push": (2.4, 0.03)},
    "40 % of the answers wrong": {"outliers": 0.4},
    "latency of 0.1 s": {"latency": 0.1},
    "three fingers": {"fingers": 3},
    "6 DoF": {"dof": 6},
    "6 DoF, belt": {"dof": 6, "belt": 200.0},
}


def nominal(bench: Bench) -> gt.NominalCamera:
    """A camera that is somewhat off: 10 % of focal length, 5 degrees, 2 cm (standard deviations)."""
    rng = np.random.default_rng(bench.seed)
    turn, offset = rotation_matrix(rng.normal(0.0, 0.08, 3)), rng.normal(0.0, 0.02, 3)
    mounting = pose_of(bench.camera.turn @ turn, bench.camera.offset + offset)
    return gt.NominalCamera(bench.camera.focal * float(np.exp(rng.normal(0.0, 0.1))), mounting, 0.4)


def run(bench: Bench, law: str) -> tuple[gt.GraspServo, list[tuple[float, float]]]:
    """The servo at its end, and s of every step: by the clock, and of the processor, which other programs do not change."""
    camera = None if law == "online" else nominal(bench)
    servo = gt.GraspServo(bench.goal(), bench.dof, law=law, camera=camera, latency=bench.latency)  # type: ignore[arg-type]
    taken = []
    while not servo.over and bench.time < 30.0:
        result = bench.result()
        start, busy = time.perf_counter(), time.thread_time()
        command = servo.update(result, time=bench.time, pose=bench.hand)
        taken.append((time.perf_counter() - start, time.thread_time() - busy))
        if command.close:
            break
        bench.move(command.twist)
    return servo, taken


def main() -> None:
    """Run and print."""
    parser = common.parser(__doc__)
    parser.add_argument("--trials", type=int, default=50)
    asked = parser.parse_args()
    common.heading("The servo, on the kinematic bench")
    rows: list[list[object]] = []
    runs = [(name, case, "online") for name, case in CASES.items()]
    runs += [("static", {}, law) for law in ("nominal", "textbook")]
    for name, case, law in runs:
        arrived, times, along, aside, took = 0, [], [], [], []
        for seed in range(asked.trials):
            bench = Bench(seed=seed, **case)  # type: ignore[arg-type]
            servo, taken = run(bench, law)
            times += taken
            if servo.state == "closing":
                across, up, turn = bench.off()
                arrived += across < 0.004 and abs(up) < 0.006 and abs(turn) < 0.1
                aside.append(1e3 * across)
                along.append(1e3 * abs(up))
                took.append(bench.time)
        clock, busy = zip(*times, strict=True)
        middle = [float(np.median(v)) if v else float("nan") for v in (aside, along, took)]
        rows.append(
            [
                name,
                law,
                100.0 * arrived / asked.trials,
                *middle,
                *common.percentiles(clock),
                common.percentiles(busy)[1],
            ]
        )
    head = [
        "",
        "law",
        "arrived %",
        "mm aside",
        "mm along",
        "s until closing",
        "median ms",
        "99 % ms",
        "of the processor",
    ]
    common.table(head, rows)
    common.say(
        "Arrived: closed within 4 mm across and 6 mm along the approach and 6 degrees of where the contacts lie between "
        "the fingertips; mm and s are medians. The last column is the 99 % of the processor's time. The steps that end an "
        "exploratory move are the slow ones; the hand rests then."
    )
    common.finish(asked.output)


if __name__ == "__main__":
    main()
