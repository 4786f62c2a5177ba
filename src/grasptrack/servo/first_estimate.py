# SPDX-License-Identifier: Apache-2.0
"""The first estimate of camera and object, from what the exploratory moves showed, or from what is believed beforehand.

The moves go one axis at a time, there and back, at rest at both ends. Let complex numbers stand for vectors across the approach
direction. A hand at p, turned by theta, sees the middle of the contacts at s = m exp(-i theta) (P + V t - p) - tau, in units of
their distance in the image: m = exp(-i phi) / L holds the mounting angle phi and the length L of the segment in m, tau the
camera's offset, V the object's velocity. This is linear in m, m P, m V and tau. The focal length follows from how the distance
in the image changes with height.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import GraspTrackError
from grasptrack.geometry.homographies import rotation_about_z
from grasptrack.servo.camera import HandCamera, NominalCamera, complex_numbers, inverse_pose
from grasptrack.servo.estimate import Estimate, Origin, Prior, Search, place_object, refine_estimate
from grasptrack.servo.observation import Observation
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
    ridge = np.diag(
        [1e-6, 1e-6, LENGTH_GUESS / SPEED_GUESS, LENGTH_GUESS / OFFSET_GUESS]
    )  # what is known before, in standard deviations
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
