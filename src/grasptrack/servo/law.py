# SPDX-License-Identifier: Apache-2.0
"""From errors of features to a twist: a damped, weighted pseudo-inverse and an adaptive gain."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grasptrack.errors import InputError
from grasptrack.typing import Floats

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
        length: m by which velocities across the approach compare with turns: of small grasps small.
        gain: the gain.
        damping: mu, relative to a Jacobian of size 1.
    """
    axes, m = list(AXES[dof]), len(error)
    depth = max(
        length, 1.0 / max(abs(float(jacobian[2, 2])), 1e-9)
    )  # m by which the third feature, l*/l, changes by one
    unit = np.array([length if a < 2 else depth if a == 2 else 1.0 for a in axes])
    sides = np.column_stack([jacobian[:, axes] * unit, error])
    faith = FAITH * np.maximum(1.0, np.abs(error))
    doubt = covariance / np.outer(faith, faith)
    doubt.flat[:: m + 1] += 1.0
    products = sides[:, :-1].T @ np.linalg.solve(doubt, sides)  # J'W J, and J'W e
    A = products[:, :-1]
    A.flat[:: len(axes) + 1] += damping**2
    out = np.zeros(6)
    out[axes] = -gain.at(math.sqrt(error @ error)) * unit * np.linalg.solve(A, products[:, -1])
    return out


FAITH = 0.05
"""A feature that is known to this standard deviation, or to this share of its error, weighs half."""
