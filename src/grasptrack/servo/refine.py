# SPDX-License-Identifier: Apache-2.0
"""Camera and object from all sightings at once: robust Levenberg-Marquardt, with what was known before as a prior.

The filter stays linearised where it was when a sighting came, and is then too sure of what it has. Here every sighting is
linearised anew at the present result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasptrack.servo.camera import HandCamera
from grasptrack.servo.estimate import ROBUST, Estimate
from grasptrack.servo.geometry import rotation_vector
from grasptrack.servo.model import FOCAL, OFFSET, PLACE, POSE, SHAPE, SPEED, TURN, Placed, changed, expected
from grasptrack.servo.sighting import Sighting

Floats = NDArray[np.float64]

SETTLED, HOPELESS = 1e-2, 1e6
"""Fall of the cost, in squared standard deviations, and damping at which a search ends."""


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


@dataclass(frozen=True)
class Search:
    """Where the search for the best camera and object has come to, at the origin's time.

    Attributes:
        camera: the camera.
        object: the object.
        damping: of the next step.
        settled: whether no step leads farther.
        scale: 1.5 times the median of the residuals, in standard deviations, or 1.
    """

    camera: HandCamera
    object: Placed
    damping: float = 1e-3
    settled: bool = False
    scale: float = 1.0


def refined(
    origin: Origin, seen: Sequence[Sighting], start: Search | None = None, steps: int = 10
) -> tuple[Estimate, Search]:
    """The estimate from what was known before and all sightings, at the time of the last one.

    Args:
        origin: the prior.
        seen: sightings of an object that rests or moves evenly; some may be wrong.
        start: where an earlier search had come to; default the prior's camera and object.
        steps: most steps. A search that has not settled can go on from what is returned.
    """
    evidence = _Evidence(origin, seen)
    now = start or Search(origin.camera, origin.object)
    camera, object_, damping = now.camera, now.object, now.damping
    cost, scale, A, b = evidence.at(camera, object_, None)
    settled = False
    for _ in range(steps):
        step = np.asarray(np.linalg.solve(A + damping * np.diag(np.diag(A)), b), dtype=np.float64)
        tried = changed(camera, object_, step)
        found, scale, A_found, b_found = evidence.at(*tried, scale)
        if found <= cost:
            settled = cost - found < SETTLED
            (camera, object_), A, b, damping = tried, A_found, b_found, max(damping / 5.0, 1e-9)
            cost, scale, *_ = (found, scale) if settled else evidence.again(scale)
        else:
            damping *= 10.0
            settled = damping > HOPELESS
        if settled:
            break
    made = Estimate(camera, object_, np.asarray(np.linalg.inv(A), dtype=np.float64), origin.time)
    made.advance(seen[-1].time, evenly=True)
    return made, Search(camera, object_, min(damping, 1.0), settled, scale)


class _Evidence:
    """The sightings as one system of equations."""

    def __init__(self, origin: Origin, seen: Sequence[Sighting]) -> None:
        self._origin, self._known = origin, np.linalg.inv(origin.covariance)
        self._hands = np.array([s.hand for s in seen])
        self._later = np.array([s.time - origin.time for s in seen])
        self._points = np.array([s.points for s in seen])
        self._white = np.linalg.inv(np.linalg.cholesky(np.array([s.noise for s in seen])))

    def at(self, camera: HandCamera, object_: Placed, scale: float | None) -> tuple[float, float, Floats, Floats]:
        """Cost, scale of the residuals, and the normal equations; a scale of None is taken from the residuals."""
        with np.errstate(all="ignore"):
            pixels, slopes = expected(camera, object_, self._hands, self._later)
        off = (self._white @ (self._points - pixels)[..., None])[..., 0]
        self._size2 = np.nan_to_num((off * off).mean(axis=(1, 2)), nan=np.inf)
        self._values = off[0].size
        d = _difference((camera, object_), self._origin)
        self._prior = float(d @ self._known @ d)
        cost, scale = self.again(scale) if scale is None else (self._cost(scale), scale)
        weight = 1.0 / (1.0 + self._size2 / (ROBUST * scale) ** 2) ** 2
        J = (self._white @ slopes).reshape(len(off), self._values, -1)
        behind = ~np.isfinite(self._size2)  # the camera: they count as far off, and ask for nothing
        off[behind], J[behind] = 0.0, 0.0
        JW = (J * weight[:, None, None]).reshape(-1, J.shape[-1])
        A = np.asarray(JW.T @ J.reshape(-1, J.shape[-1]) + self._known)
        return cost, scale, A, np.asarray(JW.T @ off.ravel() - self._known @ d)

    def _cost(self, scale: float) -> float:
        u = self._size2 / (ROBUST * scale) ** 2
        share = np.divide(u, 1.0 + u, out=np.ones_like(u), where=np.isfinite(u))
        return float(self._values * (ROBUST * scale) ** 2 * share.sum()) + self._prior

    def again(self, scale: float | None) -> tuple[float, float]:
        """Cost and scale of the last residuals, where the scale has changed."""
        now = max(1.0, 1.5 * float(np.sqrt(np.median(self._size2))))
        now = now if np.isfinite(now) else 1e3
        scale = now if scale is None or abs(now - scale) > 0.2 * scale else scale
        return self._cost(scale), scale


def _difference(now: tuple[HandCamera, Placed], origin: Origin) -> Floats:
    """The error (16 + 2n,) that takes the origin to what is tried."""
    camera, o = now
    d = np.zeros(len(origin.covariance))
    d[FOCAL] = np.log(camera.focal / origin.camera.focal)
    d[TURN] = rotation_vector(origin.camera.turn.T @ camera.turn)
    d[OFFSET] = camera.offset - origin.camera.offset
    d[PLACE], d[SPEED] = o.place - origin.object.place, o.speed - origin.object.speed
    d[POSE] = rotation_vector(origin.object.turn.T @ o.turn)
    d[SHAPE:] = (o.points - origin.object.points).ravel()
    return d
