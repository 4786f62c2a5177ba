# SPDX-License-Identifier: Apache-2.0
"""Homographies of four points, and what they do to points and normals."""

import math

import numpy as np

from grasptrack.kernels.results import CarriedPoints, Distortion, FittedHomography
from grasptrack.typing import Floats
from research.paper.correspondences import cubic_point

__all__ = ["carry_normals", "carry_points", "distortion", "fit_homography"]


# Twice the area of a triangle of points whose rms distance from their mean is 1: below this, three are in a row.
IN_A_ROW = 1e-10


def _normalize_points(points: Floats) -> tuple[Floats, Floats]:
    """(4, 3) points about their mean at rms distance 1, and the (3, 3) transform that made them."""
    mean = points.mean(axis=0)
    centred = points - mean
    size = np.sqrt((centred * centred).sum() / 4)
    if not size > 0 or not np.isfinite(size):
        raise ValueError("four points that coincide, or are not finite, fix no homography")
    transform = np.array([[1 / size, 0, -mean[0] / size], [0, 1 / size, -mean[1] / size], [0, 0, 1]])
    return np.column_stack([centred / size, np.ones(4)]), transform


def _projective_weights(p: Floats) -> Floats:
    """lambda with lambda_0 p_0 + lambda_1 p_1 + lambda_2 p_2 proportional to p_3."""
    crosses = [np.cross(p[1], p[2]), np.cross(p[2], p[0]), np.cross(p[0], p[1])]
    weights = np.array([float(c @ p[3]) for c in crosses])
    if min(abs(weights).min(), abs(float(crosses[0] @ p[0]))) <= IN_A_ROW:
        raise ValueError("three of the four points are in a row")
    return weights


def homography_4(source: Floats, target: Floats) -> Floats:
    """The homography that maps four points exactly to four others.

    Both sets are normalised first; then H = sum_i (mu_i / lambda_i) q_i (p_j x p_k)^T, where lambda and mu express the
    fourth point in the other three.

    Args:
        source: (4, 2) px.
        target: (4, 2) px.

    Returns:
        (3, 3) with H[2, 2] = 1, or of unit Frobenius norm where H[2, 2] is below 1e-12 of the norm.

    Raises:
        ValueError: three points in a row in either set, or points that are not finite.
    """
    p, S = _normalize_points(source)
    q, T = _normalize_points(target)
    ratio = _projective_weights(q) / _projective_weights(p)
    H = np.zeros((3, 3))
    for i in range(3):
        H += ratio[i] * np.outer(q[i], np.cross(p[(i + 1) % 3], p[(i + 2) % 3]))
    back = np.array([[1 / T[0, 0], 0, -T[0, 2] / T[0, 0]], [0, 1 / T[0, 0], -T[1, 2] / T[0, 0]], [0, 0, 1]])
    H = back @ H @ S
    norm = np.sqrt((H * H).sum())
    return np.asarray(H / (H[2, 2] if abs(H[2, 2]) > 1e-12 * norm else norm))


def carry_points(H: Floats, points: Floats) -> CarriedPoints:
    x, y = points.T
    with np.errstate(all="ignore"):
        w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
        u, v = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / w, (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / w
        in_front = float((w * (-1.0 if w[0] < 0 else 1.0)).min()) if len(w) else math.inf
    return CarriedPoints(np.column_stack([u, v]), in_front)


def distortion(H: Floats, points: Floats) -> Distortion:
    if not len(points):
        return Distortion(math.inf if np.isfinite(H).all() else math.nan, math.inf, 1.0)
    x, y = points.T
    (a, b, _), (d, e, _), (g, h, _) = H.tolist()
    with np.errstate(all="ignore"):
        w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
        u, v = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / w, (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / w
        a, b, c, d = (a - g * u) / w, (b - h * u) / w, (d - g * v) / w, (e - h * v) / w
        det, square = a * d - b * c, a * a + b * b + c * c + d * d
        # singular values s1 >= s2 obey s1^2 + s2^2 = square and s1 s2 = det
        larger = 0.5 * (square + np.sqrt(np.maximum(square * square - 4 * det * det, 0.0)))
        front = float((w * (-1.0 if w[0] < 0 else 1.0)).min()) if np.isfinite(H).all() else math.nan
        return Distortion(front, float(det.min()), max(1.0, float((larger / det).max())))


def fit_homography(points1: Floats, indices1: list[int], points2: Floats, places2: list[float]) -> FittedHomography:
    places: list[tuple[Floats, list[int] | list[float]]] = [(points1, indices1), (points2, places2)]
    for points, chosen in places:
        if len(chosen) != 4 or not all(0 <= place < len(points) for place in chosen):
            raise ValueError("four points of each contour are needed")
    H = homography_4(points1[indices1], np.array([cubic_point(points2, place) for place in places2]))
    return FittedHomography(H, *distortion(H, points1[indices1]))


def carry_normals(H: Floats, points: Floats, normals: Floats) -> Floats:
    x, y = points[:, 0], points[:, 1]
    w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
    if len(w):
        with np.errstate(invalid="ignore", divide="ignore"):
            w = np.where(w / (w.sum() / len(w)) > 1e-9, w, np.nan)
    u, v = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / w, (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / w
    a, b = (H[0, 0] - H[2, 0] * u) / w, (H[0, 1] - H[2, 1] * u) / w
    c, d = (H[1, 0] - H[2, 0] * v) / w, (H[1, 1] - H[2, 1] * v) / w
    nx, ny = d * normals[:, 0] - c * normals[:, 1], a * normals[:, 1] - b * normals[:, 0]
    determinant = a * d - b * c
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.sqrt(nx * nx + ny * ny) * np.sign(determinant)
        return np.column_stack([u, v, nx / size, ny / size, determinant])
