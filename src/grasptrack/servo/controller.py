# SPDX-License-Identifier: Apache-2.0
"""The servo: one object whose `update` takes what the tracker said and answers with a twist, a state and a reason."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from grasptrack import arguments
from grasptrack.errors import InputError
from grasptrack.servo.camera import NominalCamera, check_pose
from grasptrack.servo.clock import SAME_IMAGE, TIME_STANDS, ImageGate, ServoClock, Tick
from grasptrack.servo.closing import CloseGate, Closing, judge_opening
from grasptrack.servo.command import OVER, Command, Intent, ServoCall, State
from grasptrack.servo.estimate import Estimate
from grasptrack.servo.first_estimate import ImageFrame
from grasptrack.servo.goal import MAX_OPENING, Goal
from grasptrack.servo.hand_eye import HandEye
from grasptrack.servo.law import TWIST_AXES, Aim, Approach, Gain, compute_aim
from grasptrack.servo.loss import LossHandler, LossPolicy, Trail
from grasptrack.servo.motion_check import ArmCheck, ImageCheck
from grasptrack.servo.observation import Observation, Poses, ResultObserver
from grasptrack.servo.self_calibration import CalibrationSetup, Exploration, SelfCalibration
from grasptrack.servo.watchdog import Bounds, Limits, Watchdog
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats

Law = Literal["online", "nominal", "textbook"]
LAWS: tuple[Law, ...] = ("online", "nominal", "textbook")

MAX_RESTARTS = 2
"""How often an estimate that proved wrong is begun anew before the servo gives up."""
WIDTH_FACTOR = 1.5
"""Times the opening that contacts seem apart at most: a first estimate errs, but the hand is open as wide as it goes."""
DISPLACED_WAIT, MAX_DISPLACEMENTS = 0.3, 2
"""s for which it stands once the object was found displaced, so that what moves in the image then is the object and not the
hand; and so many times at most."""
FLOOR_BELOW_GOAL = 0.006
"""m below the goal, as it was known while all fitted, to which the hand may go."""
OBJECT_UNSURE = """\
not sure which object is meant: name it (object_at, box or outline), confirm it (number=1), or ask for less (sure=0)"""
"""What a servo says while it does not move for that."""


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
        closing: when the hand may close, and how long it may take.
        bounds: what the hand does at most, whatever the images say.
        standoff: m before the goal at which the hand aligns before it goes down.
        latency: s between an image being taken and the time that `update` is told with it.
        time_limit: s after which a try is given up.
        max_age: s between an image being taken (`taken`) and its result being handed in, beyond which it counts for nothing;
            None for three intervals between images, at least `bounds.blind`, and the latency besides.
        retries: how often it tries again after it has closed on nothing.
        calibration: of an earlier approach (`servo.calibration`, `HandEye.load`), to be told when it no longer holds
            (`drifted`); by default what this approach told before is compared with what it tells later.

    Raises:
        InputError: degrees of freedom other than 4 or 6, an unknown law, one without its camera, a size, stand-off,
            latency, age, number of retries or time limit that is none.
    """

    @arguments.checked(
        goal=arguments.instance(Goal), dof=arguments.whole, law=arguments.text,
        camera=arguments.optional(arguments.instance(NominalCamera)), size=arguments.array(2),
        limits=arguments.optional(arguments.instance(Limits)), gain=arguments.optional(arguments.instance(Gain)),
        loss=arguments.optional(arguments.instance(LossPolicy)),
        exploration=arguments.optional(arguments.instance(Exploration)),
        closing=arguments.optional(arguments.instance(Closing)), bounds=arguments.optional(arguments.instance(Bounds)),
        standoff=arguments.finite, latency=arguments.finite, time_limit=arguments.number,
        max_age=arguments.optional(arguments.number), retries=arguments.whole,
        calibration=arguments.optional(arguments.instance(HandEye)),
    )  # fmt: skip
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
        bounds: Bounds | None = None,
        standoff: float = 0.04,
        latency: float = 0.0,
        time_limit: float = 40.0,
        max_age: float | None = None,
        retries: int = 0,
        calibration: HandEye | None = None,
    ) -> None:
        if dof not in TWIST_AXES:
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
        if retries < 0 or (max_age is not None and not max_age > 0.0):
            raise InputError("retries are 0 or more, a greatest age is positive", retries=retries, max_age=max_age)
        self.goal, self.dof, self.law, self.standoff = goal, dof, law, standoff
        self.limits, self.gain, self.loss = limits or Limits(), gain or Gain(), loss or LossPolicy()
        self._closing, bounds = closing or Closing(), bounds or Bounds()
        self._time_limit, self._retries = time_limit, retries
        self._latency = self._age = latency  # by itself, and of the last image
        # what time it is, and what is an image
        self._clock, self._poses = ServoClock(), Poses()
        self._images = ImageGate(max_age, bounds.blind, latency)
        # what is known
        self._observer = ResultObserver(square=dof == 6)
        setup = CalibrationSetup(
            exploration or Exploration(),
            dof,
            ImageFrame(np.array([size[0] - 1.0, size[1] - 1.0]) / 2.0, float(max(size))),
            camera=None if law == "online" else camera,
            fixed=law == "textbook",
            forgiven=self._closing.tips,
            widest=WIDTH_FACTOR * goal.opening if goal.opening else MAX_OPENING,
            reference=calibration,
        )
        self._known = SelfCalibration(setup, self._poses)
        self._arm, self._follows = ArmCheck(self.limits), ImageCheck()
        # what is done
        self._unseen = LossHandler(self.loss, self.limits)
        self._doubt = CloseGate(self._closing)
        self._trail = Trail(self.loss.speed, standoff)
        self._watchdog = Watchdog(self.limits, bounds, upright=dof == 4)
        self.state: State = "searching"
        self.reason = "no image yet"
        self._began = self._since = 0.0  # s, of the servo's time: this try, and closing or going back
        self._opens = False
        self._order: tuple[int, ...] | None = None
        self._grasp: int | None = None
        self._result: TrackResult | None = None

    @property
    def over(self) -> bool:
        """Whether it is done, holds nothing, or has failed: it brakes and stands, whatever is told from now on."""
        return self.state in OVER

    @property
    def is_exploring(self) -> bool:
        """Whether the exploratory moves, that of a second search among them, are not over yet."""
        return self._known.is_exploring

    @property
    def calibration(self) -> HandEye | None:
        """Focal length and mounting of the camera as the moves so far have told, with covariance; None before."""
        known = None if self._known.is_exploring else self._known.trusted_estimate()
        return None if known is None else HandEye.from_estimate(known)

    @property
    def drifted(self) -> bool:
        """Whether later moves contradict the calibration: the camera was knocked, or its focal length changed."""
        return self._known.drifted

    @arguments.checked(held=arguments.optional(arguments.truth), opening=arguments.optional(arguments.finite))
    def closed(self, held: bool | None = None, *, opening: float | None = None) -> None:
        """Tell what came of closing. Counts only while it closes.

        Where nothing is held and a try is left, the hand is told to open, goes back along its own path, and tries again.

        Args:
            held: whether something is held, as the caller knows; decides where it is given.
            opening: m between the fingers where they stopped, as the gripper reports it: compared with the grasp's own width,
                it tells whether the part is between them.

        Raises:
            InputError: neither is given, or an opening below 0.
        """
        if held is None and opening is None:
            raise InputError(
                "closed needs to be told whether something is held, or at which opening the fingers stopped"
            )
        if opening is not None and opening < 0.0:
            raise InputError(f"an opening is 0 or more, in m, not {opening:g}", opening=opening)
        if self.state != "closing":
            return
        why = ""
        if opening is not None and not held:
            why = judge_opening(opening, self._known.contact_width(), self.goal.opening or math.nan)
        if held or (held is None and not why):
            self._set_state("done", "something is held")
        elif self._retries > 0:
            self._retries -= 1
            self._opens, self._since, self._began = True, math.nan, math.inf  # the next try has its own time limit
            self._set_state("retreating", f"goes back and tries again: {why or 'closed on nothing'}")
            self._forget_motion()
        else:
            self._set_state("empty" if held is None else "failed", why or "closed on nothing")

    def touched(self) -> None:
        """Tell that the hand felt something before it was to close: what is known of the distance is wrong, and it fails."""
        if self.state != "closing":
            self.stop("the hand touched something on its way")

    @arguments.checked(reason=arguments.text)
    def stop(self, reason: str = "stopped by the caller") -> None:
        """End it: it fails for a reason of the caller's, brakes, and stands."""
        if not self.over:
            self._set_state("failed", " ".join(reason.split()) or "stopped by the caller")

    @arguments.checked(
        result=arguments.instance(TrackResult),
        time=arguments.finite,
        pose=arguments.array(unbounded=True),
        taken=arguments.optional(arguments.finite),
    )
    def update(self, result: TrackResult, *, time: float, pose: ArrayLike, taken: float | None = None) -> Command:
        """One step of control.

        A result is news only if it stands for a new image: other pixels, frame and time than the last one's, and young enough.
        Another one counts as a call of `between`. Nothing that a tracker can return raises.

        Args:
            result: what the tracker said of the latest image.
            time: s, now. Where it is that of the last call, no time has passed; where it jumps by more than a second, or back,
                that is a gap after which a new image is waited for.
            pose: (4, 4) of the hand in the robot's base, now.
            taken: s, when the image was taken, where its time stamp is on the robot's clock; default, `latency` before `time`.

        Returns:
            What to do until the next call.

        Raises:
            InputError: a time that is no finite number, an image from after `time`, or a pose that is none: nothing changes.
        """
        if taken is not None and taken > time:
            raise InputError(f"an image taken at {taken:g} s cannot be seen at {time:g} s: are both on one clock?")
        return self._step_control(time, check_pose(pose), result, taken)

    @arguments.checked(time=arguments.finite, pose=arguments.array(unbounded=True))
    def between(self, *, time: float, pose: ArrayLike) -> Command:
        """One step of control without a new image: where the robot wants twists more often than the camera gives images.

        It goes on toward the goal as the moves so far predict it, and stands once no image has come for `bounds.blind`. It
        never closes the hand: only an image lets it.

        Args:
            time: s, now, on the clock of `update`.
            pose: (4, 4) of the hand in the robot's base, now.

        Returns:
            What to do until the next call of either.

        Raises:
            InputError: a time that is no finite number, or a pose that is none. Nothing changes then.
        """
        return self._step_control(time, check_pose(pose), None, None)

    # --- steps ------------------------------------------------------------------------------------

    def _step_control(self, time: float, hand: Floats, result: TrackResult | None, taken: float | None) -> Command:
        """One call of either: whatever happens within, a twist that the watchdog allows comes of it."""
        tick = self._clock.advance(time)
        try:
            with np.errstate(all="ignore"):
                wanted = self._decide_intent(self._take_in(tick, hand, result, time, taken), tick)
        except Exception as error:
            # a fault of this program's: the arm goes on with the last twist unless it gets another
            wanted = Intent("failed", f"internal error, please report it: {type(error).__name__}: {error}")
        self._watchdog.over = wanted.state in OVER
        twist, failure = self._watchdog.limit_twist(wanted.twist, hand, tick, self._clock.usual_step)
        if failure:
            wanted = Intent("failed", failure)
        self._set_state(wanted.state, " ".join(wanted.reason.split()))
        self._arm.twist = twist
        pose = self._known.grasp_pose_at(len(self.goal.points), hand, tick.now)
        return wanted.command_with(twist, None if pose is None else replace(pose, time=float(time)))

    def _take_in(
        self, tick: Tick, hand: Floats, result: TrackResult | None, time: float, taken: float | None
    ) -> ServoCall:
        """The call as what it is: with a new image, or without one."""
        if tick.jump:
            self._images.forget_times()
            self._watchdog.forget_image()
            self._known.lose_object(tick.now)
            self._doubt.reset_count()
            self._forget_motion()
        if not tick.goes_on and tick.step > 0.0:
            self._images.break_interval()
        if tick.goes_on:
            self._poses.add_pose(tick.now, hand)
            self._arm.add_pose(tick.now, hand)
        why = self._images.refusal
        if result is not None:
            age = self._latency if taken is None else time - taken
            at = self._poses.pose_at(tick.now - age - self._known.lateness)
            why = self._images.why_not(result, tick.now, time, taken, at) if tick.goes_on else TIME_STANDS
            if not why and not result.repeated:
                self._watchdog.note_image(tick.now, self._images.image_interval)
            if not why and not self._watchdog.is_blind(tick.now):
                self._age, self._result = age, result
                return ServoCall(tick.now, tick.step, hand, result, "")
        return ServoCall(tick.now, tick.step, hand, None, why or SAME_IMAGE)

    def _decide_intent(self, now: ServoCall, tick: Tick) -> Intent:
        """What the states say, the most urgent first."""
        if self.over:
            return Intent(self.state, self.reason)
        if self._clock.is_in_no_seconds:
            return Intent("failed", f"times differ by {tick.jump:.3g} s between calls: are they in seconds?")
        contacts = None if now.result is None else now.result.contacts
        if contacts is not None and len(contacts) != len(self.goal.points):
            return Intent(
                "failed", f"the goal has {len(self.goal.points)} points and the grasp {len(contacts)} contacts"
            )
        if self.state == "closing":
            return self._closing_intent(now)
        fault = self._arm.why_not()
        if fault:
            return Intent("failed", fault)
        if now.time - self._began > self._time_limit:
            return Intent("failed", f"not done after {self._time_limit:g} s: {self.reason}")
        unsure = self.state == "unsure" if now.result is None else not now.result.object_sure
        if unsure and self.state != "retreating":  # the way back needs no object, and a closed hand has to open
            return Intent("unsure", OBJECT_UNSURE)
        try:
            return self._decide_motion(now)
        except (InputError, ArithmeticError, np.linalg.LinAlgError):
            # poses that jump, contacts that cannot be: what is told leads to no finite twist
            self._doubt.reset_count()
            self._known.restart_estimate()
            if self.state == "retreating":
                return self._retreating_intent(now)
            return Intent("holding", "what is told of hand and object does not fit together: begins anew")

    def _decide_motion(self, now: ServoCall) -> Intent:
        known = self._known
        seen, fits = (None, False) if now.result is None else self._observe_result(now, now.result)
        if known.failed or known.restarts > MAX_RESTARTS or known.displacements > MAX_DISPLACEMENTS:
            return Intent("failed", known.failed or "what is seen does not fit the motion of the hand")
        if self.state == "retreating":
            return self._retreating_intent(now)
        if isinstance(known.estimate, Estimate) and now.time - self._age - known.estimate.displaced_at < DISPLACED_WAIT:
            self._doubt.reset_count()
            return Intent("holding", "the object is not where it was: stands, and looks where it goes")
        if now.result is None:
            return self._intent_between(now)
        if seen is not None and fits:
            self._unseen.note_seen(now.time)
            return self._exploring_intent(now) if known.is_exploring else self._approach_goal(now, now.result, seen)
        self._doubt.reset_count()
        if known.is_exploring and self._unseen.seen_recently(now.time, self._watchdog.patience):
            return self._exploring_intent(now)
        return self._handle_loss(now, now.result, seen is not None)

    def _observe_result(self, now: ServoCall, result: TrackResult) -> tuple[Observation | None, bool]:
        """The sighting of a result, and whether it fits what is known."""
        known = self._known
        if result.grasp_id is not None and result.grasp_id != self._grasp:
            if self._grasp is not None:
                known.change_grasp()
                self._order = None
                self._follows.forget_sightings()
            self._grasp = result.grasp_id
        shot = now.time - self._age - known.lateness
        seen = self._observer.observe_result(result, shot, self._poses.pose_at(shot))
        if seen is None:
            return None, False
        if isinstance(known.estimate, Estimate) and not known.is_exploring:  # too little is known before
            known.failed = known.failed or self._follows.why_not(seen, known.estimate)
        return seen, known.take_observation(seen)

    def _exploring_intent(self, now: ServoCall) -> Intent:
        known = self._known
        twist = known.exploratory_twist(now.time - self._age - known.lateness) + self._known.following_twist(now.hand)
        return Intent("approaching", f"exploratory move: {known.move_name()}", twist)

    def _intent_between(self, now: ServoCall) -> Intent:
        """What to do before the next image."""
        known, last, patience = self._known, self._result, self._watchdog.patience
        if last is None:
            return self._unseen.wait_for_first("no image yet", now.time - self._began)
        if self._watchdog.is_blind(now.time):
            self._doubt.reset_count()
            if known.is_exploring:
                known.interrupt_move()
            return self._unseen.stand_blind(now.why, self._watchdog.seconds_blind(now.time))
        if self._unseen.seen_recently(now.time, patience) and self.state in ("approaching", "converged"):
            if known.is_exploring:
                return self._exploring_intent(now)
            found = self._compute_aim(now, None)
            if found is not None:
                twist = self.limits.joined(found.twist, self._known.following_twist(now.hand))
                return Intent(self.state, self.reason, twist, found)
        return self._handle_loss(now, last, False)

    def _approach_goal(self, now: ServoCall, result: TrackResult, seen: Observation) -> Intent:
        found = self._compute_aim(now, seen)
        if found is None:
            self._known.restart_estimate()
            return Intent("holding", "the goal would lie behind the camera, or nowhere: begins anew")
        self._trail.add(now.time, now.hand)
        if self._known.displacements == 0:  # what is found displaced still lies on the same table
            self._watchdog.floor = found.height - self._watchdog.rise_of(now.hand) + FLOOR_BELOW_GOAL
        carried = self._known.following_twist(now.hand)
        if found.aligned and found.height > 0.5 * self.standoff and self._known.explore_again():
            return Intent("approaching", "explores again before it goes down", carried, found)
        why = self._doubt.why_not(result, found, now.time)
        if not why:
            self._since = now.time
            self._forget_motion()
            return Intent("closing", "converged and believed", carried, found, close=True)
        at_goal = found.error_px <= self._doubt.position_tolerance(now.time)
        twist = self.limits.joined(found.twist, carried)
        return Intent("converged" if at_goal else "approaching", why if at_goal else found.doing, twist, found)

    def _closing_intent(self, now: ServoCall) -> Intent:
        """It waits for `closed`, and stays with an object that moves for as long as that is seen."""
        if now.time - self._since > self._closing.timeout:
            return Intent(
                "failed", f"nobody told within {self._closing.timeout:g} s what came of closing: call closed()"
            )
        if now.result is not None and now.result.object_sure:
            with suppress(InputError, ArithmeticError, np.linalg.LinAlgError):
                if self._observe_result(now, now.result)[1]:
                    self._unseen.note_seen(now.time)
        seen = self._unseen.seen_recently(now.time, self._watchdog.patience)
        twist = self._known.following_twist(now.hand) if seen else np.zeros(6)
        return Intent("closing", "waits to be told whether something is held", twist)

    def _retreating_intent(self, now: ServoCall) -> Intent:
        """Back along its own path, while images come: the part may lie anywhere by now."""
        opens, self._opens = self._opens, False
        if math.isnan(self._since):
            self._since = self._began = now.time
            self._watchdog.path = 0.0
            self._trail.start_retreat(now.time, now.hand)
            self._known.lose_object(now.time)
        carried = self._known.following_twist(now.hand)
        back = self._trail.twist_back(now.time, now.hand, now.hand[:3, :3] @ carried[:3])
        if back is not None:
            return Intent("retreating", self.reason, self.limits.joined(back, carried), open=opens)
        self._unseen.note_seen(now.time)
        return Intent("searching", "has gone back, looks for the grasp", carried, open=opens)

    def _handle_loss(self, now: ServoCall, result: TrackResult, located: bool) -> Intent:
        """Nothing is seen that fits."""
        known = self._known
        if known.is_exploring:
            known.interrupt_move()
        why = "what is seen does not fit what is known" if located else result.reason or result.status
        carried = self._known.following_twist(now.hand)
        coast = None if known.estimate is None else lambda: None if known.is_exploring else self._compute_aim(now, None)
        return self._unseen.choose_intent(why, now.time, now.time - self._began, now.step, carried, coast)

    # --- parts ------------------------------------------------------------------------------------

    def _compute_aim(self, now: ServoCall, seen: Observation | None) -> Aim | None:
        known = self._known.estimate
        if known is None:
            return None
        if self._order is None:
            fitting = self.goal.orders(known.camera, known.in_hand(now.hand, now.time)[: len(self.goal.points)])
            if not fitting:  # contacts so far away that no distance between them is a number
                return None
            self._order = fitting[0]
        how = Approach(self.goal, self._order, self.dof, self.standoff, self.gain)
        return compute_aim(known, how, seen, now.hand, now.time)

    def _forget_motion(self) -> None:
        """What was told and what came of it are no longer compared: the clock has jumped, or somebody else moves the arm."""
        self._arm.forget_moves()
        self._follows.forget_sightings()

    def _set_state(self, state: State, reason: str) -> None:
        self.state, self.reason = state, reason
