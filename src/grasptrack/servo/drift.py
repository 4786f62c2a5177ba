# SPDX-License-Identifier: Apache-2.0
"""An alarm for a calibration that later moves contradict: a mounting that was knocked, a focal length that was changed.

From the sightings of late alone camera and object are estimated once more, as if next to nothing were known of the camera. What
moves tell little of has a large covariance, and contradicts nothing. An offset alone looks like an object that lies elsewhere
until the hand turns: it is found at the next approach, if the calibration of the last one is handed in.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from grasptrack.servo.estimate import Estimate, Origin, Prior, Search, refine_estimate
from grasptrack.servo.hand_eye import HandEye
from grasptrack.servo.observation import Observation
from grasptrack.servo.trust import lasting_covariance

CONTRADICTED = 24.3
"""A chi-square with 7 degrees of freedom is larger once in a thousand times."""
WINDOW, FEWEST, EVERY = 40, 10, 5
"""Sightings of late, from how many on, and after how many more they are looked at."""
STEPS = 6
"""Of the search in each look; it goes on from the last one."""
WAY, LATER = 0.002, 0.2
"""m, rad and s from one sighting that is kept to the next."""
FREE = Prior()
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
        self._late: deque[tuple[Observation, HandEye]] = deque(maxlen=WINDOW)
        self._before: HandEye | None = None
        self._displaced_at = -np.inf
        self._since = 0
        self._origin: Origin | None = None
        self._found: Search | None = None

    def take(self, seen: Observation, told: Estimate, displaced_at: float) -> bool:
        """Take in a sighting that fits, after exploring; whether the alarm rings.

        Args:
            seen: the sighting.
            told: the estimate with a covariance that is to be believed (`servo.trust.Trust.estimate`).
            displaced_at: s, when the object was found displaced, as `Estimate.displaced_at`: what came before does not belong
                to what comes after.
        """
        if self.rings:
            return True
        now = HandEye.from_estimate(told)
        if displaced_at != self._displaced_at:
            if np.isfinite(displaced_at):  # the object was displaced, or the camera
                self._begin(now)
            self._displaced_at = displaced_at
        last = self._late[-1][0] if self._late else None
        if last is not None and np.abs(seen.hand - last.hand).max() < WAY and seen.time < last.time + LATER:
            return False
        if len(self._late) == WINDOW:
            self._before = None
        self._late.append((seen, now))
        self._since += 1
        if len(self._late) >= FEWEST and self._since >= EVERY:
            self._since = 0
            self._look(told)
        return self.rings

    def change_grasp(self) -> None:
        """Other points are seen from now on."""
        if self._late:
            self._begin(self._late[-1][1])

    def _begin(self, now: HandEye) -> None:
        """A window anew."""
        self._before = self._before or (self._late[-1][1] if self._late else now)
        self._late.clear()
        self._origin, self._found, self._since = None, None, 0

    def _look(self, told: Estimate) -> None:
        sightings = [seen for seen, _ in self._late]
        if self._origin is None or self._origin.time != sightings[0].time:
            first, object_ = sightings[0], told.object.predict_after(sightings[0].time - told.time)
            slope = max(float(np.linalg.norm(object_.axes[:, 2])), FREE.slope)
            wide = replace(FREE, slope=slope).covariance(told.camera, object_, first.hand)
            self._origin = Origin(told.camera, object_, wide, first.time)
            self._found = None
        anew, self._found = refine_estimate(self._origin, sightings, self._found, STEPS)
        covariance = lasting_covariance(self._origin, self._origin.covariance, sightings, self._found)
        late = HandEye.from_estimate(Estimate(self._found.state, covariance, anew.time))
        reference = self._given or self._before or self._late[0][1]
        self.contradiction = late.contradicted_by(reference)
        self.rings = self.contradiction > CONTRADICTED
