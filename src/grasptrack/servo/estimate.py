# SPDX-License-Identifier: Apache-2.0
"""What the image Jacobian is made of, estimated while the hand moves: camera, mounting, and where the object is and goes.

The entries of the image Jacobian are functions of few unknowns: focal length, mounting, and the points' places. A robust
extended Kalman filter holds these; its measurements are the points in each image, at the hand poses that the robot reports.
Long ways of the hand tell far more than differences from image to image, and the rotational column, which changes with every
motion, needs no memory of its own. A filter keeps the places at which it once linearised and is then too sure of what it has;
`refine_estimate` linearises every observation anew at the present result.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from grasptrack.servo.camera import HandCamera, NominalCamera
from grasptrack.servo.model import (
    FOCAL,
    OFFSET,
    PLACE,
    POSE,
    SHAPE,
    SPEED,
    TURN,
    Placed,
    advance_state,
    expected_sightings,
    pack_state,
    retract_state,
    state_difference,
    unpack_state,
)
from grasptrack.servo.observation import Observation, ObservationStack, block_diagonal, stack_observations
from grasptrack.typing import Floats

ROBUST_SIZE = 3.0
"""Innovations of so many standard deviations count a quarter (Geman and McClure)."""
OUTLIER_SIZE = 5.0
"""Innovations of so many are no news of the same motion."""
AGREEING_IMAGES = 5
"""So many such images in a row that agree with each other say that the object has been displaced."""
PLACE_DRIFT, TURN_DRIFT = 1e-4, 1e-3
"""m and rad per root of a second by which the object may creep."""
SPEED_DRIFT, PUSHED_SPEED_DRIFT = 0.002, 1.0
"""m/s per root of a second by which its velocity changes, and by which just after it was displaced."""
PUSHED_SECONDS = 1.0
"""s for which a displaced object is taken to be on the move."""
MOVING_SIZE, MIN_SPEED = 3.0, 0.002
"""Standard deviations and m/s from which on a velocity is one."""
BEHIND_FACTOR = 2.0
"""So many times as far as aside may a camera be from the hand's origin along the approach direction."""


@dataclass(frozen=True)
class Prior:
    """Standard deviations at the start: log focal length, rad, m, m/s; `scale` is that of the log of the object's distance."""

    focal: float = 0.35
    tilt: float = 0.2
    spin: float = 0.2
    offset: float = 0.15
    place: float = 0.3
    scale: float = 0.3
    slope: float = 0.01
    speed: float = 0.3

    def prior_covariance(self, camera: HandCamera, object_: Placed, hand: Floats) -> Floats:
        """(16 + 2n, 16 + 2n) of all unknowns."""
        n = SHAPE + 2 * len(object_.points)
        deviation = np.full(n, 0.1 * float(np.abs(object_.points).max()))
        deviation[FOCAL], deviation[TURN] = self.focal, (self.tilt, self.tilt, self.spin)
        deviation[OFFSET] = self.offset, self.offset, BEHIND_FACTOR * self.offset
        deviation[PLACE], deviation[POSE], deviation[SPEED] = self.place, (self.slope, self.slope, 0.2), self.speed
        farther = np.zeros(n)
        farther[PLACE] = object_.place - (hand[:3, :3] @ camera.offset + hand[:3, 3])
        farther[SHAPE:] = object_.points.ravel()
        return np.asarray(np.diag(deviation**2) + self.scale**2 * np.outer(farther, farther))


class Estimate:
    """Camera and object as they are known so far.

    Args:
        state: (39 + 2n,), both as `pack_state` makes them.
        covariance: (16 + 2n, 16 + 2n) of its error.
        time: s, at which the object is where it is said to be.

    Attributes:
        packed_state: the state now.
    """

    linearised_at_goal = False  # the interaction matrix is that of where the points are

    def __init__(self, state: Floats, covariance: Floats, time: float) -> None:
        self._set_state(state, covariance)
        self.time = time
        self.displaced_at = -np.inf
        self._away: list[Floats] = []

    def _set_state(self, state: Floats, covariance: Floats) -> None:
        self.packed_state, self.covariance = state, covariance
        self.camera, self.object = unpack_state(state)

    def advance(self, time: float, evenly: bool = False) -> None:
        """Let the object go on to a later time, s; `evenly` where its velocity is known not to have changed."""
        dt = time - self.time
        if dt <= 0.0:
            return
        self.time = time
        may = (0.0, 0.0, 0.0) if evenly else (PLACE_DRIFT**2, self.wander_at(time) ** 2, TURN_DRIFT**2)
        self._set_state(*advance_state(self.packed_state, self.covariance, dt, *may))

    def wander_at(self, time: float) -> float:
        """m/s per root of a second by which the object's velocity changes at a time, s."""
        return PUSHED_SPEED_DRIFT if time < self.displaced_at + PUSHED_SECONDS else SPEED_DRIFT

    def in_hand(self, hand: Floats, time: float | None = None) -> Floats:
        """The points (n, 3) m in the frame of a hand at a pose (4, 4), at a time in s (default: the estimate's)."""
        o, R = self.object, hand[:3, :3]
        place = o.place - hand[:3, 3] if time is None else o.place - hand[:3, 3] + (time - self.time) * o.velocity()
        return np.asarray((o.points @ o.turn[:, :2].T + place) @ R)

    def observe(self, seen: Observation) -> float:
        """Take in what was seen; the innovation in rms standard deviations, inf where nothing could be compared."""
        self.advance(seen.time)
        state, covariance, off, size = filter_sighting(self.packed_state, self.covariance, seen)
        if math.isfinite(size):
            self._count_outliers(off, size)
            self._set_state(state, covariance)
        return size

    @property
    def is_displaced(self) -> bool:
        """Whether this and the images before it agree that the object is not where it was expected."""
        return len(self._away) >= AGREEING_IMAGES

    def _count_outliers(self, off: Floats, size: float) -> None:
        if size < OUTLIER_SIZE or (self._away and np.abs(off - self._away[-1]).max() > 0.5 * np.abs(off).max()):
            self._away.clear()
        if size >= OUTLIER_SIZE:
            self._away.append(off)

    def release_object(self, time: float) -> None:
        """The object has been displaced: let its place, turn and velocity be found anew; camera and shape stay."""
        self.displaced_at = time
        self._away.clear()
        axes, P = self.object.axes, self.covariance
        P[PLACE, PLACE] += 0.05**2 * axes @ axes.T
        P[POSE.stop - 1, POSE.stop - 1] += 0.3**2
        P[SPEED, SPEED] += 0.2**2 * np.eye(3)

    def adopt_outliers(self, other: Estimate) -> None:
        """Remember what another estimate of the same object saw last that did not fit."""
        self._away = other._away

    def object_velocity(self) -> Floats:
        """The object's velocity in the base, (3,) m/s; 0 where that is no more than noise."""
        speed, velocity = self.object.speed, self.object.velocity()
        if float(velocity @ velocity) <= MIN_SPEED**2:
            return np.zeros(3)
        known = float(speed @ np.linalg.solve(self.covariance[SPEED, SPEED], speed))
        return velocity if known > MOVING_SIZE**2 else np.zeros(3)

    def relative_error(self) -> float:
        """The standard deviation of the first two contacts' distance, over that distance."""
        a, b, c, d = self.object.points[:2].ravel().tolist()
        row = np.array((a - c, b - d, c - a, d - b))
        variance = float(row @ self.covariance[SHAPE : SHAPE + 4, SHAPE : SHAPE + 4] @ row)
        return math.sqrt(max(variance, 0.0)) / max(math.hypot(a - c, b - d) ** 2, 1e-12)

    def plane_normal(self, hand: Floats) -> Floats:
        """The plane's normal (3,) in the hand's frame, away from the hand."""
        n = hand[:3, :3].T @ self.object.turn[:, 2]
        return np.asarray(n if n[2] > 0.0 else -n)


def filter_sighting(
    state: Floats, covariance: Floats, seen: Observation, robust: float = ROBUST_SIZE
) -> tuple[Floats, Floats, Floats, float]:
    """One update of an extended Kalman filter by what was seen at the state's time.

    Args:
        state: (39 + 2n,) before.
        covariance: (16 + 2n, 16 + 2n) of its error.
        seen: the sighting.
        robust: innovations of so many standard deviations count a quarter: the noise grows with the innovation (Geman and
            McClure's weight).

    Returns:
        State and covariance after; (2n,) px, what was seen less what was expected; the innovation in standard deviations
        (root of the mean square), infinite where a point would lie behind the camera: nothing is changed then.
    """
    pixels, H = expected_sightings(state, seen.hand[None], np.zeros(1))
    off = (seen.points - pixels).ravel()
    if not np.isfinite(pixels).all():
        return state.copy(), covariance.copy(), off, float("inf")
    R = block_diagonal(seen.noise)
    PH = covariance @ H.T
    size = rms_deviations(off, H @ PH + R)
    gain = np.linalg.solve(H @ PH + R * (1.0 + (size / robust) ** 2) ** 2, PH.T).T
    P = covariance - gain @ PH.T
    return retract_state(state, gain @ off), np.asarray(0.5 * (P + P.T)), off, size


def place_object(camera: HandCamera, seen: Observation, depth: float, slope: float = 0.0) -> Placed:
    """The object as it lies if it is seen `depth` m before the camera, its plane facing the hand.

    The plane in which it moves may be tilted against that by `slope`, rad.
    """
    (origin, rays), facing = _rays_in_base(camera, seen), seen.hand[:3, :3]
    height = rays @ facing[:, 2]
    points = origin + depth * rays * (height.mean() / height)[:, None]
    place = points[: seen.contacts].mean(axis=0)
    return Placed((points - place) @ facing[:, :2], facing, place, np.zeros(3), facing * (1.0, 1.0, slope))


def on_plane(camera: HandCamera, object_: Placed, seen: Observation) -> Floats | None:
    """Where other points of the object lie in its plane, (n, 2) m; None where they are not seen on it."""
    origin, rays = _rays_in_base(camera, seen)
    normal = object_.turn[:, 2]
    far = ((object_.place - origin) @ normal) / (rays @ normal)
    if not (np.isfinite(far).all() and (far > 0.0).all()):
        return None
    return np.asarray((origin + far[:, None] * rays - object_.place) @ object_.turn[:, :2])


def _rays_in_base(camera: HandCamera, seen: Observation) -> tuple[Floats, Floats]:
    """The camera's place (3,) m in the base, and the directions (n, 3) there of what is seen."""
    R = seen.hand[:3, :3]
    return R @ camera.offset + seen.hand[:3, 3], camera.ray_directions(seen.points) @ R.T


def normalized_residual(known: Estimate, seen: Observation) -> float:
    """How far off a sighting is, in its own rms standard deviations."""
    off = (seen.points - known.camera.project(known.in_hand(seen.hand, seen.time))).ravel()
    return rms_deviations(off, block_diagonal(seen.noise))


def rms_deviations(off: Floats, covariance: Floats) -> float:
    """The size of an error (m,) of a covariance (m, m), in standard deviations (root of the mean square)."""
    return float(np.sqrt(off @ np.linalg.solve(covariance, off) / len(off)))


SETTLED_FALL, MAX_DAMPING = 1e-2, 1e6
"""Fall of the cost, in squared standard deviations, and damping at which a search ends."""
MAX_TURN = 0.5
"""rad by which a step may turn camera or object: one that tips the object's plane over ends where its back explains almost
as much, and no small step leads back."""


@dataclass(frozen=True)
class Origin:
    """What was known before: the likeliest camera and object at a time, s, and the covariance (16 + 2n, 16 + 2n)."""

    camera: HandCamera
    object: Placed
    covariance: Floats
    time: float

    @cached_property
    def information_matrix(self) -> Floats:
        """The inverse of the covariance."""
        return np.asarray(np.linalg.inv(self.covariance), dtype=np.float64)

    @cached_property
    def packed_state(self) -> Floats:
        """Camera and object as `pack_state` makes them."""
        return pack_state(self.camera, self.object)


@dataclass(frozen=True)
class Search:
    """Where the search for the best camera and object has come to, at the origin's time.

    Attributes:
        state: (39 + 2n,), camera and object as `pack_state` makes them.
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
    sightings, now = stack_observations(seen, origin.time), start or Search(origin.packed_state)
    found, covariance = calibrate_batch(origin.packed_state, origin.information_matrix, sightings, now, steps)
    made = Estimate(found.state, covariance, origin.time)
    made.advance(seen[-1].time, evenly=True)
    return made, replace(found, damping=min(found.damping, 1.0))


def calibrate_batch(
    origin: Floats, known: Floats, seen: ObservationStack, start: Search, steps: int
) -> tuple[Search, Floats]:
    """The state that explains all sightings best, with what was known before as a prior.

    Residuals of a sighting count together, in Geman and McClure's function: where their rms is `ROBUST_SIZE` times the scale,
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
        LinAlgError: a noise that is not positive, or equations that are singular.
    """
    evidence = _Evidence(origin, known, seen)
    now, damping = start.state.copy(), start.damping
    evidence.compute_residuals(now)
    scale = evidence.estimate_scale(None)
    cost = evidence.compute_cost(scale)
    A, b = evidence.normal_equations(scale)
    settled = False
    for _ in range(steps):
        step = np.asarray(np.linalg.solve(A + damping * np.diag(np.diag(A)), b))
        found = np.inf
        if max(np.linalg.norm(step[TURN]), np.linalg.norm(step[POSE])) <= MAX_TURN:
            tried = retract_state(now, step)
            evidence.compute_residuals(tried)
            found = evidence.compute_cost(scale)
        if found <= cost:
            settled = cost - found < SETTLED_FALL
            now, (A, b), damping = tried, evidence.normal_equations(scale), max(damping / 5.0, 1e-9)
            if not settled:
                scale = evidence.estimate_scale(scale)
            cost = evidence.compute_cost(scale)
        else:
            damping *= 10.0
            settled = damping > MAX_DAMPING
        if settled:
            break
    return Search(now, damping, settled, scale), np.asarray(np.linalg.inv(A), dtype=np.float64)


class WhitenedSightings:
    """Sightings, and what a state leaves of them, in their own standard deviations."""

    def __init__(self, seen: ObservationStack) -> None:
        self._seen, self._white = seen, np.linalg.inv(np.linalg.cholesky(seen.noise))

    def residuals(self, state: Floats) -> tuple[Floats, Floats]:
        """Residuals (N, 2n), NaN behind the camera, and derivatives (N, n, 2, 16 + 2n) of pixels, not whitened yet."""
        seen, shape = self._seen, self._seen.points.shape
        pixels, slopes = expected_sightings(state, seen.hands, seen.times)
        off = (self._white @ (seen.points - pixels.reshape(shape))[..., None])[..., 0]
        return off.reshape(len(seen.hands), -1), slopes.reshape(*shape, -1)

    def whitened_jacobian(self, slopes: Floats) -> Floats:
        """(N, 2n, 16 + 2n), whitened."""
        return np.asarray((self._white @ slopes).reshape(len(slopes), -1, slopes.shape[-1]))


class _Evidence:
    """The sightings as one system of equations."""

    def __init__(self, origin: Floats, known: Floats, seen: ObservationStack) -> None:
        self._origin, self._known, self._seen = origin, known, WhitenedSightings(seen)

    def compute_residuals(self, state: Floats) -> None:
        """What a state leaves of the sightings, and of what was known before."""
        self._off, self._slopes = self._seen.residuals(state)
        size2 = (self._off * self._off).mean(axis=1)
        self._size2 = np.where(np.isnan(size2), np.inf, size2)
        self._d = state_difference(self._origin, state)

    def compute_cost(self, scale: float) -> float:
        """In squared standard deviations."""
        u = self._size2 / (ROBUST_SIZE * scale) ** 2
        share = np.divide(u, 1.0 + u, out=np.ones_like(u), where=np.isfinite(u))
        prior = float(self._d @ self._known @ self._d)
        return float(self._off.shape[1] * (ROBUST_SIZE * scale) ** 2 * share.sum()) + prior

    def estimate_scale(self, last: float | None) -> float:
        """The scale of what is left, where it is not much like the last one."""
        now = max(1.0, 1.5 * float(np.sqrt(np.median(self._size2))))
        now = now if np.isfinite(now) else 1e3
        return now if last is None or abs(now - last) > 0.2 * last else last

    def normal_equations(self, scale: float) -> tuple[Floats, Floats]:
        """The normal equations A x = b."""
        weight = 1.0 / (1.0 + self._size2 / (ROBUST_SIZE * scale) ** 2) ** 2
        behind = ~np.isfinite(self._size2)  # the camera: they count as far off, and ask for nothing
        J, off = self._seen.whitened_jacobian(self._slopes), self._off.copy()
        off[behind], J[behind] = 0.0, 0.0
        JW = (J * weight[:, None, None]).reshape(-1, J.shape[-1])
        A = np.asarray(JW.T @ J.reshape(-1, J.shape[-1]) + self._known)
        return A, np.asarray(JW.T @ off.ravel() - self._known @ self._d)


class ClassicalIBVS:
    """The textbook's law: stands where `Estimate` stands, and the object rests where the nominal camera saw it last.

    Camera and distance are as believed at the first sighting; `centre` (2,) px is the middle of the image.
    """

    linearised_at_goal = True

    def __init__(self, seen: Observation, believed: NominalCamera, centre: Floats) -> None:
        self.camera = believed.camera(centre)
        self._length = seen.contact_spread * believed.distance / self.camera.focal
        self.observe(seen)

    def observe(self, seen: Observation) -> float:
        """Put the object where it is seen now; it always fits."""
        depth = self.camera.focal * self._length / seen.contact_spread
        self.object = place_object(self.camera, seen, depth)
        return 0.0

    def in_hand(self, hand: Floats, time: float | None = None) -> Floats:
        """The points (n, 3) m in the hand's frame."""
        return np.asarray((self.object.in_base() - hand[:3, 3]) @ hand[:3, :3])

    def object_velocity(self) -> Floats:
        """(3,) m/s: none is estimated."""
        return np.zeros(3)

    def plane_normal(self, hand: Floats) -> Floats:
        """The plane's normal (3,) in the hand's frame: it is taken to face the hand as at the last sighting."""
        return np.asarray(hand[:3, :3].T @ self.object.turn[:, 2])

    def relative_error(self) -> float:
        """Nothing is doubted."""
        return 0.0
