# SPDX-License-Identifier: Apache-2.0
"""A hand led by the truth: what it cannot lift, no controller can. So faults of the physics show apart from others."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.simulation.physical import frames
from grasptrack.simulation.physical.world import World

Floats = NDArray[np.float64]

ABOVE = 0.05
"""m above the part at which the hand aligns before it goes down."""


def lift_by_truth(world: World, contacts: ArrayLike, *, timeout: float = 15.0) -> bool:
    """Align above true contacts, go down, close, lift; whether the part came up and stayed.

    Args:
        world: of two fingers, at its start.
        contacts: (2, 2) on the part's outline, in m, x right and y down.
        timeout: s for the approach.
    """
    pair = np.asarray(contacts, dtype=np.float64)
    width = float(np.hypot(*(pair[1] - pair[0])))
    end = world.time() + timeout
    for height, near in ((ABOVE, 0.003), (0.002, 0.0005)):
        while world.time() < end:
            twist, far = _toward(world, pair, world.setting.part.thickness + height)
            if far < near:
                break
            world.move(twist)
    return world.close(width) and world.lift()


def _toward(world: World, pair: Floats, height: float) -> tuple[Floats, float]:
    """The twist that leads to the goal, the table's own motion included, and how far that is in m (10 cm to a rad)."""
    part, hand = world.part_pose(), world.pose()
    a, b = (part[:3, :3] @ np.array([x, -y, 0.0]) + part[:3, 3] for x, y in pair)
    middle = 0.5 * (a + b)
    middle[2] = height
    way = math.atan2(b[1] - a[1], b[0] - a[0])
    now = math.atan2(hand[1, 0], hand[0, 0])
    way += math.pi * round((now - way) / math.pi)  # half a turn brings two equal fingers to the same place
    R = frames.about_z(way) @ frames.DOWN
    turn = _rotation_vector(hand[:3, :3].T @ R)
    shift = hand[:3, :3].T @ (middle - hand[:3, 3])
    carried = hand[:3, :3].T @ np.array([*world.setting.belt, 0.0])
    twist = np.concatenate([_limited(6.0 * shift, 0.3) + carried, _limited(6.0 * turn, 1.5)])
    return twist, float(np.hypot(np.linalg.norm(shift), 0.1 * np.linalg.norm(turn)))


def _limited(v: Floats, most: float) -> Floats:
    return v * min(1.0, most / max(1e-12, float(np.linalg.norm(v))))


def _rotation_vector(R: Floats) -> Floats:
    q = frames.quaternion(R)
    s = float(np.linalg.norm(q[1:]))
    return np.asarray(q[1:] * (2.0 * math.atan2(s, q[0]) / s if s > 1e-12 else 2.0), dtype=np.float64)
