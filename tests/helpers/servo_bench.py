# SPDX-License-Identifier: Apache-2.0
"""A kinematic bench for the servo: a pinhole camera on a hand, contacts on a plane, and everything unknown drawn by a seed.

No images and no forces: the tracker's answers are made from the truth, with noise, latency, losses and wrong ones as asked for.
"""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

import grasptrack as gt
from grasptrack.servo.camera import HandCamera, apply_twist, interpolate_pose, pose_of, rotation_matrix

WIDTH, HEIGHT, PERIOD, MARGIN = 640, 480, 0.04, 20


def in_view(points: np.ndarray) -> bool:
    """Whether all points (k, 2) px are in the image, with a margin."""
    return bool((points > MARGIN).all() and (points < (WIDTH - MARGIN, HEIGHT - MARGIN)).all())


@dataclass
class Bench:
    """One trial.

    Args:
        seed: draws camera, mounting, gripper, object and start.
        dof: 4, or 6: then the start is tilted as well.
        fingers: 2 or 3.
        belt: px/s, of the object in the first view.
        noise: px of contacts.
        latency: s, in control periods rounded.
        outliers: share of answers that are wrong but look right.
        blackout: (from, to) s.
        push: s at which the object jumps, m.
        regrasp: s at which another grasp is chosen on it.
        narrowing: share by which the object seems to narrow on the way, as one does whose side showed at first, and in which
            direction, rad from that of the grasp.
        every: control periods from one image to the next.
        frozen: s from which the camera gives no image any more.
        stamped: the servo is told when each image was taken, and not of a latency.
        period: s of control.
        lean: (from, to) degrees by which the hand is tilted at the start; default: up to 25 with 6 DoF, else none.
        table: m by which the table lies below the contacts.
        turn, aside, distance: the start: largest turn in degrees, share of the view, times the distance at the goal.
    """

    seed: int = 0
    dof: int = 4
    fingers: int = 2
    belt: float = 0.0
    noise: float = 0.05
    latency: float = 0.0
    outliers: float = 0.0
    blackout: tuple[float, float] = (math.inf, math.inf)
    push: tuple[float, float] = (math.inf, 0.0)
    regrasp: float = math.inf
    narrowing: tuple[float, float] = (0.0, 0.0)
    every: int = 1
    frozen: float = math.inf
    stamped: bool = False
    turn: float = 45.0
    aside: float = 0.4
    distance: float = 2.5
    camera_tilt: float = 10.0
    lag: float = 0.05
    period: float = PERIOD
    lean: tuple[float, float] | None = None
    table: float = 0.01
    commands: list[gt.Command] = field(default_factory=list)
    results: list[gt.TrackResult] = field(default_factory=list)

    def __post_init__(self) -> None:
        rng = self.rng = np.random.default_rng(self.seed)
        self.time, self.twist, self._latest, self.grasp = 0.0, np.zeros(6), 0, 1
        # the gripper, in the hand's frame
        self.opening = rng.uniform(0.06, 0.09)
        reach = rng.uniform(0.0, 0.12)
        angles = np.pi + 2.0 * np.pi * np.arange(self.fingers) / self.fingers
        radius = 0.5 * self.opening / math.sin(math.pi / self.fingers)
        self.tips = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(self.fingers, reach)])
        # the camera looks down beside it, as far aside as lets the tips stay in view
        focal, phi = rng.uniform(450.0, 900.0), rng.uniform(-np.pi, np.pi)
        tilt = np.radians(rng.uniform(-self.camera_tilt, self.camera_tilt, 2))
        turned = rotation_matrix((0.0, 0.0, phi)) @ rotation_matrix((tilt[0], tilt[1], 0.0))
        self.centre = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
        middle = np.array([0.0, 0.0, reach])
        while True:
            depth, at = rng.uniform(0.15, 0.25), rng.uniform((-150.0, -100.0), (150.0, 100.0))  # px of the tips' middle
            ray = turned @ np.array([at[0] / focal, at[1] / focal, 1.0])
            self.camera = HandCamera(focal, self.centre, turned, middle - depth * ray / ray[2])
            if in_view(self.camera.project(self.tips)):
                break
        # the object on the base's plane z = 0, which the hand approaches along -z of the base
        length = self.opening * rng.uniform(0.4, 0.85)
        spin = rng.uniform(-np.pi, np.pi)
        flat = self.tips[:, :2] * (length / self.opening, -length / self.opening)
        self.shape = np.column_stack([flat, np.zeros(self.fingers)]) @ rotation_matrix((0.0, 0.0, spin)).T
        self.at = np.array([rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), 0.0])
        right = self.right_hand()
        self.hand = self._start(right, depth, rng)
        self.start = self.hand.copy()
        inward = self.centre - self.seen().mean(axis=0)  # a belt brings things into view
        heading = math.atan2(inward[1], inward[0]) + rng.uniform(-1.0, 1.0)
        toward = self.camera.turn @ np.array([math.cos(heading), math.sin(heading), 0.0])
        along = self.hand[:3, :3] @ toward
        along[2] = 0.0
        distance = float(self.camera.from_hand((self.at - self.hand[:3, 3])[None] @ self.hand[:3, :3])[0, 2])
        self.velocity = along * self.belt * distance / focal
        self._poses: deque[tuple[float, np.ndarray, np.ndarray]] = deque(maxlen=50)
        self._reference = self._plane(self.hand, self.at)
        self._far = self.camera.from_hand(((self.at - self.hand[:3, 3]) @ self.hand[:3, :3])[None])[0, 2]
        self._remember()

    def _start(self, right: np.ndarray, depth: float, rng: np.random.Generator) -> np.ndarray:
        """Up to the stated turn, tilt, part of the view and distance away from where the hand is right."""
        spin = np.radians(rng.uniform(-self.turn, self.turn))
        leaning = (0.0, 25.0) if self.lean is None and self.dof == 6 else self.lean
        lean = np.radians(rng.uniform(*leaning)) if leaning else 0.0
        about = rng.uniform(-np.pi, np.pi)
        tilt = rotation_matrix(lean * np.array([math.cos(about), math.sin(about), 0.0]))
        turned = right[:3, :3] @ rotation_matrix((0.0, 0.0, spin)) @ tilt
        distance = depth * rng.uniform(1.3, self.distance)
        while True:  # all contacts in view, with a margin
            where = rng.uniform(-self.aside, self.aside, 2) * (WIDTH, HEIGHT) + self.centre
            ray = self.camera.ray_directions(where[None])[0]
            hand = pose_of(turned, self.at - turned @ (self.camera.offset + distance * ray))
            seen = self.camera.project((self.contacts() - hand[:3, 3]) @ hand[:3, :3])
            if in_view(seen):
                return hand

    def right_hand(self) -> np.ndarray:
        """The pose in which the contacts lie between the fingertips, for the object as it lies now."""
        z = self.shape[:, 0] - 1j * self.shape[:, 1]  # the base's y is the hand's -y
        w = self.tips[:, 0] + 1j * self.tips[:, 1]
        angle = np.angle((z * w.conj()).sum())
        turned = np.diag([1.0, -1.0, -1.0]) @ rotation_matrix((0.0, 0.0, angle))
        return pose_of(turned, self.at - turned @ self.tips.mean(axis=0))

    def contacts(self) -> np.ndarray:
        """(k, 3) m in the base."""
        return self.at + self.shape

    def seen(self) -> np.ndarray:
        """(k, 2) px of the contacts now."""
        return self.camera.project((self.contacts() - self.hand[:3, 3]) @ self.hand[:3, :3])

    def goal(self, **options: object) -> gt.Goal:
        return gt.Goal.fingertips(self.camera.project(self.tips), self.opening, **options)

    def _plane(self, hand: np.ndarray, at: np.ndarray) -> np.ndarray:
        """The homography (3, 3) of the object's plane to px."""
        R = self.camera.turn.T @ hand[:3, :3].T
        t = R @ (at - hand[:3, 3]) - self.camera.turn.T @ self.camera.offset
        K = np.array([[self.camera.focal, 0, self.centre[0]], [0, self.camera.focal, self.centre[1]], [0, 0, 1.0]])
        return K @ np.column_stack([R[:, 0], R[:, 1], t])

    def _remember(self) -> None:
        self._poses.append((self.time, self.hand.copy(), self.at.copy()))

    def placed(self, shot: float) -> tuple[np.ndarray, np.ndarray]:
        """The hand (4, 4) and the object's place (3,) m at a time, s."""
        after = next((i for i, p in enumerate(self._poses) if p[0] >= shot), 0)
        (t0, h0, a0), (t1, h1, a1) = self._poses[max(after - 1, 0)], self._poses[after]
        share = (shot - t0) / (t1 - t0) if t1 > t0 else 1.0
        return interpolate_pose(h0, h1, share), a0 + share * (a1 - a0)

    def shown(self, hand: np.ndarray, at: np.ndarray) -> np.ndarray:
        """(k, 2) px of the contacts, as the hand sees them of an object at a place (3,) m."""
        return self.camera.project((at + self.shape @ self._narrow(hand, at) - hand[:3, 3]) @ hand[:3, :3])

    def result(self) -> gt.TrackResult:
        """What the tracker would say of the image that has arrived now."""
        taken = self.time - self.latency
        hand, at = self.placed(taken)
        narrow, points = self._narrow(hand, at), self.shown(hand, at)
        inside = np.isfinite(points).all() and (points >= 0).all() and (points < (WIDTH, HEIGHT)).all()
        dark = self.blackout[0] <= taken < self.blackout[1]
        self._latest += 1
        if dark or not inside:
            told = gt.TrackResult(
                self._latest, taken, "lost", "covered" if dark else "out of view", grasp_id=self.grasp
            )
        else:
            H = self._plane(hand, at) @ narrow @ np.linalg.inv(self._reference)
            k, off = len(points), self.rng.normal(0.0, self.noise, points.shape)
            if self.rng.random() < self.outliers:
                off = off + self.rng.uniform(-60.0, 60.0, points.shape)
                H = H @ (
                    np.eye(3) + self.rng.normal(0.0, 1.0, (3, 3)) * [[0.1, 0.1, 30], [0.1, 0.1, 30], [1e-4, 1e-4, 0]]
                )
            told = gt.TrackResult(
                self._latest, taken, "tracked", "", "auto", self.grasp, points + off, np.ones(k), None, 0.99,
                H / H[2, 2], np.broadcast_to(np.eye(2) * self.noise**2, (k, 2, 2)).copy(), None, 1.0,
            )  # fmt: skip
        self.results.append(told)
        return told

    def _narrow(self, hand: np.ndarray, at: np.ndarray) -> np.ndarray:
        """(3, 3) by which points of the object's plane seem to lie elsewhere: the nearer the hand, the narrower the object."""
        out, (most, angle) = np.eye(3), self.narrowing
        if most:
            way = (rotation_matrix((0.0, 0.0, angle)) @ (self.shape[1] - self.shape[0]))[:2]
            goal = self.camera.from_hand(self.tips.mean(axis=0)[None])[0, 2]
            now = self.camera.from_hand(((at - hand[:3, 3]) @ hand[:3, :3])[None])[0, 2]
            share = np.clip((self._far - now) / (self._far - goal), 0.0, 1.0)
            out[:2, :2] -= most * share * np.outer(way, way) / (way @ way)
        return out

    def clearance(self) -> float:
        """m of the lowest fingertip above the table."""
        return float((self.tips @ self.hand[2, :3] + self.hand[2, 3]).min()) + self.table

    def rise(self) -> float:
        """m of the hand above where it started."""
        return float(self.hand[2, 3] - self.start[2, 3])

    def move(self, twist: np.ndarray) -> None:
        """One control period; the hand's twist follows the command with a lag."""
        steps = 4
        for _ in range(steps):
            dt = self.period / steps
            self.twist = self.twist + (twist - self.twist) * (1.0 - math.exp(-dt / self.lag) if self.lag else 1.0)
            self.hand = apply_twist(self.hand, self.twist, dt)
            self.at = self.at + self.velocity * dt
        self.time += self.period
        if self.push[0] <= self.time < self.push[0] + self.period:
            self.at = self.at + self.push[1] * np.array([0.6, 0.8, 0.0])
        if self.time >= self.regrasp and self.grasp == 1:
            self.grasp, self.shape = 2, 0.9 * self.shape @ rotation_matrix((0.0, 0.0, 0.4))
            self.at = self.at + np.array([0.008, -0.005, 0.0])
        self._remember()

    def off(self) -> tuple[float, float, float]:
        """How far the middle of the contacts is from that of the tips, across and along the approach, m, and the turn, rad."""
        right = np.linalg.inv(self.right_hand()) @ self.hand
        at = self.tips.mean(axis=0)
        shift = right[:3, :3] @ at + right[:3, 3] - at
        angle = math.atan2(right[1, 0], right[0, 0])
        half = math.pi / self.fingers
        angle = (angle + half) % (2.0 * half) - half
        return float(np.hypot(*shift[:2])), float(shift[2]), angle

    def run(self, servo: gt.GraspServo, seconds: float = 30.0) -> gt.GraspServo:
        """Until it closes, or is over."""
        while not servo.over and self.time < seconds:
            if len(self.commands) % self.every == 0 and self.time < self.frozen:
                taken = self.time - self.latency if self.stamped else None
                command = servo.update(self.result(), time=self.time, pose=self.hand, taken=taken)
            else:
                command = servo.between(time=self.time, pose=self.hand)
                assert not command.close
            self.commands.append(command)
            if command.close:
                across, along, turn = self.off()
                servo.closed(across < 0.004 and abs(along) < 0.006 and abs(turn) < 0.1)
                break
            self.move(command.twist)
        return servo
