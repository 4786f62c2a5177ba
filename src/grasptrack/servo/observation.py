# SPDX-License-Identifier: Apache-2.0
"""What one image contributes: where the hand was, and where points of the object were seen."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from grasptrack.equality import compared_by_value
from grasptrack.errors import ConditioningError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.servo.camera import interpolate_pose
from grasptrack.servo.features import rms_diameter
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats

POSES_KEPT = 8.0
"""s for which a reported pose is kept, however often they come."""


class Poses:
    """The last poses that the robot reported, and those between them."""

    def __init__(self) -> None:
        self._times: deque[float] = deque()
        self._poses: deque[Floats] = deque()

    def add_pose(self, time: float, pose: Floats) -> None:
        """A pose (4, 4) at a time, s; one at the time of the last, or before, takes the place of that."""
        while self._times and self._times[-1] >= time:
            self._times.pop()
            self._poses.pop()
        while self._times and self._times[0] < time - POSES_KEPT:
            self._times.popleft()
            self._poses.popleft()
        self._times.append(time)
        self._poses.append(pose)

    def pose_at(self, time: float) -> Floats:
        """The pose at a time; before the first that is kept, and after the last, that one."""
        i = bisect_left(self._times, time)
        if i == 0:
            return self._poses[0]
        if i == len(self._times):
            return self._poses[-1]
        before, after = self._times[i - 1], self._times[i]
        if time == after:
            return self._poses[i]
        return interpolate_pose(self._poses[i - 1], self._poses[i], (time - before) / (after - before))


MIN_NOISE_PX = 0.2
"""px, the least standard deviation of a point: covariances know noise, not models."""
MIN_NOISE = np.eye(2)[None] * MIN_NOISE_PX**2
MAX_NOISE_PX = 30.0
"""px, the largest that is made of an unbounded one."""
SQUARE_REACH = 0.7
"""Half the side of the reference square, in distances of the contacts."""


@compared_by_value
@dataclass(frozen=True)
class Observation:
    """One image's points.

    Attributes:
        time: s, when the image was taken.
        hand: (4, 4) pose of the hand in the robot's base at that time.
        points: (n, 2) px, the contacts first, then the corners of the reference square where a homography tells them.
        noise: (n, 2, 2) px^2.
        contacts: how many of the points are contacts.
    """

    time: float
    hand: Floats
    points: Floats
    noise: Floats
    contacts: int

    @property
    def contact_spread(self) -> float:
        """px, twice the rms distance of the contacts from their mean: of two their distance."""
        return rms_diameter(self.points[: self.contacts])

    @cached_property
    def packed_row(self) -> Floats:
        """(17 + 6n,) time, pose, points and noise in a row: many such rows are stacked quickly."""
        return np.concatenate([(self.time,), self.hand.ravel(), self.points.ravel(), self.noise.ravel()])


def block_diagonal(noise: Floats) -> Floats:
    """(2n, 2n), with the covariances (n, 2, 2) of points that know nothing of each other on the diagonal."""
    n = len(noise)
    out, each = np.zeros((n, 2, n, 2)), np.arange(n)
    out[each, :, each] = noise
    return out.reshape(2 * n, 2 * n)


class ObservationStack(NamedTuple):
    """Observations of the same points: (N,) s after a common time, (N, 4, 4) poses, (N, n, 2) px and (N, n, 2, 2) px^2."""

    times: Floats
    hands: Floats
    points: Floats
    noise: Floats


def stack_observations(seen: Sequence[Observation], origin: float) -> ObservationStack:
    """Observations of the same points in arrays, their times after a time of origin, s."""
    N, n = len(seen), len(seen[0].points)
    rows = np.concatenate([s.packed_row for s in seen]).reshape(N, -1)
    points, noise = rows[:, 17 : 17 + 2 * n], rows[:, 17 + 2 * n :]
    hands = rows[:, 1:17].reshape(N, 4, 4)
    return ObservationStack(rows[:, 0] - origin, hands, points.reshape(N, n, 2), noise.reshape(N, n, 2, 2))


class ResultObserver:
    """Makes sightings of results.

    With a homography the corners of a square in the reference view are seen as well. Contacts alone show their distance in one
    direction: a thick part, of which at first a side showed along one of them, narrows there, and would seem farther away than
    it is. Nor do two of them show how the plane is tilted.

    Args:
        square: nothing is seen without the square, for which contacts alone serve otherwise.
    """

    def __init__(self, square: bool) -> None:
        self._needed = square
        self._reference: Floats | None = None
        self._grasp: tuple[int | None] | None = None  # whose square it is

    def observe_result(self, result: TrackResult, time: float, hand: Floats) -> Observation | None:
        """What a result contributes; None where it gives no contacts, or lacks the homography that the first one had."""
        if result.contacts is None:
            return None
        points = np.asarray(result.contacts, dtype=np.float64)
        k = len(points)
        if not rms_diameter(points) > MIN_NOISE_PX:  # one point, by all that is known, or none
            return None
        noise = MIN_NOISE.repeat(k, axis=0)
        if result.covariance is not None:
            noise += _bounded_covariances(result.covariance)
        H = result.homography
        if H is None and self._needed:
            return None
        try:
            if self._grasp is None or result.grasp_id not in (None, *self._grasp):
                self._reference, self._grasp = None if H is None else _reference_square(points, H), (result.grasp_id,)
            if self._reference is not None:
                if H is None:
                    return None
                points = np.vstack([points, apply_homography(H, self._reference)])
                noise = np.concatenate([noise, np.broadcast_to(4.0 * noise.mean(axis=0), (4, 2, 2))])
        except (ConditioningError, np.linalg.LinAlgError):
            return None
        return Observation(time, hand, points, noise, k) if np.isfinite(points).all() else None


def _bounded_covariances(covariance: Floats) -> Floats:
    """The covariances (k, 2, 2) with variances in 0 to MAX_NOISE_PX^2 along their axes, as nearly all have them as they are."""
    if all(
        xy == yx and xx >= 0.0 and yy >= 0.0 and xx + yy <= MAX_NOISE_PX**2 and xx * yy >= xy * xy
        for (xx, xy), (yx, yy) in covariance.tolist()
    ):
        return covariance
    told = np.nan_to_num(covariance, nan=MAX_NOISE_PX**2, posinf=MAX_NOISE_PX**2, neginf=MAX_NOISE_PX**2)
    values, vectors = np.linalg.eigh(told)
    return np.asarray((vectors * np.clip(values, 0.0, MAX_NOISE_PX**2)[:, None, :]) @ np.swapaxes(vectors, 1, 2))


def _reference_square(contacts: Floats, homography: Floats) -> Floats:
    """The corners (4, 2) px of a square round the contacts, in the reference view."""
    reference = apply_homography(np.linalg.inv(homography), contacts)
    mean = reference.mean(axis=0)
    reach = SQUARE_REACH * float(np.sqrt(((reference - mean) ** 2).sum(axis=1).max())) * 2.0
    return np.asarray(mean + reach * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) / np.sqrt(2.0))
