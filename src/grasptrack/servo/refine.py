# SPDX-License-Identifier: Apache-2.0
"""Camera and object from all sightings at once: robust Levenberg-Marquardt, with what was known before as a prior.

The filter stays linearised where it was when a sighting came, and is then too sure of what it has. Here every sighting is
linearised anew at the present result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from grasptrack.servo.camera import HandCamera
from grasptrack.servo.estimate import ROBUST, Estimate
from grasptrack.servo.model import (
    POSE,
    TURN,
    Placed,
    check_size,
    count_points,
    expected_sightings,
    pack_state,
    retract_state,
    state_difference,
)
from grasptrack.servo.sighting import Observation, stack_observations
from grasptrack.typing import Floats

SETTLED, HOPELESS = 1e-2, 1e6
"""Fall of the cost, in squared standard deviations, and damping at which a search ends."""
FARTHEST = 0.5
"""rad by which a step may turn camera or object: one that tips the object's plane over ends where its back explains almost
as much, and no small step leads back."""


@dataclass(frozen=True)
class Origin:
    """What was known before.

    Attributes:
        camera: most likely.
        object: most likely, at `time`.
        covariance: (16 + 2n, 16 + 2n).
        time: s.
    """

    camera: HandCamera
    object: Placed
    covariance: Floats
    time: float

    @cached_property
    def known(self) -> Floats:
        """The inverse of the covariance."""
        return np.asarray(np.linalg.inv(self.covariance), dtype=np.float64)

    @cached_property
    def state(self) -> Floats:
        """Camera and object as `model.packed` makes them."""
        return pack_state(self.camera, self.object)


@dataclass(frozen=True)
class Search:
    """Where the search for the best camera and object has come to, at the origin's time.

    Attributes:
        state: (39 + 2n,), camera and object as `model.packed` makes them.
        damping: of the next step.
        settled: whether no step leads farther.
        scale: 1.5 times the median of the residuals, in standard deviations, or 1.
    """

    state: Floats
    damping: float = 1e-3
    settled: bool = False
    scale: float = 1.0


def refine_estimate(
    origin: Origin, seen: Sequence[Observation], start: Search | None = None, steps: int = 10
) -> tuple[Estimate, Search]:
    """The estimate from what was known before and all sightings, at the time of the last one.

    Args:
        origin: the prior.
        seen: sightings of an object that rests or moves evenly; some may be wrong.
        start: where an earlier search had come to; default the prior's camera and object.
        steps: most steps. A search that has not settled can go on from what is returned.
    """
    times, hands, points, noise = stack_observations(seen)
    now = start or Search(origin.state)
    sightings = Sightings(hands, times - origin.time, points, noise)
    found, covariance = calibrate_batch(origin.state, origin.known, sightings, now, steps)
    made = Estimate(found.state, covariance, origin.time)
    made.advance(seen[-1].time, evenly=True)
    return made, replace(found, damping=min(found.damping, 1.0))


class Sightings(NamedTuple):
    """What was seen from N poses.

    Attributes:
        hands: (N, 4, 4) poses in the base.
        later: (N,) s, of each after the time of the states.
        points: (N, n, 2) px, where they were seen.
        noise: (N, n, 2, 2) px^2.
    """

    hands: Floats
    later: Floats
    points: Floats
    noise: Floats


def calibrate_batch(origin: Floats, known: Floats, seen: Sightings, start: Search, steps: int) -> tuple[Search, Floats]:
    """The state that explains all sightings best, with what was known before as a prior.

    Residuals of a sighting count together, in Geman and McClure's function: where their rms is `ROBUST` times the scale,
    a quarter. A step that would turn camera or object by more than half a radian is damped as one that explains less.

    Args:
        origin: (39 + 2n,), the most likely state before.
        known: (16 + 2n, 16 + 2n), the inverse of its covariance.
        seen: all sightings.
        start: where the search begins.
        steps: most steps.

    Returns:
        Where the search has come to, and the covariance (16 + 2n, 16 + 2n) of that state.

    Raises:
        ValueError: a size that is none, a noise that is not positive, or equations that are singular.
    """
    n, N = count_points(origin), len(seen.hands)
    check_size(known, n)
    if not N or seen.hands.shape[1:] != (4, 4) or len(seen.later) != N:
        raise ValueError("poses are (N, 4, 4), one or more, each with its time")
    if len(start.state) != len(origin):
        raise ValueError("both states have as many points")
    if seen.points.shape != (N, n, 2) or seen.noise.shape != (N, n, 2, 2):
        raise ValueError("each point needs its noise, (2, 2)")
    evidence = _Evidence(origin, known, seen)
    now, damping = start.state.copy(), start.damping
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
            settled = cost - found < SETTLED
            now, (A, b), damping = tried, evidence.equations(scale), max(damping / 5.0, 1e-9)
            if not settled:
                scale = evidence.scale(scale)
            cost = evidence.cost(scale)
        else:
            damping *= 10.0
            settled = damping > HOPELESS
        if settled:
            break
    return Search(now, damping, settled, scale), np.asarray(np.linalg.inv(A), dtype=np.float64)


class _Evidence:
    """The sightings as one system of equations."""

    def __init__(self, origin: Floats, known: Floats, seen: Sightings) -> None:
        self._origin, self._known, self._seen = origin, known, seen
        self._white = np.linalg.inv(np.linalg.cholesky(seen.noise))

    def look(self, state: Floats) -> None:
        """What a state leaves of the sightings, and of what was known before."""
        pixels, slopes = expected_sightings(state, self._seen.hands, self._seen.later)
        shape = self._seen.points.shape
        self._off = (self._white @ (self._seen.points - pixels.reshape(shape))[..., None])[..., 0].reshape(
            len(self._seen.hands), -1
        )
        self._slopes = slopes.reshape(*shape, -1)
        size2 = (self._off * self._off).mean(axis=1)
        self._size2 = np.where(np.isnan(size2), np.inf, size2)
        self._d = state_difference(self._origin, state)

    def cost(self, scale: float) -> float:
        """In squared standard deviations."""
        u = self._size2 / (ROBUST * scale) ** 2
        share = np.divide(u, 1.0 + u, out=np.ones_like(u), where=np.isfinite(u))
        prior = float(self._d @ self._known @ self._d)
        return float(self._off.shape[1] * (ROBUST * scale) ** 2 * share.sum()) + prior

    def scale(self, last: float | None) -> float:
        """The scale of what is left, where it is not much like the last one."""
        now = max(1.0, 1.5 * float(np.sqrt(np.median(self._size2))))
        now = now if np.isfinite(now) else 1e3
        return now if last is None or abs(now - last) > 0.2 * last else last

    def equations(self, scale: float) -> tuple[Floats, Floats]:
        """The normal equations A x = b."""
        weight = 1.0 / (1.0 + self._size2 / (ROBUST * scale) ** 2) ** 2
        behind = ~np.isfinite(self._size2)  # the camera: they count as far off, and ask for nothing
        J = (self._white @ self._slopes).reshape(*self._off.shape, -1)
        off = self._off.copy()
        off[behind], J[behind] = 0.0, 0.0
        JW = (J * weight[:, None, None]).reshape(-1, J.shape[-1])
        A = np.asarray(JW.T @ J.reshape(-1, J.shape[-1]) + self._known)
        return A, np.asarray(JW.T @ off.ravel() - self._known @ self._d)
