# SPDX-License-Identifier: Apache-2.0
"""One approach, from the first look to the part in the air, and what became of it."""

from __future__ import annotations

import math
import time as clock
import zlib
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import ConditioningError, GraspTrackError
from grasptrack.geometry.contours import Contour, View
from grasptrack.grasp.hand import Hand
from grasptrack.matching import Sampled, match_outlines
from grasptrack.servo import Command, Goal, GraspServo, NominalCamera
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import Floats
from grasptrack_bench.approach.case import ApproachCase, Law, Row
from grasptrack_bench.approach.choosing import closing_grasps, first_look, hand_for, turn_between, width_in_m
from grasptrack_bench.approach.truth import on_part, pairs_that_close, record_closing_errors, triples_that_close
from grasptrack_bench.physics import World
from grasptrack_bench.physics.gripper import Gripper, make_gripper
from grasptrack_bench.physics.setting import Setting
from grasptrack_bench.simulation.coverage import subdivide_polygon
from grasptrack_bench.simulation.outlines import Shape

WINDOW, LEAST = 8, 0.5
"""Images, and the share of them in which the grasp has to be found, or it is looked for anew."""
OTHERWISE = 2
"""Of so many grasps chosen anew, one is followed by its outline alone: what a faint surface shows may mislead."""
SELDOM = 4
"""Images from one look to the next where nothing was found."""
LIES_ON, MISFIT = 0.6, 0.05
"""What is chosen anew must be the part that was looked at first: so much of both outlines lies on each other, and they differ
by this share of sqrt(area) at most, rms. A grain of the table does not; sides of the part that now show may."""


class Looking:
    """Follows one grasp all the way down, as `GraspTracker` does, and looks anew where the tracker no longer finds it.

    The tracker would rather say nothing than something wrong. From 2.5 times the distance an outline shows less than half of
    its detail, and a thick part shows other sides of itself from elsewhere: what speaks against the reference then ends in
    "lost" for good. The hand is nearer by that time, and there is but one part: so a grasp is chosen again in what is seen
    now, with a new `grasp_id`, if that has the outline of the first look.

    Args:
        tracker: that has seen its first image and chosen a grasp.
        view: the outline of the part in that image.
        ignore: (H, W), where the hand is in the image.
        hand: its limits.
        tips: (k, 2) px of the fingertips.
        risk: of a tracker that follows a grasp chosen anew.

    Attributes:
        again: how often a grasp was chosen anew.
        looked: in the last image the part was looked for anew, which takes far longer than following it.
    """

    def __init__(
        self,
        tracker: GraspTracker,
        view: View,
        ignore: NDArray[Any],
        hand: Hand,
        tips: Floats,
        risk: float = DEFAULT_RISK,
    ) -> None:
        self._tracker, self._ignore, self._hand, self._tips, self._risk = tracker, ignore, hand, tips, risk
        self._outline = Sampled(view)
        self._found: deque[bool] = deque([True] * WINDOW, maxlen=WINDOW)
        self._wait = 0
        self.again = 0
        self.looked = False
        # looked for anew it is the same part, no surer to be the one that is meant
        self._object_sure = tracker.object_sure

    def update(self, image: NDArray[Any], time: float, *, look: bool = True) -> TrackResult:
        """What is seen now."""
        result: TrackResult = self._tracker.update(image, time)
        self._found.append(result.status == "tracked")
        self._wait = max(0, self._wait - 1)
        self.looked = look and result.status != "tracked" and self._wait == 0 and sum(self._found) < LEAST * WINDOW
        if self.looked:
            self._wait = SELDOM
            strategy = "auto" if self.again % OTHERWISE < OTHERWISE - 1 else "homography"
            tracker, anew = first_look(image, time, self._ignore, self._hand, self._tips, strategy, self._risk)
            if anew.status == "tracked" and anew.view is not None and self._is_the_part(anew.view):
                self._tracker, result = tracker, anew
                self._found.extend([True] * WINDOW)
                self.again += 1
        result = replace(result, object_sure=self._object_sure)
        if result.grasp_id is None:
            return result
        return replace(result, grasp_id=result.grasp_id + self.again)

    def _is_the_part(self, view: View) -> bool:
        """Whether an outline is that of the first look, from anywhere."""
        ways = match_outlines(self._outline, Sampled(view), thorough=False)
        return bool(ways) and ways[0].share >= LIES_ON and ways[0].misfit <= MISFIT * ways[0].size


ABOVE = 0.008
"""m above the part's upper face at which the tips stop; what is left is felt for."""
KNOWN = 0.1
"""How well the size of the part is known beforehand, which is what the hand's limits are told by."""
RETRIES = 1
"""How often the hand may try again after it has closed on nothing, where the part is pulled away."""
PATIENCE = 25
"""Images in which to look for the part before giving up."""
LOOK_PERIODS = 3
"""Control periods that pass while the whole image is looked at for a grasp. The hand goes on as it was told last; the images
that come meanwhile are gone through afterwards."""
SHORT_S = 0.5
"""s of an arm at its limits, from which on a failure says so."""
NOMINAL_FOCAL, NOMINAL_HEIGHT, NOMINAL_ASIDE, NOMINAL_LEAN = 600.0, 0.275, 0.07, math.radians(6.0)
"""px, m, m and rad of the camera that the nominal laws believe in: the middle of what is drawn."""


@dataclass
class Step:
    """One step of the loop, for whoever watches.

    Attributes:
        stage: "look", "approach", "close", "open" or "lift".
        time: s.
        image: of the hand's camera; None while it closes, opens and lifts.
        result, command: of tracker and servo; None where there is none.
    """

    stage: str
    time: float
    image: NDArray[np.uint8] | None = None
    result: TrackResult | None = None
    command: Command | None = None


Watch = Callable[[World, Step], None]


class ClosingSight(Protocol):
    """What follows a grasp down to where the fingers close, and may choose it anew; `again` and `looked` as of `Looking`."""

    again: int
    looked: bool

    def update(self, image: NDArray[Any], time: float, *, look: bool = True) -> TrackResult:
        """What is seen now; `look` allows for a look at the whole image."""
        ...


@dataclass
class TrialRun:
    """A trial on its way: the world, what is tried, what has become of it so far, and who watches."""

    world: World
    case: ApproachCase
    row: Row
    watch: Watch | None
    step: Step = field(default_factory=lambda: Step("look", 0.0))
    servo_ms: list[float] = field(default_factory=list)
    loop_ms: list[float] = field(default_factory=list)
    look_ms: list[float] = field(default_factory=list)
    truth: Floats | None = None  # the chosen contacts on the part, m
    seen: Step | None = None  # the last in which the grasp was seen, ...
    missed: Step | None = None  # ... and the first after it
    locate: Callable[[World, Floats], Floats] = on_part  # where contacts that are chosen on the way lie on the part, m

    def later(self, stage: str) -> Callable[[], None]:
        """What tells of steps without images of the loop's own."""
        last = self.step
        return lambda: self.tell(Step(stage, self.world.time(), None, last.result, last.command))

    def tell(self, step: Step) -> None:
        """Keep the step, and tell whoever watches."""
        self.step = step
        if step.image is not None and step.result is not None:
            if step.result.contacts is not None:
                self.seen, self.missed = step, None
            else:
                self.missed = self.missed or step
        if self.watch is not None:
            self.watch(self.world, step)


def run_trial(case: ApproachCase, watch: Watch | None = None) -> tuple[Row, bytes]:
    """Look, choose, approach, close, lift; `watch` is called after every step.

    What became of it, and a PNG of the end where it failed and pictures are asked for; else empty.
    """
    row = Row(case.seed, case.shape.name, case.scenario, case.arm, case.law, fingers=case.fingers)
    world = World(
        case.shape,
        seed=case.seed,
        scenario=case.scenario,
        arm=case.arm,
        fingers=case.fingers,
        images=case.images,
        axis=grasp_axis_angle(case.shape, make_gripper(case.fingers)),
    )
    run = TrialRun(world, case, row, watch)
    try:
        _run_approach(run)
    except GraspTrackError as error:
        row.outcome, row.reason = "failed", f"{type(error).__name__}: {' '.join(str(error).split())}"
    if row.outcome == "failed" and world.short_s > SHORT_S:
        row.reason += f"; for {world.short_s:.1f} s the arm could not go as told"
    if math.isnan(row.time_s):
        row.time_s = world.time()
    if run.loop_ms:
        row.servo_ms, row.loop_ms = float(np.median(run.servo_ms)), float(np.median(run.loop_ms))
        row.loop_p99_ms = float(np.percentile(run.loop_ms, 99))
    if run.look_ms:
        row.look_ms = float(np.median(run.look_ms))
    if row.outcome == "lifted" or not case.pictures:
        return row, b""
    from grasptrack_bench.approach.pictures import render_final_png

    try:
        return row, render_final_png(world, run.step, row, run.seen, run.missed)
    except ConditioningError:  # the hand has come so near that a part of the scene is behind its camera
        return row, b""


def _run_approach(run: TrialRun) -> None:
    world, row = run.world, run.row
    tips, opening = world.fingertips()
    ignore = world.ignore()
    rng = np.random.default_rng((run.case.seed, zlib.crc32(run.case.shape.name.encode()), 72))
    hand = hand_for(world.setting.part.size * float(rng.uniform(1.0 - KNOWN, 1.0 + KNOWN)), KNOWN)
    for _ in range(PATIENCE):
        image = world.image()
        began = clock.perf_counter()
        tracker, result = first_look(image, world.time(), ignore, hand, tips, risk=run.case.risk, sure=run.case.sure)
        run.look_ms.append(1e3 * (clock.perf_counter() - began))
        run.tell(Step("look", world.time(), image, result))
        row.images += 1
        if result.contacts is not None or result.view is not None:
            break
        world.move(np.zeros(6))
    if result.contacts is None:
        refused = result.view is not None
        row.outcome, row.reason = ("refused" if refused else "failed"), result.reason or "no grasp"
        closing = pairs_that_close if run.case.fingers == 2 else triples_that_close
        row.confirmed = closing(run.case.shape, world.setting.part.size) == 0 if refused else None
        return
    _record_start_state(run, result.contacts, tips)
    assert result.view is not None  # contacts lie on an outline
    looking = Looking(tracker, result.view, ignore, hand, tips, run.case.risk)
    apart = float(np.linalg.norm(np.diff(world.hand.tips(opening)[:2], axis=0)))
    goal = Goal.fingertips(tips, apart, beyond_m=-ABOVE)
    dof, pulled = 6 if world.arm == "arm" else 4, run.case.scenario == "pulled"
    servo = GraspServo(goal, dof, law=run.case.law, camera=_nominal_camera(run.case.law), retries=RETRIES * pulled)
    if not close_on_part(run, servo, looking, tips, opening, by_opening=pulled):
        return
    world.watch = run.later("lift")
    if world.lift():
        row.outcome = "lifted"
    else:
        row.reason = world.failure


def close_on_part(
    run: TrialRun, servo: GraspServo, looking: ClosingSight, tips: Floats, opening: float, *, by_opening: bool
) -> bool:
    """Let the servo bring the hand to the grasp, and close; whether the servo says that something is held.

    Args:
        run: its row is told how it went.
        servo, looking: what moves the hand, and what follows the grasp.
        tips, opening: (k, 2) px of the fingertips, and m between them where they are seen.
        by_opening: the servo is told the gripper's opening alone, not whether fingers press on something.
    """
    world, row = run.world, run.row
    twist = np.zeros(6)
    _process_buffered_frames(run, looking, twist)
    world.move(twist)
    while not servo.over:
        image = world.image()
        began = clock.perf_counter()
        result = looking.update(image, world.time())
        tracked, looked = clock.perf_counter(), looking.looked
        if looked:
            run.look_ms.append(1e3 * (tracked - began))
            if looking.again > row.again:
                row.again = looking.again
                assert result.contacts is not None  # they were chosen in this image
                run.truth = run.locate(world, result.contacts)
            image, result = _process_buffered_frames(run, looking, twist)
        decided = clock.perf_counter()
        command = servo.update(result, time=world.time(), pose=world.pose())
        ended = clock.perf_counter()
        run.servo_ms.append(1e3 * (ended - decided))
        if not looked:
            run.loop_ms.append(1e3 * (ended - began))
        row.images += 1
        twist = command.twist
        run.tell(Step("approach", world.time(), image, result, command))
        if command.close:
            row.time_s, row.error_px = world.time(), command.error_px
            row.believed = bool(result.status == "tracked" and result.contacts is not None)
            if run.truth is not None and result.contacts is not None:
                record_closing_errors(row, world, run.truth, result.contacts)
                row.wrong += row.right is False
        world.move(twist)
        if command.close:
            width = width_in_m(result.contacts, tips, opening) if result.contacts is not None else None
            world.watch = run.later("close")
            held = world.close(width)
            world.watch = None
            if by_opening:
                servo.closed(opening=world.opening())
            else:
                servo.closed(held)
            row.tries += 1
            if row.tries == 1 and not held:
                row.noticed = servo.state != "done"
        elif command.open:
            world.watch = run.later("open")
            world.open()
            world.watch = None
        elif world.touches():
            servo.touched()
    if servo.state != "done":
        row.reason = servo.reason if command.close else f"servo: {servo.reason}"
    return servo.state == "done"


def _process_buffered_frames(
    run: TrialRun, looking: ClosingSight, twist: Floats
) -> tuple[NDArray[np.uint8], TrackResult]:
    """What has become of it while the whole image was looked at: the last image since, and what is seen there."""
    came = []
    for _ in range(LOOK_PERIODS):
        run.world.move(twist)
        came.append((run.world.image(), run.world.time()))
        run.tell(Step("look", run.world.time(), came[-1][0]))
    run.row.images += len(came)
    results = [looking.update(image, time, look=False) for image, time in came]
    return came[-1][0], results[-1]


def _record_start_state(run: TrialRun, contacts: Floats, tips: Floats) -> None:
    """How far off the view is at the start, and where the chosen contacts truly are."""
    world, row = run.world, run.row
    run.truth = on_part(world, contacts)
    row.start_turn_deg = math.degrees(turn_between(contacts, tips))
    off = (contacts.mean(axis=0) - tips.mean(axis=0)) / np.array(
        [world.setting.camera.width, world.setting.camera.height]
    )
    row.start_off = float(np.abs(off).max())
    row.start_away = _start_depth_ratio(world.setting)


def _start_depth_ratio(setting: Setting) -> float:
    """Distance of the part at the start along the optical axis, as a multiple of that of the fingertips."""
    to_camera = np.linalg.inv(setting.hand @ setting.mount)
    tips = np.linalg.inv(setting.mount)[2, 3]
    return float((to_camera @ setting.place[:, 3])[2] / tips)


def _nominal_camera(law: Law) -> NominalCamera | None:
    if law == "online":
        return None
    mounting = np.eye(4)
    c, s = math.cos(NOMINAL_LEAN), math.sin(NOMINAL_LEAN)
    mounting[:3, :3] = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    mounting[:3, 3] = (0.0, -NOMINAL_ASIDE, -NOMINAL_HEIGHT)
    return NominalCamera(NOMINAL_FOCAL, mounting, distance=2.0 * math.hypot(NOMINAL_ASIDE, NOMINAL_HEIGHT))


def grasp_axis_angle(shape: Shape, hand: Gripper) -> float | None:
    """rad, where x of the hand points in the best grasp on the true outline; None where there is none."""
    scale = 150.0
    outline = View([Contour(subdivide_polygon(r, 0.02) * scale, hole=k > 0) for k, r in enumerate(shape.polygons)])
    found, _ = closing_grasps(outline, hand.fingers, hand_for(0.065))
    if not found:
        return None
    contacts = found[0].contacts
    way = contacts[-1] - (contacts[0] if hand.fingers == 2 else contacts.mean(axis=0))
    return math.atan2(way[1], way[0]) - hand.azimuths[-1]
