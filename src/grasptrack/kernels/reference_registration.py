# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of the registration of an outline: the homography that lays it on the edges of an image."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_evidence import (
    SLIDING,
    carry_normals,
    displacement_fields,
    lower_median,
    near_identity,
    whitening,
)
from grasptrack.kernels.reference_support import in_hidden, search_edges

Floats = NDArray[np.float64]

ROUNDS = 4
"""Of weighing, within one search for edges."""
TUKEY = 4.685
"""A residual of so many times the noise and more counts nothing (Tukey's biweight)."""
LEAST_NOISE_PX = 0.03
"""Edges are never believed to be better than this."""
ENOUGH = 12
"""Edges that are needed for any motion."""


def register_outline(
    image: NDArray[np.uint8],
    H: Floats,
    points: Floats,
    normals: Floats,
    strength: Floats,
    polarity: int,
    reaches: Floats,
    motions: NDArray[np.int64],
    strides: NDArray[np.int64],
    least_strength: float,
    relative_strength: float,
    clear: NDArray[np.uint8] | None = None,
) -> tuple[Floats, Floats, Floats, float]:
    """Refine a homography on the edges along an outline: iterated robust Gauss-Newton, point to tangent line.

    Each step looks for edges along the carried normals and moves the outline onto them by the motion that leaves least,
    in Tukey's biweight. Motions along which the outline slides into itself stay as they were.

    Args:
        image: (H, W).
        H: (3, 3) reference to current, to begin with.
        points, normals, strength: (m, 2) px, (m, 2) unit and (m,) grey levels per px of the reference's samples. Where
            the polarity is 0, the sign of the strength is the edge's: positive for grey that rises outward.
        polarity: +1 object darker than its surroundings, -1 lighter, 0 where its parts differ.
        reaches: (r,) px searched on either side, step by step.
        motions: (r,) parameters of the motion of each step: 4 similarity, 6 affine, 8 projective.
        strides: (r,) of each step: every so many-th sample is looked at.
        least_strength: grey levels per px of an edge.
        relative_strength: of an edge, relative to the reference's and to the gain of most.
        clear: (H, W) px from each pixel to what is hidden, 0 in it; None where nothing is. Edges in it count nothing.

    Returns:
        (3, 3) the homography, its last element 1; (m,) what is left, px along the normals, NaN without an edge; (m,)
        weights 0 to 1 of the last step; px, the noise of its edges. All NaN where too few edges are left.
    """
    if not len(points) or len(normals) != len(points) or len(strength) != len(points):
        raise ValueError("samples are needed, each with its normal and strength")
    if not len(reaches) or len(motions) != len(reaches) or len(strides) != len(reaches):
        raise ValueError("each step needs its reach, motion and stride")
    for reach, motion, stride in zip(reaches.tolist(), motions.tolist(), strides.tolist(), strict=True):
        if not 0 < reach <= 1000:
            raise ValueError(f"reach must be above 0 and at most 1000 px, not {reach:g}")
        if motion not in (4, 6, 8):
            raise ValueError(f"a motion has 4, 6 or 8 parameters, not {motion}")
        if stride < 1:
            raise ValueError(f"a stride is 1 or more, not {stride}")
    if clear is not None and clear.shape != image.shape:
        raise ValueError("what is hidden needs the image's size")
    nothing = np.full((3, 3), np.nan), np.full(len(points), np.nan), np.zeros(len(points)), math.nan
    left, weights, noise = nothing[1:]
    for reach, motion, stride in zip(reaches.tolist(), motions.tolist(), strides.tolist(), strict=True):
        carried = carry_normals(H, points[::stride], normals[::stride])
        if not np.isfinite(carried).all():
            return nothing
        at, along = np.ascontiguousarray(carried[:, :2]), np.ascontiguousarray(carried[:, 2:4])
        asked = strength[::stride]
        edges = search_edges(image, at, along, reach, polarity, asked)
        blind = in_hidden(clear, at, along, edges[:, 0])
        edges[blind] = np.nan
        size = np.abs(edges[:, 1])
        found = np.isfinite(edges[:, 0]) & (size >= least_strength)
        if found.any():
            gain = lower_median(size[found] / np.abs(asked[found]))
            found &= size >= relative_strength * gain * np.abs(asked)
        if np.count_nonzero(found) < ENOUGH:
            return nothing
        index = np.flatnonzero(found)
        centre = at.mean(axis=0)
        radius = math.sqrt(float(np.einsum("ni,ni->", at - centre, at - centre)) / len(at))
        x, weight, residual, noise = _fitted((at[index] - centre) / radius, along[index], edges[index, 0], int(motion))
        H = near_identity(x / radius, centre, radius) @ H
        if not abs(H[2, 2]) > 1e-12:
            return nothing
        H = H / H[2, 2]
        left, weights = np.full(len(points), np.nan), np.zeros(len(points))
        left[index * stride], weights[index * stride] = residual, weight
    return H, left, weights, noise


def _fitted(points: Floats, normals: Floats, offsets: Floats, motion: int) -> tuple[Floats, Floats, Floats, float]:
    """(8,) parameters in px, (n,) weights, (n,) residuals in px, and the noise in px."""
    fields = displacement_fields(points)[:, :, :motion]
    own = whitening(fields)
    A = np.einsum("mi,mij->mj", normals, fields) @ own
    weight, x = np.ones(len(points)), np.zeros(motion)
    residual, noise = offsets, math.nan
    for _ in range(ROUNDS):
        told, V = np.linalg.eigh(np.einsum("m,mi,mj->ij", weight, A, A))
        least = SLIDING**2 * float(weight.sum())
        keep = told > least
        b = V.T @ (A.T @ (weight * offsets))
        x = V @ np.where(keep, b / np.where(keep, told, 1.0), 0.0)
        residual = offsets - A @ x
        noise = max(1.4826 * lower_median(np.abs(residual)), LEAST_NOISE_PX)
        u = residual / (TUKEY * noise)
        weight = np.where(np.abs(u) < 1.0, (1.0 - u * u) ** 2, 0.0)
    full = np.zeros(8)
    full[:motion] = own @ x
    return full, weight, residual, noise
