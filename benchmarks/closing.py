# SPDX-License-Identifier: Apache-2.0
"""How much the chance of closing gives away: against contacts drawn, slid along the outline, and judged one by one."""

from __future__ import annotations

import common

# isort: split
import time

import numpy as np

import grasptrack as gt
from grasptrack.bench.simulation import SHAPES
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.closure_probability import chance_of_closing
from grasptrack.grasp.contact_regions import regions_of
from grasptrack.grasp.force_closure import closes_after, closes_at
from steps_contour import resampled

SIZE, FRICTION = 175.0, 0.5
SIGMAS = (0.1, 0.5, 1.0, 2.0, 5.0)
TILTED = np.array([[0.9, 0.2, 10.0], [-0.15, 1.1, 5.0], [3e-4, -2e-4, 1.0]])


def outline(name: str) -> gt.View:
    """A part of sqrt(area) = SIZE px, a point for each px."""
    shape, contours = SHAPES[name](), []
    for i, polygon in enumerate((shape.outer, *shape.holes)):
        points = np.asarray(polygon) * SIZE + (320.0, 240.0)
        length = float(np.hypot(*np.diff(points, axis=0, append=points[:1]).T).sum())
        contours.append(gt.Contour(resampled(points, max(24, round(length))), hole=i > 0))
    return gt.View(contours)


def errors(rng: np.random.Generator, fingers: int, sigma: float) -> np.ndarray:
    """(k, 2, 2) px^2 of any direction, with a mean variance of sigma^2."""
    A = rng.normal(size=(fingers, 2, 2))
    C = A @ np.swapaxes(A, 1, 2)
    return np.asarray(C * (2.0 * sigma**2 / np.trace(C, axis1=1, axis2=2))[:, None, None])


def main() -> None:
    """Run and print."""
    parser = common.parser(__doc__)
    parser.add_argument("--draws", type=int, default=500)
    parser.add_argument("--grasps", type=int, default=3, help="of each part: the best, the tenth, and between")
    asked = parser.parse_args()
    common.heading("The chance of closing")
    rng = np.random.default_rng(0)
    rows, times = [], []
    for fingers in (2, 3):
        found: dict[float, list[tuple[float, float, float]]] = {sigma: [] for sigma in SIGMAS}
        once = []
        for name in SHAPES:
            view = outline(name)
            listed = gt.synthesize(view, fingers, FRICTION, None, 10)
            for at in sorted({round(i) for i in np.linspace(0, len(listed) - 1, asked.grasps)} if listed else ()):
                began = time.perf_counter()
                regions = regions_of(listed[at], view, FRICTION)
                once.append(1e3 * (time.perf_counter() - began))
                current = apply_homography(TILTED, regions.contacts)
                for sigma in SIGMAS:
                    C = errors(rng, fingers, sigma)
                    drawn = [rng.multivariate_normal(c, v, asked.draws) for c, v in zip(current, C, strict=True)]
                    back = apply_homography(np.linalg.inv(TILTED), np.stack(drawn, axis=1).reshape(-1, 2))
                    back = back.reshape(asked.draws, fingers, 2)
                    slips = ((back - regions.contacts) * regions.tangents).sum(axis=2)
                    slid = closes_after(view, regions.contacts, slips, FRICTION).mean()
                    snapped = closes_at(view, back, FRICTION).mean()
                    found[sigma].append((chance_of_closing(regions, C, TILTED), float(slid), float(snapped)))
        C, contacts = errors(rng, fingers, 0.3), current
        for _ in range(300):
            began = time.perf_counter()
            chance_of_closing(regions, C, TILTED, contacts)
            times.append((fingers, 1e6 * (time.perf_counter() - began)))
        for sigma, triples in found.items():
            chance, slid, snapped = np.array(triples).T
            noise = 3.0 * np.sqrt(np.maximum(slid * (1.0 - slid), 1.0 / asked.draws) / asked.draws)
            near = 3.0 * np.sqrt(np.maximum(snapped * (1.0 - snapped), 1.0 / asked.draws) / asked.draws)
            less = slid - chance
            rows.append(
                [
                    str(fingers),
                    f"{sigma:g}",
                    str(len(triples)),
                    f"{slid.mean():.3f}",
                    f"{chance.mean():.3f}",
                    f"{np.median(less):.3f}",
                    f"{np.percentile(less, 95):.3f}",
                    str(int((chance > slid + noise).sum())),
                    str(int((chance > snapped + near).sum())),
                ]
            )
        spent = np.median([t for k, t in times if k == fingers])
        common.say(f"{fingers} fingers: regions {np.median(once):.1f} ms once, chance {spent:.1f} us a frame.")
    heads = [
        "fingers",
        "error px",
        "grasps",
        "closes, slid",
        "chance",
        "less: median",
        "95 %",
        "above slid",
        "above nearest",
    ]
    common.table(heads, rows)
    common.finish(asked.output)


if __name__ == "__main__":
    main()
