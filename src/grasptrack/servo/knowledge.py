# SPDX-License-Identifier: Apache-2.0
"""From nothing to an estimate, and back where it proves wrong: which move to explore next, and what is known so far."""

from __future__ import annotations

from collections import deque
from contextlib import suppress

import numpy as np

from grasptrack.servo import begin
from grasptrack.servo.camera import NominalCamera
from grasptrack.servo.estimate import AGREEING, ASTIR, FAR, Estimate, normalized_residual, on_plane
from grasptrack.servo.explore import ORDER, Exploration
from grasptrack.servo.model import SHAPE, Placed
from grasptrack.servo.refine import Origin, Search, refine_estimate
from grasptrack.servo.sighting import Observation
from grasptrack.servo.textbook import ClassicalIBVS
from grasptrack.typing import Floats

KEPT = 80
"""Observations that are kept; of the older half then every second."""
ELSEWHERE, LATER = 0.002, 0.2
"""m, rad and s from the last that is kept."""
EVERY, STEPS, FEWEST, AFRESH = 5, 2, 8, 20
"""All are gone through again every so many sightings, or at once while the search has not settled, with so many steps, from so
many on; with so many where it must be known whether they can be explained at all."""
ANYWHERE = 0.02
"""m, how well the contacts of another grasp are known from a first look at them."""
SURE = 0.01
"""Relative standard deviation of a length that needs no further moves."""
AMISS = 4.0
"""Scale of the residuals from which on the search begins anew from the exploratory moves."""
DOUBLINGS = 3
"""How often moves that showed nothing are made larger."""
STRANGE = 75
"""So many sightings of the last hundred that do not fit, and the estimate is begun anew."""


class SelfCalibration:
    """The estimate and how it came about.

    Args:
        exploration: how the exploratory moves are made.
        dof: 4 or 6.
        camera: what is believed of the camera; with it nothing is explored.
        fixed: whether that is never corrected: the textbook's law.
    """

    def __init__(self, exploration: Exploration, dof: int, camera: NominalCamera | None, fixed: bool = False) -> None:
        self._how, self._order, self._nominal = exploration, ORDER[dof], camera
        self._fixed = fixed
        self._slope = 0.01 if dof == 4 else 0.3
        self.restarts = 0
        self.forget()

    def forget(self) -> None:
        """Begin anew: another object, or an estimate that proved wrong."""
        self._seen: list[Observation] = []
        self._origin: Origin | None = None
        self._search: Search | None = None
        self._last: deque[Observation] = deque(maxlen=AGREEING)
        self._since = 0
        self._stage, self._began, self._larger, self._doublings = 0, float("nan"), 1.0, 0
        self._fits: deque[bool] = deque(maxlen=100)
        self.estimate: Estimate | ClassicalIBVS | None = None
        self.failed = ""
        self._regrasp = self._sure = False
        self._asked = self._nominal is None

    def another(self) -> None:
        """Another grasp is followed from now on, on the same object: the camera stays known, and where the object lies."""
        if isinstance(self.estimate, Estimate):
            self._regrasp, self._sure = True, False
        else:
            self.forget()

    @property
    def exploring(self) -> bool:
        """Whether there are exploratory moves to make."""
        return self._asked and self._stage < len(self._order)

    def make_sure(self) -> bool:
        """Explore once more where the length of the grasp is not known well, once for each grasp; whether it will."""
        known = self.estimate
        if self._sure or not isinstance(known, Estimate) or known.relative_error() < SURE:
            return False
        self._sure = self._asked = True
        self._stage, self._began, self._larger = 0, float("nan"), 1.0
        return True

    def take(self, seen: Observation, centre: Floats, side: float) -> bool:
        """Take in a sighting; whether it fits what is known."""
        if self._regrasp:
            self._begin_from_the_same_object(seen)
        fits = True
        self._last.append(seen)
        if isinstance(self.estimate, Estimate):
            fits = self.estimate.observe(seen) < FAR
            if self.estimate.elsewhere:
                fits = self._explain_mismatch(self.estimate, seen)
        elif self.estimate is not None:
            self.estimate.observe(seen)
        elif self._nominal is not None:
            if self._fixed:
                self.estimate = ClassicalIBVS(seen, self._nominal, centre)
            else:
                self._origin, self.estimate, self._search = begin.initialize_from_nominal(
                    seen, self._nominal, centre, self._slope
                )
        self._keep_observation(seen)
        self._fits.append(fits)
        if sum(not f for f in self._fits) >= STRANGE:
            self.restarts += 1
            self.forget()
            return False
        if self.exploring:
            self._go_on(seen.time, centre, side)
        self._refine_estimate()
        return fits

    def _begin_from_the_same_object(self, seen: Observation) -> None:
        known, self._regrasp = self.estimate, False
        assert isinstance(known, Estimate)
        known.advance(seen.time)
        points = on_plane(known.camera, known.object, seen)
        if points is None:
            self.forget()
            return
        o = known.object
        covariance = np.eye(SHAPE + points.size) * ANYWHERE**2
        covariance[:SHAPE, :SHAPE] = known.covariance[:SHAPE, :SHAPE]
        moved = Placed(points, o.turn, o.place, o.speed, o.axes)
        self._origin = Origin(known.camera, moved, covariance, seen.time)
        self.estimate, self._search = refine_estimate(self._origin, [seen])
        self._seen = []
        self._last.clear()
        self._fits.clear()

    def _explain_mismatch(self, known: Estimate, seen: Observation) -> bool:
        """What was seen agrees with itself, not with the estimate: is that the estimate's fault, or was the object moved?"""
        if self._origin is not None and len(self._seen) >= FEWEST and not np.isfinite(known.displaced_at):
            anew, search = refine_estimate(self._origin, [*self._seen, *self._last], self._search, AFRESH)
            if all(normalized_residual(anew, one) < FAR for one in self._last):
                self.estimate, self._search = anew, search
                return True
        known.release(seen.time)
        return known.observe(seen) < FAR

    def _keep_observation(self, seen: Observation) -> None:
        """Keep what tells more than the last one: sightings from elsewhere, or some time later."""
        self._since += 1
        if self._seen and not self.exploring:
            last = self._seen[-1]
            way = float(np.abs(seen.hand - last.hand).max())
            if way < ELSEWHERE and seen.time - last.time < LATER:
                return
        self._seen.append(seen)
        if len(self._seen) > KEPT:
            self._seen = self._seen[: KEPT // 2 : 2] + self._seen[KEPT // 2 :]

    def _refine_estimate(self) -> None:
        """From time to time go through all that was kept again, as long as the object has not been displaced."""
        known = self.estimate
        if self._origin is None or not isinstance(known, Estimate):
            return
        if np.isfinite(known.displaced_at):
            if (
                known.time > known.displaced_at + ASTIR
            ):  # it rests, or moves evenly again: what came before is the prior
                self._origin = Origin(known.camera, known.object, known.covariance.copy(), known.time)
                self._seen, self._search, known.displaced_at = [], None, -np.inf
            return
        settled = self._search is None or self._search.settled
        if len(self._seen) < FEWEST or (settled and self._since < min(EVERY, len(self._seen) // FEWEST)):
            return
        self._since = 0
        anew, self._search = refine_estimate(self._origin, self._seen, self._search, STEPS)
        anew.advance(known.time)
        anew.follow(known)
        self.estimate = anew

    def _go_on(self, time: float, centre: Floats, side: float) -> None:
        """Begin the first move, or end one that is over with a new estimate."""
        if np.isnan(self._began):
            self._began = time
        if time < self._began + self._how.seconds:
            return
        if self._origin is not None:
            self.estimate, self._search = refine_estimate(self._origin, self._seen, self._search, AFRESH)
            if self._search.scale < AMISS:
                self._stage, self._began = self._stage + 1, time
                return
        try:
            self._origin, self.estimate, self._search = begin.initialize_calibration(
                tuple(self._seen), centre, side, self._slope
            )
            self._stage += 1
        except begin.UnexploredError as found:
            self._doublings += 1
            self._larger *= 2.0
            if self._doublings > DOUBLINGS:
                self.failed = str(found)
        self._began = time

    def interrupted(self, centre: Floats, side: float) -> None:
        """The grasp went out of sight: the present move is made again, the other way. Until then what it told must do."""
        if not np.isnan(self._began):
            self._larger *= -1.0
            if self.estimate is None:
                with suppress(begin.UnexploredError):
                    self._origin, self.estimate, self._search = begin.initialize_calibration(
                        self._seen, centre, side, self._slope
                    )
        self._began = float("nan")

    def twist(self, time: float) -> Floats:
        """The exploratory twist (6,) at a time; `take` begins it."""
        if not self.exploring or np.isnan(self._began):
            return np.zeros(6)
        return self._how.twist(self._order[self._stage], time - self._began, self._larger)

    def telling(self) -> str:
        """Which move is being made."""
        names = ("x", "y", "z", "turn about x", "turn about y", "turn about z")
        return names[self._order[min(self._stage, len(self._order) - 1)]]
