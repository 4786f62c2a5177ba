# SPDX-License-Identifier: Apache-2.0
"""From errors of features to a twist: a damped, weighted pseudo-inverse and an adaptive gain."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError

Floats = NDArray[np.float64]

AXES = {4: (0, 1, 2, 5), 6: (0, 1, 2, 3, 4, 5)}
"""Components of the twist that a hand of so many degrees of freedom has."""


@dataclass(frozen=True)
class Gain:
    """The gain falls from `near` at the goal to `far` away from it: quick at the end, calm at the beginning.

    Args:
        near: 1/s at an error of 0.
        far: 1/s at a large error.
        fall: the error (norm of the features') at which it has fallen by about two thirds.

    Raises:
        InputError: not positive.
    """

    near: float = 5.0
    far: float = 2.0
    fall: float = 0.4

    def __post_init__(self) -> None:
        if not (self.near > 0.0 and self.far > 0.0 and self.fall > 0.0):
            raise InputError("gains are positive", gain=repr(self))

    def at(self, error: float) -> float:
        """1/s."""
        return self.far + (self.near - self.far) * math.exp(-error / self.fall)


def twist_for(
    error: Floats, jacobian: Floats, covariance: Floats, *, dof: int, length: float, gain: Gain, damping: float = 0.02
) -> Floats:
    """The twist (6,) that lets the error fall off exponentially.

    v = -lambda (J' W J + mu^2 D)^-1 J' W e (Chaumette and Hutchinson 2006, eq. 5, damped as Nakamura and Hanafusa 1986). A
    feature that is poorly known weighs less, and beside the damping is followed more slowly.

    Args:
        error: (m,) features less those of the goal.
        jacobian: (m, 6), of the features by the hand's twist.
        covariance: (m, m) of the features.
        dof: 4 (x, y, z, turn about z) or 6.
        length: m by which velocities compare with turns.
        gain: the gain.
        damping: mu, relative to a Jacobian of size 1.
    """
    axes = list(AXES[dof])
    unit = np.where(np.array(axes) < 3, length, 1.0)
    J = jacobian[:, axes] * unit
    W = np.linalg.inv(np.eye(len(error)) + covariance / FAITH**2)
    JW = J.T @ W
    solved = np.linalg.solve(JW @ J + damping**2 * np.eye(len(axes)), JW @ error)
    out = np.zeros(6)
    out[axes] = -gain.at(float(np.sqrt(error @ error))) * unit * solved
    return out


FAITH = 0.05
"""A feature that is known to this standard deviation weighs half."""
