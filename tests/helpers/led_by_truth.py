# SPDX-License-Identifier: Apache-2.0
"""A hand led by the truth: what it cannot lift, no controller can. So faults of the physics show apart from others."""

import math

import numpy as np
from numpy.typing import ArrayLike

from grasptrack.geometry.homographies import rotation_about_z
from grasptrack.servo.camera import rotation_vector
from grasptrack.typing import Floats
from grasptrack_bench.physics import frames
from grasptrack_bench.physics.world import World

ABOVE = 0.05
"""m above the part at which the hand aligns before it goes down."""


def lift_by_truth(world: World, contacts: ArrayLike, *, timeout: float = 15.0) -> bool:
    """Align above true contacts, go down, close, lift; whether the part came up and stayed.

    Args:
        world: at its start.
        contacts: (k, 2) on the part's outline, in m, x right and y down; of three fingers evenly round their middle.
        timeout: s for the approach.
    """
    grasp = np.asarray(contacts, dtype=np.float64)
    width = 2.0 * float(np.hypot(*(grasp - grasp.mean(axis=0)).T).mean())
    end = world.time() + timeout
    for height, near in ((ABOVE, 0.003), (0.002, 0.0005)):
        while world.time() < end:
            twist, far = _twist_toward_grasp(world, grasp, world.setting.part.thickness + height)
            if far < near:
                break
            world.move(twist)
    return world.close(width) and world.lift()


def _twist_toward_grasp(world: World, grasp: Floats, height: float) -> tuple[Floats, float]:
    """The twist that leads to the goal, the table's own motion included, and how far that is in m (10 cm to a rad)."""
    part, hand = world.part_pose(), world.pose()
    places = np.array([part[:3, :3] @ np.array([x, -y, 0.0]) + part[:3, 3] for x, y in grasp])
    middle = places.mean(axis=0)
    last = places[-1] - middle
    middle[2] = height
    # azimuths are from x toward y of the hand, and its z is down
    way = math.atan2(last[1], last[0]) + world.hand.azimuths[-1]
    now, alike = math.atan2(hand[1, 0], hand[0, 0]), 2.0 * math.pi / world.hand.fingers
    way += alike * round((now - way) / alike)  # equal fingers change places
    R = rotation_about_z(way) @ frames.DOWN
    turn = rotation_vector(hand[:3, :3].T @ R)
    shift = hand[:3, :3].T @ (middle - hand[:3, 3])
    carried = hand[:3, :3].T @ np.array([*world.setting.belt, 0.0])
    twist = np.concatenate([_limit_norm(6.0 * shift, 0.3) + carried, _limit_norm(6.0 * turn, 1.5)])
    return twist, float(np.hypot(np.linalg.norm(shift), 0.1 * np.linalg.norm(turn)))


def _limit_norm(v: Floats, most: float) -> Floats:
    return v * min(1.0, most / max(1e-12, float(np.linalg.norm(v))))
