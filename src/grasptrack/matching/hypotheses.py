# SPDX-License-Identifier: Apache-2.0
"""The homographies that lay one outline on another, without a prior: any turn, any start, any scale, strong tilt."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.contour import Outline
from grasptrack.matching.samples import Sampled, sampled

Floats = NDArray[np.float64]


def _bends(*rings: tuple[float, int]) -> Floats:
    turns = [(0.0, 0.0)]
    for radius, count in rings:
        turns += [
            (radius * math.cos(2 * math.pi * k / count), radius * math.sin(2 * math.pi * k / count))
            for k in range(count)
        ]
    return np.array(turns)


BENDS = _bends((0.1, 6))
"""Perspective that is tried, in units of the whitened outline: up to 0.18 arises when an object that fills 60 % of a view
of 60 degrees is tilted by 60; nine of ten such views are below 0.11."""
COUNT = 128
"""Samples of the whitened alignment."""
APART = 0.025
"""Lengths of the outline between two starts."""
STARTS = 14
"""Alignments that are refined."""
COARSE = np.array([0.3, 0.25, 0.2, 0.15, 0.12, 0.1, 0.1, 0.1]), np.array([1e-2, 3e-3, 1e-3, 1e-3, 3e-4, 1e-4, 1e-4, 1e-4])
"""Step by step: reach in sqrt(area), damping. Few samples of each start."""
COARSE_SAMPLES = 64
FINE = np.array([0.08, 0.06, 0.06, 0.05]), np.array([1e-5, 1e-6, 1e-6, 1e-6]), np.array([2, 1, 1, 1])
"""The same of what is left, with more samples."""
PROMISING = 3.0
"""Starts that are left with more than so many times the best one's misfit, and ..."""
PROMISING_SHARE = 0.02
"""... more than this share of sqrt(area) beyond it are given up."""
FINAL = 7
"""Hypotheses that are refined on all samples."""
LEAST_NOISE = 0.1
"""px; outlines are never believed to be better than this."""
REACH = 0.1
"""sqrt(area); distances are counted up to this."""
NEAR, NEAR_PX = 0.02, 1.0
"""Share of sqrt(area), or px, whichever is more: what is as near as this lies on the other outline."""
SAME = 0.05
"""Hypotheses that put all points within this share of sqrt(area) of each other are one."""
MAX_STRETCH = 3.0
"""Largest ratio of the two magnifications at any point of the outline: 2.6 arises at 60 degrees, strong perspective."""
MAX_DEPTH = 2.2
"""Largest ratio of the distances of two points of the outline from the camera: 1.9 arises then."""


class Match(NamedTuple):
    """One way in which the first outline lies on the second.

    Attributes:
        homography: (3, 3) first -> second, its last element 1.
        misfit: px rms in the second view between the outlines, both ways, each distance counted up to a tenth of
            sqrt(area).
        residual: px rms of those distances that are small (`NEAR`).
        share: 0 to 1, how much of both outlines is so near the other.
        worst: px, the largest distance, up to a tenth of sqrt(area).
        stretch: 1 and more, the largest ratio of the two magnifications at any point: the tilt that it takes.
        size: px, sqrt(area) of the second outline.
    """

    homography: Floats
    misfit: float
    residual: float
    share: float
    worst: float
    stretch: float
    size: float


def match(first: Outline | Sampled, second: Outline | Sampled, most: int = 4) -> list[Match]:
    """The homographies that may lay one outline on another, the likeliest first.

    Args:
        first, second: the outlines, or samples of them made before. Any start point and direction; holes help.
        most: hypotheses given at most.

    Returns:
        Distinct hypotheses, never a mirror image, none that asks for more tilt than `MAX_STRETCH` and `MAX_DEPTH` allow.
        The least misfit comes first. Empty where nothing fits at all.
    """
    a, b = sampled(first), sampled(second)
    starts = kernels.outline_starts(a.outer, b.outer, BENDS, COUNT, APART, STARTS)[:, 2:]
    stride = max(1, len(a.points) // COARSE_SAMPLES)
    reaches, damping = COARSE
    coarse = _laid(starts, a, b, reaches, damping, np.full(len(reaches), stride, dtype=np.int64))
    if not len(coarse):
        return []
    coarse = coarse[np.argsort(coarse[:, 9], kind="stable")]
    limit = max(PROMISING * coarse[0, 9], coarse[0, 9] + PROMISING_SHARE * b.size)
    rough = _distinct(coarse[coarse[:, 9] <= limit], a, b.size)[:FINAL]
    fine = _laid(rough[:, :9], a, b, *FINE)
    found = [m for row in fine if (m := _judged(row[:9].reshape(3, 3), a, b)) is not None]
    found.sort(key=lambda m: m.misfit)
    kept = _distinct(np.array([m.homography.ravel() for m in found]).reshape(-1, 9), a, b.size)
    rows = {row.tobytes() for row in np.ascontiguousarray(kept[:, :9])}
    return [m for m in found if np.ascontiguousarray(m.homography.ravel()).tobytes() in rows][:most]


def _laid(starts: Floats, a: Sampled, b: Sampled, reaches: Floats, damping: Floats, strides: NDArray[np.int64]) -> Floats:
    """(k, 10) those starts that come to anything, refined."""
    found = kernels.lay_outlines(
        np.ascontiguousarray(starts),
        a.points,
        a.normals,
        b.points,
        b.normals,
        b.offsets,
        reaches * b.size,
        damping,
        strides,
        LEAST_NOISE,
    )
    return found[np.isfinite(found[:, 9])]


def _distinct(rows: Floats, a: Sampled, size: float) -> Floats:
    """Of homographies (k, 9 or more) that put the outline in the same place the first."""
    points = a.points[:: max(1, len(a.points) // 16)]
    kept: list[int] = []
    places: list[Floats] = []
    for i, row in enumerate(rows):
        H = row[:9].reshape(3, 3)
        w = points @ H[2, :2] + H[2, 2]
        at = (points @ H[:2, :2].T + H[:2, 2]) / w[:, None]
        if all(((at - other) ** 2).sum(axis=1).max() > (SAME * size) ** 2 for other in places):
            kept.append(i)
            places.append(at)
    return rows[kept]


def _judged(H: Floats, a: Sampled, b: Sampled) -> Match | None:
    """How well a homography lays one outline on the other; None when no camera could have seen it so."""
    in_front, determinant, ratio = kernels.distortion(H, a.points)
    depth = a.points @ H[2, :2] + H[2, 2]
    if not (in_front > 1e-9 and determinant > 0.0 and ratio <= MAX_STRETCH and depth.max() <= MAX_DEPTH * depth.min()):
        return None
    moved = kernels.carry_normals(H, a.points, a.normals)
    at, along = np.ascontiguousarray(moved[:, :2]), np.ascontiguousarray(moved[:, 2:4])
    reach = REACH * b.size
    gaps = np.concatenate(
        [
            kernels.outline_gaps(at, along, b.points, b.normals, b.offsets, reach),
            kernels.outline_gaps(b.points, b.normals, at, along, a.offsets, reach),
        ]
    )
    near = gaps[gaps <= max(NEAR * b.size, NEAR_PX)]
    return Match(
        H,
        math.sqrt(float(gaps @ gaps) / len(gaps)),
        math.sqrt(float(near @ near) / len(near)) if len(near) else math.inf,
        len(near) / len(gaps),
        float(gaps.max()),
        ratio,
        b.size,
    )
