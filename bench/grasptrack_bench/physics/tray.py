# SPDX-License-Identifier: Apache-2.0
"""A tray of equal parts below a hand that points straight down: where they lie, and from where the hand looks at them."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from grasptrack.errors import InputError
from grasptrack.geometry.homographies import rotation_about_z
from grasptrack.servo.camera import rotation_vector
from grasptrack.typing import Floats, Pixels
from grasptrack_bench.physics import frames
from grasptrack_bench.physics.gripper import MAX_OPENING, make_gripper
from grasptrack_bench.physics.part import extrude_body
from grasptrack_bench.physics.setting import HEIGHT, WIDTH, Setting, hand_mask, sample_setting
from grasptrack_bench.physics.world import PERIOD_S, World
from grasptrack_bench.simulation.outlines import Shape

SIZE, FARTHEST = (0.040, 0.048), 0.055
"""m, the root of a part's area, and from its centroid to its farthest point at most; its thickness goes with that."""
TRAY = (0.42, 0.32)
"""m along x and y within which parts lie; it has no walls."""
GAP = 0.003
"""m between two parts at least."""
PLACES, LAYOUTS = 200, 50
"""Places that are drawn for a part, and layouts for a tray."""
ABOVE_TRAY, ABOVE_TAUGHT = 0.20, 0.12
"""m of the fingertips above the table where the hand looks at the tray, and at the part that it is taught."""
ASIDE_M = 0.075
"""m along x and y between a part and where the nearest look is aimed: from farther aside it shows its sides instead."""
BIN: Floats = np.array([0.50, 0.0, 0.14])
"""Where the hand lets go of what it holds."""
SPEED, TURNING = 0.5, 1.2
"""m/s and rad/s of the hand on its way to the bin and back."""
ARRIVED, ARRIVED_RAD = 0.002, 0.01
PER_M = 1000.0


def sample_tray(shape: Shape, count: int, *, seed: int, snatched: bool = False) -> Setting:
    """The setting of a tray.

    Args:
        shape: outline of the parts, of area 1.
        count: parts in it.
        seed: of everything.
        snatched: somebody pulls the first part away while the hand closes on it.

    Raises:
        InputError: so many parts do not fit.
    """
    usual = sample_setting(shape, make_gripper(2), seed=seed, scenario="pulled" if snatched else "static")
    rng = np.random.default_rng((seed, 83))
    size = min(float(rng.uniform(*SIZE)), FARTHEST / shape.radius())
    whole = usual.part
    density = whole.mass / (whole.thickness * whole.size**2)
    part = extrude_body(shape, size, whole.thickness * size / whole.size, density)
    for _ in range(LAYOUTS):
        places = _lay_parts(part.shape, count, rng)
        if len(places) == count:
            made = replace(usual, part=part, place=places[0], beside=tuple(places[1:]))
            return replace(made, hand=looks_over(made)[0])
    raise InputError(f"{count} parts like {shape.name} do not fit into the tray", parts=count)


def _lay_parts(shape: Shape, count: int, rng: np.random.Generator) -> list[Floats]:
    """Poses (4, 4) of parts, as many as find room."""
    width, depth = (math.ceil(side * PER_M) for side in TRAY)
    taken = np.zeros((depth, width), np.uint8)
    room = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, 2 * (1 + 2 * round(GAP * PER_M / 2.0),))
    places: list[Floats] = []
    for _ in range(count):
        for _ in range(PLACES):
            turn = float(rng.uniform(-math.pi, math.pi))
            at = rng.uniform(-0.5, 0.5, 2) * np.array(TRAY)
            place = frames.pose_of(rotation_about_z(turn), np.array([*at, 0.0]))
            drawn, outer = np.zeros_like(taken), _in_tray(shape.outer, place)
            if (outer < 0.0).any() or (outer > [width - 1.0, depth - 1.0]).any():
                continue
            cv2.fillPoly(drawn, [np.rint(outer).astype(np.int32)], (255,))
            if not (taken & drawn).any():
                taken |= np.asarray(cv2.dilate(drawn, cv2.dilate(room, room)), np.uint8)
                places.append(place)
                break
        else:
            break
    return places


def _in_tray(ring: Floats, place: Floats) -> Floats:
    """(N, 2) mm from a corner of the tray, of an outline in m at a place (4, 4)."""
    there = (ring * [1.0, -1.0]) @ place[:2, :2].T + place[:2, 3]
    return np.asarray((there + 0.5 * np.array(TRAY)) * PER_M, dtype=np.float64)


def taught_alone(setting: Setting) -> Setting:
    """The same hand and camera above one part that lies alone."""
    alone = replace(setting, place=np.eye(4), beside=(), pulls=(), belt=np.zeros(2))
    return replace(alone, hand=_look_at(alone, np.zeros(2), ABOVE_TAUGHT))


def looks_over(setting: Setting) -> list[Floats]:
    """Poses (4, 4) of the hand from which it sees every part of the tray whole, beside its own fingers, and not far aside."""
    reach = 2.0 * float(np.hypot(*setting.part.shape.outer.T).max())
    spread = np.array(TRAY) - reach
    seen = 0.9 * _free_rows(setting) / _px_per_m(setting) - reach
    steps = np.minimum(2.0 * ASIDE_M, [math.inf, max(seen, 0.25 * reach)])
    counts = np.maximum(1, np.ceil(spread / steps)).astype(int).tolist()
    x, y = (((np.arange(n) + 0.5) / n - 0.5) * wide for n, wide in zip(counts, spread.tolist(), strict=True))
    return [_look_at(setting, np.array([u, v]), ABOVE_TRAY) for v in y.tolist() for u in x.tolist()]


def seen_from_above(setting: Setting) -> tuple[Floats, float]:
    """(2,) px at which a look is aimed, and px round it within which parts are not seen far aside."""
    return np.array([WIDTH / 2.0, _free_rows(setting) / 2.0]), 1.5 * ASIDE_M * _px_per_m(setting)


def _px_per_m(setting: Setting) -> float:
    """In the tray, from where the hand looks at it."""
    return float(setting.camera.matrix[0, 0] / (ABOVE_TRAY - setting.mount[2, 3]))


def _free_rows(setting: Setting) -> int:
    """Rows of the image above the hand's own fingers."""
    covered = fingers_in_view(setting).any(axis=1)
    return int(np.argmax(covered)) if covered.any() else HEIGHT


def fingers_in_view(setting: Setting) -> Pixels:
    """(480, 640) 255 where the open hand is in its own camera's way."""
    return hand_mask(setting.camera, setting.mount, make_gripper(2), MAX_OPENING, grow=5)


def _look_at(setting: Setting, point: Floats, height: float) -> Floats:
    """(4, 4) of the hand so high above the table that sees a point (2,) m in the middle above its fingers, the image level."""
    x = setting.mount[:3, 0]  # of the image, in the hand
    R = rotation_about_z(math.atan2(x[1], x[0])) @ frames.DOWN
    pixel = np.array([*seen_from_above(setting)[0], 1.0])
    offset = R @ setting.mount[:3, 3]
    ray = R @ setting.mount[:3, :3] @ np.linalg.inv(setting.camera.matrix) @ pixel
    along = (setting.part.thickness - height - offset[2]) / ray[2]
    return frames.pose_of(R, np.array([*(point - offset[:2] - along * ray[:2]), height]))


def travel(world: World, pose: Floats, limit_s: float = 10.0) -> bool:
    """Move the hand straight to a pose (4, 4); whether it is there in time."""
    until = world.time() + limit_s
    while world.time() < until:
        now = world.pose()
        way, turn = now[:3, :3].T @ (pose[:3, 3] - now[:3, 3]), rotation_vector(now[:3, :3].T @ pose[:3, :3])
        if np.linalg.norm(way) < ARRIVED and np.linalg.norm(turn) < ARRIVED_RAD:
            world.move(np.zeros(6))
            return True
        world.move([*_limited(way, SPEED), *_limited(turn, TURNING)])
    return False


def _limited(way: Floats, speed: float) -> Floats:
    """The velocity that leads over a way without overshooting: slower where the rest is short."""
    wanted = way / (4.0 * PERIOD_S)
    return np.asarray(wanted * min(1.0, speed / max(float(np.linalg.norm(wanted)), 1e-9)), dtype=np.float64)
