# SPDX-License-Identifier: Apache-2.0
"""What an uncalibrated camera on the hand sees of a flat part on a table, the tracker on it, and cameras that fail."""

import math
from collections import deque
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np

import grasptrack as gt
from grasptrack.grasp.hand import Length
from grasptrack.servo.camera import pose_of, rotation_matrix
from servo_bench import HEIGHT, WIDTH, Bench
from servo_judge import Judge
from servo_trial import Faults, Handed, Trial, how_far, is_right, is_same_view

SCALE, REACH = 1000.0, 1.0
"""px per m of the table's texture, and how far it reaches from the part, m."""
FINER = 4
"""Times as fine as the image is the picture in which the part is drawn."""
WIDEST = 0.92
"""Share of its opening that a hand can take."""
LATE = 12
"""Images by which a camera is late."""

CAMERA = (
    "freezes", "freezes with noise", "answers repeat", "black", "dark", "other camera", "drops out", "late",
    "out of order",
)  # fmt: skip
FAILING = ("arm stands", "pose stuck", "arm drifts", "arm half", "arm runs on")
CLOCK = ("hour ahead", "hour back", "time stands", "ms")
FAULTS = ("nothing", "nothing", *CAMERA, *FAILING, *CLOCK)


class Shot(NamedTuple):
    """An image."""

    image: np.ndarray  # (480, 640) uint8
    shot: float  # s, when it was taken
    hand: np.ndarray  # (4, 4), and
    at: np.ndarray  # (3,) m, where hand and part were


def draw_outline(rng: np.random.Generator, width: float) -> np.ndarray:
    """(n, 2) m of a part that is some `width` m wide along x: a plate, a bracket, a tee, a notched plate, any polygon."""
    w, long = 0.5 * width, width * rng.uniform(0.7, 1.1)
    match int(rng.integers(5)):
        case 0:
            points = [(-w, -long), (w, -long), (w, long), (-w, long)]
        case 1:
            side = 1.2 * width
            points = [(-w, -long), (side, -long), (side, -long + width), (w, -long + width), (w, long), (-w, long)]
        case 2:
            arm, thick = 1.1 * width, 0.8 * width
            points = [(-w, long), (w, long), (w, -long + thick), (arm, -long + thick), (arm, -long), (-arm, -long)]
            points += [(-arm, -long + thick), (-w, -long + thick)]
        case 3:
            points = [(-w, -long), (w, -0.9 * long), (w, 0.2 * long), (0.5 * w, 0.25 * long), (0.5 * w, 0.6 * long)]
            points += [(w, 0.65 * long), (0.9 * w, long), (-0.9 * w, 0.9 * long)]
        case _:
            angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, int(rng.integers(6, 10))))
            angles = np.linspace(0.0, 2.0 * math.pi, len(angles), endpoint=False) + 0.25 * rng.uniform(
                -1, 1, len(angles)
            )
            size = rng.uniform(0.75, 1.25, len(angles))
            return np.column_stack([w * size * np.cos(angles), long * size * np.sin(angles)])
    return np.array(points) * rng.choice([-1.0, 1.0], 2)


@cache
def _texture(seed: int) -> np.ndarray:
    """(2000, 2000) uint8: grain about 128."""
    rng, size = np.random.default_rng(seed), int(2 * REACH * SCALE)
    grain = np.zeros((size, size), np.float32)
    for blur in (1.5, 5.0, 15.0):
        each = cv2.GaussianBlur(rng.standard_normal((size, size), dtype=np.float32), (0, 0), blur)
        grain += each / each.std()
    return np.clip(128.0 + 20.0 * grain, 0, 255).astype(np.uint8)


def _warped(texture: np.ndarray, H: np.ndarray) -> np.ndarray:
    """(480, 640) float32."""
    return cv2.warpPerspective(texture, H, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT).astype(np.float32)


@dataclass
class Look:
    """Of a part and its table."""

    outline: np.ndarray  # (n, 2) m in the part's plane, about `Rendered.anchor`
    grey: tuple[float, float]  # of the table and of the part, 0 to 255
    depth: tuple[float, float]  # of their grain
    noise: float  # of the camera, in grey levels
    texture: int  # its seed


class Rendered(Bench):
    """A bench whose camera renders a part with an outline, of which the servo's contacts are wherever the tracker puts them."""

    def dress(self, rng: np.random.Generator) -> None:
        """Draw the part and its look."""
        way = self.shape[1] - self.shape[0]
        turn = rotation_matrix((0.0, 0.0, math.atan2(way[1], way[0])))[:2, :2]
        outline = draw_outline(rng, float(np.hypot(*way[:2])))
        light, dark = rng.uniform(150.0, 215.0), rng.uniform(30.0, 95.0)
        grey = (light, dark) if rng.random() < 0.5 else (dark, light)
        depth = (rng.uniform(2.0, 12.0), rng.uniform(1.0, 6.0))
        self.part = Look(outline @ turn.T, grey, depth, float(rng.uniform(0.8, 2.5)), int(rng.integers(3)))
        self.anchor = np.zeros(2)  # of the outline, from `at`

    def corners(self, hand: np.ndarray) -> np.ndarray:
        """(n, 2) px of the outline, with the part where it lies now."""
        flat = np.column_stack([self.part.outline + self.anchor, np.zeros(len(self.part.outline))])
        return self.camera.project((self.at + flat - hand[:3, 3]) @ hand[:3, :3])

    def take_grasp(self, contacts: np.ndarray, hand: np.ndarray, at: np.ndarray) -> None:
        """The tracker's contacts (k, 2) px in an image are the grasp from now on."""
        plane = np.linalg.inv(self._plane(hand, at)) @ np.column_stack([contacts, np.ones(len(contacts))]).T
        flat = (plane[:2] / plane[2]).T
        middle = flat.mean(axis=0)
        self.shape = np.column_stack([flat - middle, np.zeros(len(flat))])
        self.anchor = self.anchor - middle
        step = np.append(middle, 0.0)
        self.at = self.at + step
        self._poses = deque(((t, h, a + step) for t, h, a in self._poses), maxlen=self._poses.maxlen)

    def render(self, hand: np.ndarray, at: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(480, 640) uint8 of a camera on a hand (4, 4), of the part at a place (3,) m."""
        look = self.part
        corner = np.array(
            [[1.0 / SCALE, 0.0, self.anchor[0] - REACH], [0.0, 1.0 / SCALE, self.anchor[1] - REACH], [0, 0, 1.0]]
        )
        planes = self._plane(hand, at - np.array([0.0, 0.0, self.table])), self._plane(hand, at)
        table, part = (
            grey + (depth / 20.0) * (_warped(_texture(look.texture + k), plane @ corner) - 128.0)
            for k, (grey, depth, plane) in enumerate(zip(look.grey, look.depth, planes, strict=True))
        )
        flat = np.column_stack([look.outline + self.anchor, np.zeros(len(look.outline))])
        seen = self.camera.project((at + flat - hand[:3, 3]) @ hand[:3, :3])
        cover = np.zeros((FINER * HEIGHT, FINER * WIDTH), np.uint8)
        if np.isfinite(seen).all():
            at_px = np.rint(16.0 * (FINER * seen + 0.5 * (FINER - 1))).astype(np.int32)
            cv2.fillPoly(cover, [np.clip(at_px, -(10**6), 10**6)], (255,), cv2.LINE_8, 4)
        share = cv2.resize(cover, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.float32) / 255.0
        image = cv2.GaussianBlur(table + share * (part - table), (3, 3), 0)
        return noisy(image, look.noise, rng)


@cache
def _noise_bank() -> np.ndarray:
    return np.random.default_rng(0).standard_normal((HEIGHT + 256, WIDTH + 256), dtype=np.float32)


def noisy(image: np.ndarray, sd: float, rng: np.random.Generator) -> np.ndarray:
    """An image (480, 640) with the noise of a sensor, as uint8."""
    y, x = (int(v) for v in rng.integers(0, 256, 2))
    return np.clip(np.rint(image + sd * _noise_bank()[y : y + HEIGHT, x : x + WIDTH]), 0, 255).astype(np.uint8)


class Camera:
    """The camera on the hand, and the tracker.

    Args:
        object_at: (2,) px of the part in the first image, as a person would click, who then confirms what is shown.
        widest: what the hand can take, in shares of the part's sqrt(area).
    """

    def __init__(self, object_at: np.ndarray, widest: float) -> None:
        hand = gt.Hand(max_opening=Length(widest, "size"))
        self._tracker = gt.GraspTracker(fingers=2, object_at=object_at, number=1, hand=hand)
        self._calls = 0
        self._taken: deque[Shot] = deque(maxlen=LATE + 8)
        self._shown: Shot | None = None  # the last image that the tracker saw
        self._pixels: np.ndarray | None = None  # where it would show the contacts
        self._given: Handed = Handed(None)
        self._fault, self._count = "", 0
        self._elsewhere: np.ndarray | None = None
        self._grasp: int | None = None
        self._last = -math.inf

    def was_taken(self, handed: Handed) -> None:
        """See `Sight`."""
        if handed.image:
            self._last = handed.shot

    def look(self, bench: Bench, faults: Faults, rng: np.random.Generator) -> Handed:
        """See `Sight`."""
        assert isinstance(bench, Rendered)
        due, self._calls = self._calls % bench.every == 0, self._calls + 1
        if not due:
            return Handed(None)
        hand, at = bench.placed(bench.time - bench.latency)
        fresh = Shot(bench.render(hand, at, rng), bench.time - bench.latency, hand, at)
        self._taken.append(fresh)
        fault = next((f for f in faults if f in CAMERA), "")
        self._count = self._count + 1 if fault == self._fault else 0
        self._fault = fault
        if fault == "answers repeat":
            return self._given._replace(image=False)
        shown = self._fail(fault, fresh, bench, rng)
        if shown is None:
            return Handed(None)
        again = self._shown is not None and np.array_equal(shown.image, self._shown.image)
        self._shown = shown
        result = self._tracker.update(shown.image, time=shown.shot)
        if result.contacts is not None and result.grasp_id != self._grasp and not fault:
            self._grasp = result.grasp_id
            bench.take_grasp(result.contacts, shown.hand, shown.at)
        truth = bench.shown(*bench.placed(shown.shot))
        slack = max(3.0, 0.04 * math.sqrt(_area(bench.corners(bench.hand))))
        new = shown.shot > self._last and (not again or is_same_view(self._pixels, truth))
        if not again:
            self._pixels = truth
        strange = fault in ("freezes", "freezes with noise", "other camera")
        misled = how_far(result, truth) if strange else 0.0
        self._given = Handed(result, new, is_right(result, truth, slack), misled, shown.shot)
        return self._given

    def _fail(self, fault: str, fresh: Shot, bench: Rendered, rng: np.random.Generator) -> Shot | None:
        """What the tracker is shown; None for nothing."""
        before, noise = self._shown or fresh, bench.part.noise
        match fault:
            case "freezes":
                return fresh._replace(image=before.image)
            case "freezes with noise":
                frozen = self._taken[max(-2 - self._count, -len(self._taken))]
                again = bench.render(frozen.hand, frozen.at, rng) if self._count <= LATE else None
                return fresh._replace(
                    image=noisy(before.image.astype(np.float32), 0.5, rng) if again is None else again
                )
            case "black":
                return fresh._replace(image=np.zeros_like(fresh.image))
            case "dark":
                return fresh._replace(image=noisy(np.full(fresh.image.shape, 8.0, np.float32), noise, rng))
            case "other camera":
                if self._elsewhere is None:
                    turn = rotation_matrix(rng.normal(0.0, 0.1, 3))
                    shift = rng.normal(0.0, 0.02, 3)
                    self._elsewhere = bench.start @ pose_of(turn, shift)
                return fresh._replace(image=bench.render(self._elsewhere, fresh.at, rng))
            case "drops out":
                return None
            case "late":
                return self._taken[-1 - LATE] if self._count >= LATE and len(self._taken) > LATE else None
            case "out of order":
                if len(self._taken) < 2:
                    return None
                return self._taken[-2] if self._count % 2 else fresh
        return fresh


def _area(corners: np.ndarray) -> float:
    """Of a polygon (n, 2), px^2 or m^2."""
    x, y = corners.T
    return abs(0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def _is_shown(points: np.ndarray, margin: float) -> bool:
    inside = (points > margin).all() and (points < (WIDTH - margin, HEIGHT - margin)).all()
    return bool(np.isfinite(points).all() and inside)


def draw_trial(seed: int, number: int) -> tuple[Trial, str, np.random.Generator]:
    """An approach with rendered images, which of FAULTS it meets, and the draws that go on."""
    rng = np.random.default_rng((seed, number, 2))
    fault = FAULTS[number % len(FAULTS)]
    while True:
        bench = Rendered(
            seed=int(rng.integers(1 << 30)),
            dof=int(rng.choice([4, 4, 4, 6])),
            belt=float(rng.choice([0.0, 0.0, 60.0])),
            latency=float(rng.choice([0.0, 0.04])),
            every=int(rng.choice([1, 1, 2])),
            stamped=bool(rng.random() < 0.4),
            aside=0.3,
        )
        bench.dress(rng)
        near = bench.right_hand()
        if (
            bench.clearance() > 0.04
            and _is_shown(bench.corners(bench.hand), 15.0)
            and _is_shown(bench.corners(near), 8.0)
        ):
            break
    limits = gt.Limits(linear=0.25) if rng.random() < 0.5 else gt.Limits()
    servo = gt.GraspServo(bench.goal(), bench.dof, latency=0.0 if bench.stamped else bench.latency, limits=limits)
    clicked = bench.shown(bench.hand, bench.at).mean(axis=0)
    judge = Judge(servo.limits, bench.every * bench.period, bench.period)
    camera = Camera(clicked, WIDEST * bench.opening / math.sqrt(_area(bench.part.outline)))
    return Trial(bench, servo, camera, judge), fault, rng
