# SPDX-License-Identifier: Apache-2.0
"""How much the closure probability gives away: against contacts drawn, slid along the outline, and judged one by one."""

from __future__ import annotations

import math
import time

import numpy as np

import grasptrack as gt
from grasptrack import kernels
from grasptrack.geometry.contours import Outline
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.closure_probability import chance_of_closing
from grasptrack.grasp.contact_regions import regions_of
from grasptrack.grasp.force_closure import FINGER_WIDTH, ForceClosure
from grasptrack.typing import Bools, Floats
from grasptrack_bench.method import outline_of
from grasptrack_bench.simulation import SHAPES
from research.studies import common

SIZE, FRICTION = 175.0, 0.5
SIGMAS = (0.1, 0.5, 1.0, 2.0, 5.0)
TILTED = np.array([[0.9, 0.2, 10.0], [-0.15, 1.1, 5.0], [3e-4, -2e-4, 1.0]])


def closes_after(outline: Outline, contacts: Floats, slips: Floats, friction: float) -> Bools:
    """(n,) whether a grasp closes after its contacts have slipped along the outline: what independent regions promise.

    The contacts (k, 2) px are moved onto the outline; slips (n, k) are px of arc length, along the direction of the contours.
    """
    n, k = slips.shape
    places = np.empty((n, k, 2))
    for i, (contour, position, _) in enumerate(
        kernels.project_to_contour(outline.points, outline.offsets, contacts).tolist()
    ):
        line = outline.contours[int(contour)]
        s = line.arc_length
        here = np.interp(position, np.arange(len(s)), s)
        places[:, i, 0] = contour
        places[:, i, 1] = np.interp(np.mod(here + slips[:, i], line.length), s, np.arange(len(s))) % len(line)
    return _closes_at_places(outline, places.reshape(-1, 2), k, friction)


def closes_at(outline: Outline, points: Floats, friction: float) -> Bools:
    """(n,) whether contacts at the places of an outline that are nearest to points (n, k, 2) px close."""
    places = kernels.project_to_contour(outline.points, outline.offsets, np.ascontiguousarray(points.reshape(-1, 2)))
    return _closes_at_places(outline, places, points.shape[1], friction)


def _closes_at_places(outline: Outline, places: Floats, k: int, friction: float) -> Bools:
    area, *centre = kernels.polygon_moments(outline.points, outline.offsets)[:3]
    size = math.sqrt(area)
    contacts = kernels.point_at(outline.points, outline.offsets, places).reshape(-1, k, 2)
    frames = kernels.contact_frames(outline.points, outline.offsets, places, FINGER_WIDTH * size)
    normals = np.ascontiguousarray(frames[:, :2]).reshape(-1, k, 2)
    at = (centre[0], centre[1])
    return np.array(
        [ForceClosure.of(c, n, at, 0.5 * size, friction).closes for c, n in zip(contacts, normals, strict=True)]
    )


def sample_covariances(rng: np.random.Generator, fingers: int, sigma: float) -> Floats:
    """(k, 2, 2) px^2 of any direction, with a mean variance of sigma^2."""
    A = rng.normal(size=(fingers, 2, 2))
    C = A @ np.swapaxes(A, 1, 2)
    return np.asarray(C * (2.0 * sigma**2 / np.trace(C, axis1=1, axis2=2))[:, None, None])


def probability_row(sigma: float, drawn: Floats, draws: int) -> list[str]:
    """Of grasps (n, 3): the probability given, and the shares that close when slid along the outline, and when moved to it."""
    chance, slid, snapped = drawn.T

    def count_above(share: Floats) -> str:
        noise = np.sqrt(np.maximum(share * (1.0 - share), 1.0 / draws) / draws)
        return str(int((chance > share + 3.0 * noise).sum()))

    less = slid - chance
    shares = (slid.mean(), chance.mean(), np.median(less), np.percentile(less, 95))
    return [f"{sigma:g}", str(len(drawn)), *(f"{v:.3f}" for v in shares), count_above(slid), count_above(snapped)]


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__, shapes=",".join(SHAPES), draws=500)
    parser.add_argument("--grasps", type=int, default=3, help="of each part: the best, the tenth, and between")
    asked = parser.parse_args()
    common.begin_section("The chance of closing")
    rng, rows = np.random.default_rng(0), []
    for fingers in (2, 3):
        found: dict[float, list[tuple[float, float, float]]] = {sigma: [] for sigma in SIGMAS}
        once = []
        for name in asked.shapes.split(","):
            view = outline_of([polygon * SIZE + (320.0, 240.0) for polygon in SHAPES[name]().polygons])
            listed = gt.synthesize(view, fingers, FRICTION, None, 10)
            for at in sorted({round(i) for i in np.linspace(0, len(listed) - 1, asked.grasps)} if listed else ()):
                began = time.perf_counter()
                regions = regions_of(listed[at], view, FRICTION)
                once.append(1e3 * (time.perf_counter() - began))
                current = apply_homography(TILTED, regions.contacts)
                for sigma in SIGMAS:
                    C = sample_covariances(rng, fingers, sigma)
                    drawn = [rng.multivariate_normal(c, v, asked.draws) for c, v in zip(current, C, strict=True)]
                    back = apply_homography(np.linalg.inv(TILTED), np.stack(drawn, axis=1).reshape(-1, 2))
                    back = back.reshape(asked.draws, fingers, 2)
                    slips = ((back - regions.contacts) * regions.tangents).sum(axis=2)
                    slid = float(closes_after(view, regions.contacts, slips, FRICTION).mean())
                    snapped = float(closes_at(view, back, FRICTION).mean())
                    found[sigma].append((chance_of_closing(regions, C, TILTED), slid, snapped))
        C = sample_covariances(rng, fingers, 0.3)
        spent = 1e6 * np.median(common.time_calls(chance_of_closing, [(regions, C, TILTED, current)] * 300))
        rows += [
            [str(fingers), *probability_row(sigma, np.array(grasps), asked.draws)] for sigma, grasps in found.items()
        ]
        common.add_paragraph(
            f"{fingers} fingers: regions {np.median(once):.1f} ms once, chance {spent:.1f} us a frame."
        )
    heads = ["error px", "grasps", "closes, slid", "chance", "less: median", "95 %", "above slid", "above nearest"]
    common.add_table(["fingers", *heads], rows)
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()
