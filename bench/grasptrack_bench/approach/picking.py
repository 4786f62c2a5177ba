# SPDX-License-Identifier: Apache-2.0
"""A tray of equal parts is emptied: look, take the first that can be taken, approach, close, lift, carry away, and look again.

The robot knows a part that was taught from one image, its own joints, and what its gripper reads. Which part it took, and
whether its fingers closed where the part was to be grasped, is told by the truth.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from grasptrack.errors import GraspTrackError, InputError
from grasptrack.geometry.homographies import apply_homography, rotation_about_z
from grasptrack.io.parts import Part
from grasptrack.servo import Goal, GraspServo, HandEye
from grasptrack.tracking.instances import Instance, find
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.scene import SceneResult, SceneTracker
from grasptrack.typing import Floats, Pixels
from grasptrack_bench.approach.case import ApproachCase, Law
from grasptrack_bench.approach.tray_picture import TrayPicture
from grasptrack_bench.approach.trays import Emptied, PickRow, TrayCase, teach
from grasptrack_bench.approach.trial import LEAST, RETRIES, WINDOW, Step, TrialRun, close_on_part
from grasptrack_bench.physics.setting import is_fully_visible
from grasptrack_bench.physics.tray import (
    BIN,
    fingers_in_view,
    looks_over,
    sample_tray,
    seen_from_above,
    taught_alone,
    travel,
)
from grasptrack_bench.physics.world import LIFTED, PERIOD_S, World

LOOK_S = 0.5
"""s for which the hand stands while it looks for parts: longer than `find` takes on one core."""
TRY_S = 12.0
"""s of an approach, three times what it usually takes, after which the hand looks again: a tray shows other views."""
TRIES = 2
"""How often a part is tried that lies where it lay."""
MOST = 3
"""Times as many picks as there are parts, at most."""
SAME_PLACE = 0.3
"""Of sqrt(area), within which a part lies where it lay."""
CLEAR = 0.02
"""m above the part at which open fingers stop: neighbours are as high, and of a narrow part that is known to a centimetre."""
RISEN = 0.12
"""m of the fingertips above the table at which they cross the tray."""
BIN_WIDTH = 0.15
"""m from the middle of the bin within which a part has fallen into it."""


class TrayLooking:
    """Follows a grasp of a part among its equals, and looks for the part anew in what is seen now, as `find` does.

    It does so where the tracker does not find the grasp any more, and any part will do.

    Args:
        part: as it was taught, the grasp that is meant being its first.
        ignore, risk: of `find` and the tracker.
        image, time: in which the grasp was chosen, and when.
        one: the part as it was found there.

    Attributes:
        again, looked: as of `Looking`.
    """

    def __init__(self, part: Part, ignore: Pixels, risk: float, image: Pixels, time: float, one: Instance) -> None:
        self._part, self._ignore, self._risk = part, ignore, risk
        self._found: deque[bool] = deque(maxlen=WINDOW)
        self._wait, self.again, self.looked = 0, 0, False
        self._last: TrackResult
        self._begin(image, time, one)

    def _begin(self, image: Pixels, time: float, one: Instance) -> TrackResult:
        """Follow it from this image on."""
        self._middle = _middle(one)
        self._tracker = SceneTracker(self._part, instances=[one], risk=self._risk, ignore=self._ignore)
        self._found.extend([True] * WINDOW)
        return self._follow(image, time)

    def _follow(self, image: Pixels, time: float) -> TrackResult:
        """What is seen of it; as before where it is not followed any more."""
        told: SceneResult = self._tracker.update(image, time)
        for result in told.results.values():
            self._last = result
        return self._last

    def update(self, image: Pixels, time: float, *, look: bool = True) -> TrackResult:
        """What is seen now."""
        result = self._follow(image, time)
        self._found.append(result.status == "tracked")
        self._wait = max(0, self._wait - 1)
        if result.view is not None:
            self._middle = _middle(result)
        self.looked = look and not self._found[-1] and self._wait == 0 and sum(self._found) < LEAST * WINDOW
        if self.looked:
            self._wait = WINDOW
            found = find(image, self._part, risk=self._risk, ignore=self._ignore)
            near = min((one for one in found if not _why_not(one)), key=self._distance_to, default=None)
            if near is not None:
                result = self._begin(image, time, near)
                self.again += 1
        return result if result.grasp_id is None else replace(result, grasp_id=result.grasp_id + self.again)

    def _distance_to(self, one: Instance) -> float:
        """px from where the grasp was seen last."""
        return float(np.hypot(*(_middle(one) - self._middle)))


class TrayRobot:
    """Empties one tray.

    Args:
        case: the tray.
        watch: called after every step.

    Attributes:
        world: with the tray.
        taught: the part.
        ignore: (480, 640) 255 where the fingers are in the camera's way.
        looks: poses (4, 4) of the hand from which it looks.
        told: what has become of the tray so far.
    """

    def __init__(self, case: TrayCase, watch: Callable[[World, Step], None] | None = None) -> None:
        setting = sample_tray(case.shape, case.count, seed=case.seed, snatched=case.snatched)
        self.case, self._watch = case, watch
        self.world = World(case.shape, seed=case.seed, images="planar", setting=setting)
        alone = World(case.shape, seed=case.seed, images="planar", setting=taught_alone(setting))
        self.taught = teach(case, alone)
        self.looks = looks_over(setting)
        self.told = Emptied(case.name, case.count)
        self.ignore = fingers_in_view(setting)
        self._tips, self._opening = self.world.fingertips()
        self._known: HandEye | None = None
        self._seen: list[list[Instance]] = [[] for _ in self.looks]
        self._aim, self._aside_px = seen_from_above(setting)
        self._images: list[Floats] = [np.eye(4) for _ in self.looks]
        self._failed: list[tuple[int, Floats, str]] = []

    def empty_tray(self) -> Emptied:
        """Take what can be taken, until no look shows anything more that can."""
        idle, at = 0, 0
        while idle < len(self.looks) and len(self.told.picks) < MOST * self.case.count:
            found = self._look(at)
            if found is None:
                idle, at = idle + 1, (at + 1) % len(self.looks)
                continue
            idle = 0
            self._take(at, *found)
        self.told.seconds = self.world.time()
        self.told.left = {k: self._reason_for(k) for k in self.world.part_poses()}
        return self.told

    # --- what is there ----------------------------------------------------------------------------

    def _look(self, at: int) -> tuple[Pixels, Instance, int] | None:
        """The first part of the order that can be taken, with the image, and by which grasp; None where there is none."""
        world = self.world
        travel(world, self.looks[at])
        for _ in range(round(LOOK_S / PERIOD_S)):
            world.move(np.zeros(6))
        image, self._images[at] = world.image(), world.camera_pose()
        for grasp, part in enumerate(self.taught.parts):
            seen = find(image, part, risk=self.case.risk, ignore=self.ignore)
            if grasp == 0:
                self._seen[at] = seen
            for one in seen:
                if not self._why_not(one) and len(self._failures_at(at, one)) < TRIES:
                    return image, one, grasp
            if all(self._why_not(one) != NO_ROOM for one in seen):
                break
        return None

    def _why_not(self, one: Instance) -> str:
        """Why a part cannot be taken from where it is seen; empty where it can."""
        aside = np.hypot(*(_middle(one) - self._aim)) > self._aside_px
        return _why_not(one) or ("seen too far aside" if aside else "")

    def _failures_at(self, at: int, one: Instance) -> list[str]:
        near = SAME_PLACE * math.sqrt(one.view.outer.area)
        return [why for k, place, why in self._failed if k == at and np.hypot(*(place - _middle(one))) < near]

    def _reason_for(self, number: int) -> str:
        """Why a part that is left was not taken, as the last looks told."""
        world, reasons, whole = self.world, list[str](), False
        world.chosen = number
        K, thickness = world.setting.camera.matrix, world.setting.part.thickness
        for at, pose in enumerate(self._images):
            centre = world.part_pose() @ np.array([0.0, 0.0, thickness, 1.0])
            seen = K @ (np.linalg.inv(pose) @ centre)[:3]
            near = [
                one
                for one in self._seen[at]
                if np.hypot(*(_middle(one) - seen[:2] / seen[2])) < 0.5 * math.sqrt(one.view.outer.area)
            ]
            for one in sorted(near, key=lambda o: not o.found):
                failed = self._failures_at(at, one)
                if failed:
                    reasons.insert(0, f"tried {len(failed)} times: {failed[-1]}")
                else:
                    reasons.append(self._why_not(one) or "found at last, and not tried")
            setting = world.setting
            whole |= is_fully_visible(setting.part, world.part_pose(), pose, setting.camera, self.ignore)
        if world.touches_another(number):
            reasons.append("not recognised: it touches another part")
        return next(iter(reasons), "not recognised" if whole else "in no view whole and beside the hand")

    # --- what is done -----------------------------------------------------------------------------

    def _take(self, at: int, image: Pixels, one: Instance, grasp: int) -> None:
        """Approach, close, lift, carry away; what became of it is one more pick."""
        world, case = self.world, self.case
        assert one.contacts is not None
        row = PickRow(
            case.seed, case.shape.name, "snatched" if case.snatched else "static", world.arm, "online", grasp=grasp
        )
        row.number, row.began_s = 1 + len(self.told.picks), world.time() - LOOK_S
        self.told.picks.append(row)
        approach = ApproachCase(case.shape, case.seed, risk=case.risk)
        run = TrialRun(world, approach, row, self._watch)

        def locate(world: World, contacts: Floats) -> Floats:
            row.part, places = self._truth_of(contacts, grasp)
            world.chosen = row.part
            return places

        run.locate, run.truth = locate, locate(world, one.contacts)
        held = False
        try:
            held = self._approach(run, image, one, grasp)
            if held:
                self._carry_away(row)
        except GraspTrackError as error:
            row.reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
        row.empty = row.tries - held
        if row.outcome != "lifted":
            self._failed.append((at, _middle(one), row.reason))
            world.open()
            self._rise()

    def _truth_of(self, contacts: Floats, grasp: int) -> tuple[int, Floats]:
        """The part on which contacts (k, 2) px lie best by its taught grasp, and where that is on it, (k, 2) m."""
        world, best = self.world, (math.inf, -1, contacts)
        for number in world.part_poses():
            world.chosen = number
            H = world.outline_to_image()
            for turn in self.taught.turns:
                places = apply_homography(rotation_about_z(turn), self.taught.grasps[grasp])
                off = float(np.hypot(*(apply_homography(H, places) - contacts).T).max())
                if off < best[0]:
                    best = off, number, places
        return best[1:]

    def _approach(self, run: TrialRun, image: Pixels, one: Instance, grasp: int) -> bool:
        """Follow what was chosen, down to where the fingers close."""
        world = self.world
        looking = TrayLooking(self.taught.parts[grasp], self.ignore, self.case.risk, image, world.time(), one)
        apart = float(np.linalg.norm(np.diff(world.hand.tips(self._opening)[:2], axis=0)))
        goal = Goal.fingertips(self._tips, apart, beyond_m=-CLEAR)
        known = self._known
        law: Law = "online" if known is None else "nominal"
        run.row.law, camera = law, None if known is None else known.nominal()
        servo = GraspServo(goal, 4, law=law, camera=camera, time_limit=TRY_S, retries=RETRIES)
        held = close_on_part(run, servo, looking, self._tips, self._opening, by_opening=True)
        if held and servo.calibration is not None:
            self._known = servo.calibration
        return held

    def _carry_away(self, row: PickRow) -> None:
        """Lift what is held, and drop it into the bin; the gripper tells whether it is still there."""
        world = self.world
        world.lift()
        risen = [k for k, pose in world.part_poses().items() if pose[2, 3] > LIFTED]
        row.others = sum(k != row.part for k in risen)
        if not world.holds():
            row.reason = "nothing was held any more after the lift"
            return
        self._rise()
        pose = self.looks[0].copy()
        pose[:3, 3] = BIN
        travel(world, pose)
        row.reason = "" if world.holds() else "lost on the way to the bin"
        world.open()
        fallen = [k for k, p in world.part_poses().items() if np.hypot(*(p[:2, 3] - BIN[:2])) < BIN_WIDTH]
        for number in fallen:
            world.take_away(number)
        if row.part in fallen:
            row.outcome = "lifted"

    def _rise(self) -> None:
        """Straight up, to where the fingers are above all parts."""
        pose = self.world.pose()
        pose[2, 3] = max(pose[2, 3], RISEN)
        travel(self.world, pose)


NO_ROOM = "no room for the fingers"


def _why_not(one: Instance) -> str:
    """Why a part cannot be taken; empty where it can."""
    return one.reason or one.reason_code if not one.found else "" if math.isinf(one.room) else NO_ROOM


def _middle(one: Instance | TrackResult) -> Floats:
    """(2,) px of an outline that is seen."""
    assert one.view is not None
    return np.asarray(one.view.outer.points.mean(axis=0), dtype=np.float64)


def run_tray(case: TrayCase) -> Emptied:
    """Empty one tray, and draw it."""
    try:
        robot = TrayRobot(case)
    except InputError as error:
        return Emptied(case.name, 0, refused=str(error))
    picture = TrayPicture(robot.world)
    told = robot.empty_tray()
    told.picture = picture.with_outcome(told)
    return told
