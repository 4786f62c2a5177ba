# SPDX-License-Identifier: Apache-2.0
"""Synthesis on all silhouettes of a folder: which have no grasp, why, and whether brute force agrees."""

from __future__ import annotations

import common

# isort: split
import math
import os
import time
from collections import Counter
from pathlib import Path

import cv2
import numpy as np

import grasptrack as gt
from grasptrack import kernels
from grasptrack.grasp.hand import HandPx
from grasptrack.grasp.synthesis.candidates import Candidates, sample_candidates
from grasptrack.grasp.synthesis.limits import Limits, reject_infeasible
from grasptrack.grasp.synthesis.terms import Stable
from grasptrack.segmentation.silhouettes import trace_silhouettes

DATA = Path(os.environ.get("GRASPTRACK_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
POINTS = 300
SMOOTHING = 0.01
"""Stairs are averaged over this fraction of sqrt(area), at least 4 px."""


def outline(path: Path) -> gt.View:
    """The largest component of a silhouette with its holes, about 300 points."""
    mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    binary = np.where(cv2.copyMakeBorder(mask, 3, 3, 3, 3, cv2.BORDER_CONSTANT) > 127, 255, 0).astype(np.uint8)
    largest = trace_silhouettes(binary, 1.0)[0]
    chains = (largest.outer, *largest.holes)
    smoothing = max(4.0, SMOOTHING * math.sqrt(largest.area))
    contours = []
    for i, chain in enumerate(chains):
        count = int(np.clip(round(POINTS * len(chain) / len(largest.outer)), 16, POINTS))
        contours.append(gt.Contour(kernels.resample(chain.astype(np.float64), count, smoothing), hole=i > 0))
    return gt.View(contours)


def by_brute_force(view: gt.View, fingers: int, friction: float) -> tuple[int, int]:
    """Of all pairs or triples of contour points how many are stable, and how many of them the hand can do."""
    area, cx, cy, *_ = kernels.polygon_moments(view.points, view.offsets)
    hand = gt.Hand().in_px(math.sqrt(area))
    at = every_point(view, area, np.array([cx, cy]), hand)
    if fingers == 2:
        index, sense, strength = kernels.opposed_pairs(at.contacts, at.normals, np.ones(len(at.contacts)), 1, friction)
    else:
        index, sense, strength = kernels.closing_triples(
            at.contacts, at.normals, cx, cy, 0.5 * math.sqrt(area), friction
        )
    found = Stable(at, index, sense, strength, friction)
    left, _ = reject_infeasible(found, at, view, hand, (), Limits())
    return len(found), len(left)


def every_point(view: gt.View, area: float, centroid: np.ndarray, hand: HandPx) -> Candidates:
    """The contour's own points as candidates."""
    places = np.concatenate(
        [np.column_stack([np.full(len(c), float(i)), np.arange(len(c))]) for i, c in enumerate(view.contours)]
    )
    frames, beside = (
        kernels.contact_frames(view.points, view.offsets, places, f * hand.finger_width) for f in (1.0, 2.0)
    )
    return sample_candidates(view, area, centroid, hand.finger_width)._replace(
        places=places,
        contacts=view.points,
        normals=np.ascontiguousarray(frames[:, :2]),
        roughness=np.maximum(frames[:, 2], 0.5 * beside[:, 2]),
    )


def main() -> None:
    parser = common.parser(__doc__)
    parser.add_argument("--folder", type=Path, default=DATA / "silhouettes")
    parser.add_argument("--friction", type=float, default=0.5)
    options = parser.parse_args()
    files = sorted(options.folder.glob("*.png"))
    common.heading(f"Choosing grasps on silhouettes, friction {options.friction:g}")
    common.say(f"{len(files)} silhouettes, the hand of its defaults.")
    for fingers in (2, 3):
        reasons, without, taken, spread, found = Counter(), [], [], 0, []
        for path in files:
            view = outline(path)
            start = time.perf_counter()
            grasps = gt.synthesize(view, fingers, options.friction)
            taken.append(1e3 * (time.perf_counter() - start))
            spread += any(g.spread for g in grasps)
            found.append(len(grasps))
            if not grasps:
                reasons[next(iter(grasps.refused), grasps.reason)] += 1  # without the figures
                stable, done = by_brute_force(view, fingers, options.friction)
                without.append([path.stem, grasps.reason, str(grasps.refused), stable, done])
        common.say(
            f"{fingers} fingers: {len(files) - len(without)} with grasps ({spread} with one that spreads), "
            f"{len(without)} without; {min(found)} to {max(found)} grasps, median {np.median(found):g}; "
            f"{np.median(taken):.2f} ms in the median, {max(taken):.2f} at most."
        )
        if reasons:
            common.table(["silhouettes", "reason"], [[count, reason] for reason, count in reasons.most_common()])
        if without:
            head = ["silhouette", "reason", "refused", "stable by brute force", "left by brute force"]
            common.table(head, without)
    common.finish(options.output)


if __name__ == "__main__":
    main()
