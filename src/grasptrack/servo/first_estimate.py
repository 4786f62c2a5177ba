# SPDX-License-Identifier: Apache-2.0
"""What the exploratory moves tell: the first estimate of camera and object, and what is wrong with the set-up.

The moves go one axis at a time, there and back, at rest at both ends. Let complex numbers stand for vectors across the approach
direction. A hand at p, turned by theta, sees the middle of the contacts at s = m exp(-i theta) (P + V t - p) - tau, in units of
their distance in the image: m = exp(-i phi) / L holds the mounting angle phi and the length L of the segment in m, tau the
camera's offset, V the object's velocity. This is linear in m, m P, m V and tau. The focal length follows from how the distance
in the image changes with height.

The moves are few and known, so that each fault makes a pattern of its own: a mirrored view turns against the hand, an object
seems to shrink when a hand whose z is turned round comes nearer, and what is seen of a late image comes after the move. Each is
a hypothesis that has to explain the sightings, and the right one must not. The estimate of a hand of 4 degrees of freedom takes
the part's plane to be square to the approach direction: a tilt is found by explaining the same sightings with the plane left
free, until it is known as well as matters for the fingertips.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import GraspTrackError
from grasptrack.geometry.homographies import rotation_about_z
from grasptrack.servo.camera import HandCamera, NominalCamera, complex_numbers, inverse_pose
from grasptrack.servo.estimate import (
    Estimate,
    Origin,
    Prior,
    Search,
    normalized_residual,
    place_object,
    refine_estimate,
)
from grasptrack.servo.model import POSE
from grasptrack.servo.observation import MIN_NOISE_PX, Observation
from grasptrack.typing import Floats

Complex = NDArray[np.complex128]

SUBSETS, SUBSET_SIZE, REWEIGHTINGS, INITIAL_STEPS = 100, 6, 5, 30
"""Random small sets, how many sightings are in each, rounds of reweighting after the best of them; steps of the search."""
OFFSET_GUESS, SPEED_GUESS, LENGTH_GUESS, FOCAL_GUESS = 0.15, 0.3, 0.05, 1.1
"""Before anything is known: m of the camera's offset, m/s of the object, m between contacts, focal length over the image's
larger side."""
NOMINAL_PRIOR = Prior(focal=0.15, tilt=0.15, spin=0.2, offset=0.03, scale=0.5)
"""How far a nominal camera may be off."""
MOVE_NOISE_PX = 0.5
"""px, the standard deviation at which a sighting counts here: that a part is not flat, and a move not pure, is in it."""


class ImageFrame(NamedTuple):
    """The images: their middle (2,) px, and their larger side, px."""

    centre: Floats
    side: float


class Signals(NamedTuple):
    """Sightings as the linear model of the moves takes them.

    Attributes:
        p, theta: (N,) the hand across the approach direction, m, and its turn, rad.
        z: (N,) m, along it.
        t: (N,) s.
        s: (N,) middle of the contacts over their distance in the image.
        length: (N,) px, that distance.
        segment: (N,) px, from the first contact to the second.
    """

    p: Complex
    theta: Floats
    z: Floats
    t: Floats
    s: Complex
    length: Floats
    segment: Complex

    @property
    def signal_noise(self) -> Floats:
        """(N,) of s."""
        return MOVE_NOISE_PX / self.length


def signals_of(seen: Sequence[Observation], base: Floats, centre: Floats) -> Signals:
    """Sightings in the frame (4, 4) whose inverse is `base`; `centre` (2,) px is the middle of the image."""
    poses = np.array([base @ s.hand for s in seen])
    contacts = [s.points[: s.contacts] for s in seen]
    length = np.array([s.contact_spread for s in seen])
    middle = np.array([sum(complex_numbers(c)) / len(c) for c in contacts]) - complex(*centre)
    segment = np.array([complex(*(c[1] - c[0])) for c in contacts])
    theta = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    t = np.array([s.time - seen[0].time for s in seen])
    return Signals(poses[:, 0, 3] + 1j * poses[:, 1, 3], theta, poses[:, 2, 3], t, middle / length, length, segment)


class UnexploredError(GraspTrackError):
    """The moves so far do not tell enough: the message says what is missing. Caught by the servo."""


class FirstEstimate(NamedTuple):
    """What was known before, the estimate after the observations, and where the search for it has come to."""

    origin: Origin
    estimate: Estimate
    search: Search


def initialize_calibration(
    seen: Sequence[Observation], frame: ImageFrame, slope: float, widest: float = 1.0
) -> FirstEstimate:
    """What was known before, and the estimate after all sightings of exploratory moves.

    Args:
        seen: sightings in the order of time, some of them wrong.
        frame: middle and size of the images.
        slope: rad, by how much the object's plane may be tilted against the hand.
        widest: m that the contacts are apart at most.

    Raises:
        UnexploredError: too few sightings, or the hand's moves do not show in the image.
    """
    if len(seen) < 6:
        raise UnexploredError("too few images of the exploratory moves")
    found = signals_of(seen, inverse_pose(seen[0].hand), frame.centre)
    fit = fit_moves(found)
    off = np.asarray(np.abs(fit.left) / found.signal_noise, dtype=np.float64)
    m, ok = complex(-fit.terms[0]), off < 6.0 * max(1.0, 1.5 * float(_last_axis_median(off)))
    if not 1.0 / widest < abs(m) < 1e4:
        raise UnexploredError(
            "the hand's moves do not show in the image: is it another camera's, or does the object move along with the hand?"
        )
    L, phi = 1.0 / abs(m), -float(np.angle(m))
    focal = _estimate_focal_length(found.z[ok], found.length[ok], L, FOCAL_GUESS * frame.side)
    camera = HandCamera(focal, frame.centre, rotation_about_z(phi), np.zeros(3))
    chosen = [x for x, good in zip(seen, ok, strict=True) if good]
    depth = focal * L / chosen[0].contact_spread
    origin = origin_of(chosen[0], camera, depth, Prior(slope=slope))
    return FirstEstimate(origin, *refine_estimate(origin, chosen, steps=INITIAL_STEPS))


def origin_of(seen: Observation, camera: HandCamera, depth: float, prior: Prior) -> Origin:
    """What is known before: a camera, and the object where it is seen `depth` m before it, facing the hand."""
    object_ = place_object(camera, seen, depth, prior.slope)
    return Origin(camera, object_, prior.prior_covariance(camera, object_, seen.hand), seen.time)


def initialize_from_nominal(seen: Observation, believed: NominalCamera, centre: Floats, slope: float) -> FirstEstimate:
    """What is known before from a nominal camera, and the estimate from a single sighting."""
    prior = replace(NOMINAL_PRIOR, slope=slope)
    origin = origin_of(seen, believed.camera(centre), believed.distance, prior)
    return FirstEstimate(origin, *refine_estimate(origin, [seen]))


class LinearFit(NamedTuple):
    """The linear model as it fits: its terms (4,) -m, m P, m V and -tau, and what it leaves (N,) of s."""

    terms: Complex
    left: Complex


def fit_moves(found: Signals) -> LinearFit:
    """The linear model that fits best: of random subsets the best, then reweighted least squares; half may be wrong."""
    p, s, noise = found.p, found.s, found.signal_noise
    back = np.exp(-1j * found.theta)
    A = np.column_stack([back * p, back, back * found.t, np.ones(len(p))])
    rng = np.random.default_rng(0)
    # what is known before, in standard deviations
    ridge = np.diag([1e-6, 1e-6, LENGTH_GUESS / SPEED_GUESS, LENGTH_GUESS / OFFSET_GUESS])
    rows = rng.permuted(np.tile(np.arange(len(p)), (SUBSETS, 1)), axis=1)[:, :SUBSET_SIZE]
    drawn = _solve_ridge(A[rows], s[rows], 1.0 / noise[rows], ridge)
    best = drawn[np.argmin(_last_axis_median(np.abs(drawn @ A.T - s) / noise))]
    for _ in range(REWEIGHTINGS):
        left = np.asarray(np.abs(A @ best - s) / noise, dtype=np.float64)
        scale = max(1.0, 1.5 * float(_last_axis_median(left)))
        weight = 1.0 / (1.0 + (left / (3.0 * scale)) ** 2)
        best = _solve_ridge(A, s, weight / noise, ridge)
    return LinearFit(best, np.asarray(A @ best - s))


def _last_axis_median(values: Floats) -> Floats:
    """NumPy's own median loads masked arrays when it is first called, which takes 20 ms."""
    n, ordered = values.shape[-1], np.sort(values, axis=-1)
    return np.asarray(0.5 * (ordered[..., (n - 1) // 2] + ordered[..., n // 2]))


def _solve_ridge(A: Complex, s: Complex, weight: Floats, ridge: Floats) -> Complex:
    """Least squares with a ridge, of one system or of many at once."""
    W = A * weight[..., None]
    Wh = np.swapaxes(W.conj(), -1, -2)
    return np.asarray(np.linalg.solve(Wh @ W + ridge**2, Wh @ (s * weight)[..., None])[..., 0])


def _estimate_focal_length(z: Floats, length: Floats, L: float, guess: float) -> float:
    """px, from 1/l = (Z_0 - z) / (f L); where height has hardly changed, the guess."""
    inverse_length = 1.0 / length
    d = z - z.mean()
    if float(np.abs(d).max()) < 3e-3:
        return guess
    slope = -float(d @ (inverse_length - inverse_length.mean())) / float(d @ d)
    found = 1.0 / (slope * L) if slope > 0.0 else np.inf
    return float(np.clip(found, 0.4 * guess, 3.0 * guess))


# --- what the moves show to be wrong ---------------------------------------------------------------

MAX_SQUARE = 25.0
"""Squared standard deviations that a sighting counts at most: some are wrong."""
CLEAR_GAIN = 25.0
"""So much less is left by the hypothesis that is believed, in squared standard deviations: odds of 1 in 10^5."""
MIN_RAISE = 0.004
"""m of the hand's move along the approach direction from which on it tells something."""
LATENESS_STEPS: Floats = np.arange(-0.06, 0.331, 0.03)
LATENESS_STEP = 0.01
"""s by which images may be older than was told: first in steps that no move lasts, then finer about the best."""
MIN_LATENESS = 0.012
"""s of lateness that are not corrected: the moves do not show them better."""


def find_fault(found: Signals) -> str:
    """Why these sightings cannot be of a right set-up; empty where they can."""
    right, mirrored = (_cost_of_view(found, way) for way in (False, True))
    turned = right - mirrored > CLEAR_GAIN and right > 4.0 * mirrored
    if not turned:
        return ""
    nearer, away = _costs_of_nearing(found)
    if nearer - away > CLEAR_GAIN:  # of a hand that leans, or an object that moves, the size alone tells nothing
        return "the hand's z axis is turned round: it has to point along the fingers, toward the object, as twists go along it"
    if away - nearer > CLEAR_GAIN:
        return "the image is mirrored: it turns against the hand"
    return "the image turns against the hand: it is mirrored, or the hand's z axis is turned round"


def find_lateness(
    seen: Sequence[Observation], pose_at: Callable[[float], Floats], base: Floats, centre: Floats
) -> float:
    """s by which the images are older than their sightings say; 0 where the moves do not show it.

    `pose_at` gives the hand's pose (4, 4) at a time, s; base and centre are as of `signals_of`.
    """

    def misfit_at(late: float) -> float:
        found = signals_of(delay_sightings(seen, late, pose_at), base, centre)
        return _bounded_squares(fit_moves(found).left / found.signal_noise)

    costs = {late: misfit_at(late) for late in LATENESS_STEPS.tolist()}
    told = costs[min(costs, key=abs)]
    best = min(costs, key=costs.__getitem__)
    if told - costs[best] < CLEAR_GAIN and best == min(costs, key=abs):
        return 0.0
    costs |= {late: misfit_at(late) for late in (best - LATENESS_STEP, best + LATENESS_STEP)}
    best = min(costs, key=costs.__getitem__)
    for late in (best - LATENESS_STEP, best + LATENESS_STEP):
        costs.setdefault(late, misfit_at(late))
    # a hand that leans fits the linear model badly at any delay: lateness is believed only where it explains the misfit
    if told - costs[best] < CLEAR_GAIN or told < 4.0 * costs[best] or abs(best) < MIN_LATENESS:
        return 0.0
    before, at, after = costs[best - LATENESS_STEP], costs[best], costs[best + LATENESS_STEP]
    # of the parabola
    return float(best + 0.5 * LATENESS_STEP * (before - after) / max(before - 2.0 * at + after, 1e-9))


def delay_sightings(seen: Sequence[Observation], late: float, pose_at: Callable[[float], Floats]) -> list[Observation]:
    """The same sightings of images that were taken so much earlier, s."""
    return [replace(s, time=s.time - late, hand=pose_at(s.time - late)) for s in seen]


def _cost_of_view(found: Signals, mirrored: bool) -> float:
    """What the moves leave of the sightings, in squared standard deviations: of the middle, and of the segment's turn."""
    if mirrored:
        found = found._replace(s=found.s.conj(), segment=found.segment.conj())
    middle, segment = fit_moves(found).left / found.signal_noise, found.segment
    unturned = segment * np.exp(1j * found.theta)
    angle = np.angle(unturned * np.exp(-1j * np.angle(np.median(unturned.real) + 1j * np.median(unturned.imag))))
    return _bounded_squares(middle) + _bounded_squares(angle / (MOVE_NOISE_PX * np.sqrt(2.0) / np.abs(segment)))


def _costs_of_nearing(found: Signals) -> tuple[float, float]:
    """What is left of the object's size in the image if it grows where the hand comes nearer, and if it shrinks."""
    z, inverse = found.z - np.median(found.z), 1.0 / found.length
    if float(np.ptp(z)) < MIN_RAISE:
        return 0.0, 0.0
    noise = MIN_NOISE_PX / found.length**2
    costs = []
    for sign in (-1.0, 1.0):
        slopes = sign * np.linspace(0.05, 10.0, 60) * float(np.median(inverse))  # 1/m: the object 0.1 to 20 m away
        off = inverse[None] - slopes[:, None] * z[None]
        off = off - np.median(off, axis=1)[:, None]
        costs.append(min(_bounded_squares(row / noise) for row in off))
    return costs[0], costs[1]


def _bounded_squares(off: NDArray[np.generic]) -> float:
    return float(np.minimum(np.abs(off) ** 2, MAX_SQUARE).sum())


TILT_EVERY = 3
"""Sightings from one look to the next."""
FREE_SLOPE = 0.3
"""rad by which the plane may be tilted."""
SHARED_ERROR_PX = 2.0
"""px by which points are off alike in all images, as those of a thick part are: more images do not make that less."""
CORRELATED_SIGHTINGS, TILT_ODDS = 5, 1e3
"""Sightings in a row that count as one, since their errors are much the same; odds at which a tilted plane is believed."""
MAX_LEFT_SHARE = 0.7
"""Share of what is not explained that a tilted plane leaves at most: the tracker's small errors are left by either."""
MAX_LEFT_VARIANCE = 0.5
"""Variance of what it leaves, over that of a sighting, at most: a part that is moved meanwhile is explained by no plane."""
TIPS_SURE = 3.0
"""Standard deviations by which the fingertips' error has to lie below or above what is forgiven."""


class TiltEstimate(NamedTuple):
    """A plane that was left free.

    Attributes:
        found: what explains the sightings so.
        angle, sd: rad, of its normal to the approach direction.
        width: m between the first two contacts.
    """

    found: FirstEstimate
    angle: float
    sd: float
    width: float

    @property
    def tips_error(self) -> float:
        """m along the approach direction by which a fingertip and its contact are apart when the hand is right on average."""
        return 0.5 * self.width * math.sin(self.angle)

    @property
    def tips_sd(self) -> float:
        """m, its standard deviation."""
        return 0.5 * self.width * self.sd


class TiltCheck:
    """Looks now and then until the tilt is known, of which m along the approach direction are forgiven a fingertip."""

    def __init__(self, forgiven: float, frame: ImageFrame) -> None:
        self._forgiven, self._frame = forgiven, frame
        self._count, self._known = 0, False

    def check_tilt(self, seen: Sequence[Observation], square: Estimate) -> TiltEstimate | None:
        """The tilt, once it is known to be less than what is forgiven, or more; None before, and afterwards.

        Args:
            seen: sightings of an object that rests or moves evenly, those of the exploratory moves among them.
            square: the estimate so far, which takes the plane to be square to the hand.
        """
        self._count += 1
        if self._known or self._count % TILT_EVERY or len(seen[-1].points) == seen[-1].contacts:
            return None
        try:
            found = initialize_calibration(seen, self._frame, FREE_SLOPE)
        except (UnexploredError, ValueError, np.linalg.LinAlgError):
            return None
        known = found.estimate
        normal, spread = known.plane_normal(seen[-1].hand), known.covariance[POSE, POSE][:2, :2]
        width = math.dist(*known.object.points[:2].tolist())
        alike = SHARED_ERROR_PX / seen[-1].contact_spread
        sd = math.sqrt(float(np.trace(spread)) + alike**2)
        tilt = TiltEstimate(found, math.acos(min(1.0, float(normal[2]))), sd, width)
        decided = abs(tilt.tips_error - self._forgiven) > TIPS_SURE * tilt.tips_sd
        self._known = decided and (tilt.angle < TIPS_SURE * sd or _is_likelier(known, square, seen))
        return tilt if self._known else None


def _is_likelier(one: Estimate, other: Estimate, seen: Sequence[Observation]) -> bool:
    """Whether the sightings speak clearly for one estimate: it leaves less of them, and not just of their small errors."""
    left, instead = (_unexplained_misfit(each, seen) for each in (one, other))
    explains = left < MAX_LEFT_VARIANCE * 2 * sum(len(each.points) for each in seen)
    is_clear = instead - left > 2.0 * CORRELATED_SIGHTINGS * math.log(TILT_ODDS)
    return explains and is_clear and left < MAX_LEFT_SHARE * instead


def _unexplained_misfit(known: Estimate, seen: Sequence[Observation]) -> float:
    """What is left of all sightings, in squared standard deviations."""
    sizes = [normalized_residual(known, one) ** 2 for one in seen]
    return sum(2 * len(one.points) * min(size, MAX_SQUARE) for one, size in zip(seen, sizes, strict=True))
