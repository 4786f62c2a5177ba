# SPDX-License-Identifier: Apache-2.0
"""All that chance decides in a physical world, drawn from one seed before anything moves."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError
from grasptrack.geometry.homographies import rotation_about_z
from grasptrack.typing import Floats
from grasptrack_bench.physics import frames
from grasptrack_bench.physics.gripper import MAX_OPENING, Gripper
from grasptrack_bench.physics.part import Body, extrude_body
from grasptrack_bench.physics.pull import Pull, sample_pulls, whole_outline
from grasptrack_bench.simulation.camera import Pinhole
from grasptrack_bench.simulation.outlines import Shape

Scenario = Literal["static", "pushed", "belt", "blackout", "pulled"]
Arm = Literal["gantry", "arm"]
SCENARIOS: tuple[Scenario, ...] = ("static", "pushed", "belt", "blackout", "pulled")
ARMS: tuple[Arm, ...] = ("gantry", "arm")

WIDTH, HEIGHT = 640, 480
SIZE = (0.060, 0.072)
"""m, the root of a part's area."""
LONGEST = 0.10
"""m from a part's centroid to its farthest point at most: what is longer is made smaller."""
AWAY = (1.5, 2.5)
"""Distances at the start, as multiples of that in which the fingertips reach the part."""
ASIDE = 0.4
"""Of the view's width and height, by which the part lies off at most."""
TURN, TILT = math.radians(45.0), math.radians(25.0)
BELT = (0.2, 0.5)
"""Speed of a belt in widths of the view at the start, a second."""
BLACKOUT_S = 0.5


@dataclass(frozen=True)
class Setting:
    """What a seed decides.

    Attributes:
        part: the body.
        place: (4, 4) of the part on the table, in the world, at the start.
        hand: (4, 4) of the hand in the world at the start.
        camera: intrinsics.
        mount: (4, 4) of the camera in the hand; x right, y down, z into the scene.
        belt: (2,) m/s, velocity of the table.
        push: time in s, velocity (2,) in m/s and turn in rad/s of the part while somebody pushes it for a moment; None.
        blackout: s, when the view is blocked; infinite where it is not.
        pulls: ways in which somebody may pull the part away when the hand closes for the first time; empty where nobody does.
        beside: (4, 4) of further parts like it on the table, in the world, at the start.
    """

    part: Body
    place: Floats
    hand: Floats
    camera: Pinhole
    mount: Floats
    belt: Floats
    push: tuple[float, Floats, float] | None
    blackout: float
    pulls: tuple[Pull, ...] = ()
    beside: tuple[Floats, ...] = ()


def sample_setting(
    shape: Shape,
    hand: Gripper,
    *,
    seed: int,
    scenario: Scenario = "static",
    arm: Arm = "gantry",
    axis: float | None = None,
) -> Setting:
    """The setting of a seed.

    The part is seen whole in the first view and not behind the hand; within that the view is as far off, turned and away as
    the limits above allow, evenly. A belt carries the part toward the middle of the view, within 60 degrees, as one that
    enters it.

    Args:
        shape: the part's outline, of area 1.
        hand: its fingers.
        seed: of everything.
        scenario: "static", "pushed" (somebody moves the part on the way), "belt" (the table moves), "blackout" (the view is
            blocked for half a second), "pulled" (somebody pulls the part away while the hand closes for the first time).
        arm: "gantry" starts upright, "arm" leans by up to 25 degrees.
        axis: rad, x toward y in the plane of the outline: where x of the hand points in a grasp, from which the hand is turned
            by up to 45 degrees at the start, or fingers have changed places as well; None draws one.
    """
    if scenario not in SCENARIOS:
        raise InputError(f'unknown scenario "{scenario}"; choose from {", ".join(SCENARIOS)}', scenario=scenario)
    if arm not in ARMS:
        raise InputError(f'unknown arm "{arm}"; choose from {", ".join(ARMS)}', arm=arm)
    rng = np.random.default_rng((seed, zlib.crc32(shape.name.encode()), 71))
    size = min(float(rng.uniform(*SIZE)), LONGEST / shape.radius())
    part = extrude_body(shape, size, float(rng.uniform(0.002, 0.006)), float(rng.uniform(1000.0, 2700.0)))
    camera = Pinhole(WIDTH, HEIGHT, focal=float(rng.uniform(520.0, 680.0)))
    mount = _sample_camera_mount(rng)
    chosen = float(rng.uniform(0.0, math.pi)) if axis is None else axis
    yaw = float(rng.uniform(-math.pi, math.pi))
    place = frames.pose_of(rotation_about_z(yaw), np.zeros(3))
    goal = frames.project_points(camera.matrix, frames.inverse_pose(mount), np.zeros((1, 3)))[0]
    depth = float((frames.inverse_pose(mount) @ np.array([0.0, 0.0, 0.0, 1.0]))[2])
    blocked = hand_mask(camera, mount, hand, MAX_OPENING, grow=6)
    for attempt in range(400):
        tilt = float(rng.uniform(0.0, TILT)) if arm == "arm" else 0.0
        # seen from above, x toward y of the outline is from x to -y of the world
        spin = (
            yaw
            - chosen
            + float(rng.uniform(-TURN, TURN))
            + 2.0 * math.pi / hand.fingers * int(rng.integers(hand.fingers))
        )
        R = rotation_about_z(spin) @ frames.tilt_rotation(tilt, float(rng.uniform(-math.pi, math.pi))) @ frames.DOWN
        share = 1.0 - attempt / 800.0
        off = rng.uniform(-ASIDE, ASIDE, 2) * np.array([WIDTH, HEIGHT]) * share
        away = float(rng.uniform(*AWAY)) * depth
        ray = np.linalg.inv(camera.matrix) @ np.array([*(goal + off), 1.0])
        R_camera = R @ mount[:3, :3]
        at = np.array([0.0, 0.0, part.thickness]) - R_camera @ ray * away
        start = frames.pose_of(R_camera, at) @ frames.inverse_pose(mount)
        if is_fully_visible(part, place, start @ mount, camera, blocked) and start[2, 3] > 0.08:
            break
    else:
        raise InputError(f"{shape.name}: the part cannot be shown whole beside the hand", shape=shape.name)
    belt = np.zeros(2)
    if scenario == "belt":
        inward = R_camera @ np.array([*(-off), 0.0])
        way = math.atan2(inward[1], inward[0]) + float(rng.uniform(-math.pi / 3.0, math.pi / 3.0))
        speed = float(rng.uniform(*BELT)) * WIDTH / camera.matrix[0, 0] * away
        belt = speed * np.array([math.cos(way), math.sin(way)])
    push = None
    if scenario == "pushed":
        way = float(rng.uniform(-math.pi, math.pi))
        velocity = float(rng.uniform(0.04, 0.12)) * np.array([math.cos(way), math.sin(way)])
        push = (float(rng.uniform(0.8, 2.0)), velocity, float(rng.uniform(-1.0, 1.0)))
    dark = float(rng.uniform(0.8, 2.0)) if scenario == "blackout" else math.inf
    pulls = sample_pulls(rng) if scenario == "pulled" else ()
    return Setting(part, place, start, camera, mount, belt, push, dark, pulls)


def _sample_camera_mount(rng: np.random.Generator) -> Floats:
    """The camera beside and above the fingers, leaning more or less toward their tips, which it sees in the lower half."""
    x, y, z = rng.uniform(-0.012, 0.012), -rng.uniform(0.06, 0.08), -rng.uniform(0.25, 0.30)
    aim, aside, roll = (math.radians(float(v)) for v in rng.uniform([0.0, -6.0, -15.0], [12.0, 6.0, 15.0]))
    # y of the image is y of the hand; leaning toward the tips turns the axis from z toward +y
    R = frames.about_x(-aim) @ frames.about_y(aside) @ rotation_about_z(roll)
    return frames.pose_of(R, np.array([x, y, z]))


def hand_mask(camera: Pinhole, mount: Floats, hand: Gripper, opening: float, grow: int) -> NDArray[np.uint8]:
    """(H, W) 255 where the hand is seen by its own camera, `grow` px more on every side."""
    mask = np.zeros((camera.height, camera.width), np.uint8)
    inverse = frames.inverse_pose(mount)
    for corners in hand.boxes(opening):
        outline = frames.convex_silhouette(camera.matrix, inverse, corners)
        if outline is not None:
            cv2.fillConvexPoly(mask, np.rint(outline * 16.0).astype(np.int32), 255, shift=4)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * grow + 1, 2 * grow + 1))
    return np.asarray(cv2.dilate(mask, kernel), dtype=np.uint8)


def is_fully_visible(
    part: Body, place: Floats, camera_pose: Floats, camera: Pinhole, blocked: NDArray[np.uint8]
) -> bool:
    """Whether the outline of a part at a pose (4, 4) is seen whole and beside the hand, 255 in (H, W)."""
    seen = whole_outline(part, place, camera_pose, camera)
    if seen is None:
        return False
    drawn = np.zeros_like(blocked)
    cv2.fillPoly(drawn, [np.rint(seen).astype(np.int32)], 255)
    return not bool((drawn & blocked).any())
