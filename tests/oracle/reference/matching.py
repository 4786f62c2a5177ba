# SPDX-License-Identifier: Apache-2.0
"""One outline laid on another: every cyclic shift, and by a homography."""

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.geometry.homographies import displacement_fields, near_identity
from grasptrack.kernels.results import AlignmentSteps, CyclicShift
from grasptrack.statistics import lower_median, robust_sd
from grasptrack.typing import Floats
from reference.checks import check_arc, check_contour, check_outline, check_power_of_2, check_size, check_within
from reference.geometry import polygon_moments, resample
from reference.homography import carry_normals

__all__ = ["align_outlines", "align_projective", "initial_alignments", "outline_gaps"]


# --- The cyclic shifts under which one outline lies on another -----


def align_outlines(
    points1: Floats, arc1: Floats, points2: Floats, arc2: Floats, count: int, tie: float
) -> list[CyclicShift]:
    check_power_of_2(count)
    check_arc(len(points1), arc1)
    check_arc(len(points2), arc2)
    a, b = _normalized_samples(points1, arc1, count), _normalized_samples(points2, arc2, count)
    c = np.fft.ifft(np.fft.fft(b) * np.conj(np.fft.fft(a)))
    square = c.real**2 + c.imag**2
    left = np.sqrt(np.maximum(1.0 - square, 0.0))
    peak = (left <= left.min() + tie) & (square >= np.roll(square, 1)) & (square > np.roll(square, -1))
    found = [CyclicShift(k / count, float(np.angle(c[k])), float(left[k])) for k in np.flatnonzero(peak).tolist()]
    return sorted(found, key=lambda fit: fit.residual)


def _normalized_samples(points: Floats, arc: Floats, count: int) -> NDArray[np.complex128]:
    closed = np.append(points, points[:1], axis=0) - points[0]
    s = np.arange(count) * (arc[-1] / count)
    z = np.interp(s, arc, closed[:, 0]) + 1j * np.interp(s, arc, closed[:, 1])
    z -= z.mean()
    out: NDArray[np.complex128] = z / np.sqrt((z * z.conj()).real.sum())
    return out


# --- NumPy reference of the first step of a match without a prior: whitened outlines, aligned at every shift -----

IN_FRONT = 0.25
"""A bend that magnifies a part of the outline by more than the inverse of this is not tried."""


def initial_alignments(first: Floats, second: Floats, bends: Floats, count: int, apart: float, most: int) -> Floats:
    check_power_of_2(count)
    check_size(len(bends), 1000, "bends")
    check_within(most, 0, 1000, "most")
    check_contour(first)
    check_contour(second)
    to_first, to_second = _whitening_transform(first), _whitening_transform(second)
    white = first @ to_first[:2, :2].T + to_first[:2, 2]
    b = np.fft.fft(_resampled_samples(second @ to_second[:2, :2].T + to_second[:2, 2], count))
    back = np.linalg.inv(to_second)
    rows = []
    for bend in bends:
        w = white @ bend + 1.0
        if w.min() < IN_FRONT:
            continue
        bent = np.ascontiguousarray(white / w[:, None])
        again = _whitening_transform(bent)
        c = np.fft.ifft(b * np.conj(np.fft.fft(_resampled_samples(bent @ again[:2, :2].T + again[:2, 2], count))))
        square = c.real**2 + c.imag**2
        projective = np.eye(3)
        projective[2, :2] = bend
        for k in np.flatnonzero((square >= np.roll(square, 1)) & (square > np.roll(square, -1))).tolist():
            size = math.sqrt(float(square[k]))
            cos, sin = c[k].real / size, c[k].imag / size
            H = back @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ again @ projective @ to_first
            rows.append([math.sqrt(max(1.0 - float(square[k]), 0.0)), k / count, *(H / H[2, 2]).ravel().tolist()])
    rows.sort(key=lambda row: row[0])
    kept: list[list[float]] = []
    for row in rows:
        if len(kept) < most and all(abs((row[1] - other[1] + 0.5) % 1.0 - 0.5) >= apart for other in kept):
            kept.append(row)
    return np.array(kept, dtype=np.float64).reshape(-1, 11)


def _whitening_transform(points: Floats) -> Floats:
    """(3, 3) the affine map after which the area within has mean 0 and unit second moments, without a turn."""
    _, x, y, theta, major, minor, *_ = polygon_moments(points, np.array([0, len(points)], dtype=np.int64))
    if not minor > 0.0:
        raise ValueError("a contour must enclose an area")
    c, s = math.cos(theta), math.sin(theta)
    a, b = 1.0 / math.sqrt(major), 1.0 / math.sqrt(minor)
    xx, xy, yy = a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c
    return np.array([[xx, xy, -xx * x - xy * y], [xy, yy, -xy * x - yy * y], [0.0, 0.0, 1.0]])


def _resampled_samples(points: Floats, count: int) -> NDArray[np.complex128]:
    at = resample(np.ascontiguousarray(points), count, 0.0)
    z = at[:, 0] + 1j * at[:, 1]
    z -= z.mean()
    out: NDArray[np.complex128] = z / np.sqrt((z * z.conj()).real.sum())
    return out


# --- NumPy reference of laying one outline on another: how far they are apart, and the homography that makes it least -----

ALIKE = 0.5
"""Cosine of the angle, 60 degrees, up to which two outlines may differ in direction where they correspond."""
TUKEY = 4.685
"""A distance of so many times the noise and more counts nothing (Tukey's biweight)."""
ENOUGH = 12
"""Points with a counterpart that are needed for any motion."""


def outline_gaps(
    points: Floats, normals: Floats, targets: Floats, target_normals: Floats, offsets: NDArray[np.int64], reach: float
) -> Floats:
    _check_arguments(points, normals, targets, target_normals, offsets, reach)
    return _nearest_target_gaps(points, normals, targets, target_normals, _half_spacing(targets, offsets), reach)[0]


def align_projective(
    starts: Floats,
    points: Floats,
    normals: Floats,
    targets: Floats,
    target_normals: Floats,
    offsets: NDArray[np.int64],
    steps: AlignmentSteps,
) -> Floats:
    reaches, damping, strides, least_noise = steps
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
    points: Floats, normals: Floats, targets: Floats, target_normals: Floats, offsets: NDArray[np.int64], reach: float
) -> None:
    if not len(points) or len(points) != len(normals) or len(targets) != len(target_normals):
        raise ValueError("points are needed, each with its normal")
    check_outline(targets, offsets)
    if not reach > 0:
        raise ValueError(f"reach must be above 0, not {reach:g}")
