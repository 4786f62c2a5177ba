# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of what an image says of a small motion: along an outline by its edges, on surfaces by their grey levels."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_evidence import (
    SLIDING,
    carry_normals,
    displacement_fields,
    whitening,
)
from grasptrack.kernels.reference_light import EDGE, FEWEST, WEIGHINGS, bilinear, independent, quiet, tukey
from grasptrack.kernels.reference_support import hidden_at, in_hidden, search_edges

Floats = NDArray[np.float64]

LEAST_NOISE_PX = 0.03
"""Edges are never believed to be better than this."""
LEAST_NOISE_GREY = 0.7
"""Grey levels, the same of surfaces."""
CHANCE = 3.0
"""Of a surface's slopes, the share of so many over the root of their number may be noise."""
LEAST_REAL = 0.4
"""Of a surface's squared slopes, at least this share is taken to be no noise when a step is made."""


BESIDE_HIDDEN = 3.0
"""Shrunk pixels within which of what is hidden a surface is not looked at."""
RIGHT, DOWN = np.array([1.0, 0.0]), np.array([0.0, 1.0])


class MotionEquations(NamedTuple):
    """Normal equations of the motion, row 0 of the outline, then one for each surface.

    Motions are counted in `basis`: eight that each move the whole outline by 1 px rms.

    Attributes:
        centre: (2,) px, of the outline in the image.
        radius: px, its rms distance from there.
        basis: (8, 8) columns: the parameters of `displacement_fields`, in px, of these motions.
        N: (1 + G, 8, 8) weighted squares: 1 per edge that moves by 1 px; of surfaces grey levels squared.
        sure: (1 + G, 8, 8) of N what is left without what chance alone could give: N tells how far to go, this how
            surely it is right.
        b: (1 + G, 8) weighted products with what is left: N^-1 b is the motion that the evidence asks for, in px.
        stats: (1 + G, 4) total weight; share of the samples in the image that agree; noise, px or grey levels;
            correlation of a surface with its reference, light allowed for (of the outline the share in the image).
        left: (m,) px along the normals at which edges were found, NaN without one.
        weights: (m,) 0 to 1 of these.
    """

    centre: Floats
    radius: float
    basis: Floats
    N: Floats
    sure: Floats
    b: Floats
    stats: Floats
    left: Floats
    weights: Floats


def motion_equations(
    image: NDArray[np.uint8],
    coarse: NDArray[np.uint8],
    shrink: float,
    H: Floats,
    points: Floats,
    normals: Floats,
    strength: Floats,
    polarity: int,
    reach: float,
    least_strength: float,
    relative_strength: float,
    places: Floats,
    values: Floats,
    slopes: Floats,
    starts: NDArray[np.int64],
    clear: NDArray[np.uint8] | None = None,
) -> MotionEquations:
    """What an image says of the motion that is still missing at a pose.

    Args:
        image: (H, W), in which edges are searched.
        coarse: (H', W') the same, shrunk, from which surfaces are read.
        shrink: how many times: pixel (i, j) of `coarse` is the mean of shrink x shrink pixels.
        H: (3, 3) reference to current.
        points, normals, strength: (m, 2) px, (m, 2) unit and (m,) grey levels per px of the outline in the reference.
        polarity: +1 object darker than its surroundings, -1 lighter, 0 where the sign of each strength tells.
        reach: px searched on either side.
        least_strength, relative_strength: of an edge: grey levels per px, and relative to the reference's and the gain of
            most.
        places, values, slopes: (p, 2) px, (p,) grey levels and (p, 2) grey levels per px of surfaces in the reference, read
            off it as from `coarse`.
        starts: (G + 1,) surface g has the places ``starts[g]:starts[g + 1]``.
        clear: (H, W) px from each pixel to what is hidden, 0 in it; None where nothing is. Edges in it, and places within
            BESIDE_HIDDEN shrunk pixels of it, are as if they were outside the image.

    Light may differ by a gain and by levels that change linearly over each surface: they are fitted along.

    Raises:
        ValueError: samples of unlike number, or no reach.
    """
    if not len(points) or len(normals) != len(points) or len(strength) != len(points):
        raise ValueError("samples are needed, each with its normal and strength")
    if (
        len(values) != len(places)
        or len(slopes) != len(places)
        or not len(starts)
        or starts[0] != 0
        or starts[-1] != len(places)
    ):
        raise ValueError("each place needs its value and slope, and starts rise from 0 to the number of places")
    if (np.diff(starts) < 0).any():
        raise ValueError("each place needs its value and slope, and starts rise from 0 to the number of places")
    if not 0 < reach <= 1000:
        raise ValueError(f"reach must be above 0 and at most 1000 px, not {reach:g}")
    if clear is not None and clear.shape != image.shape:
        raise ValueError("what is hidden needs the image's size")
    surfaces = len(starts) - 1
    N, sure = np.zeros((1 + surfaces, 8, 8)), np.zeros((1 + surfaces, 8, 8))
    b, stats = np.zeros((1 + surfaces, 8)), np.zeros((1 + surfaces, 4))
    left, weights = np.full(len(points), np.nan), np.zeros(len(points))
    moved = carry_normals(H, points, normals)
    if not np.isfinite(moved).all():
        nothing = np.full(2, np.nan)
        return MotionEquations(nothing, math.nan, np.full((8, 8), np.nan), N, sure, b, stats, left, weights)
    at, along = np.ascontiguousarray(moved[:, :2]), np.ascontiguousarray(moved[:, 2:4])
    centre = at.mean(axis=0)
    radius = math.sqrt(float(np.einsum("ni,ni->", at - centre, at - centre)) / len(at))
    fields = displacement_fields((at - centre) / radius)
    basis = whitening(fields)

    edges = search_edges(image, at, along, reach, polarity, strength)
    blind = in_hidden(clear, at, along, edges[:, 0])
    edges[blind] = np.nan
    size = np.abs(edges[:, 1])
    found = np.isfinite(edges[:, 0]) & (size >= least_strength)
    if found.any():
        ratio = size[found] / np.abs(strength[found])
        found &= size >= relative_strength * float(np.sort(ratio)[(len(ratio) - 1) // 2]) * np.abs(strength)
    height, width = image.shape
    inside = (at >= 1.0).all(axis=1) & (at[:, 0] <= width - 2.0) & (at[:, 1] <= height - 2.0) & ~blind
    found &= inside
    if found.any():
        offsets = edges[found, 0]
        noise = max(quiet(np.abs(offsets)), LEAST_NOISE_PX)
        weight = tukey(offsets / noise)
        A = np.einsum("mi,mij->mj", along[found], fields[found]) @ basis
        total = float(weight.sum())
        # motions along which the outline slides into itself are not seen, whatever the normals' noise pretends
        told = np.einsum("m,mi,mj->ij", weight, A, A)
        chance = SLIDING**2 * total * np.eye(8)
        N[0] = sure[0] = without_chance(told, chance)
        b[0] = _seen(told, chance) @ (A.T @ (weight * offsets))
        stats[0] = total, total / max(int(np.count_nonzero(inside)), 1), noise, np.count_nonzero(inside) / len(at)
        left[found], weights[found] = offsets, weight
    for g in range(surfaces):
        mine = slice(int(starts[g]), int(starts[g + 1]))
        found_here = _surface(coarse, shrink, H, places[mine], values[mine], slopes[mine], centre, radius, basis, clear)
        if found_here is not None:
            N[1 + g], sure[1 + g], b[1 + g], stats[1 + g] = found_here
    return MotionEquations(centre, radius, basis, N, sure, b, stats, left, weights)


def _surface(
    coarse: NDArray[np.uint8],
    shrink: float,
    H: Floats,
    places: Floats,
    values: Floats,
    slopes: Floats,
    centre: Floats,
    radius: float,
    basis: Floats,
    clear: NDArray[np.uint8] | None,
) -> tuple[Floats, Floats, Floats, tuple[float, float, float, float]] | None:
    """N, sure, b and stats of one surface; None where it says nothing."""
    carried = carry_normals(H, places, slopes)
    h = H / H[2, 2]
    w = places @ h[2, :2] + 1.0
    u = carried[:, :2]
    v = (u + 0.5) / shrink - 0.5
    height, width = coarse.shape
    with np.errstate(invalid="ignore"):
        inside = (v >= EDGE).all(axis=1) & (v[:, 0] < width - 1 - EDGE) & (v[:, 1] < height - 1 - EDGE)
    if clear is not None:
        inside &= ~hidden_at(clear, np.where(np.isfinite(u), u, 0.0), BESIDE_HIDDEN * shrink)
    if np.count_nonzero(inside) < FEWEST:
        return None
    u, v, wanted, w = u[inside], v[inside], values[inside], w[inside]
    # slopes go by the inverse transpose of the Jacobian, as normals do
    a, b = (h[0, 0] - h[2, 0] * u[:, 0]) / w, (h[0, 1] - h[2, 1] * u[:, 0]) / w
    c, d = (h[1, 0] - h[2, 0] * u[:, 1]) / w, (h[1, 1] - h[2, 1] * u[:, 1]) / w
    sx, sy = slopes[inside].T
    then = np.column_stack([d * sx - c * sy, a * sy - b * sx]) / (a * d - b * c)[:, None]
    seen = bilinear(coarse, v)
    now = np.column_stack(
        [
            bilinear(coarse, v + RIGHT) - bilinear(coarse, v - RIGHT),
            bilinear(coarse, v + DOWN) - bilinear(coarse, v - DOWN),
        ]
    ) / (2.0 * shrink)
    place = (u - centre) / radius
    R = np.column_stack([wanted - wanted.mean(), np.ones(len(u)), place])
    light = np.zeros(4)
    rest = seen - wanted
    rest = rest - float(np.sort(rest)[(len(rest) - 1) // 2])  # so that what covers it does not bend the light
    for _ in range(WEIGHINGS):
        noise = max(quiet(np.abs(rest)), LEAST_NOISE_GREY)
        weight = tukey(rest / noise)
        Q = R.T @ (weight[:, None] * R)
        if not independent(Q):
            return None  # of one grey level: it says nothing
        light = np.linalg.solve(Q, R.T @ (weight * seen))
        rest = seen - R @ light
    fields = displacement_fields(place)
    moving = [np.einsum("mi,mij->mj", slope, fields) @ basis for slope in (now, light[0] * then)]
    flat = [A - R @ np.linalg.solve(Q, R.T @ (weight[:, None] * A)) for A in moving]
    # noise of the two images is not the same: what both slopes have in common is real
    told = flat[0].T @ (weight[:, None] * flat[1])
    mean = 0.5 * (flat[0] + flat[1])
    total = float(weight.sum())
    N = mean.T @ (weight[:, None] * mean)
    sure = without_chance(0.5 * (told + told.T), CHANCE / math.sqrt(max(total, 1.0)) * N)
    real = float(np.trace(told)) / (float(np.trace(N)) + 1e-300)
    N *= min(max(real, LEAST_REAL), 1.0)  # noise would shorten steps
    stats = total, total / len(u), noise, _correlation(seen, R[:, 0], R[:, 1:], weight)
    return N, sure, -mean.T @ (weight * rest), stats


def without_chance(told: Floats, chance: Floats) -> Floats:
    """(n, n) squares without what chance could give: nothing is left of motions that only chance shows."""
    left, V = np.linalg.eigh(told - chance)
    return np.asarray((V * np.maximum(left, 0.0)) @ V.T)


def _seen(told: Floats, chance: Floats) -> Floats:
    """(n, n) what it keeps of each motion: all of those that are well seen, nothing of those that chance could show."""
    left, V = np.linalg.eigh(told - chance)
    left = np.maximum(left, 0.0)
    return np.asarray((V * (left / np.maximum(left + np.einsum("ie,ij,je->e", V, chance, V), 1e-300))) @ V.T)


def _correlation(seen: Floats, wanted: Floats, light: Floats, weight: Floats) -> float:
    """Of two grey levels, without the levels that change linearly."""
    Q = light.T @ (weight[:, None] * light)
    pair = np.column_stack([seen, wanted])
    pair = pair - light @ np.linalg.solve(Q, light.T @ (weight[:, None] * pair))
    a, b, c = ((weight * pair[:, i] * pair[:, j]).sum() for i, j in ((0, 0), (1, 1), (0, 1)))
    return float(c / math.sqrt(a * b)) if a > 0.0 and b > 0.0 else 0.0
