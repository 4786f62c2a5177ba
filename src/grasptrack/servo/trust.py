# SPDX-License-Identifier: Apache-2.0
"""How far an estimate is to be trusted, and an alarm for a calibration that no longer holds.

The estimate weighs images as if each erred by itself. That finds the right place for camera and object, but is too sure of it:
what misleads a tracker (a side of a thick part that shows, an edge that is soft) is much the same in the next image. In
rendered approaches of all shapes the errors of two images are half alike after a second, and beside them the noise of each
image is small. Nearly all of a lasting error is explained by a camera or an object that is a little elsewhere; the little that
is left over shows how large it was. The covariance that is told follows from both: that of weighted least squares under the
noise that there is (the "sandwich", H. White 1980).

The alarm finds a calibration that later moves contradict: a mounting that was knocked, a focal length that was changed.
From the last sightings alone camera and object are estimated once more, as if next to nothing were known of the camera.
What moves tell little of has a large covariance, and contradicts nothing. An offset alone looks like an object that lies
elsewhere until the hand turns: it is found at the next approach, if the calibration of the last one is handed in.
"""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from grasptrack.servo.estimate import ROBUST_SIZE, Estimate, Origin, Prior, Search, WhitenedSightings, refine_estimate
from grasptrack.servo.hand_eye import HandEye
from grasptrack.servo.model import SHAPE, pack_state, state_difference
from grasptrack.servo.observation import Observation, stack_observations
from grasptrack.typing import Floats

ERROR_LASTS = 1.3
"""s after which the errors of two images are alike by 1/e, in rendered approaches. The next two were chosen by the table of
`tests/slow/test_servo_metres.py` with seeds 777 and 888, so that the fingertips' true place at closing lies within the 95 %
ellipsoid in 95 % of approaches on each of still, belt and 6 DoF, the few that the tracker misleads included; in most others the
ellipsoid is wider than it need be. With seed 999, which was not looked at before, all 165 lay within."""
LASTING_VARIANCE = 2.0
"""Variance of what lasts, over that told of a point, where nothing is left over."""
ABSORBED_FACTOR = 80.0
"""By how much more variance lasts than is left over, after camera and object have been fitted."""


def lasting_covariance(origin: Origin, before: Floats, seen: Sequence[Observation], found: Search) -> Floats:
    """The covariance (16 + 2n, 16 + 2n), at the origin's time, of what a search found, where errors of images last.

    `before` is the one that the prior has in truth; `seen` are all sightings that were searched.
    """
    stack, known, N = stack_observations(seen, origin.time), origin.information_matrix, len(seen)
    whitened, later = WhitenedSightings(stack), stack.times
    off, slopes = whitened.residuals(found.state)
    J = whitened.whitened_jacobian(slopes)
    behind = ~np.isfinite(off).all(axis=1)
    off[behind], J[behind] = 0.0, 0.0
    size2 = (off * off).mean(axis=1)
    weight = np.where(behind, 0.0, 1.0 / (1.0 + size2 / (ROBUST_SIZE * found.scale) ** 2) ** 2)
    left, anew = _residual_variances(off, weight)
    lasting = LASTING_VARIANCE + ABSORBED_FACTOR * max(left - anew, 0.0)
    alike = lasting * np.exp(-np.abs(later[:, None] - later[None]) / ERROR_LASTS) + max(1.0, anew) * np.eye(N)
    G = J * weight[:, None, None]
    mixed = (alike @ G.reshape(N, -1)).reshape(-1, J.shape[-1])
    G = G.reshape(-1, J.shape[-1])
    A = G.T @ J.reshape(G.shape) + known
    bread = np.linalg.inv(A)
    C = bread @ (G.T @ mixed + known @ before @ known) @ bread
    ahead = bread @ (G.T @ off.ravel() - known @ state_difference(origin.packed_state, found.state))
    C += np.outer(ahead, ahead)  # a search that has not settled is so far from where it goes
    return np.asarray(0.5 * (C + C.T))


def _residual_variances(off: Floats, weight: Floats) -> tuple[float, float]:
    """Of residuals (N, m), over those told: all of it, and what two images after each other do not share."""
    all_ = float(weight @ (off * off).mean(axis=1)) / max(float(weight.sum()), 1e-12)
    if len(off) < 2:
        return all_, all_
    pairs, steps = np.sqrt(weight[1:] * weight[:-1]), np.diff(off, axis=0)
    return all_, 0.5 * float(pairs @ (steps * steps).mean(axis=1)) / max(float(pairs.sum()), 1e-12)


class Trust:
    """Estimates with the covariance that they have. One for each calibration: make another where that is begun anew."""

    def __init__(self) -> None:
        self._found: Search | None = None
        self._origin: Origin | None = None
        self._before = self._excess = np.zeros((0, 0))
        self._refined: Estimate | None = None

    def with_true_covariance(
        self, known: Estimate, origin: Origin | None, seen: Sequence[Observation], found: Search | None
    ) -> Estimate:
        """The estimate with its true covariance; that given is left as it is."""
        rests = not np.isfinite(known.displaced_at)
        if rests and found is not self._found and origin is not None and found is not None and len(seen) > 0:
            self._take_search(origin, seen, found)
        told = Estimate(pack_state(known.camera, known.object), known.covariance, known.time)
        told.displaced_at = known.displaced_at
        if rests and self._refined is not None and origin is self._origin:
            later = copy.copy(self._refined)
            later.advance(known.time)
            told.covariance = later.covariance
            self._excess = _positive_part(told.covariance - known.covariance)
        else:  # it was displaced: what images told too often before, they still do
            told.covariance = known.covariance + _resized_covariance(self._excess, len(known.covariance))
        return told

    def _take_search(self, origin: Origin, seen: Sequence[Observation], found: Search) -> None:
        if origin is not self._origin:
            self._before = origin.covariance + _resized_covariance(self._excess, len(origin.covariance))
        self._origin, self._found = origin, found
        C = lasting_covariance(origin, self._before, seen, found)
        self._refined = Estimate(found.state, C, origin.time)
        self._refined.advance(seen[-1].time, evenly=True)


def _positive_part(matrix: Floats) -> Floats:
    """The nearest symmetric matrix without negative eigenvalues."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _resized_covariance(excess: Floats, n: int) -> Floats:
    """(n, n): of all unknowns but the points where there are others now."""
    out, same = np.zeros((n, n)), len(excess) if len(excess) == n else min(len(excess), SHAPE)
    out[:same, :same] = excess[:same, :same]
    return out


MAX_CONTRADICTION = 24.3
"""A chi-square with 7 degrees of freedom is larger once in a thousand times."""
DRIFT_WINDOW, MIN_SIGHTINGS, DRIFT_EVERY = 40, 10, 5
"""Sightings of late, from how many on, and after how many more they are looked at."""
DRIFT_STEPS = 6
"""Of the search in each look; it goes on from the last one."""
MIN_WAY, MIN_DELAY = 0.002, 0.2
"""m, rad and s from one sighting that is kept to the next."""
FREE_PRIOR = Prior()
"""What is taken to be known of the camera."""


class DriftAlarm:
    """Whether later moves contradict a calibration. Rings once, and then for good.

    Args:
        reference: the calibration, as of an earlier approach (`HandEye.load`); by default what the present one told
            before the sightings of late.

    Attributes:
        contradiction: of the last look, squared standard deviations; 0 before the first.
        rings: whether the calibration is contradicted.
    """

    def __init__(self, reference: HandEye | None = None) -> None:
        self._given = reference
        self.contradiction, self.rings = 0.0, False
        self._late: deque[tuple[Observation, HandEye]] = deque(maxlen=DRIFT_WINDOW)
        self._before: HandEye | None = None
        self._displaced_at = -np.inf
        self._since = 0
        self._origin: Origin | None = None
        self._found: Search | None = None

    def take_sighting(self, seen: Observation, told: Estimate, displaced_at: float) -> bool:
        """Take in a sighting that fits, after exploring; whether the alarm rings.

        Args:
            seen: the sighting.
            told: the estimate with a covariance that is to be believed (`Trust.with_true_covariance`).
            displaced_at: s, when the object was found displaced, as `Estimate.displaced_at`: what came before does not belong
                to what comes after.
        """
        if self.rings:
            return True
        now = HandEye.from_estimate(told)
        if displaced_at != self._displaced_at:
            if np.isfinite(displaced_at):  # the object was displaced, or the camera
                self._begin_window(now)
            self._displaced_at = displaced_at
        last = self._late[-1][0] if self._late else None
        if last is not None and np.abs(seen.hand - last.hand).max() < MIN_WAY and seen.time < last.time + MIN_DELAY:
            return False
        if len(self._late) == DRIFT_WINDOW:
            self._before = None
        self._late.append((seen, now))
        self._since += 1
        if len(self._late) >= MIN_SIGHTINGS and self._since >= DRIFT_EVERY:
            self._since = 0
            self._compare_estimates(told)
        return self.rings

    def change_grasp(self) -> None:
        """Other points are seen from now on."""
        if self._late:
            self._begin_window(self._late[-1][1])

    def _begin_window(self, now: HandEye) -> None:
        self._before = self._before or (self._late[-1][1] if self._late else now)
        self._late.clear()
        self._origin, self._found, self._since = None, None, 0

    def _compare_estimates(self, told: Estimate) -> None:
        sightings = [seen for seen, _ in self._late]
        if self._origin is None or self._origin.time != sightings[0].time:
            first, object_ = sightings[0], told.object.predict_after(sightings[0].time - told.time)
            slope = max(float(np.linalg.norm(object_.axes[:, 2])), FREE_PRIOR.slope)
            wide = replace(FREE_PRIOR, slope=slope).prior_covariance(told.camera, object_, first.hand)
            self._origin = Origin(told.camera, object_, wide, first.time)
            self._found = None
        anew, self._found = refine_estimate(self._origin, sightings, self._found, DRIFT_STEPS)
        covariance = lasting_covariance(self._origin, self._origin.covariance, sightings, self._found)
        late = HandEye.from_estimate(Estimate(self._found.state, covariance, anew.time))
        reference = self._given or self._before or self._late[0][1]
        self.contradiction = late.contradicted_by(reference)
        self.rings = self.contradiction > MAX_CONTRADICTION
