# SPDX-License-Identifier: Apache-2.0
"""Choosing grasps: time and yield on the built-in parts; of a folder of silhouettes which have no grasp, why, and whether brute
force agrees."""

from __future__ import annotations

import math
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

import grasptrack as gt
from grasptrack import kernels
from grasptrack.grasp.synthesis.candidates import Stable, sample_candidates
from grasptrack.grasp.synthesis.limits import UnevennessLimits, reject_infeasible
from grasptrack.segmentation.silhouettes import trace_silhouettes
from grasptrack.typing import Floats
from grasptrack_bench.method import outline_of
from grasptrack_bench.simulation import SHAPES
from grasptrack_bench.simulation.outlines import circle_polygon
from research.studies import common

TARGETS = {2: 5.0, 3: 30.0}
"""ms by number of fingers."""
POINTS = 300
SMOOTHING = 0.01
"""Stairs are averaged over this fraction of sqrt(area), at least 4 px."""


class Yield(NamedTuple):
    """How many pairs or triples of contour points are stable, and how many of them the hand can do."""

    stable: int
    feasible: int


def test_outlines() -> dict[str, gt.View]:
    """Outlines of some 300 points: the built-in parts, and some that are hard: a ring, a frame, a long bar, a comb."""
    rings: dict[str, list[Floats]] = {name: list(make().polygons) for name, make in SHAPES.items()}
    rings["ring"] = [circle_polygon(0.0, 0.0, 100.0, 300), circle_polygon(0.0, 0.0, 60.0, 300)[::-1]]
    rings["frame"] = [
        np.array([[0.0, 0.0], [300.0, 0.0], [300.0, 220.0], [0.0, 220.0]]),
        np.array([[50.0, 40.0], [50.0, 170.0], [240.0, 170.0], [240.0, 40.0]]),
    ]
    rings["bar"] = [np.array([[0.0, 0.0], [600.0, 0.0], [600.0, 40.0], [0.0, 40.0]])]
    teeth = [[20.0 * (i // 2), 60.0 * (i // 2 % 2 if i % 2 else (i // 2 + 1) % 2)] for i in range(1, 22)]
    rings["comb"] = [np.array([*teeth, [220.0, 120.0], [0.0, 120.0]])]
    found = {}
    for name, polygons in rings.items():
        scale = 200.0 / float(np.ptp(polygons[0], axis=0).max())
        scaled = [scale * polygon for polygon in polygons]
        length = sum(float(np.hypot(*np.diff(c, axis=0, append=c[:1]).T).sum()) for c in scaled)
        found[name] = outline_of(scaled, length / POINTS)
    return found


def silhouette_outline(path: Path) -> gt.View:
    """The largest component of a silhouette with its holes, about 300 points."""
    mask = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
    binary = np.where(cv2.copyMakeBorder(mask, 3, 3, 3, 3, cv2.BORDER_CONSTANT) > 127, 255, 0).astype(np.uint8)
    largest = trace_silhouettes(binary, 1.0)[0]
    smoothing = max(4.0, SMOOTHING * math.sqrt(largest.area))
    contours = []
    for i, chain in enumerate((largest.outer, *largest.holes)):
        count = int(np.clip(round(POINTS * len(chain) / len(largest.outer)), 16, POINTS))
        contours.append(gt.Contour(kernels.resample(chain.astype(np.float64), count, smoothing), hole=i > 0))
    return gt.View(contours)


def by_brute_force(view: gt.View, fingers: int, friction: float) -> Yield:
    """All pairs or triples of the contour's own points."""
    area, cx, cy, *_ = kernels.polygon_moments(view.points, view.offsets)
    hand = gt.Hand().in_px(math.sqrt(area))
    places = np.concatenate(
        [np.column_stack([np.full(len(c), float(i)), np.arange(len(c))]) for i, c in enumerate(view.contours)]
    )
    frames, beside = (
        kernels.contact_frames(view.points, view.offsets, places, f * hand.finger_width) for f in (1.0, 2.0)
    )
    at = sample_candidates(view, area, np.array([cx, cy]), hand.finger_width)._replace(
        places=places,
        contacts=view.points,
        normals=np.ascontiguousarray(frames[:, :2]),
        roughness=np.maximum(frames[:, 2], 0.5 * beside[:, 2]),
    )
    if fingers == 2:
        index, sense, strength = kernels.opposed_pairs(at.contacts, at.normals, np.ones(len(at.contacts)), 1, friction)
    else:
        index, sense, strength = kernels.closing_triples(
            at.contacts, at.normals, cx, cy, 0.5 * math.sqrt(area), friction
        )
    found = Stable(at, index, sense, strength, friction)
    return Yield(len(found), len(reject_infeasible(found, at, view, hand, (), UnevennessLimits())[0]))


def show_parts(calls: int) -> None:
    """Times on the built-in parts."""
    common.begin_section("Choosing grasps")
    common.add_paragraph("50 grasps with the hand of its defaults, ms.")
    rows: list[list[object]] = []
    medians: dict[int, list[float]] = {2: [], 3: []}
    for name, view in test_outlines().items():
        for fingers in (2, 3):
            found = gt.synthesize(view, fingers)
            taken = 1e3 * common.time_calls(gt.synthesize, [(view, fingers)] * calls)
            medians[fingers].append(float(np.median(taken)))
            told = [len(found), sum(g.spread for g in found), sum(found.refused.values())]
            rows.append([name, len(view.contours) - 1, fingers, medians[fingers][-1], float(taken.max()), *told])
    common.add_table(["shape", "holes", "fingers", "median", "max", "grasps", "spread", "refused"], rows)
    for fingers, values in medians.items():
        verdict = "yes" if max(values) <= TARGETS[fingers] else "NO"
        common.add_paragraph(
            f"{fingers} fingers: median of the shapes {np.median(values):.2f} ms, slowest shape {max(values):.2f} ms, "
            f"target {TARGETS[fingers]:g} ms, met: {verdict}"
        )


def show_silhouettes(folder: Path, friction: float) -> None:
    """What is found on silhouettes, and why nothing is."""
    files = sorted(folder.glob("*.png"))
    common.begin_section(f"Choosing grasps on silhouettes, friction {friction:g}")
    common.add_paragraph(f"{len(files)} silhouettes, the hand of its defaults.")
    for fingers in (2, 3):
        reasons: Counter[str] = Counter()
        without: list[list[object]] = []
        taken, found, spread = [], [], 0
        for path in files:
            view = silhouette_outline(path)
            start = time.perf_counter()
            grasps = gt.synthesize(view, fingers, friction)
            taken.append(1e3 * (time.perf_counter() - start))
            spread += any(g.spread for g in grasps)
            found.append(len(grasps))
            if not grasps:
                reasons[next(iter(grasps.refused), grasps.reason)] += 1  # without the figures
                without.append([path.stem, grasps.reason, *by_brute_force(view, fingers, friction)])
        common.add_paragraph(
            f"{fingers} fingers: {len(files) - len(without)} with grasps ({spread} with one that spreads), "
            f"{len(without)} without; {min(found)} to {max(found)} grasps, median {np.median(found):g}; "
            f"{np.median(taken):.2f} ms in the median, {max(taken):.2f} at most."
        )
        if without:
            common.add_table(["silhouettes", "reason"], [[count, reason] for reason, count in reasons.most_common()])
            head = ["silhouette", "reason", "stable by brute force", "left by brute force"]
            common.add_table(head, without)


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--calls", type=int, default=30, help="calls for each shape and number of fingers")
    parser.add_argument("--silhouettes", type=Path, metavar="FOLDER", help="these instead of the built-in parts")
    parser.add_argument("--friction", type=float, default=0.5, help="for the silhouettes")
    args = parser.parse_args()
    if args.silhouettes is None:
        show_parts(args.calls)
    elif not any(args.silhouettes.glob("*.png")):
        parser.error(f"no PNG in {args.silhouettes}")
    else:
        show_silhouettes(args.silhouettes, args.friction)
    common.write_sections(args.output)


if __name__ == "__main__":
    main()
