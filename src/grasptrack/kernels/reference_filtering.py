# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of a robust extended Kalman filter: how it goes on, and one update by what was seen.

States and steps are those of `reference_sightings`.
"""

from __future__ import annotations

import numpy as np

from grasptrack.kernels.reference_sightings import (
    AXES,
    GOING,
    OBJECT_AT,
    PLACE,
    POSE,
    SPEED,
    check_size,
    count_points,
    expected_sightings,
    retract_state,
)
from grasptrack.typing import Floats


def advance_state(
    state: Floats, covariance: Floats, seconds: float, drift: float, wander: float, twirl: float
) -> tuple[Floats, Floats]:
    """State and covariance after some time in which the object goes on.

    Args:
        state: (39 + 2n,) before.
        covariance: (16 + 2n, 16 + 2n) of its error.
        seconds: how long.
        drift: m^2/s by which the object may creep.
        wander: (m/s)^2/s by which its velocity may change.
        twirl: rad^2/s by which it may turn about its plane's normal.

    Raises:
        ValueError: a size that is none.
    """
    check_size(covariance, count_points(state))
    state, P, axes = state.copy(), covariance.copy(), state[AXES].reshape(3, 3)
    state[OBJECT_AT] += seconds * axes @ state[GOING]
    P[PLACE] += seconds * axes @ P[SPEED]
    P[:, PLACE] += seconds * P[:, SPEED] @ axes.T
    P[PLACE, PLACE] += axes @ axes.T * (drift * seconds + wander * seconds**3 / 3.0)
    P[SPEED, SPEED] += np.eye(3) * wander * seconds
    P[PLACE, SPEED] += axes * (wander * seconds**2 / 2.0)
    P[SPEED, PLACE] += axes.T * (wander * seconds**2 / 2.0)
    P[POSE.stop - 1, POSE.stop - 1] += twirl * seconds
    return state, P


def filter_sighting(
    state: Floats, covariance: Floats, hand: Floats, points: Floats, noise: Floats, robust: float
) -> tuple[Floats, Floats, Floats, float]:
    """One update of an extended Kalman filter by what was seen at the state's time.

    Args:
        state: (39 + 2n,) before.
        covariance: (16 + 2n, 16 + 2n) of its error.
        hand: (4, 4), its pose in the base.
        points: (n, 2) px, where they were seen.
        noise: (n, 2, 2) px^2.
        robust: innovations of so many standard deviations count a quarter: the noise grows with the innovation (Geman and
            McClure's weight).

    Returns:
        State and covariance after; (2n,) px, what was seen less what was expected; the innovation in standard deviations
        (root of the mean square), infinite where a point would lie behind the camera: nothing is changed then.

    Raises:
        ValueError: a size that is none, or a noise that makes the update singular.
    """
    n = count_points(state)
    check_size(covariance, n)
    if hand.shape != (4, 4):
        raise ValueError("a pose is (4, 4)")
    if points.shape != (n, 2) or noise.shape != (n, 2, 2):
        raise ValueError("each point needs its noise, (2, 2)")
    pixels, H = expected_sightings(state, hand[None], np.zeros(1))
    off = (points - pixels).ravel()
    if not np.isfinite(pixels).all():
        return state.copy(), covariance.copy(), off, float("inf")
    R = np.zeros((2 * n, 2 * n))
    for i, block in enumerate(noise):
        R[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = block
    PH = covariance @ H.T
    size = float(np.sqrt(off @ np.linalg.solve(H @ PH + R, off) / len(off)))
    gain = np.linalg.solve(H @ PH + R * (1.0 + (size / robust) ** 2) ** 2, PH.T).T
    P = covariance - gain @ PH.T
    return retract_state(state, gain @ off), np.asarray(0.5 * (P + P.T)), off, size
