# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of laying one outline on another: how far they are apart, and the homography that makes it least."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_evidence import carry_normals, displacement_fields, lower_median, near_identity
from grasptrack.statistics import robust_sd
from grasptrack.typing import Floats

ALIKE = 0.5
"""Cosine of the angle, 60 degrees, up to which two outlines may differ in direction where they correspond."""
TUKEY = 4.685
"""A distance of so many times the noise and more counts nothing (Tukey's biweight)."""
ENOUGH = 12
"""Points with a counterpart that are needed for any motion."""


def outline_gaps(
    points: Floats, normals: Floats, targets: Floats, target_normals: Floats, offsets: NDArray[np.int64], reach: float
) -> Floats:
    """How far each point of one outline is from another outline.

    Of the targets whose normals differ by 60 degrees at most the nearest counts. Its distance is taken to the piece of
    the tangent there that lies half way to the neighbours on either side.

    Args:
        points, normals: (m, 2) px, (m, 2) unit.
        targets, target_normals, offsets: the other outline, (n, 2), (n, 2), (C + 1,).
        reach: px that are searched.

    Returns:
        (m,) px, `reach` where nothing is nearer.

    Raises:
        ValueError: normals or offsets of other points, or no reach, or targets that are not finite.
    """
    _check_arguments(points, normals, targets, target_normals, offsets, reach)
    return _nearest_target_gaps(points, normals, targets, target_normals, _half_spacing(targets, offsets), reach)[0]


def align_projective(
    starts: Floats,
    points: Floats,
    normals: Floats,
    targets: Floats,
    target_normals: Floats,
    offsets: NDArray[np.int64],
    reaches: Floats,
    damping: Floats,
    strides: NDArray[np.int64],
    least_noise: float,
) -> Floats:
    """Refine homographies that lay points of one outline on another: Gauss-Newton, point to tangent line.

    In each step every sample is carried by the homography; its counterpart is the nearest target whose normal differs by
    60 degrees at most. Distances to the tangents there are weighted by Tukey's biweight, so that a part that fits
    nowhere counts nothing. Damping holds what the outline hardly shows.

    Args:
        starts: (k, 9) homographies by rows, each refined on its own.
        points, normals: (m, 2) px, (m, 2) unit, samples of the first outline.
        targets, target_normals, offsets: the second outline, as in `outline_gaps`.
        reaches: (s,) px searched, step by step.
        damping: (s,) share of what a motion displaces that is added to what is seen of it.
        strides: (s,) every so many-th sample is looked at.
        least_noise: px.

    Returns:
        (k, 10): the homography by rows, its last element 1, and px rms of the distances that are left, of the samples of
        the last step, those beyond its reach counted as the reach. NaN where too few points have a counterpart, where
        the outline turns over, or where a part of it is sent to infinity.

    Raises:
        ValueError: arrays that do not belong together.
    """
    if not len(reaches) or len(damping) != len(reaches) or len(strides) != len(reaches):
        raise ValueError("each step needs its reach, damping and stride")
    for reach, stride in zip(reaches.tolist(), strides.tolist(), strict=True):
        _check_arguments(points, normals, targets, target_normals, offsets, reach)
        if stride < 1:
            raise ValueError(f"a stride is 1 or more, not {stride}")
    if starts.ndim != 2 or starts.shape[1] != 9:
        raise ValueError("a homography has nine elements")
    half = _half_spacing(targets, offsets)
    out = np.full((len(starts), 10), np.nan)
    for row, start in zip(out, starts, strict=True):
        H: Floats | None = start.reshape(3, 3) / start[8]
        for reach, share, stride in zip(reaches.tolist(), damping.tolist(), strides.tolist(), strict=True):
            if H is None:
                break
            H = _gauss_newton_step(
                H, points[::stride], normals[::stride], targets, target_normals, half, reach, share, least_noise
            )
        if H is None:
            continue
        stride = int(strides[-1])
        moved = carry_normals(H, points[::stride], normals[::stride])
        if not (moved[:, 4] > 0.0).all():
            continue
        gaps = _nearest_target_gaps(moved[:, :2], moved[:, 2:4], targets, target_normals, half, float(reaches[-1]))[0]
        row[:9], row[9] = H.ravel(), math.sqrt(float(gaps @ gaps) / len(gaps))
    return out


def _gauss_newton_step(
    H: Floats,
    points: Floats,
    normals: Floats,
    targets: Floats,
    target_normals: Floats,
    half: Floats,
    reach: float,
    damping: float,
    least_noise: float,
) -> Floats | None:
    moved = carry_normals(H, points, normals)
    if not (moved[:, 4] > 0.0).all():
        return None
    at = moved[:, :2]
    centre = at.mean(axis=0)
    radius = math.sqrt(float(((at - centre) ** 2).sum()) / len(at))
    index = _nearest_target_gaps(at, moved[:, 2:4], targets, target_normals, half, reach)[1]
    use = index >= 0
    if np.count_nonzero(use) < ENOUGH:
        return None
    across = target_normals[index[use]]
    distance = np.einsum("mi,mi->m", targets[index[use]] - at[use], across)
    noise = max(robust_sd(distance, lower_median), least_noise)
    u = distance / (TUKEY * noise)
    weight = np.where(np.abs(u) < 1.0, (1.0 - u * u) ** 2, 0.0)
    fields = displacement_fields((at[use] - centre) / radius)
    A = np.einsum("mi,mij->mj", across, fields)
    size = np.einsum("m,mij,mij->j", weight, fields, fields)
    try:
        x = np.linalg.solve(
            np.einsum("m,mi,mj->ij", weight, A, A) + np.diag(damping * size), A.T @ (weight * distance) / radius
        )
    except np.linalg.LinAlgError:
        return None
    out = near_identity(x, centre, radius) @ H
    return np.asarray(out / out[2, 2]) if abs(out[2, 2]) > 1e-12 else None


def _nearest_target_gaps(
    points: Floats, normals: Floats, targets: Floats, target_normals: Floats, half: Floats, reach: float
) -> tuple[Floats, NDArray[np.int64]]:
    """(m,) px and (m,) the index of the target that is nearest, -1 where none is within reach."""
    apart = ((points[:, None, :] - targets[None, :, :]) ** 2).sum(axis=2)
    apart[~(normals @ target_normals.T >= ALIKE)] = np.inf
    index = apart.argmin(axis=1)
    none = ~(apart[np.arange(len(points)), index] <= reach * reach)
    way, across = targets[index] - points, target_normals[index]
    off = np.einsum("mi,mi->m", way, across)
    along = np.abs(way[:, 0] * across[:, 1] - way[:, 1] * across[:, 0])
    beyond = np.maximum(along - half[index], 0.0)
    gaps = np.sqrt(off * off + beyond * beyond)
    return np.where(none, reach, np.minimum(gaps, reach)), np.where(none, -1, index)


def _half_spacing(targets: Floats, offsets: NDArray[np.int64]) -> Floats:
    """(n,) px, half the way to the farther neighbour along the contour."""
    half = np.empty(len(targets))
    for begin, end in zip(offsets[:-1].tolist(), offsets[1:].tolist(), strict=True):
        side = np.roll(targets[begin:end], -1, axis=0) - targets[begin:end]
        ahead = np.sqrt((side * side).sum(axis=1))
        half[begin:end] = 0.5 * np.maximum(ahead, np.roll(ahead, 1))
    return half


def _check_arguments(
    points: Floats,
    normals: Floats,
    targets: Floats,
    target_normals: Floats,
    offsets: NDArray[np.int64],
    reach: float,
) -> None:
    if not len(points) or len(points) != len(normals) or len(targets) != len(target_normals):
        raise ValueError("points are needed, each with its normal")
    if len(offsets) < 2 or offsets[0] != 0 or offsets[-1] != len(targets) or (np.diff(offsets) <= 0).any():
        raise ValueError("offsets must rise from 0 to the number of points")
    if not np.isfinite(targets).all():
        raise ValueError("targets must be finite")
    if not reach > 0:
        raise ValueError(f"reach must be above 0, not {reach:g}")
