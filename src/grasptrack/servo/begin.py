# SPDX-License-Identifier: Apache-2.0
"""Where the estimate begins: what small exploratory moves tell of a camera that nobody knows.

Let complex numbers stand for vectors across the approach direction. A hand at p, turned by theta, sees the middle of the
contacts at s = m exp(-i theta) (P + V t - p) - tau, in units of their distance in the image: m = exp(-i phi) / L holds the
mounting angle phi and the length L of the segment in m, tau the camera's offset, V the object's velocity. This is linear in
m, m P, m V and tau. The focal length follows from how the distance in the image changes with height.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import GraspTrackError
from grasptrack.geometry.homographies import rotation_about_z
from grasptrack.servo.camera import HandCamera, NominalCamera
from grasptrack.servo.estimate import Estimate, Prior, place_object
from grasptrack.servo.features import rms_diameter
from grasptrack.servo.geometry import inverse_pose
from grasptrack.servo.refine import Origin, Search, refine_estimate
from grasptrack.servo.sighting import Observation
from grasptrack.typing import Floats

Complex = NDArray[np.complex128]

DRAWS, MINIMAL, ROUNDS, STEPS = 100, 6, 5, 30
"""Random small sets, how many sightings are in each, rounds of reweighting after the best of them; steps of the search."""
ASIDE, BELT, LENGTH, FOCAL_LENGTHS = 0.15, 0.3, 0.05, 1.1
"""Before anything is known: m of the camera's offset, m/s of the object, m between contacts, focal length over the image's
larger side."""
NOMINAL = Prior(focal=0.15, tilt=0.15, spin=0.2, offset=0.03, scale=0.5)
"""How far a nominal camera may be off."""


class UnexploredError(GraspTrackError):
    """The moves so far do not tell enough: the message says what is missing. Caught by the servo."""


def initialize_calibration(
    seen: Sequence[Observation], centre: Floats, side: float, slope: float, seed: int = 0
) -> tuple[Origin, Estimate, Search]:
    """What was known before, and the estimate after all sightings of exploratory moves.

    Args:
        seen: sightings in the order of time, some of them wrong.
        centre: (2,) px, the middle of the image.
        side: px, the larger side of the image.
        slope: rad, by how much the object's plane may be tilted against the hand.
        seed: of the random subsets.

    Raises:
        UnexploredError: too few sightings, or the hand's moves do not show in the image.
    """
    if len(seen) < 6:
        raise UnexploredError("too few images of the exploratory moves")
    base = inverse_pose(seen[0].hand)
    poses = np.array([base @ s.hand for s in seen])
    p = poses[:, 0, 3] + 1j * poses[:, 1, 3]
    theta = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    t = np.array([s.time - seen[0].time for s in seen])
    contacts = np.array([s.points[: s.contacts] for s in seen])
    length = np.array([rms_diameter(c) for c in contacts])
    middle = contacts.mean(axis=1) - centre
    s = (middle[:, 0] + 1j * middle[:, 1]) / length
    m, ok = _estimate_mounting(p, theta, t, s, 0.5 / length, seed)
    if not 1.0 < abs(m) < 1e4:
        raise UnexploredError("the hand's moves do not show in the image")
    L, phi = 1.0 / abs(m), -float(np.angle(m))
    focal = _estimate_focal_length(poses[ok, 2, 3], length[ok], L, FOCAL_LENGTHS * side)
    camera = HandCamera(focal, centre, rotation_about_z(phi), np.zeros(3))
    chosen = [x for x, good in zip(seen, ok, strict=True) if good]
    depth = focal * L / rms_diameter(chosen[0].points[: chosen[0].contacts])
    origin = origin_of(chosen[0], camera, depth, Prior(slope=slope))
    return origin, *refine_estimate(origin, chosen, steps=STEPS)


def origin_of(seen: Observation, camera: HandCamera, depth: float, prior: Prior) -> Origin:
    """What is known before: a camera, and the object where it is seen `depth` m before it, facing the hand."""
    object_ = place_object(camera, seen, depth, seen.hand[:3, :3], prior.slope)
    return Origin(camera, object_, prior.covariance(camera, object_, seen.hand), seen.time)


def initialize_from_nominal(
    seen: Observation, believed: NominalCamera, centre: Floats, slope: float
) -> tuple[Origin, Estimate, Search]:
    """What is known before from a nominal camera, and the estimate from a single sighting."""
    prior = replace(NOMINAL, slope=slope)
    origin = origin_of(seen, believed.camera(centre), believed.distance, prior)
    return origin, *refine_estimate(origin, [seen])


def _estimate_mounting(
    p: Complex, theta: Floats, t: Floats, s: Complex, noise: Floats, seed: int
) -> tuple[complex, NDArray[np.bool_]]:
    """m, and which sightings bear it out: the best of random subsets, then reweighted least squares."""
    back = np.exp(-1j * theta)
    A = np.column_stack([back * p, back, back * t, np.ones(len(p))])  # of -m, m P, m V, -tau
    rng = np.random.default_rng(seed)
    ridge = np.diag([1e-6, 1e-6, LENGTH / BELT, LENGTH / ASIDE])  # what is known before, in standard deviations
    rows = rng.permuted(np.tile(np.arange(len(p)), (DRAWS, 1)), axis=1)[:, :MINIMAL]
    drawn = _solve_ridge(A[rows], s[rows], 1.0 / noise[rows], ridge)
    best = drawn[np.argmin(_last_axis_median(np.abs(drawn @ A.T - s) / noise))]
    for _ in range(ROUNDS):
        off = np.abs(A @ best - s) / noise
        scale = max(1.0, 1.5 * float(_last_axis_median(off)))
        weight = 1.0 / (1.0 + (off / (3.0 * scale)) ** 2)
        best = _solve_ridge(A, s, weight / noise, ridge)
    off = np.abs(A @ best - s) / noise
    return complex(-best[0]), off < 6.0 * max(1.0, 1.5 * float(_last_axis_median(off)))


def _last_axis_median(values: Floats) -> Floats:
    """Of the last axis. NumPy's own loads masked arrays when it is first called, which takes 20 ms."""
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
