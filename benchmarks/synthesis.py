# SPDX-License-Identifier: Apache-2.0
"""Time of a synthesis on outlines of 300 points, with holes and without, and what it finds."""

from __future__ import annotations

import common

# isort: split
import time

import numpy as np

import grasptrack as gt
from grasptrack.bench.simulation import SHAPES
from steps_contour import resampled

TARGETS = {2: 5.0, 3: 30.0}


def circle(radius: float, count: int) -> np.ndarray:
    t = 2.0 * np.pi * np.arange(count) / count
    return np.column_stack([radius * np.cos(t), radius * np.sin(t)]) + 200.0


def outlines() -> dict[str, gt.View]:
    """Shapes of the simulation and some that are hard: round ones, a ring, a frame, a long bar, a comb."""
    found = {}
    for name, make in SHAPES.items():
        shape = make()
        lengths = [float(np.hypot(*np.diff(c, axis=0, append=c[:1]).T).sum()) for c in (shape.outer, *shape.holes)]
        counts = [max(round(300 * length / sum(lengths)), 12) for length in lengths]
        scale = 200.0 / float(np.ptp(shape.outer, axis=0).max())
        contours = [scale * resampled(c, n) for c, n in zip((shape.outer, *shape.holes), counts, strict=True)]
        found[name] = gt.View([gt.Contour(c, hole=i > 0) for i, c in enumerate(contours)])
    found["disc"] = gt.View(gt.Contour(circle(100.0, 300)))
    found["ring"] = gt.View([gt.Contour(circle(100.0, 190)), gt.Contour(circle(60.0, 110), hole=True)])
    frame = [np.array([[0, 0], [300, 0], [300, 220], [0, 220]]), np.array([[50, 40], [240, 40], [240, 170], [50, 170]])]
    found["frame"] = gt.View(
        [gt.Contour(resampled(c.astype(float), n), hole=n < 150) for c, n in zip(frame, (190, 110), strict=True)]
    )
    found["bar"] = gt.View(gt.Contour(resampled(np.array([[0.0, 0], [600, 0], [600, 40], [0, 40]]), 300)))
    teeth = [[20.0 * (i // 2), 60.0 * (i // 2 % 2 if i % 2 else (i // 2 + 1) % 2)] for i in range(1, 22)]
    found["comb"] = gt.View(gt.Contour(resampled(np.array([*teeth, [220.0, 120.0], [0.0, 120.0]]), 300)))
    return found


def main() -> None:
    parser = common.parser(__doc__)
    parser.add_argument("--calls", type=int, default=30, help="calls for each shape and number of fingers")
    args = parser.parse_args()
    common.heading("Choosing grasps")
    common.say("50 grasps with the hand of its defaults, ms.")
    rows, medians = [], {2: [], 3: []}
    for name, view in outlines().items():
        for fingers in (2, 3):
            found = gt.synthesize(view, fingers)
            taken = []
            for _ in range(args.calls):
                start = time.perf_counter()
                gt.synthesize(view, fingers)
                taken.append(1e3 * (time.perf_counter() - start))
            medians[fingers].append(float(np.median(taken)))
            spread = sum(g.spread for g in found)
            holes = len(view.contours) - 1
            refused = sum(found.refused.values())
            rows.append([name, holes, fingers, medians[fingers][-1], max(taken), len(found), spread, refused])
    common.table(["shape", "holes", "fingers", "median", "max", "grasps", "spread", "refused"], rows)
    for fingers, values in medians.items():
        verdict = "yes" if max(values) <= TARGETS[fingers] else "NO"
        common.say(
            f"{fingers} fingers: median of the shapes {np.median(values):.2f} ms, slowest shape {max(values):.2f} ms, "
            f"target {TARGETS[fingers]:g} ms, met: {verdict}"
        )
    common.finish(args.output)


if __name__ == "__main__":
    main()
