# SPDX-License-Identifier: Apache-2.0
"""From a hand's twist to the rates of six joints (D. E. Whitney 1969), near singular poses and near the joints' limits too."""

from __future__ import annotations

import numpy as np

from grasptrack.bench.physics.serial import HIGHEST, LOWEST, SPEED
from grasptrack.typing import Floats

LENGTH = 0.3
"""m to a rad: how much a turn counts beside a way."""
NEAR, DAMPING = 0.04, 0.04
"""Least singular value below which rates are damped, and the damping where it is 0."""
BRAKE_S = 0.1
"""s: a joint comes no nearer to its limit than it could go in this time at its present rate."""


def joint_rates(jacobian: Floats, twist: Floats, joints: Floats) -> Floats:
    """Rates (6,) rad/s that move the hand by a twist as nearly as the arm can.

    Damped least squares (C. W. Wampler 1986; Y. Nakamura and H. Hanafusa 1986), the damping growing from 0 as the least
    singular value falls below NEAR, so that elsewhere the twist is met exactly. What would exceed a joint's speed, or run it
    into its limit, is slowed as a whole: the hand goes the same way, less fast.

    Args:
        jacobian: (6, 6) from rates to the twist.
        twist: (6,) m/s and rad/s, in any frame that is the Jacobian's too.
        joints: (6,) rad, where they are.
    """
    weight = np.array([1.0, 1.0, 1.0, LENGTH, LENGTH, LENGTH])
    U, s, Vt = np.linalg.svd(weight[:, None] * jacobian)
    damped = DAMPING**2 * max(0.0, 1.0 - (float(s[-1]) / NEAR) ** 2)
    rates = Vt.T @ (s / (s**2 + damped) * (U.T @ (weight * twist)))
    room = np.maximum(0.0, np.where(rates > 0.0, HIGHEST - joints, joints - LOWEST)) / BRAKE_S
    share = np.minimum(SPEED, room) / np.maximum(np.abs(rates), 1e-12)
    return np.asarray(rates * min(1.0, float(share.min())), dtype=np.float64)
