# SPDX-License-Identifier: Apache-2.0
"""Somebody snatches the part away while the hand closes on it: how far, and whether that leaves the fingers empty."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np

from grasptrack.geometry.homographies import apply_homography, rotation_about_z
from grasptrack.typing import Floats, Pixels
from grasptrack_bench.physics import frames
from grasptrack_bench.physics.gripper import MAX_OPENING, PAD_THICKNESS, PAD_WIDTH, SHAFT_THICKNESS, Gripper
from grasptrack_bench.physics.part import Body
from grasptrack_bench.simulation.camera import Pinhole

PULL_S = 0.2
"""s that it takes: as a rule the tips are not down by then, and the part comes away from between them in any direction."""
DISTANCE, TURN = (0.03, 0.06), 0.4
"""m by which the part is pulled, and rad by which it is turned at most."""
WAYS, FARTHER = 200, 0.01
"""So many ways are drawn, each farther by this share of the first one's distance: a long part has to go farther."""
ROOM = 0.003
"""m round the fingers that the part leaves free."""
BACK = 0.04
"""m by which the hand goes back before it looks again."""
BORDER = 8.0
"""px between the part and the border of a view that shows it whole, at least."""
ON_THE_WAY = (0.15, 0.3, 0.45, 0.6, 0.8)
"""Shares of the way at which the part must not run into fingers that are down already."""
FINE, HALF = 5e-4, 0.16
"""m to a pixel of the picture in which fingers and part must not meet, and half of its side."""


class Pull(NamedTuple):
    """What is done to the part: a way (2,) in m, in the world, and a turn in rad about the vertical."""

    way: Floats
    turn: float

    def moved(self, place: Floats, share: float = 1.0) -> Floats:
        """(4, 4) of a part that is at a place (4, 4) after a share of the way."""
        there = place[:3, 3] + share * np.array([*self.way, 0.0])
        return frames.pose_of(rotation_about_z(share * self.turn) @ place[:3, :3], there)

    def velocity(self, elapsed: float) -> tuple[Floats, float]:
        """(2,) m/s and rad/s after so many s: from rest to rest, without a jerk."""
        share = elapsed / PULL_S
        pace = 30.0 * (share * (1.0 - share)) ** 2 / PULL_S
        return pace * self.way, pace * self.turn


def sample_pulls(rng: np.random.Generator) -> tuple[Pull, ...]:
    """Ways to pull a part, any direction as likely as another."""
    found = []
    for k in range(WAYS):
        way, far = float(rng.uniform(-math.pi, math.pi)), float(rng.uniform(*DISTANCE)) * (1.0 + FARTHER * k)
        found.append(Pull(far * np.array([math.cos(way), math.sin(way)]), float(rng.uniform(-TURN, TURN))))
    return tuple(found)


def choose_pull(
    pulls: tuple[Pull, ...],
    part: Body,
    place: Floats,
    hand: Gripper,
    at: Floats,
    opening: float,
    camera: Pinhole,
    mount: Floats,
) -> Pull:
    """The first way after which the fingers close on nothing, and the hand sees the part whole once it has gone back.

    Where the tips are too low for the part to pass below, it is also one on which fingers do not hold it up. Where nothing
    does all of it, it is the first that leaves the fingers empty.

    Args:
        pulls: to choose from.
        part, place: the body, and where it is, (4, 4).
        hand, at: the fingers, and where the hand is, (4, 4).
        opening: m, from which the fingers close.
        camera, mount: the hand's camera, and its place in the hand.
    """
    swept = _drawn_fingers(hand, 0.0, opening / 2.0 + PAD_THICKNESS)
    in_the_way = _drawn_fingers(hand, opening / 2.0, MAX_OPENING / 2.0 + SHAFT_THICKNESS)
    low = at[2, 3] < part.thickness + ROOM
    seen_from = at.copy()
    seen_from[:3, 3] -= BACK * at[:3, 2]
    empty = []
    for pull in pulls:
        there = pull.moved(place)
        if (_drawn(part, there, at) & swept).any():
            continue
        empty.append(pull)
        if low and any((_drawn(part, pull.moved(place, share), at) & in_the_way).any() for share in ON_THE_WAY):
            continue
        if whole_outline(part, there, seen_from @ mount, camera) is not None:
            return pull
    return (empty or [pulls[-1]])[0]


def _drawn_fingers(hand: Gripper, near: float, far: float) -> Pixels:
    """Picture in the plane of the tips, 255 where fingers come from so far to so near to the middle, m, and round that."""
    drawn = _blank()
    wide, near, far = PAD_WIDTH / 2.0 + ROOM, max(0.0, near), far + ROOM
    for finger in range(hand.fingers):
        R = hand.finger_frame(finger, 0.0)[:2, :2]
        box = np.array([[near, -wide], [far, -wide], [far, wide], [near, wide]])
        cv2.fillConvexPoly(drawn, _pixels(box @ R.T), 255)
    return drawn


def _drawn(part: Body, place: Floats, at: Floats) -> Pixels:
    """Picture of the part at a place in the plane of the tips, as the hand would come down on it."""
    drawn = _blank()
    rings = []
    for ring in part.shape.polygons:
        there = np.column_stack([ring[:, 0], -ring[:, 1], np.zeros(len(ring))]) @ place[:3, :3].T + place[:3, 3]
        local = (there - at[:3, 3]) @ at[:3, :3]
        rings.append(_pixels(local[:, :2]))
    cv2.fillPoly(drawn, rings, 255)
    return drawn


def _blank() -> Pixels:
    side = round(2.0 * HALF / FINE)
    return np.zeros((side, side), np.uint8)


def _pixels(points: Floats) -> Any:
    return np.rint((points + HALF) / FINE).astype(np.int32)


def whole_outline(part: Body, place: Floats, camera_pose: Floats, camera: Pinhole) -> Floats | None:
    """(N, 2) px of the part's outline at a place (4, 4); None where not all of it is in view, within `BORDER`."""
    H = frames.plane_to_image(camera.matrix, camera_pose, place, part.thickness)
    seen = apply_homography(H, part.shape.outer)
    inside = (seen >= BORDER) & (seen <= np.array([camera.width, camera.height]) - 1.0 - BORDER)
    return seen if inside.all() else None
