# SPDX-License-Identifier: Apache-2.0
"""How well a focal length and a tilt explain views of a rigid plane: what `PoseTarget.plane_modes` makes least."""

import numpy as np

from grasptrack.kernels.results import PlaneViews
from grasptrack.typing import Floats
from reference.registration.camera import pinhole_rows
from reference.registration.target import Target


def plane_cost(
    target: Target, views: PlaneViews, theta: Floats, *, freedom: float, pinhole_sd: float
) -> tuple[float, Floats, Floats]:
    """Twice the negative log of the density of theta (3,), and matrix and right side of its normal equations."""
    C, off, n = views.scale, views.theta - theta, views.freedom
    inverse, with_slopes = np.linalg.inv(C[1:, 1:]), np.linalg.solve(C[1:, 1:], C[1:, 0])
    of_focal = np.array([1.0, *-with_slopes]) / np.sqrt(C[0, 0] - with_slopes @ C[1:, 0])
    slopes, weight = off[1:] @ inverse @ off[1:], 1.0
    if np.isfinite(n):
        slopes, weight = (n + 2.0) * np.log1p(slopes / n), (n + 2.0) / (n + slopes)
    A = np.outer(of_focal, of_focal)
    A[1:, 1:] += weight * inverse
    cost, b = float(slopes + (of_focal @ off) ** 2), A @ off
    f, (width, height, aspect) = views.width * np.exp(theta[0]), views[3:6]
    depth = f + (views.hull - np.array([width, height]) / 2.0) @ (theta[1:] / (1.0, aspect))
    if not depth.min() > 1e-9 * np.abs(depth).max():
        return np.inf, A, b
    for G, P in zip(views.poses, views.covariances, strict=True):
        valid, misfit, by_pose, by_theta = pinhole_rows(target, G, theta, width, height, aspect)
        if not valid:
            return np.inf, A, b
        W = np.linalg.inv(by_pose @ P @ by_pose.T + pinhole_sd**2 * np.eye(2))
        far = float(misfit @ W @ misfit)
        cost += (freedom + 2.0) * float(np.log1p(far / freedom))
        weighed = by_theta.T @ W * ((freedom + 2.0) / (freedom + far))
        A, b = A + weighed @ by_theta, b - weighed @ misfit
    return cost, A, b
