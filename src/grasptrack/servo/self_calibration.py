# SPDX-License-Identifier: Apache-2.0
"""Self-calibration: exploratory moves, the first estimate from what they show, and what is done where it proves wrong.

See `first_estimate` for what the moves tell, and what they show to be wrong.
"""

from __future__ import annotations

import math
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

import numpy as np

from grasptrack import arguments
from grasptrack.errors import InputError
from grasptrack.servo.camera import NominalCamera, inverse_pose
from grasptrack.servo.estimate import (
    AGREEING_IMAGES,
    OUTLIER_SIZE,
    PUSHED_SECONDS,
    ClassicalIBVS,
    Estimate,
    Origin,
    Search,
    normalized_residual,
    on_plane,
    refine_estimate,
)
from grasptrack.servo.first_estimate import (
    FirstEstimate,
    ImageFrame,
    TiltCheck,
    UnexploredError,
    delay_sightings,
    find_fault,
    find_lateness,
    initialize_calibration,
    initialize_from_nominal,
    signals_of,
)
from grasptrack.servo.grasp_pose import GraspPose, grasp_pose
from grasptrack.servo.hand_eye import HandEye
from grasptrack.servo.model import SHAPE, Placed
from grasptrack.servo.observation import Observation, Poses
from grasptrack.servo.trust import MIN_DELAY, MIN_WAY, DriftAlarm, Trust
from grasptrack.typing import Floats

MOVE_ORDER = {4: (0, 2, 5, 1), 6: (0, 2, 5, 1, 3, 4)}
"""Components of the twist in turn. The first alone tells mounting angle and length, so that a moving object can be followed."""


@arguments.checked(arguments.finite)
@dataclass(frozen=True)
class Exploration:
    """How the moves are made.

    Args:
        way: m, of shifts.
        turn: rad, of turns.
        seconds: of each move, there and back; longer where images come seldom.

    Raises:
        InputError: one of them is not positive.
    """

    way: float = 0.008
    turn: float = 0.05
    seconds: float = 0.24

    def __post_init__(self) -> None:
        if not (self.way > 0.0 and self.turn > 0.0 and self.seconds > 0.0):
            raise InputError("exploratory moves are positive", exploration=repr(self))

    @arguments.checked(arguments.finite, axis=arguments.whole)
    def twist(self, axis: int, elapsed: float, seconds: float, larger: float) -> Floats:
        """(6,) at a time since a move of so many seconds along an axis began, 0 after its end; `larger` multiplies the way."""
        out = np.zeros(6)
        if 0.0 <= elapsed < seconds:
            way = larger * (self.way if axis < 3 else self.turn)
            if axis == 2:
                way = -abs(way)  # away from the object
            out[axis] = way * math.pi / seconds * math.sin(2.0 * math.pi * elapsed / seconds)
        return out


MAX_SIGHTINGS = 80
"""Observations that are kept; of the older half then every second."""
REFINE_EVERY, REFINE_STEPS, REFINE_FROM, AFRESH_STEPS = 5, 2, 8, 20
"""All are gone through again every so many sightings, or at once while the search has not settled, with so many steps, from so
many on; with so many where it must be known whether they can be explained at all."""
REGRASP_SD = 0.02
"""m, how well the contacts of another grasp are known from a first look at them."""
SURE_LENGTH = 0.01
"""Relative standard deviation of a length that needs no further moves."""
MAX_SCALE = 4.0
"""Scale of the residuals from which on the search begins anew from the exploratory moves."""
MAX_DOUBLINGS = 2
"""How often moves that showed nothing are made larger."""
KEPT_INTERVALS = 9
"""Sightings of which the usual interval is the median."""
LEAST_IMAGES = 4
"""Images in which each exploratory move shows."""
MOVES_BEFORE_CHECK = 2
"""Moves after which the set-up is looked at: a sighting of the first move may come as late as that."""
SQUARE_SIZE = 3.0
"""Standard deviations of the tilt within which a part is taken to be square to the hand."""
MAX_MISFITS = 75
"""So many sightings of the last hundred that do not fit, and the estimate is begun anew."""


@dataclass(frozen=True)
class CalibrationSetup:
    """What is given of hand and camera.

    Attributes:
        exploration: how the exploratory moves are made.
        dof: 4 or 6.
        frame: middle and size of the images.
        camera: what is believed of the camera; with it nothing is explored.
        fixed: whether that is never corrected: the textbook's law.
        forgiven: m by which the fingertips of a hand of 4 DoF may be off because the part is tilted.
        widest: m that the contacts are apart at most.
        reference: a calibration of an earlier approach; None for what the present one told before.
    """

    exploration: Exploration
    dof: int
    frame: ImageFrame
    camera: NominalCamera | None
    fixed: bool
    forgiven: float
    widest: float
    reference: HandEye | None

    @property
    def slope(self) -> float:
        """rad by which the object's plane may be tilted against the hand."""
        return 0.01 if self.dof == 4 else 0.3


class SelfCalibration:
    """The estimate and how it came about.

    Attributes:
        failed: why it cannot be calibrated; empty where it can.
        restarts: how often an estimate proved wrong.
        displacements: how often the object was found displaced.
        lateness: s by which images are older than was told, as the exploratory moves show.
        drifted: later moves have contradicted the calibration.
    """

    def __init__(self, setup: CalibrationSetup, poses: Poses) -> None:
        self._setup, self._poses, self._order = setup, poses, MOVE_ORDER[setup.dof]
        self.restarts, self.displacements, self.lateness, self.drifted = 0, 0, 0.0, False
        self.begin_anew()

    def begin_anew(self) -> None:
        """Begin anew: another object, or an estimate that proved wrong."""
        self._seen: list[Observation] = []
        self._has_moves = True  # whether those of the exploratory moves are among them
        self._origin: Origin | None = None
        self._search: Search | None = None
        self._last: deque[Observation] = deque(maxlen=AGREEING_IMAGES)
        self._since = 0
        self._stage, self._began, self._larger, self._doublings = 0, float("nan"), 1.0, 0
        self._fits: deque[bool] = deque(maxlen=100)
        self._tilt = TiltCheck(self._setup.forgiven, self._setup.frame)
        self._trust, self._drift = Trust(), DriftAlarm(self._setup.reference)
        self.estimate: Estimate | ClassicalIBVS | None = None
        self.failed = ""
        self._regrasp = self._sure = False
        self._asked = self._setup.camera is None

    def restart_estimate(self) -> None:
        """Begin anew with an estimate that proved wrong; how often is counted."""
        self.restarts += 1
        self.begin_anew()

    def trusted_estimate(self) -> Estimate | None:
        """The estimate with a covariance that is to be believed; None where there is none, or it cannot be told."""
        known = self.estimate
        if not isinstance(known, Estimate):
            return None
        try:
            return self._trust.with_true_covariance(known, self._origin, self._seen, self._search)
        except (ValueError, ArithmeticError, np.linalg.LinAlgError):
            return None

    def grasp_pose_at(self, contacts: int, hand: Floats, time: float) -> GraspPose | None:
        """Where a grasp of so many contacts is in the base, at a time in s; None where that is not known yet."""
        known = None if self.is_exploring else self.trusted_estimate()
        if known is None:
            return None
        try:
            with np.errstate(all="ignore"):
                found = grasp_pose(known, contacts, hand, time, self._setup.dof)
        except (ValueError, ArithmeticError, np.linalg.LinAlgError):
            return None
        return found if np.isfinite(found.covariance).all() and np.isfinite(found.contacts).all() else None

    def following_twist(self, hand: Floats) -> Floats:
        """The twist (6,) that keeps the hand (4, 4) with a moving object."""
        out = np.zeros(6)
        known = self.estimate
        if known is not None:
            velocity, normal = hand[:3, :3].T @ known.object_velocity(), known.plane_normal(hand)
            out[:3] = velocity - normal * (normal @ velocity)
            out[2] *= self._setup.dof == 6  # nothing that lies on a table comes nearer by itself
        return out

    def contact_width(self) -> float:
        """m between the first two contacts, as the moves have told; NaN where they have not."""
        known = self.estimate
        return math.dist(*known.object.points[:2].tolist()) if isinstance(known, Estimate) else math.nan

    def _look_for_drift(self, seen: Observation) -> None:
        told = self.trusted_estimate()
        if told is not None:
            with suppress(ValueError, ArithmeticError, np.linalg.LinAlgError):
                self.drifted = self._drift.take_sighting(seen, told, told.displaced_at) or self.drifted

    def lose_object(self, time: float) -> None:
        """Nobody knows where the object went meanwhile; camera and shape stay known."""
        if self.is_exploring:
            self._began = float("nan")  # the present move is made again
        if isinstance(self.estimate, Estimate):
            self.estimate.release_object(time)

    def change_grasp(self) -> None:
        """Another grasp is followed from now on, on the same object: the camera stays known, and where the object lies."""
        if isinstance(self.estimate, Estimate):
            self._regrasp, self._sure = True, False
            self._drift.change_grasp()
        else:
            self.begin_anew()

    @property
    def is_exploring(self) -> bool:
        """Whether there are exploratory moves to make."""
        return self._asked and self._stage < len(self._order)

    def explore_again(self) -> bool:
        """Explore once more where the length of the grasp is not known well, once for each grasp; whether it will."""
        known = self.estimate
        if self._sure or not isinstance(known, Estimate) or known.relative_error() < SURE_LENGTH:
            return False
        self._sure = self._asked = True
        self._stage, self._began, self._larger = 0, float("nan"), 1.0
        self._has_moves = True
        return True

    def take_observation(self, seen: Observation) -> bool:
        """Take in a sighting; whether it fits what is known."""
        if self._regrasp:
            self._begin_from_the_same_object(seen)
        fits = True
        self._last.append(seen)
        if isinstance(self.estimate, Estimate):
            fits = self.estimate.observe(seen) < OUTLIER_SIZE
            if self.estimate.is_displaced:
                fits = self._explain_mismatch(self.estimate, seen)
        elif self.estimate is not None:
            self.estimate.observe(seen)
        elif self._setup.camera is not None:
            camera, centre = self._setup.camera, self._setup.frame.centre
            if self._setup.fixed:
                self.estimate = ClassicalIBVS(seen, camera, centre)
            else:
                self._take_estimate(initialize_from_nominal(seen, camera, centre, self._setup.slope))
        self._keep_observation(seen)
        self._fits.append(fits)
        if sum(not f for f in self._fits) >= MAX_MISFITS:
            self.restart_estimate()
            return False
        if self.is_exploring:
            self._go_on(seen.time)
        elif self._setup.dof == 4 and self._has_moves:
            self._check_tilt()
        self._refine_estimate()
        if fits and not self.is_exploring:
            self._look_for_drift(seen)
        return fits

    def _take_estimate(self, found: FirstEstimate) -> None:
        self._origin, self.estimate, self._search = found

    def _begin_from_the_same_object(self, seen: Observation) -> None:
        known, self._regrasp = self.estimate, False
        assert isinstance(known, Estimate)
        known.advance(seen.time)
        points = on_plane(known.camera, known.object, seen)
        if points is None:
            self.begin_anew()
            return
        o = known.object
        covariance = np.eye(SHAPE + points.size) * REGRASP_SD**2
        covariance[:SHAPE, :SHAPE] = known.covariance[:SHAPE, :SHAPE]
        moved = Placed(points, o.turn, o.place, o.speed, o.axes)
        self._origin = Origin(known.camera, moved, covariance, seen.time)
        self.estimate, self._search = refine_estimate(self._origin, [seen])
        self._forget_sightings()
        self._last.clear()
        self._fits.clear()

    def _explain_mismatch(self, known: Estimate, seen: Observation) -> bool:
        """What was seen agrees with itself, not with the estimate: is that the estimate's fault, or was the object moved?"""
        if self._origin is not None and len(self._seen) >= REFINE_FROM and not np.isfinite(known.displaced_at):
            anew, search = refine_estimate(self._origin, [*self._seen, *self._last], self._search, AFRESH_STEPS)
            if all(normalized_residual(anew, one) < OUTLIER_SIZE for one in self._last):
                self.estimate, self._search = anew, search
                return True
        known.release_object(seen.time)
        self.displacements += 1
        return known.observe(seen) < OUTLIER_SIZE

    def _keep_observation(self, seen: Observation) -> None:
        """Keep what tells more than the last one: sightings from elsewhere, or some time later."""
        self._since += 1
        if self._seen and not self.is_exploring:
            last = self._seen[-1]
            way = float(np.abs(seen.hand - last.hand).max())
            if way < MIN_WAY and seen.time - last.time < MIN_DELAY:
                return
        self._seen.append(seen)
        if len(self._seen) > MAX_SIGHTINGS:
            self._seen = self._seen[: MAX_SIGHTINGS // 2 : 2] + self._seen[MAX_SIGHTINGS // 2 :]

    def _forget_sightings(self) -> None:
        """They are of an object that lay elsewhere. Without the exploratory moves too little is left to tell a tilt."""
        self._seen, self._has_moves = [], False

    def _refine_estimate(self) -> None:
        """From time to time go through all that was kept again, as long as the object has not been displaced."""
        known = self.estimate
        if self._origin is None or not isinstance(known, Estimate):
            return
        if np.isfinite(known.displaced_at):
            if known.time > known.displaced_at + PUSHED_SECONDS:
                # it rests, or moves evenly again: what came before is the prior
                self._origin = Origin(known.camera, known.object, known.covariance.copy(), known.time)
                self._search = None
                self._forget_sightings()
                known.displaced_at = -np.inf
            return
        settled = self._search is None or self._search.settled
        is_due = self._since >= min(REFINE_EVERY, len(self._seen) // REFINE_FROM)
        if len(self._seen) < REFINE_FROM or (settled and not is_due):
            return
        self._since = 0
        anew, self._search = refine_estimate(self._origin, self._seen, self._search, REFINE_STEPS)
        anew.advance(known.time)
        anew.adopt_outliers(known)
        self.estimate = anew

    def _go_on(self, time: float) -> None:
        """Begin the first move, or end one that is over with a new estimate."""
        if np.isnan(self._began):
            self._began = time
        if time < self._began + self._move_duration():
            return
        if self._setup.camera is None and self._stage + 1 >= MOVES_BEFORE_CHECK:
            self._check_setup()
            if self.failed:
                return
        if self._origin is not None:
            self.estimate, self._search = refine_estimate(self._origin, self._seen, self._search, AFRESH_STEPS)
            if self._search.scale < MAX_SCALE:
                self._stage, self._began = self._stage + 1, time
                return
        try:
            self._explain_moves()
            self._stage += 1
        except UnexploredError as found:
            self._doublings += 1
            self._larger *= 2.0
            if self._doublings > MAX_DOUBLINGS:
                self.failed = str(found)
        self._began = time

    def _explain_moves(self) -> None:
        setup = self._setup
        self._take_estimate(initialize_calibration(self._seen, setup.frame, setup.slope, setup.widest))

    def _check_setup(self) -> None:
        """What the moves so far show of the set-up: what cannot be is a failure, images that are late are taken as such."""
        base, centre = inverse_pose(self._seen[0].hand), self._setup.frame.centre
        late = find_lateness(self._seen, self._poses.pose_at, base, centre)
        if late:
            self.lateness += late
            self._seen = delay_sightings(self._seen, late, self._poses.pose_at)
            self._last.clear()
            self._origin, self.estimate, self._search = None, None, None
        self.failed = find_fault(signals_of(self._seen, base, centre))

    def _check_tilt(self) -> None:
        """A part that is tilted is taken as it lies, or not with 4 DoF; one that is displaced is not looked at."""
        known = self.estimate
        if not isinstance(known, Estimate) or np.isfinite(known.displaced_at):
            return
        tilt = self._tilt.check_tilt(self._seen, known)
        if tilt is None or tilt.angle < SQUARE_SIZE * tilt.sd:
            return
        if tilt.tips_error > self._setup.forgiven:
            self.failed = (
                f"the part is tilted by {math.degrees(tilt.angle):.0f} degrees, the fingertips would be off by "
                f"{1000.0 * tilt.tips_error:.1f} mm: it needs a hand with dof=6, or one that forgives as much (Closing.tips)"
            )
            return
        self._take_estimate(tilt.found)
        tilt.found.estimate.advance(known.time)
        tilt.found.estimate.adopt_outliers(known)

    def _move_duration(self) -> float:
        """s of an exploratory move: each shows in some images."""
        times = [s.time for s in self._seen[-KEPT_INTERVALS:]]
        interval = median(b - a for a, b in pairwise(times)) if len(times) > 1 else 0.0
        return max(self._setup.exploration.seconds, LEAST_IMAGES * interval)

    def interrupt_move(self) -> None:
        """The grasp went out of sight: the present move is made again, the other way. Until then what it told must do."""
        if not np.isnan(self._began):
            self._larger *= -1.0
            if self.estimate is None:
                with suppress(UnexploredError):
                    self._explain_moves()
        self._began = float("nan")

    def exploratory_twist(self, time: float) -> Floats:
        """The exploratory twist (6,) at a time; `take` begins it."""
        if not self.is_exploring or np.isnan(self._began):
            return np.zeros(6)
        return self._setup.exploration.twist(
            self._order[self._stage], time - self._began, self._move_duration(), self._larger
        )

    def move_name(self) -> str:
        """Which move is being made."""
        names = ("x", "y", "z", "turn about x", "turn about y", "turn about z")
        return names[self._order[min(self._stage, len(self._order) - 1)]]
