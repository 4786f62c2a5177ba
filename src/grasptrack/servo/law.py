# SPDX-License-Identifier: Apache-2.0
"""From errors of features to a twist of the hand: the control law, and one step toward the goal."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grasptrack import arguments
from grasptrack.errors import InputError
from grasptrack.servo.camera import HandCamera, skew_matrix, turn_between
from grasptrack.servo.estimate import ClassicalIBVS, Estimate
from grasptrack.servo.features import Features
from grasptrack.servo.goal import Goal
from grasptrack.servo.observation import MIN_NOISE_PX, Observation, block_diagonal
from grasptrack.typing import Floats

TWIST_AXES = {4: (0, 1, 2, 5), 6: (0, 1, 2, 3, 4, 5)}
"""Components of the twist that a hand of so many degrees of freedom has."""


@arguments.checked(arguments.finite)
@dataclass(frozen=True)
class Gain:
    """The gain falls from `near` at the goal to `far` away from it: quick at the end, calm at the beginning.

    Args:
        near: 1/s at an error of 0.
        far: 1/s at a large error.
        fall: the error (norm of the features') at which it has fallen by about two thirds.

    Raises:
        InputError: not positive.
    """

    near: float = 5.0
    far: float = 2.0
    fall: float = 0.4

    def __post_init__(self) -> None:
        if not (self.near > 0.0 and self.far > 0.0 and self.fall > 0.0):
            raise InputError("gains are positive", gain=repr(self))

    @arguments.checked(arguments.number)
    def at(self, error: float) -> float:
        """1/s."""
        return self.far + (self.near - self.far) * math.exp(-error / self.fall)


def twist_for(error: Floats, jacobian: Floats, covariance: Floats, *, dof: int, length: float, gain: Gain) -> Floats:
    """The twist (6,) that lets the error fall off exponentially.

    v = -lambda (J' W J + mu^2 D)^-1 J' W e (Chaumette and Hutchinson 2006, eq. 5, damped as Nakamura and Hanafusa 1986). A
    feature that is poorly known weighs less, and beside the damping is followed more slowly.

    Args:
        error: (m,) features less those of the goal.
        jacobian: (m, 6), of the features by the hand's twist.
        covariance: (m, m) of the features.
        dof: 4 (x, y, z, turn about z) or 6.
        length: m by which velocities across the approach compare with turns: of small grasps small.
        gain: the gain.
    """
    axes, m = list(TWIST_AXES[dof]), len(error)
    # m by which the third feature, l*/l, changes by one
    depth = max(length, 1.0 / max(abs(float(jacobian[2, 2])), 1e-9))
    unit = np.array([length if a < 2 else depth if a == 2 else 1.0 for a in axes])
    sides = np.column_stack([jacobian[:, axes] * unit, error])
    faith = HALF_WEIGHT_SD * np.maximum(1.0, np.abs(error))
    doubt = covariance / np.outer(faith, faith)
    doubt.flat[:: m + 1] += 1.0
    products = sides[:, :-1].T @ np.linalg.solve(doubt, sides)  # J'W J, and J'W e
    A = products[:, :-1]
    A.flat[:: len(axes) + 1] += DAMPING**2
    out = np.zeros(6)
    out[axes] = -gain.at(math.sqrt(error @ error)) * unit * np.linalg.solve(A, products[:, -1])
    return out


DAMPING = 0.02
"""mu, relative to a Jacobian of size 1."""
HALF_WEIGHT_SD = 0.05
"""A feature that is known to this standard deviation, or to this share of its error, weighs half."""


MAX_ASIDE, MAX_MISALIGNED = 0.006, 0.06
"""m and rad from which on the hand stays at the stand-off; within half of them it goes all the way."""
MAX_LENGTH_SD = 0.1
"""Relative standard deviation of the contacts' distance from which on it stays at the stand-off."""
NEARER_SIZE, CAUTIOUS_SHARE = 3.0, 0.75
"""Standard deviations by which an object may be nearer than it seems, and the share of the way down that is kept for that: what
is left of the way shows how far away it is."""
NORMAL_SD = 0.01
"""rad, how well the plane's normal is taken to be known."""


@dataclass(frozen=True)
class Approach:
    """The way to the goal: which finger each contact is for, in 4 or 6 freedoms, first to a standoff, m before it."""

    goal: Goal
    order: tuple[int, ...]
    dof: int
    standoff: float
    gain: Gain


@dataclass(frozen=True)
class Aim:
    """A step.

    Attributes:
        twist: (6,) m/s and rad/s, relative to the object.
        error: (4,) or (6,) features less those of the goal in the end.
        error_px: the farthest contact from its goal in the end.
        height: m to go along the approach direction.
        final: (k, 2) px, the contacts in the end.
        doing: a short sentence.
        aligned: whether it may go down.
        moved_px: how far the contacts have moved in the image since the sighting, as predicted; NaN where there was none.
    """

    twist: Floats
    error: Floats
    error_px: float
    height: float
    final: Floats
    doing: str
    aligned: bool
    moved_px: float = math.nan


def compute_aim(
    known: Estimate | ClassicalIBVS, how: Approach, seen: Observation | None, hand: Floats, time: float
) -> Aim | None:
    """The next step toward the goal; None where the goal would not be in front of the camera.

    What was seen counts as it will be now: as predicted for now, plus what the image showed beside the prediction for its
    own time; `seen` is None while the object is out of sight. The hand (4, 4) is where it is now, at a time in s.
    """
    k, camera, dof, standoff = len(how.order), known.camera, how.dof, how.standoff
    points = known.in_hand(hand, time)[:k]
    right = how.goal.targets(camera, known.object.points[:k], how.order)
    normal = known.plane_normal(hand)
    places = [points] if seen is None else [points, known.in_hand(seen.hand, seen.time)[:k]]
    pixels = camera.project(np.concatenate(places)).reshape(-1, k, 2)
    contacts = pixels[0] if seen is None else pixels[0] + seen.points[:k] - pixels[1]
    if not np.isfinite(contacts).all():
        return None
    # what is seen tells how far aside the hand is: a prediction that it does not bear out would keep it at the stand-off
    here = points if seen is None else _at_depth(camera, contacts, points)
    relative, height = known.relative_error(), float((points - right)[:, 2].sum()) / k
    raised = standoff * _standoff_share(here, right, normal if dof == 6 else None, relative)
    # m by which the object may be nearer
    nearer = NEARER_SIZE * relative * float((points - camera.offset)[:, 2].sum()) / k
    if nearer > standoff:
        raised = max(raised, min(nearer, CAUTIOUS_SHARE * height))
    wanted = right.copy()
    wanted[:, 2] += raised
    final, goal_px = camera.project(np.concatenate([right, wanted])).reshape(2, k, 2)
    if not (np.isfinite(final).all() and np.isfinite(goal_px).all()):
        return None
    last, features = Features(final, camera.centre), Features(goal_px, camera.centre)
    at, there = (wanted, goal_px) if known.linearised_at_goal else (points, pixels[0])
    slopes = features.jacobian_at(there)
    error, in_the_end = features.feature_error(contacts), last.feature_error(contacts)
    jacobian = slopes @ camera.interaction_matrices(at).reshape(2 * k, 6)
    # of predicted contacts the least
    noise = np.eye(2 * k) * MIN_NOISE_PX**2 if seen is None else block_diagonal(seen.noise[:k])
    covariance = slopes @ noise @ slopes.T
    if dof == 6:
        by_normal = np.hstack([np.zeros((2, 3)), skew_matrix(normal)[:2]])
        jacobian = np.vstack([jacobian, by_normal])
        error, in_the_end = np.append(error, normal[:2]), np.append(in_the_end, normal[:2])
        wide = np.eye(6) * NORMAL_SD**2
        wide[:4, :4] = covariance
        covariance = wide
    length = math.dist(points[0].tolist(), points[1].tolist())
    twist = twist_for(error, jacobian, covariance, dof=dof, length=length, gain=how.gain)
    aligned = raised <= 0.5 * standoff
    doing = "goes down" if aligned else "aligns at the stand-off"
    moved_px = math.nan if seen is None else max(map(math.dist, pixels[0].tolist(), pixels[1].tolist()))
    return Aim(twist, in_the_end, last.farthest_error(contacts), height, final, doing, aligned, moved_px)


def _at_depth(camera: HandCamera, contacts: Floats, points: Floats) -> Floats:
    """Contacts (k, 2) px as points (k, 3) m in the hand's frame, each as far along the approach direction as that given."""
    rays = camera.ray_directions(contacts)
    return np.asarray(camera.offset + rays * ((points[:, 2] - camera.offset[2]) / rays[:, 2])[:, None])


def _standoff_share(points: Floats, right: Floats, normal: Floats | None, relative: float) -> float:
    """The share of the stand-off that is kept: 1 while the hand is not aligned, 0 when it is."""
    if relative > MAX_LENGTH_SD:
        return 1.0
    x, y, _ = (points - right).sum(axis=0).tolist()
    aside, turn = math.hypot(x, y) / len(points), abs(turn_between(right, points))
    tilt = 0.0 if normal is None else math.hypot(*normal[:2].tolist())
    return min(max(2.0 * max(aside / MAX_ASIDE, turn / MAX_MISALIGNED, tilt / MAX_MISALIGNED) - 1.0, 0.0), 1.0)
