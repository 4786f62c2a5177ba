# SPDX-License-Identifier: Apache-2.0
"""The servo: one object whose `update` takes what the tracker said and answers with a twist, a state and a reason."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from grasptrack import arguments
from grasptrack.errors import InputError
from grasptrack.servo.camera import NominalCamera, check_pose
from grasptrack.servo.closing import CloseGate, Closing
from grasptrack.servo.goal import Goal
from grasptrack.servo.law import AXES, Aim, Approach, Gain, compute_aim
from grasptrack.servo.limits import OVER, Command, Intent, Limits, State
from grasptrack.servo.loss import LossHandler, LossPolicy
from grasptrack.servo.observation import Observation, Poses, ResultObserver
from grasptrack.servo.self_calibration import Exploration, SelfCalibration
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats

Law = Literal["online", "nominal", "textbook"]
LAWS: tuple[Law, ...] = ("online", "nominal", "textbook")

RESTARTS = 2
"""How often an estimate that proved wrong is begun anew before the servo gives up."""
UNSURE = "not sure which object is meant: name it (object_at, box or outline), confirm it (number=1), or ask for less (sure=0)"
"""What a servo says while it does not move for that."""
LONGEST_STEP = 0.2
"""s that count as one step of control at most: after a pause the acceleration limit holds all the same."""


@contextlib.contextmanager
def _own_errors() -> Iterator[None]:
    """Arguments that are refused within come of an estimate, not from the caller."""
    try:
        yield
    except InputError as error:
        raise ArithmeticError(str(error)) from error


class GraspServo:
    """Brings the hand to the grasp.

    Args:
        goal: `Goal.fingertips` or `Goal.taught`.
        dof: 4 (shifts, and the turn about the approach direction) or 6.
        law: "online" (nothing known of the camera: exploratory moves, then estimated on the way), "nominal" (begins with
            `camera`, estimated on the way), "textbook" (`camera` as it is, a fixed interaction matrix: to compare with).
        camera: what is believed of the camera; needed by "nominal" and "textbook".
        size: (width, height) px of the images.
        limits: of velocity and acceleration.
        gain: how quickly errors fall.
        loss: what is done while the grasp is not seen.
        exploration: how exploratory moves are made.
        closing: when the hand may close.
        standoff: m before the goal at which the hand aligns before it goes down.
        latency: s between an image being taken and the time that `update` is told with it.
        time_limit: s after which it gives up.

    Raises:
        InputError: degrees of freedom other than 4 or 6, an unknown law, one without its camera, a size, stand-off,
            latency or time limit that is none.
    """

    @arguments.checked(
        goal=arguments.instance(Goal),
        dof=arguments.whole,
        law=arguments.text,
        camera=arguments.optional(arguments.instance(NominalCamera)),
        size=arguments.array(2),
        limits=arguments.optional(arguments.instance(Limits)),
        gain=arguments.optional(arguments.instance(Gain)),
        loss=arguments.optional(arguments.instance(LossPolicy)),
        exploration=arguments.optional(arguments.instance(Exploration)),
        closing=arguments.optional(arguments.instance(Closing)),
        standoff=arguments.finite,
        latency=arguments.finite,
        time_limit=arguments.number,
    )
    def __init__(
        self,
        goal: Goal,
        dof: int = 4,
        *,
        law: Law = "online",
        camera: NominalCamera | None = None,
        size: tuple[int, int] = (640, 480),
        limits: Limits | None = None,
        gain: Gain | None = None,
        loss: LossPolicy | None = None,
        exploration: Exploration | None = None,
        closing: Closing | None = None,
        standoff: float = 0.04,
        latency: float = 0.0,
        time_limit: float = 40.0,
    ) -> None:
        if dof not in AXES:
            raise InputError(f"a hand has 4 or 6 degrees of freedom, not {dof}", dof=dof)
        if law not in LAWS:
            raise InputError(f'unknown law "{law}"; choose from {", ".join(LAWS)}', law=law)
        if law != "online" and camera is None:
            raise InputError(f'the law "{law}" needs a nominal camera', law=law)
        if min(size) <= 0 or standoff < 0.0 or latency < 0.0 or not time_limit > 0.0:
            raise InputError(
                "size and time limit are positive, stand-off and latency 0 or more",
                size=size, standoff=standoff, latency=latency, time_limit=time_limit,
            )  # fmt: skip
        self.goal, self.dof, self.law, self.standoff = goal, dof, law, standoff
        self.limits, self.gain, self.loss = limits or Limits(), gain or Gain(), loss or LossPolicy()
        self._unseen = LossHandler(self.loss, self.limits)
        self._centre = np.array([size[0] - 1.0, size[1] - 1.0]) / 2.0
        self._side, self._time_limit = float(max(size)), time_limit
        self._latency = self._age = latency  # by itself, and of the last image
        self.calibration = SelfCalibration(
            exploration or Exploration(), dof, None if law == "online" else camera, fixed=law == "textbook"
        )
        self._observer, self._poses = ResultObserver(square=dof == 6), Poses()
        self._doubt = CloseGate(closing or Closing())
        self.state: State = "searching"
        self.reason = "no image yet"
        self._twist = np.zeros(6)
        self._began = self._time = math.nan
        self._order: tuple[int, ...] | None = None
        self._grasp: int | None = None
        self._result: TrackResult | None = None

    @property
    def over(self) -> bool:
        """Whether it is done or has failed."""
        return self.state in OVER

    def closed(self, held: bool) -> None:
        """Tell what came of closing: whether something is held."""
        if self.state == "closing":
            self.state, self.reason = ("done", "something is held") if held else ("failed", "closed on nothing")

    def touched(self) -> None:
        """Tell that the hand felt something before it was to close: what is known of the distance is wrong, and it fails."""
        if not self.over and self.state != "closing":
            self.state, self.reason = "failed", "the hand touched something on its way"

    @arguments.checked(
        result=arguments.instance(TrackResult),
        time=arguments.number,
        pose=arguments.array(unbounded=True),
        taken=arguments.optional(arguments.finite),
    )
    def update(self, result: TrackResult, *, time: float, pose: ArrayLike, taken: float | None = None) -> Command:
        """One step of control.

        Args:
            result: what the tracker said of the latest image.
            time: s, now.
            pose: (4, 4) of the hand in the robot's base, now.
            taken: s, when the image was taken, where its time stamp is on the robot's clock; default, `latency` before `time`.

        Returns:
            What to do until the next call.

        Raises:
            InputError: a time that is not later than the last one, an image from after `time`, or a pose that is none.
        """
        if taken is not None and taken > time:
            raise InputError(f"an image taken at {taken:g} s cannot be seen at {time:g} s: are both on one clock?")
        hand, step = self._take_pose(time, pose)
        shot = time - self._latency if taken is None else taken
        self._age = time - shot
        self._result = result
        if self.over:
            return self._make_command(Intent(self.state, self.reason), 0.0)
        if not result.object_sure:
            return self._make_command(self._unsure_intent(time), step)

        def decide() -> Intent:
            seen, fits = self._observe_result(result, shot)
            with _own_errors():
                return self._decide_intent(result, seen if fits else None, seen is not None, time, hand, step)

        return self._make_command(self._finite_intent(decide), step)

    @arguments.checked(
        time=arguments.number,
        pose=arguments.array(unbounded=True),
    )
    def between(self, *, time: float, pose: ArrayLike) -> Command:
        """One step of control without a new image: where the robot wants twists more often than the camera gives images.

        It goes on toward the goal as the moves so far predict it, for as long as an image may be missing anyway
        (`loss.BLINK`); after that it is a loss, and the loss policy says what is done. It never closes the hand: only an
        image lets it.

        Args:
            time: s, now, on the clock of `update`.
            pose: (4, 4) of the hand in the robot's base, now.

        Returns:
            What to do until the next call of either.

        Raises:
            InputError: a time that is not later than the last one of either, or a pose that is none.
        """
        hand, step = self._take_pose(time, pose)
        if self.over:
            return self._make_command(Intent(self.state, self.reason), 0.0)
        if self.state == "unsure":
            return self._make_command(self._unsure_intent(time), step)

        def decide() -> Intent:
            with _own_errors():
                return self._intent_between(time, hand, step)

        return self._make_command(self._finite_intent(decide), step)

    # --- steps ------------------------------------------------------------------------------------

    def _take_pose(self, time: float, pose: ArrayLike) -> tuple[Floats, float]:
        """The pose as it was checked, and the s since the last call that count."""
        hand = check_pose(pose)
        if not math.isfinite(time) or time <= self._time:
            raise InputError(f"times go on: {time} s after {self._time} s", time=time, last=self._time)
        step = min(time - self._time, LONGEST_STEP) if math.isfinite(self._time) else 0.0
        self._began = time if math.isnan(self._began) else self._began
        self._time = time
        self._poses.add_pose(time, hand)
        return hand, step

    def _unsure_intent(self, time: float) -> Intent:
        late = time - self._began > self._time_limit
        why = f"not done after {self._time_limit:g} s: {UNSURE}" if late else UNSURE
        return Intent("failed" if late else "unsure", why)

    def _finite_intent(self, decide: Callable[[], Intent]) -> Intent:
        """What to do; to stand, where what was told leads to no finite twist: poses that jump, contacts that cannot be."""
        try:
            with np.errstate(all="ignore"):
                wanted = decide()
            if np.isfinite(wanted.twist).all():
                return wanted
        except (ArithmeticError, np.linalg.LinAlgError):
            pass
        self._doubt.reset_count()
        self.calibration.restart_estimate()
        return Intent("holding", "what is told of hand and object does not fit together: begins anew")

    def _observe_result(self, result: TrackResult, shot: float) -> tuple[Observation | None, bool]:
        """The sighting of a result, and whether it fits what is known."""
        if result.grasp_id is not None and result.grasp_id != self._grasp:
            if self._grasp is not None:
                self.calibration.change_grasp()
                self._order = None
            self._grasp = result.grasp_id
        seen = self._observer.observe_result(result, shot, self._poses.pose_at(shot))
        if seen is not None and seen.contacts != len(self.goal.points):
            raise InputError(
                f"the goal has {len(self.goal.points)} points and the grasp {seen.contacts} contacts",
                goal=len(self.goal.points), contacts=seen.contacts,
            )  # fmt: skip
        if seen is None:
            return None, False
        return seen, self.calibration.take_observation(seen, self._centre, self._side)

    def _decide_intent(
        self, result: TrackResult, seen: Observation | None, located: bool, time: float, hand: Floats, step: float
    ) -> Intent:
        """What the states say, the most urgent first."""
        known, urgent = self.calibration, self._urgent_intent(time, hand)
        if urgent is not None:
            return urgent
        if seen is not None:
            self._unseen.note_seen(time)
        else:
            self._doubt.reset_count()
            if not (known.exploring and self._unseen.seen_recently(time)):
                return self._handle_loss(result, located, time, hand, step)
        if seen is None or known.exploring:
            return self._exploring_intent(time, hand)
        return self._approach_goal(result, seen, time, hand)

    def _urgent_intent(self, time: float, hand: Floats) -> Intent | None:
        """What comes first whether something is seen or not."""
        known = self.calibration
        if time - self._began > self._time_limit:
            return Intent("failed", f"not done after {self._time_limit:g} s: {self.reason}")
        if known.failed or known.restarts > RESTARTS:
            return Intent("failed", known.failed or "what is seen does not fit the motion of the hand")
        if self.state == "closing":
            return Intent("closing", "waits to be told whether something is held", self._following_twist(hand))
        return None

    def _exploring_intent(self, time: float, hand: Floats) -> Intent:
        known = self.calibration
        twist = known.exploratory_twist(time - self._age) + self._following_twist(hand)
        return Intent("approaching", f"exploratory move: {known.move_name()}", twist)

    def _intent_between(self, time: float, hand: Floats, step: float) -> Intent:
        """What to do before the next image."""
        known, urgent, last = self.calibration, self._urgent_intent(time, hand), self._result
        if urgent is not None:
            return urgent
        if last is None:
            return self._unseen.choose_intent("no image yet", time, time - self._began, step, np.zeros(6), None)
        if self._unseen.seen_recently(time) and self.state in ("approaching", "converged"):
            if known.exploring:
                return self._exploring_intent(time, hand)
            found = self._compute_aim(time, hand, None)
            if found is not None:
                twist = self.limits.joined(found.twist, self._following_twist(hand))
                return Intent(self.state, self.reason, twist, found)
        if not self._unseen.seen_recently(time):
            self._doubt.reset_count()
        return self._handle_loss(last, False, time, hand, step, "no image since" if last.contacts is not None else "")

    def _approach_goal(self, result: TrackResult, seen: Observation, time: float, hand: Floats) -> Intent:
        found = self._compute_aim(time, hand, seen)
        if found is None:
            self.calibration.restart_estimate()
            return Intent("holding", "the goal would lie behind the camera, or nowhere: begins anew")
        carried = self._following_twist(hand)
        if found.aligned and found.height > 0.5 * self.standoff and self.calibration.explore_again():
            return Intent("approaching", "explores again before it goes down", carried, found)
        why = self._doubt.why_not(result, found.error_px, found.final, time)
        if not why:
            return Intent("closing", "converged and believed", carried, found, close=True)
        at_goal = found.error_px <= self._doubt.position_tolerance(time)
        twist = self.limits.joined(found.twist, carried)
        return Intent("converged" if at_goal else "approaching", why if at_goal else found.doing, twist, found)

    def _handle_loss(
        self, result: TrackResult, located: bool, time: float, hand: Floats, step: float, cause: str = ""
    ) -> Intent:
        """Nothing is seen that fits."""
        known = self.calibration
        if known.exploring:
            known.interrupt_move(self._centre, self._side)

        def coasting_aim() -> Aim | None:
            return None if known.exploring else self._compute_aim(time, hand, None)

        why = cause or ("what is seen does not fit what is known" if located else result.reason or result.status)
        carried = self._following_twist(hand)
        knows = coasting_aim if known.estimate is not None else None
        return self._unseen.choose_intent(why, time, time - self._began, step, carried, knows)

    # --- parts ------------------------------------------------------------------------------------

    def _compute_aim(self, time: float, hand: Floats, seen: Observation | None) -> Aim | None:
        known = self.calibration.estimate
        if known is None:
            return None
        if self._order is None:
            fitting = self.goal.orders(known.camera, known.in_hand(hand, time)[: len(self.goal.points)])
            if not fitting:  # contacts so far away that no distance between them is a number
                return None
            self._order = fitting[0]
        how = Approach(self.goal, self._order, self.dof, self.standoff, self.gain)
        return compute_aim(known, how, seen, hand, time)

    def _following_twist(self, hand: Floats) -> Floats:
        """The twist (6,) that keeps the hand with a moving object."""
        out = np.zeros(6)
        known = self.calibration.estimate
        if known is not None:
            out[:3] = hand[:3, :3].T @ known.object_velocity()
        return out

    def _make_command(self, wanted: Intent, step: float) -> Command:
        self.state, self.reason = wanted.state, wanted.reason
        self._twist = self.limits.reachable(wanted.twist, self._twist, step)
        return wanted.command(self._twist.copy())
