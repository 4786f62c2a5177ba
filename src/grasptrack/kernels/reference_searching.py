# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of camera and object from all sightings at once: robust Levenberg-Marquardt with a prior."""

from __future__ import annotations

import numpy as np

from grasptrack.kernels.reference_sightings import (
    POSE,
    TURN,
    check_size,
    count_points,
    expected_sightings,
    retract_state,
    state_difference,
)
from grasptrack.typing import Floats

FARTHEST = 0.5
"""rad by which a step may turn camera or object: one that tips the object's plane over ends where its back explains almost
as much, and no small step leads back."""


def calibrate_batch(
    origin: Floats,
    known: Floats,
    hands: Floats,
    later: Floats,
    points: Floats,
    noise: Floats,
    start: Floats,
    damping: float,
    steps: int,
    robust: float,
    least_fall: float,
    most_damping: float,
) -> tuple[Floats, Floats, float, bool, float]:
    """The state that explains all sightings best, with what was known before as a prior.

    States and steps are those of `reference_sightings`. Residuals of a sighting count together, in Geman and McClure's
    function: where their rms is `robust` times the scale, a quarter. A step that would turn camera or object by more than
    half a radian is damped as one that explains less.

    Args:
        origin: (39 + 2n,), the most likely state before.
        known: (16 + 2n, 16 + 2n), the inverse of its covariance.
        hands: (N, 4, 4) poses in the base.
        later: (N,) s, of each after the time of the states.
        points: (N, n, 2) px, where they were seen.
        noise: (N, n, 2, 2) px^2.
        start: (39 + 2n,), where the search begins.
        damping: of the first step.
        steps: most steps.
        robust: see above.
        least_fall: of the cost, in squared standard deviations, by less than which a search that ends has fallen.
        most_damping: beyond which it ends.

    Returns:
        The state; its covariance (16 + 2n, 16 + 2n); the damping of the next step; whether the search has ended; 1.5 times
        the median of the residuals in standard deviations, or 1.

    Raises:
        ValueError: a size that is none, a noise that is not positive, or equations that are singular.
    """
    n, N = count_points(origin), len(hands)
    check_size(known, n)
    if not N or hands.shape[1:] != (4, 4) or len(later) != N:
        raise ValueError("poses are (N, 4, 4), one or more, each with its time")
    if len(start) != len(origin):
        raise ValueError("both states have as many points")
    if points.shape != (N, n, 2) or noise.shape != (N, n, 2, 2):
        raise ValueError("each point needs its noise, (2, 2)")
    evidence = _Evidence(origin, known, hands, later, points, noise, robust)
    now = start.copy()
    evidence.look(now)
    scale = evidence.scale(None)
    cost = evidence.cost(scale)
    A, b = evidence.equations(scale)
    settled = False
    for _ in range(steps):
        step = np.asarray(np.linalg.solve(A + damping * np.diag(np.diag(A)), b))
        found = np.inf
        if max(np.linalg.norm(step[TURN]), np.linalg.norm(step[POSE])) <= FARTHEST:
            tried = retract_state(now, step)
            evidence.look(tried)
            found = evidence.cost(scale)
        if found <= cost:
            settled = cost - found < least_fall
            now, (A, b), damping = tried, evidence.equations(scale), max(damping / 5.0, 1e-9)
            if not settled:
                scale = evidence.scale(scale)
            cost = evidence.cost(scale)
        else:
            damping *= 10.0
            settled = damping > most_damping
        if settled:
            break
    return now, np.asarray(np.linalg.inv(A), dtype=np.float64), damping, settled, scale


class _Evidence:
    """The sightings as one system of equations."""

    def __init__(
        self, origin: Floats, known: Floats, hands: Floats, later: Floats, points: Floats, noise: Floats, robust: float
    ) -> None:
        self._origin, self._known, self._hands, self._later, self._points = origin, known, hands, later, points
        self._white, self._robust = np.linalg.inv(np.linalg.cholesky(noise)), robust

    def look(self, state: Floats) -> None:
        """What a state leaves of the sightings, and of what was known before."""
        pixels, slopes = expected_sightings(state, self._hands, self._later)
        shape = self._points.shape
        self._off = (self._white @ (self._points - pixels.reshape(shape))[..., None])[..., 0].reshape(
            len(self._hands), -1
        )
        self._slopes = slopes.reshape(*shape, -1)
        size2 = (self._off * self._off).mean(axis=1)
        self._size2 = np.where(np.isnan(size2), np.inf, size2)
        self._d = state_difference(self._origin, state)

    def cost(self, scale: float) -> float:
        """In squared standard deviations."""
        u = self._size2 / (self._robust * scale) ** 2
        share = np.divide(u, 1.0 + u, out=np.ones_like(u), where=np.isfinite(u))
        prior = float(self._d @ self._known @ self._d)
        return float(self._off.shape[1] * (self._robust * scale) ** 2 * share.sum()) + prior

    def scale(self, last: float | None) -> float:
        """The scale of what is left, where it is not much like the last one."""
        now = max(1.0, 1.5 * float(np.sqrt(np.median(self._size2))))
        now = now if np.isfinite(now) else 1e3
        return now if last is None or abs(now - last) > 0.2 * last else last

    def equations(self, scale: float) -> tuple[Floats, Floats]:
        """The normal equations A x = b."""
        weight = 1.0 / (1.0 + self._size2 / (self._robust * scale) ** 2) ** 2
        behind = ~np.isfinite(self._size2)  # the camera: they count as far off, and ask for nothing
        J = (self._white @ self._slopes).reshape(*self._off.shape, -1)
        off = self._off.copy()
        off[behind], J[behind] = 0.0, 0.0
        JW = (J * weight[:, None, None]).reshape(-1, J.shape[-1])
        A = np.asarray(JW.T @ J.reshape(-1, J.shape[-1]) + self._known)
        return A, np.asarray(JW.T @ off.ravel() - self._known @ self._d)
