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


@dataclass(frozen=True)
class Origin:
    """What was known before.

    Attributes:
        camera: most likely.
        object: most likely, at `time`.
        covariance: (15 + 2n, 15 + 2n).
        time: s.
    """

    camera: HandCamera
    object: Placed
    covariance: Floats
    time: float


def refined(
    origin: Origin, seen: Sequence[Sighting], start: tuple[HandCamera, Placed] | None = None, steps: int = 10
) -> Estimate:
    """The estimate from what was known before and all sightings, at the time of the last one.

    Args:
        origin: the prior.
        seen: sightings of an object that rests or moves evenly; some may be wrong.
        start: camera and object, at the origin's time, to begin from; default the prior's.
        steps: most steps.
    """
    hands, later = np.array([s.hand for s in seen]), np.array([s.time - origin.time for s in seen])
    points, noise = np.array([s.points for s in seen]), np.linalg.inv(np.array([s.noise for s in seen]))
    known = np.linalg.inv(origin.covariance)
    camera, object_ = start or (origin.camera, origin.object)
    damping, least, A = 1e-3, np.inf, known
    scale = 0.0
    system: tuple[Floats, Floats] | None = None
    step = np.zeros(len(known))
    for _ in range(steps):
        tried = changed(camera, object_, step)
        pixels, slopes = expected(*tried, hands, later)
        off = points - pixels
        size = np.sqrt(np.einsum("nki,nkij,nkj->n", off, noise, off) / (2.0 * off.shape[1]))
        if scale == 0.0:
            scale = max(1.0, 1.5 * float(np.nanmedian(size))) if np.isfinite(size).any() else 1.0
        d = _difference(tried, origin)
        with np.errstate(invalid="ignore"):
            u = (size / (ROBUST * scale)) ** 2
            cost = float(np.sum(off.shape[1] * 2.0 * (ROBUST * scale) ** 2 * u / (1.0 + u)) + d @ known @ d)
        if system is None or cost < least:
            done = system is not None and least - cost < 1e-3
            (camera, object_), least, damping = tried, cost, damping / 5.0
            weight = 1.0 / (1.0 + u) ** 2
            scale_now = max(1.0, 1.5 * float(np.median(size)))
            weighted = np.einsum("n,nkij,nkja->nkia", weight, noise, slopes)
            A = np.einsum("nkia,nkib->ab", slopes, weighted) + known
            b = np.einsum("nkia,nki->a", weighted, off) - known @ d
            system = A, b
            if abs(scale_now - scale) > 0.2 * scale:
                scale, least = scale_now, np.inf
            elif done:
                break
        else:
            damping *= 10.0
        A, b = system
        step = np.asarray(np.linalg.solve(A + damping * np.diag(np.diag(A)), b))
    last = seen[-1].time
    made = Estimate(camera, object_, np.linalg.inv(A), origin.time)
    made.advance(last, evenly=True)
    return made


def at_origin(origin: Origin, found: Estimate) -> tuple[HandCamera, Placed]:
    """What was found, the object where it was at the origin's time: where the next search begins."""
    return found.camera, found.object.later(origin.time - found.time)


def _difference(now: tuple[HandCamera, Placed], origin: Origin) -> Floats:
    """The error (15 + 2n,) that takes the origin to what is tried."""
    camera, o = now
    d = np.zeros(len(origin.covariance))
    d[FOCAL] = np.log(camera.focal / origin.camera.focal)
    d[TURN] = rotation_vector(origin.camera.turn.T @ camera.turn)
    d[OFFSET] = camera.offset - origin.camera.offset
    d[PLACE], d[SPEED] = o.place - origin.object.place, o.speed - origin.object.speed
    d[POSE] = rotation_vector(origin.object.turn.T @ o.turn)
    d[SHAPE:] = (o.points - origin.object.points).ravel()
    return d
