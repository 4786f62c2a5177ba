# SPDX-License-Identifier: Apache-2.0
"""A servo, a simulated arm, and everything between them that can fail: what is handed in, and what the judge is told of it."""

import copy
import itertools
import math
import pickle
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol

import numpy as np

import grasptrack as gt
from grasptrack.servo.camera import apply_twist, pose_of, rotation_matrix
from servo_bench import Bench
from servo_judge import Judge, Seen

DRIVER = 0.2
"""s after which the arm's driver stops it, where no new twist comes: no servo can, while nobody calls it."""
RIGHT = 3.0
"""px by which contacts that are right may be off, and five times their noise."""
SAME = 1.5
"""px within which a camera sees what it saw: the same pixels again are as good as new ones."""
DRIFT = 0.01
"""m/s of an arm that drifts."""

Faults = Collection[str]


class Handed(NamedTuple):
    """What comes of a look."""

    result: gt.TrackResult | None  # the tracker's; None where there is no image
    image: bool = False  # it stands for pixels that are new
    right: bool = False  # it shows the grasp where it is, and is believed
    misled: float = 0.0  # px by which an image that does not follow the hand is off; 0 where it is the hand's camera's
    shot: float = 0.0  # s, when it was taken, by the true clock


class Sight(Protocol):
    """A camera and a tracker, or what stands for them."""

    def look(self, bench: Bench, faults: Faults, rng: np.random.Generator) -> Handed:
        """What there is to be handed in at this call."""

    def was_taken(self, handed: Handed) -> None:
        """It was handed in, and the call was not refused: its image is no news any more."""


def is_right(result: gt.TrackResult, truth: np.ndarray, slack: float = RIGHT) -> bool:
    """Whether a result is believed, and its contacts lie where those of the object (k, 2) px are seen in truth."""
    if result.status != "tracked" or result.contacts is None or result.contacts.shape != truth.shape:
        return False
    orders = itertools.permutations(range(len(truth)))  # fingers can take each other's places
    near = any(bool(np.hypot(*(result.contacts - truth[list(order)]).T).max() <= slack) for order in orders)
    return near and result.confidence >= 0.5 and result.object_sure and not result.notice


def how_far(result: gt.TrackResult | None, truth: np.ndarray) -> float:
    """px from the farthest contact to its true place (k, 2) px; 0 where nothing is told."""
    if result is None or result.contacts is None or result.contacts.shape != truth.shape:
        return 0.0
    return float(np.nan_to_num(np.hypot(*(result.contacts - truth).T).max(), nan=0.0))


def is_same_view(before: np.ndarray | None, now: np.ndarray) -> bool:
    """Whether contacts (k, 2) px lie where they lay."""
    return before is not None and before.shape == now.shape and bool(np.hypot(*(before - now).T).max() <= SAME)


class Answers:
    """The answers of a tracker that is right, or not, as faults ask for."""

    def __init__(self) -> None:
        self._calls = 0
        self._given: gt.TrackResult | None = None  # the last that was handed in
        self._fault, self._base = "", None  # what began last, and the result of that time
        self._made: deque[tuple[gt.TrackResult, np.ndarray]] = deque(maxlen=40)
        self._pixels: np.ndarray | None = None  # where its pixels show the contacts
        self._last = -math.inf  # true time of the newest image that was handed in

    def look(self, bench: Bench, faults: Faults, rng: np.random.Generator) -> Handed:
        """See `Sight`."""
        due, self._calls = self._calls % bench.every == 0, self._calls + 1
        if not due and not {"repeated", "stale"} & set(faults):
            return Handed(None)
        fresh = bench.result() if due else bench.results[-1]
        if due:
            self._made.append((fresh, bench.shown(*bench.placed(bench.time - bench.latency))))
        fault = next((f for f in faults if f in FALSE), "")
        if fault != self._fault:
            self._fault, self._base = fault, fresh
        result = fresh
        if fault:
            result = CHANGED[fault](fresh) if fault in CHANGED else getattr(self, fault)(fresh, rng)
        if result is None:
            return Handed(None)
        at = next((i for i, (m, _) in enumerate(self._made) if m.frame == self._frame_of(result, fresh)), 0)
        shot = float(self._made[at][0].time or 0.0)
        new, truth = shot > self._last, self._made[at][1]
        if fault == "flagged" and self._pixels is not None:
            new = new and is_same_view(self._pixels, truth)
        else:
            self._pixels = truth
        self._given = result
        misled = how_far(result, truth) if fault == "frozen" else 0.0
        return Handed(result, new, is_right(result, truth, RIGHT + 5.0 * bench.noise), misled, shot)

    def was_taken(self, handed: Handed) -> None:
        """See `Sight`."""
        if handed.image:
            self._last = handed.shot

    def _frame_of(self, result: gt.TrackResult, fresh: gt.TrackResult) -> int:
        """Of the image that a result stands for."""
        return fresh.frame if self._fault in ("restarted", "numbered") else result.frame

    # --- what a result may be instead -------------------------------------------------------------

    def stale(self, fresh: gt.TrackResult, rng: np.random.Generator) -> gt.TrackResult | None:
        made = [m for m, _ in self._made]
        return made[-1 - int(rng.integers(0, min(len(made), 20)))]

    def repeated(self, fresh: gt.TrackResult, rng: np.random.Generator) -> gt.TrackResult | None:
        return self._given

    def flagged(self, fresh: gt.TrackResult, rng: np.random.Generator) -> gt.TrackResult | None:
        base = self._given or fresh
        return replace(base, frame=fresh.frame, time=fresh.time, repeated=True)

    def frozen(self, fresh: gt.TrackResult, rng: np.random.Generator) -> gt.TrackResult | None:
        base = self._base
        if base is None or base.contacts is None:
            return fresh
        noise = rng.normal(0.0, 0.1, base.contacts.shape)
        return replace(base, frame=fresh.frame, time=fresh.time, contacts=base.contacts + noise)

    def jump(self, fresh: gt.TrackResult, rng: np.random.Generator) -> gt.TrackResult | None:
        if fresh.contacts is None or fresh.homography is None:
            return fresh
        shift = rng.uniform(-90.0, 90.0, 2)
        moved = np.eye(3)
        moved[:2, 2] = shift
        return replace(fresh, contacts=fresh.contacts + shift, homography=moved @ fresh.homography)

    def nan(self, fresh: gt.TrackResult, rng: np.random.Generator) -> gt.TrackResult | None:
        if fresh.contacts is None:
            return fresh
        value = float(rng.choice([math.nan, math.inf, -math.inf, 1e12, 1e300]))
        name = str(rng.choice(["contacts", "seen", "covariance", "homography", "confidence"]))
        if name == "confidence":
            return replace(fresh, confidence=value)
        wrong = np.array(getattr(fresh, name))
        wrong.flat[int(rng.integers(wrong.size)) :] = value
        return replace(fresh, **{name: wrong})

    def late(self, fresh: gt.TrackResult, rng: np.random.Generator) -> gt.TrackResult | None:
        """By 12 images, so that nothing comes at first."""
        base = self._base
        made = [m for m, _ in self._made if base is not None and m.frame >= base.frame]
        return made[-13] if len(made) > 12 else None

    def reordered(self, fresh: gt.TrackResult, rng: np.random.Generator) -> gt.TrackResult | None:
        made = [m for m, _ in self._made]
        base = self._base
        if base is None or (fresh.frame - base.frame) % 2 == 0:
            return None if self._given is None or len(made) < 2 else made[-2]
        return fresh

    def other_count(self, fresh: gt.TrackResult, rng: np.random.Generator) -> gt.TrackResult | None:
        if fresh.contacts is None or fresh.seen is None or fresh.covariance is None:
            return fresh
        more = [*range(len(fresh.contacts)), 0] if rng.random() < 0.5 else [0]
        contacts = fresh.contacts[more] + rng.normal(0.0, 5.0, (len(more), 2))
        return replace(fresh, contacts=contacts, seen=fresh.seen[more], covariance=fresh.covariance[more])

    def restarted(self, fresh: gt.TrackResult, rng: np.random.Generator) -> gt.TrackResult | None:
        """A new tracker, which counts from 0."""
        return replace(fresh, frame=fresh.frame - (self._base.frame if self._base is not None else 0))


CHANGED: dict[str, Callable[[gt.TrackResult], gt.TrackResult | None]] = {
    "swap": lambda r: r if r.contacts is None else replace(r, contacts=r.contacts[::-1].copy()),
    "lost": lambda r: gt.TrackResult(r.frame, r.time, "lost", "covered", grasp_id=r.grasp_id),
    "unstable": lambda r: r if r.contacts is None else replace(r, status="unstable", reason="chance"),
    "searching": lambda r: gt.TrackResult(r.frame, r.time, "searching", "no object"),
    "doubtful": lambda r: replace(r, confidence=0.2),
    "unsure": lambda r: replace(r, object_sure=False),
    "open_tilt": lambda r: r if r.contacts is None else replace(r, notice="tilt-open"),
    "regrasp": lambda r: replace(r, grasp_id=7),
    "timeless": lambda r: replace(r, time=None),
    "none": lambda r: None,
}
"""What a result may be instead, whatever came before."""
FALSE = (
    "stale", "repeated", "flagged", "frozen", "jump", "swap", "nan", "late", "reordered", "lost", "unstable", "searching",
    "doubtful", "unsure", "open_tilt", "regrasp", "other_count", "restarted", "timeless", "none",
)  # fmt: skip
"""Methods of `Answers`, and names of CHANGED."""
POSES = (
    "pose stuck", "pose stale", "pose jump", "pose moved", "pose inverse", "pose mm", "pose nan", "pose no rotation",
)  # fmt: skip
TIMES = ("time stands", "time back", "hour ahead", "hour back", "time late", "time nan", "ms")
ARM = ("arm stands", "arm half", "arm drifts", "arm runs on")
CALLS = ("pause", "hurry", "touched", "stopped", "closed early", "copied")


@dataclass
class Trial:
    """A servo and its arm."""

    bench: Bench  # the arm, and where the object is
    servo: gt.GraspServo  # is called
    sight: Sight  # camera and tracker
    judge: Judge  # is told the truth
    twist: np.ndarray = field(default_factory=lambda: np.zeros(6))
    told: float = math.nan  # s of the caller's clock at the last call that was taken
    true: float = math.nan
    offsets: list[tuple[float, float]] = field(default_factory=lambda: [(-math.inf, 0.0)])
    since: dict[str, float] = field(default_factory=dict)  # true times at which the present faults began
    kept: dict[str, np.ndarray] = field(default_factory=dict)  # poses and twists of that time
    poses: deque[np.ndarray] = field(default_factory=lambda: deque(maxlen=12))
    ghost: np.ndarray | None = None  # where an arm would be that did what it was told
    misled: float = 0.0
    waits: int | None = None  # calls until somebody tells what came of closing

    def call(self, faults: Faults, rng: np.random.Generator) -> gt.Command | None:
        """One call of the servo and the motion that follows; None where its arguments were refused."""
        self._begin_faults(faults)
        self._act(faults, rng)
        handed = self.sight.look(self.bench, faults, rng)
        time, pose = self._time(faults, rng), self._pose(faults, rng)
        command = self._ask(handed, time, pose)
        if command is not None:
            self.twist = command.twist
            if command.close:
                self.waits = int(rng.integers(0, 15)) if not faults or rng.random() < 0.9 else None
        self._move(faults, self.bench.period * (0.05 if "hurry" in faults else 1.0))
        if "pause" in faults:
            self._pause(faults, float(rng.choice([0.3, 0.8, 1.5, 20.0])))
        return command

    # --- the caller -------------------------------------------------------------------------------

    def _begin_faults(self, faults: Faults) -> None:
        for name in [n for n in self.since if n not in faults]:
            del self.since[name]
        for name in faults:
            if name not in self.since:
                self.since[name] = self.bench.time
                self.kept[name] = self.twist.copy() if name == "arm runs on" else self.bench.hand.copy()
                by = {"hour ahead": 3600.0, "hour back": -3600.0}.get(name)
                if by is not None:
                    self.offsets.append((self.bench.time, self.offsets[-1][1] + by))

    def _act(self, faults: Faults, rng: np.random.Generator) -> None:
        """What a caller does beside calling."""
        if "touched" in faults:
            self.servo.touched()
        if "stopped" in faults:
            self.servo.stop()
        if "closed early" in faults and self.servo.state != "closing":
            self.servo.closed(bool(rng.integers(2)))
        if "copied" in faults:
            self.servo = copy.deepcopy(self.servo) if rng.random() < 0.5 else pickle.loads(pickle.dumps(self.servo))
        if self.waits is not None and self.servo.state == "closing":
            self.waits -= 1
            if self.waits < 0:
                self.waits = None
                self._tell_closed(rng)

    def _tell_closed(self, rng: np.random.Generator) -> None:
        across, along, turn = self.bench.off()
        held = across < 0.004 and abs(along) < 0.006 and abs(turn) < 0.1
        if rng.random() < 0.5:
            self.servo.closed(held)
        else:
            width = float(np.linalg.norm(self.bench.shape[1] - self.bench.shape[0]))
            self.servo.closed(opening=width if held else 0.0)

    def _time(self, faults: Faults, rng: np.random.Generator) -> float:
        now = self.bench.time + self.offsets[-1][1]
        if "time nan" in faults:
            return float(rng.choice([math.nan, math.inf, -math.inf]))
        if "time stands" in faults:
            return self.since["time stands"] + self.offsets[-1][1]
        if "time back" in faults and not math.isnan(self.told):
            return self.told - float(rng.choice([0.0, 1e-9, 0.003, 0.02]))
        if "time late" in faults:
            return now - 0.1
        return 1000.0 * now if "ms" in faults else now

    def _taken(self, shot: float, now: float, faults_in_time: bool) -> float:
        """By the caller's clock, as it was when the image was taken."""
        stamp = shot + next(by for begin, by in reversed(self.offsets) if begin <= shot)
        return min(stamp, now) if faults_in_time and math.isfinite(now) else stamp

    def _pose(self, faults: Faults, rng: np.random.Generator) -> np.ndarray:
        hand = self.bench.hand.copy()
        self.poses.append(hand.copy())
        if "pose nan" in faults:
            hand[int(rng.integers(3)), int(rng.integers(4))] = math.nan
            return hand
        if "pose no rotation" in faults:
            return hand @ np.diag([1.0, 1.0, float(rng.choice([-1.0, 0.0, 1.3])), 1.0])
        if "pose stuck" in faults:
            return self.kept["pose stuck"]
        if "pose stale" in faults:
            return self.poses[0]
        if "pose inverse" in faults:
            return np.linalg.inv(hand)
        if "pose mm" in faults:
            return pose_of(hand[:3, :3], 1000.0 * hand[:3, 3])
        if "pose moved" in faults or "pose jump" in faults:
            own = np.random.default_rng(int(1e6 * self.since["pose moved"])) if "pose moved" in faults else rng
            shift = own.uniform(-1.0, 1.0, 3) * own.choice([0.02, 0.2, 2.0])
            return pose_of(rotation_matrix(own.uniform(-1.0, 1.0, 3)), shift) @ hand
        return hand

    def _ask(self, handed: Handed, time: float, pose: np.ndarray) -> gt.Command | None:
        result, faults = handed.result, self.since
        by_stamp = result is not None and self.bench.stamped
        taken = self._taken(handed.shot, time, bool(set(faults) & set(TIMES))) if by_stamp else None
        malformed = bool({"time nan", "pose nan", "pose no rotation"} & set(faults))
        malformed = malformed or (taken is not None and taken > time)
        if result is not None:
            self.misled = handed.misled
        try:
            if result is None:
                command = self.servo.between(time=time, pose=pose)
            else:
                command = self.servo.update(result, time=time, pose=pose, taken=taken)
        except gt.InputError as error:
            if not malformed:
                self.judge.find("undocumented exception", f"InputError: {error}")
            return None
        except Exception as error:
            self.judge.find("undocumented exception", f"{type(error).__name__}: {error}")
            return None
        if malformed:
            self.judge.find("malformed, yet taken", f"time {time}, taken {taken}, pose {pose.tolist()}")
        first = math.isnan(self.told)
        seconds = 0.0 if first else self.bench.time - self.true
        seen = Seen(
            seconds, 0.0 if first else time - self.told, self._is_news(handed, time, taken), handed.right, self.misled,
            self._astray(pose), self.bench.clearance(), self.bench.rise(), self.bench.off(),
        )  # fmt: skip
        self.told, self.true = time, self.bench.time
        self.sight.was_taken(handed)
        self.judge.pass_time(seen)
        self.judge.take(command, seen)
        return command

    def _is_news(self, handed: Handed, time: float, taken: float | None) -> bool:
        """New, and, where it is told when the image was taken, young enough."""
        return handed.image and (taken is None or time - taken <= self.judge.patience + self.bench.latency + 1e-9)

    def _astray(self, pose: np.ndarray) -> float:
        """m between the pose that is told and that of an arm that does what it is told, since it does not."""
        if self.ghost is None:
            return 0.0
        return float(np.linalg.norm(self.ghost[:3, 3] - pose[:3, 3]))

    # --- the arm ----------------------------------------------------------------------------------

    def _move(self, faults: Faults, seconds: float) -> None:
        bench, whole, twist = self.bench, self.bench.period, self.twist
        if "arm stands" in faults or "pose stuck" in faults:
            self.ghost = bench.hand.copy() if self.ghost is None else self.ghost
            self.ghost = apply_twist(self.ghost, twist, seconds)
        else:
            self.ghost = None
        if "arm stands" in faults:
            twist, bench.twist = np.zeros(6), np.zeros(6)
        elif "arm half" in faults:
            twist = 0.5 * twist
        elif "arm drifts" in faults:
            about = np.random.default_rng(int(1e6 * self.since["arm drifts"])).normal(size=3)
            twist = twist + np.append(DRIFT * about / np.linalg.norm(about), np.zeros(3))
        elif "arm runs on" in faults:
            twist, self.judge.physical = self.kept["arm runs on"], False
        bench.period = seconds
        bench.move(twist)
        bench.period = whole

    def _pause(self, faults: Faults, seconds: float) -> None:
        """Nobody calls; the arm's driver stops it."""
        self._move(faults, min(seconds, DRIVER))
        if seconds > DRIVER:
            told, self.twist = self.twist, np.zeros(6)
            self._move(faults, seconds - DRIVER)
            self.twist = told
