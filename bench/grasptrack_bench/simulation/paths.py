# SPDX-License-Identifier: Apache-2.0
"""Where the camera is, frame by frame: smooth paths, and paths that keep a part in view or lose it on purpose."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike

from grasptrack.geometry.homographies import apply_homography, rotation_about_z
from grasptrack.typing import Floats
from grasptrack_bench.simulation.camera import Pinhole
from grasptrack_bench.simulation.outlines import Shape


@dataclass(frozen=True)
class Path:
    """Where the camera is in each frame: it looks at a point of the table from a distance, rolled and tilted.

    Attributes:
        target: (F, 2) the point of the table that the optical axis meets, in table units.
        distance: (F,) from the camera's centre to it, in table units.
        roll: (F,) rad, about the optical axis.
        tilt: (F,) rad, between the optical axis and the table's normal; 0 is frontal.
        azimuth: (F,) rad, the direction in the table of the axis that the camera tilts about.
    """

    target: Floats
    distance: Floats
    roll: Floats
    tilt: Floats
    azimuth: Floats

    def __len__(self) -> int:
        return len(self.distance)

    def __getitem__(self, frames: slice) -> Path:
        return Path(*(getattr(self, field.name)[frames] for field in fields(self)))

    def pose(self, index: int) -> Path:
        """The path of one frame that stays at that pose."""
        return self[index : index + 1]

    def table_to_image(self, camera: Pinhole, height: float = 0.0) -> Floats:
        """(F, 3, 3) homographies from table coordinates to ideal pixels, the last element of each 1.

        Distortion comes after, by `Pinhole.distort`. The plane that is seen is at a height in table units.
        """
        homographies = np.empty((len(self), 3, 3))
        for i in range(len(self)):
            rotation = rotation_about_z(self.roll[i]) @ _about_axis(self.azimuth[i], self.tilt[i])
            shift = np.array([0.0, 0.0, self.distance[i]]) - rotation[:, :2] @ self.target[i]
            if height != 0.0:
                shift = shift - height * rotation[:, 2]  # the table's normal points away from the camera
            H = camera.matrix @ np.column_stack([rotation[:, :2], shift])
            homographies[i] = H / H[2, 2]
        return homographies

    def eye(self) -> Floats:
        """(F, 3) table units: where the camera's centre is, the last of them its height above the table."""
        axis = np.array([_about_axis(a, t)[2] for a, t in zip(self.azimuth, self.tilt, strict=True)])
        return np.column_stack([self.target - self.distance[:, None] * axis[:, :2], self.distance * axis[:, 2]])

    def between(self, index: int, offsets: ArrayLike) -> Path:
        """The poses at `index` + offsets (K,) frames, on the cubic through the four poses around; 0 is the pose itself."""
        lean = self.tilt[:, None] * np.column_stack([np.cos(self.azimuth), np.sin(self.azimuth)])
        known = np.column_stack([self.target, self.distance, self.roll, lean])
        last = len(known) - 1
        k = index + np.arange(-2, 3)
        poses = known[np.clip(k, 0, last)]
        if last > 0:  # beyond its ends the path goes on evenly
            poses += np.minimum(k, 0)[:, None] * (known[1] - known[0])
            poses += np.maximum(k - last, 0)[:, None] * (known[last] - known[last - 1])
        u = np.asarray(offsets, dtype=np.float64)[:, None]
        v, side = np.abs(u), np.where(u < 0.0, -1, 1)[:, 0]
        a, b, before, beyond = poses[2], poses[2 + side], poses[2 - side], poses[2 + 2 * side]
        m, n = 0.5 * (b - before), 0.5 * (beyond - a)  # slopes of Catmull and Rom
        at = a + m * v + (3 * (b - a) - 2 * m - n) * v**2 + (2 * (a - b) + m + n) * v**3
        return Path(at[:, :2], at[:, 2], at[:, 3], np.hypot(at[:, 4], at[:, 5]), np.arctan2(at[:, 5], at[:, 4]))


def _about_axis(azimuth: float, angle: float) -> Floats:
    """Rotation by `angle` about the axis (cos azimuth, sin azimuth, 0)."""
    turn = rotation_about_z(azimuth)
    c, s = math.cos(angle), math.sin(angle)
    lean = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return np.asarray(turn @ lean @ turn.T, dtype=np.float64)


def _random_smooth_curve(rng: np.random.Generator, frames: int, cycles: float) -> Floats:
    """(frames,) a smooth curve that starts at 0 and stays within -1..1."""
    u = np.linspace(0.0, cycles, frames)
    phase = rng.uniform(0.0, 2.0 * math.pi, 3)
    weight = rng.uniform(0.4, 1.0, 3) / np.array([1.0, 2.0, 3.0])
    waves = sum(w * np.sin(2.0 * math.pi * k * u + p) for k, w, p in zip((1, 2, 3), weight, phase, strict=True))
    curve = np.asarray(waves - waves[0], dtype=np.float64)
    return curve / max(1e-9, float(np.abs(curve).max()))


def similarity_path(
    frames: int,
    *,
    distance: float = 3.6,
    reach: float = 0.35,
    zoom: float = 0.2,
    turn: float = math.pi / 2,
    cycles: float = 0.6,
    seed: int = 0,
) -> Path:
    """A path of 4 DoF: the table stays parallel to the image, which moves by a similarity (paper, Section III).

    Args:
        frames: number of frames.
        distance: of the camera in the first frame, table units.
        reach: largest shift along each axis, table units.
        zoom: largest relative change of the distance.
        turn: largest roll, rad.
        cycles: slow waves over the whole path; more is faster.
        seed: of the path.
    """
    rng = np.random.default_rng(seed)
    still = np.zeros(frames)
    return Path(
        target=reach
        * np.column_stack([_random_smooth_curve(rng, frames, cycles), _random_smooth_curve(rng, frames, cycles)]),
        distance=distance * np.exp(math.log1p(zoom) * _random_smooth_curve(rng, frames, cycles)),
        roll=turn * _random_smooth_curve(rng, frames, cycles),
        tilt=still,
        azimuth=still,
    )


def tilting_path(
    frames: int,
    *,
    tilt: float = math.radians(25.0),
    distance: float = 3.6,
    reach: float = 0.3,
    zoom: float = 0.15,
    turn: float = math.pi / 3,
    cycles: float = 0.6,
    seed: int = 0,
) -> Path:
    """A path of 6 DoF: that of `similarity_path`, and the camera leans up to `tilt` rad in changing directions.

    The first frame is frontal.
    """
    plain = similarity_path(frames, distance=distance, reach=reach, zoom=zoom, turn=turn, cycles=cycles, seed=seed)
    rng = np.random.default_rng((seed, 1))
    lean_x, lean_y = _random_smooth_curve(rng, frames, cycles), _random_smooth_curve(rng, frames, cycles)
    lean = np.hypot(lean_x, lean_y)
    return replace(plain, tilt=tilt * lean / max(1e-9, float(lean.max())), azimuth=np.arctan2(lean_y, lean_x))


MOST_MOVED = np.array([0.8, 0.8, 0.4, 0.8, 0.4, 0.4])
"""How far a free hand goes to each side: two shifts in table units, distance by its logarithm, roll and two leans in rad."""
MARGIN = 10.0
"""px between a part that is to stay in view and the border."""


def bounded_path(
    shape: Shape,
    frames: int,
    seed: int,
    *,
    camera: Pinhole,
    size: float = 175.0,
    start: float = 0.0,
    tilt: float = 0.0,
    speed: float = 4.0,
    spin: float = 2.0,
    reach: float = 0.35,
    zoom: float = 0.15,
    cycles: float = 0.6,
) -> Path:
    """A smooth path over a part that stays in view: slowed down, and farther away where it must be.

    Args:
        shape: the part.
        frames: number of frames; the first is frontal, with the part in the middle.
        seed: of the path.
        camera: whose image the part stays in.
        size: px, sqrt(area) of the part in the first frame, or less where it would not fit.
        start: rad, of the roll in the first frame.
        tilt: rad, largest.
        speed: px a frame, largest motion of the part's middle.
        spin: degrees a frame, largest change of the roll.
        reach: table units, largest shift.
        zoom: largest relative change of the distance.
        cycles: slow waves over the whole path.
    """
    focal = float(camera.matrix[0, 0])
    path = tilting_path(
        frames, tilt=tilt, distance=focal / size, reach=reach, zoom=zoom, turn=math.pi / 2, cycles=cycles, seed=seed
    )
    most = float(np.abs(np.diff(path.roll)).max(initial=0.0))
    roll = start + path.roll * min(1.0, math.radians(spin) / max(most, 1e-12))
    path = replace(path, roll=roll)
    for _ in range(3):
        moved = apply_all(path.table_to_image(camera), np.zeros((1, 2)))[:, 0]
        steps = np.hypot(*np.diff(moved, axis=0).T)
        path = replace(path, target=path.target * min(1.0, speed / max(float(steps.max(initial=0.0)), 1e-12)))
    for step in range(60):
        if in_view(shape, path, camera):
            break
        path = replace(path, target=0.8 * path.target) if step < 5 else replace(path, distance=1.05 * path.distance)
    return path


def at_rest(path: Path) -> Path:
    """A camera that stays where a path begins."""
    return Path(*(np.repeat(getattr(path, field.name)[:1], len(path), axis=0) for field in fields(path)))


def add_hand_tremor(shape: Shape, path: Path, camera: Pinhole, *, speed: float, seed: int) -> Path:
    """The same path with the tremor of a hand: irregular, its direction another every few frames, from rest on.

    It adds at most px a frame to the motion of the part's middle; the camera keeps so far away that the part stays in view.
    """
    rng, frames = np.random.default_rng((seed, 71)), len(path)
    white = rng.standard_normal((frames + 24, 3))
    near, wide = (np.exp(-0.5 * (np.arange(-12, 13) / sigma) ** 2) for sigma in (0.9, 2.5))
    band = near / near.sum() - wide / wide.sum()
    tremor = np.column_stack([np.convolve(white[:, k], band, mode="valid") for k in range(3)])
    tremor = (tremor - tremor[0]) * np.clip(np.arange(frames) / 4.0, 0.0, 1.0)[:, None] ** 2
    most = float(np.hypot(*np.diff(tremor[:, :2], axis=0).T).max(initial=0.0))
    units = speed / float(camera.matrix[0, 0]) * path.distance / max(most, 1e-12)
    moved = replace(path, target=path.target + units[:, None] * tremor[:, :2], roll=path.roll + 0.012 * tremor[:, 2])
    return kept_in_view(shape, moved, camera, 1.02)


def hand_held(shape: Shape, path: Path, camera: Pinhole, *, speed: float, tail: float, seed: int) -> Path:
    """The same path in a free hand: a walk in all six degrees of freedom whose speed changes as much as hands' does.

    Args:
        shape: the part; the camera keeps so far away that it stays in view.
        path: without the hand; its first pose stays.
        camera: whose image the part stays in.
        speed: px a frame, median over the frames of the part's fastest corner.
        tail: the speed that one frame in twenty exceeds, in medians.
        seed: of the hand.
    """
    rng, frames = np.random.default_rng((seed, 73)), len(path)
    steps, pace = np.zeros((frames, 6)), np.zeros(frames)
    for i in range(1, frames):  # the pace is a slow log-normal, the direction another after some frames
        pace[i] = 0.85 * pace[i - 1] + math.sqrt(1.0 - 0.85**2) * rng.standard_normal()
        steps[i] = 0.55 * steps[i - 1] + rng.standard_normal(6)
    # What each degree of freedom is in the image: shifts, distance, roll, and leaning by some degrees.
    steps *= np.exp(math.log(tail) / 1.645 * pace)[:, None] * np.array([1.0, 1.0, 0.25, 0.25, 0.3, 0.3])
    walk = np.zeros((frames, 6))
    for i in range(1, frames):
        walk[i] = 0.85 * walk[i - 1] + steps[i]
    corners, gain = np.asarray(cv2.boxPoints(cv2.minAreaRect(shape.outer.astype(np.float32))), np.float64), 1e-3
    held = path
    for _ in range(8):
        shift = MOST_MOVED * np.tanh(gain * walk / MOST_MOVED)
        target, distance, roll = (
            path.target + shift[:, :2],
            path.distance * np.exp(shift[:, 2]),
            path.roll + shift[:, 3],
        )
        lean, azimuth = np.hypot(shift[:, 4], shift[:, 5]), np.arctan2(shift[:, 5], shift[:, 4])
        held = kept_in_view(shape, Path(target, distance, roll, lean, azimuth), camera, 1.03)
        seen = apply_all(held.table_to_image(camera), corners)
        fastest = np.hypot(*np.moveaxis(np.diff(seen, axis=0), 2, 0)).max(axis=1) if frames > 1 else np.ones(1)
        gain *= speed / max(float(np.median(fastest)), 1e-9)
    return held


def from_aside(shape: Shape, path: Path, camera: Pinhole, *, lean: float, seed: int) -> Path:
    """A frontal path that begins aside: the camera leans, rad, at first, and comes over the part in four fifths of the time.

    It keeps so far away that the part stays in view.
    """
    u = np.clip(np.arange(len(path)) / max(1.0, 0.8 * (len(path) - 1)), 0.0, 1.0)
    azimuth = np.random.default_rng((seed, 72)).uniform(0.0, 2.0 * math.pi)
    leaning = replace(path, tilt=lean * 0.5 * (1.0 + np.cos(math.pi * u)), azimuth=np.full(len(path), azimuth))
    return kept_in_view(shape, leaning, camera, 1.03)


def add_camera_retreat(path: Path, *, factor: float, shift: tuple[float, float], times: tuple[float, float]) -> Path:
    """The same path, but the camera draws back and aside, so that it sees more of the table.

    At last, by a factor of the distance and a shift in table units; it sets out and arrives at two frames.
    """
    ramp = np.clip((np.arange(len(path)) - times[0]) / max(1e-9, times[1] - times[0]), 0.0, 1.0)
    ramp = ramp * ramp * (3.0 - 2.0 * ramp)
    distance = path.distance * (1.0 + (factor - 1.0) * ramp)
    return replace(path, distance=distance, target=path.target + ramp[:, None] * np.array(shift))


def apply_all(homographies: Floats, points: Floats) -> Floats:
    """(F, N, 2) points (N, 2) through each of (F, 3, 3) homographies."""
    return np.array([apply_homography(H, points) for H in homographies])


def _project_outline(shape: Shape, path: Path, camera: Pinhole, count: int) -> Floats:
    """(F, count, 2) px of points of the outline, every other frame."""
    return camera.distort(apply_all(path[::2].table_to_image(camera), shape.samples(count)))


def in_view(shape: Shape, path: Path, camera: Pinhole) -> bool:
    """Whether the whole part stays in the image, MARGIN px from its border, in all frames."""
    points = _project_outline(shape, path, camera, 60)
    limit = np.array([camera.width - 1, camera.height - 1]) - MARGIN
    return bool(np.all((points >= MARGIN) & (points <= limit)))


def kept_in_view(shape: Shape, path: Path, camera: Pinhole, farther: float) -> Path:
    """The path from as many times `farther` as keeps the part in view."""
    for _ in range(60):
        if in_view(shape, path, camera):
            break
        path = replace(path, distance=farther * path.distance)
    return path


def drift_out_of_view(
    shape: Shape,
    path: Path,
    camera: Pinhole,
    *,
    direction: float,
    share: float,
    times: tuple[float, float, float, float],
) -> Path:
    """The same path, but for some time the part drifts out of the image, and comes back.

    Args:
        shape: the part.
        path: on which it stays in view.
        camera: whose image it leaves.
        direction: rad in the image, where it goes.
        share: of the outline's length out of view, at most; 1 is all of it, and a little farther.
        times: frames at which it sets out, has arrived, starts back, is back.
    """
    index = np.arange(len(path), dtype=np.float64)
    u = np.clip((index - times[0]) / max(1e-9, times[1] - times[0]), 0.0, 1.0)
    v = np.clip((times[3] - index) / max(1e-9, times[3] - times[2]), 0.0, 1.0)
    ramp = np.minimum(u, v)
    ramp = ramp * ramp * (3.0 - 2.0 * ramp)
    heading = direction - path.roll  # a direction of the image in the table
    way = -ramp[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
    limit = np.array([camera.width - 1, camera.height - 1])

    def largest_share(distance: float) -> float:
        points = _project_outline(shape, replace(path, target=path.target + distance * way), camera, 120)
        return float(1.0 - np.all((points >= 0.0) & (points <= limit), axis=2).mean(axis=1).min())

    low, high = 0.0, 0.5 * math.hypot(camera.width, camera.height) / float(camera.matrix[0, 0]) * path.distance.max()
    high += shape.radius()
    for _ in range(14):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if largest_share(middle) < share else (low, middle)
    farther = high + 0.15 if share >= 1.0 else low
    return replace(path, target=path.target + farther * way)
