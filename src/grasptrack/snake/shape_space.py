# SPDX-License-Identifier: Apache-2.0
"""Shape spaces on a template's points, Q = W X + Q0, and motion in them (Blake and Isard, Active Contours, chs. 4, 10)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from grasptrack.errors import ConditioningError, ContourError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.typing import Floats

DOF = 4
"""Of a planar similarity."""


class ShapeSpace:
    """The views of a template that differ by a planar similarity: translation, rotation, scale (Section III-A).

    A state X = (tx, ty, rho (s cos a - 1), rho s sin a) is all in px: the first two entries move the template's centroid g,
    the others turn and scale about it, multiplied by the template's rms radius rho, so that one unit of any moves the points
    by about 1 px.

    Args:
        points: (n, 2) px, the template Q0.

    Raises:
        ContourError: fewer than 3 points, or all in one place.
    """

    __slots__ = ("_pinv", "centre", "local", "points", "rho")

    def __init__(self, points: ArrayLike) -> None:
        self.points: Floats = np.array(points, dtype=np.float64)
        if self.points.ndim != 2 or self.points.shape[1] != 2 or len(self.points) < 3:
            raise ContourError(f"a template is an array of at least 3 points (n, 2), not {self.points.shape}")
        self.centre: Floats = np.asarray(self.points.mean(axis=0))
        offset: Floats = self.points - self.centre
        self.rho = float(np.sqrt(np.einsum("ij,ij->", offset, offset) / len(offset)))
        if not self.rho > 0.0:
            raise ContourError("a template must have an extent; these points are one place")
        self.local: Floats = offset / self.rho  # the template's shape, at size 1
        self._pinv: Floats = np.asarray(np.linalg.pinv(self.W))

    @property
    def W(self) -> Floats:  # noqa: N802  the name it has in Q = W X + Q0
        """(2 n, dof): how each state moves the points; rows are x of all points, then y of all."""
        return np.concatenate([self.point_jacobian(self.points)[:, i] for i in (0, 1)])

    def point_jacobian(self, points: Floats) -> Floats:
        """(m, 2, dof): derivative of where points (m, 2) of the template go by the state, the same at any state."""
        p = (points - self.centre) / self.rho
        x, y = p[:, 0], p[:, 1]
        out = np.zeros((len(p), 2, DOF))
        out[:, 0, 0] = out[:, 1, 1] = 1.0
        out[:, 0, 2], out[:, 0, 3] = x, -y
        out[:, 1, 2], out[:, 1, 3] = y, x
        return out

    def linear_part(self, state: Floats) -> Floats:
        """(2, 2): the linear part of the map that a state stands for."""
        a, b = 1.0 + float(state[2]) / self.rho, float(state[3]) / self.rho
        return np.array(((a, -b), (b, a)))

    def curve_points(self, state: Floats) -> Floats:
        """(n, 2) px: Q = W X + Q0."""
        return np.asarray(self.local @ (self.rho * self.linear_part(state).T) + (self.centre + state[:2]))

    def homography(self, state: Floats) -> Floats:
        """(3, 3) H_current_reference that a state stands for."""
        M = self.linear_part(state)
        H = np.eye(3)
        H[:2, :2] = M
        H[:2, 2] = self.centre + state[:2] - M @ self.centre
        return H

    def state_near(self, H: ArrayLike) -> Floats:
        """(dof,) state nearest to a homography: its image of the template, least squares over the points.

        Exact where H lies in the space; the similarity that fits best where it does not.

        Raises:
            ConditioningError: not (3, 3), not finite, or H sends part of the template to infinity.
        """
        h = np.asarray(H, dtype=np.float64)
        if h.shape != (3, 3) or not np.isfinite(h).all():
            raise ConditioningError("a homography is a finite array of shape (3, 3)")
        moved = apply_homography(h, self.points) - self.points
        return np.asarray(self._pinv @ moved.T.ravel())

    def metric_matrix(self) -> Floats:
        """(dof, dof): X^T metric X is the mean square displacement of the points, px^2."""
        W = self.W
        return np.asarray(W.T @ W / len(self.points))


MIN_DRIVE = 0.7
"""px per frame^2: however smooth the motion has been, so much may come."""
MAX_DRIVE = 10.0
MEMORY = 0.85
"""Share of the drive that a frame leaves as it was; a higher one forgets a jerk more slowly."""


class ConstantVelocity:
    """State X and velocity V in the shape space; accelerations are noise whose size is learned from the innovations.

    Args:
        dof: dimension of the shape space.
        size: px per unit of the noise; 1 at 640x480, proportionally more for larger images.

    Attributes:
        state: (dof,) px; velocity: (dof,) px per frame.
        P, B, C: (dof, dof) covariances of state, of state with velocity, of velocity.
        drive: rms acceleration expected, px per frame^2.
    """

    __slots__ = ("B", "C", "P", "drive", "free", "size", "state", "velocity")

    def __init__(self, dof: int, size: float = 1.0) -> None:
        self.size = size
        # A hand or a camera moves an object farther than it turns or scales it.
        self.free: Floats = np.diag([1.0, 1.0] + [0.25] * (dof - 2))
        self.reset(np.zeros(dof))

    def reset(self, state: Floats) -> None:
        """Put the state somewhere, at rest, knowing nothing of its velocity."""
        self.state: Floats = np.array(state, dtype=np.float64)
        self.velocity: Floats = np.zeros_like(self.state)
        self.drive = 5.0 * self.size
        self.P: Floats = self.free * self.size**2
        self.B: Floats = np.zeros_like(self.P)
        self.C: Floats = self.free * self.drive**2

    def predict(self, dt: float = 1.0) -> None:
        """Move on by dt frames."""
        noise = self.free * self.drive**2
        self.state = self.state + dt * self.velocity
        self.P = self.P + dt * (self.B + self.B.T) + dt * dt * self.C + 0.25 * dt**4 * noise
        self.B = self.B + dt * self.C + 0.5 * dt**3 * noise
        self.C = self.C + dt * dt * noise

    def correct(self, measured: Floats, R: Floats) -> None:
        """Take in a measured state with covariance R (dof, dof) px^2."""
        innovation = measured - self.state
        jerk = min(max(float(np.sqrt(innovation @ innovation)), MIN_DRIVE * self.size), MAX_DRIVE * self.size)
        # A jerk is believed at once and forgotten slowly.
        self.drive = max(jerk, float(np.sqrt(MEMORY * self.drive**2 + (1.0 - MEMORY) * jerk**2)))
        S = np.linalg.inv(self.P + R)
        K, L = self.P @ S, self.B.T @ S
        self.state = self.state + K @ innovation
        self.velocity = self.velocity + L @ innovation
        # R is far below P: written as R times a gain, nothing cancels and the whole stays positive
        C = self.C - L @ self.B
        self.B = R @ L.T
        P = R @ K.T
        self.P, self.C = 0.5 * (P + P.T), 0.5 * (C + C.T)

    def coast(self) -> None:
        """A frame without measurement: nothing is known to keep the velocity up."""
        self.velocity = 0.8 * self.velocity
        ceiling = (MAX_DRIVE * self.size) ** 2 * self.free
        excess = float(np.trace(self.P) / np.trace(ceiling))
        if excess > 1.0:
            self.P, self.B, self.C = ceiling, np.zeros_like(self.B), ceiling / 4.0
