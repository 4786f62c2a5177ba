# SPDX-License-Identifier: Apache-2.0
"""Where a snake will be: a Kalman filter in its shape space (Blake and Isard, Active Contours, ch. 10)."""

from __future__ import annotations

import numpy as np

from grasptrack.typing import Floats

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
